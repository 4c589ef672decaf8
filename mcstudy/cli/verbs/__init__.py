"""The verbs of the command line: those of this package, and those that other packages add.

A verb is a module with ``add_arguments(parser)`` and ``main(args)``, imported only when the verb is used; its ``TOPIC``
is the page that `mcstudy help VERB` prints too. Those of this package are listed in `VERBS`, and in `RESUMED`. Another
package names its module in the entry point group ``mcstudy.commands``, by the words that call it: ``infer``, or
``gap challenge`` for a verb below a verb. Such a module also states ``HELP`` (one line) and, where they apply,
``RESUMABLE`` (words of the verbs below it that continue from where they were stopped, "" for itself) and ``SHIPPED``
(words and argument that take the name of a shipped file, and its kind).
"""

from __future__ import annotations

TYPE_CHECKING = False  # as in `mcstudy`: nothing is imported before signals are caught
if TYPE_CHECKING:
    from typing import Any

GROUP = "mcstudy.commands"

VERBS = {
    "studies": "list the studies that come with mcstudy, each with what it answers",
    "models": "list the models that a study may name, print one as TOML, or check one",
    "run": "run a study file into a results cube, or resume it",
    "plan": "predict run time, size and precision of a study before running it",
    "status": "show the progress of a results cube",
    "extend": "add realizations, starts, Fmax values or amplitudes to a results cube; only new cells are run",
    "replay": "repeat one stored fit, print every iteration, and compare the result with the stored one",
    "verify": "check every chunk of a results cube and recompute a sample of fits",
    "show": "print what a results cube says: the first screen, or all tables",
    "performance": "print bias, errors and coverage of estimates that any program made",
    "report": "write one HTML page with tables and figures of a results cube",
    "figure": "draw one figure of a results cube for a paper or a talk, or write its numbers",
    "simulate": "simulate a recording of a standing body, optionally with effects that the model lacks",
    "import": "read a recording from a laboratory's files (MATLAB, C3D, text), check it and write it for fit and gap",
    "fit": "estimate the parameters of the person in a recording, with confidence intervals",
    "study-from": "write a study of the experiment in which a person was recorded",
    "design": "design the stimulus that identifies the parameters best, and verify it by Monte Carlo",
    "solve": "find the cheapest design (cycles, amplitude, Fmax, realizations) that reaches a target",
    "gap": "diagnose the mismatch between model and recording: where it is, and which missing effect explains it",
    "warm": "compile the kernels ahead of the first run",
    "help": "print a page of the documentation: mcstudy help gap",
    "completion": "print a script for completion in bash, zsh or fish",
}
"""Verbs of this package and their one-line help; ``x-y`` lives in ``mcstudy.cli.verbs.x_y``."""

SHORT = {
    "diagnose": "find where the model fails a recording, and which missing effect explains it (gap diagnose)",
    "compare": "find what differs between two groups of people (gap compare)",
    "next": "rank possible next trials by what they would tell of the cause (gap next)",
}
"""Verbs below ``gap`` that are also called without it, and their one-line help."""

RESUMED = ("run", "extend", "design")
"""Those that continue from where they were stopped when they are given again."""

_added: dict[str, Any] = {}


def added() -> dict[str, Any]:
    """Modules of the commands of other packages by the words that call them."""
    if not _added:
        from importlib.metadata import entry_points

        _added.update((point.name, point.load()) for point in sorted(entry_points(group=GROUP)))
    return _added


def below(verb: str) -> dict[str, Any]:
    """Modules of the commands that other packages add below a verb, by their last word."""
    return {name.partition(" ")[2]: module for name, module in added().items() if name.startswith(f"{verb} ")}


def verbs() -> dict[str, str]:
    """Every verb and its one-line help."""
    return VERBS | {name: module.HELP for name, module in added().items() if " " not in name}


def module(verb: str) -> Any:
    """The module of a verb."""
    import importlib

    return importlib.import_module(f"{__name__}.{verb.replace('-', '_')}") if verb in VERBS else added()[verb]


def listed() -> dict[str, str]:
    """The verbs as the help lists them: those of one experiment, of one recording, and the others."""
    every = verbs() | SHORT
    first = ("run", "show", "report", "figure", "import", "fit", *SHORT, "design", "solve")
    return {name: every[name] for name in (*first, *(name for name in every if name not in first))}


def is_verb(word: str) -> bool:
    """Whether a word is a verb."""
    return word in VERBS or word in verbs()


def resumable(words: tuple[str, ...]) -> bool:
    """Whether a command continues from where it was stopped when it is given again."""
    if words[:1] and words[0] in RESUMED:
        return True
    try:
        commands = added()  # not loaded yet where a command is stopped at once
    except (ImportError, OSError, MemoryError):  # there is no memory left, or no file can be opened
        commands = _added
    return any(
        words[: len(call)] == call
        for name, command in commands.items()
        for call in (tuple(f"{name} {verb}".split()) for verb in getattr(command, "RESUMABLE", ()))
    )
