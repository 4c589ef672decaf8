"""``mcstudy gap``: diagnose the mismatch between model and recording."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcstudy.cli.options import add_figure_argument, add_out_argument, add_page_argument, shown_command
from mcstudy.cli.recording_options import (
    add_output_arguments,
    add_recording_arguments,
    read_recordings,
    tell,
    with_names,
)
from mcstudy.cli.verbs import below
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser
    from mcstudy.gap.diagnosis import DiagnosisRecord
    from mcstudy.gap.settings import DiagnosisSettings

TOPIC = "diagnosis"

VERBS = {
    "effects": "list the effects that a model may lack, with equations, usual sizes and their sources",
    "diagnose": "diagnose one recording, or several of the same person",
    "report": "diagnose, and write the result as one HTML page with figures",
    "compare": "compare two groups of people: what differs, where, and which parameter changed",
    "next": "rank possible next trials by how much they would reveal about the cause",
}
"""Verbs below this one, and their one-line help."""


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb and of its sub-verbs."""
    added = below("gap")
    named = VERBS | {name: command.HELP for name, command in added.items()}
    effects, diagnose, report, compare, planned, *others = parser.add_verbs("gap", named)
    effects.add_argument(
        "--model", metavar="NAME|FILE", help="those of a declared model (`mcstudy models`, or a .toml)"
    )
    effects.set_defaults(run=_effects)
    add_output_arguments(diagnose, "diagnosis")
    add_page_argument(diagnose, "also write the page of gap report")
    diagnose.set_defaults(run=_diagnose)
    add_out_argument(report, "PAGE", "page to write; default REC.html", dest="output")
    report.add_argument("--next", action="store_true", help="also rank possible next trials (see gap next)")
    report.set_defaults(run=_report)
    for verb in (diagnose, report):
        add_recording_arguments(verb)
        _add_prior(verb)
        verb.add_argument("--fast", action="store_true", help="asymptotic statistics instead of the bootstrap")
        verb.add_argument("--bootstrap", type=int, metavar="N", help="number of bootstrap samples (default 1000)")
    _compare_arguments(compare)
    _next_arguments(planned)
    for command, verb in zip(added.values(), others, strict=True):
        command.add_arguments(verb)


def _add_prior(verb: Parser) -> None:
    verb.add_argument(
        "--prior-none",
        type=float,
        metavar="P",
        help="prior probability that no effect is missing (default 0.3); all others keep their ratios",
    )


def _compare_arguments(compare: Parser) -> None:
    compare.add_argument(
        "group",
        nargs="+",
        type=Path,
        metavar="A",
        help="first group: a description of FRFs (.toml with frf_group), or recordings, one for each person",
    )
    compare.add_argument(
        "--with",
        dest="other",
        nargs="+",
        type=Path,
        default=[],
        metavar="B",
        help="second group, in the same form; left out for two conditions of one description",
    )
    compare.add_argument(
        "--condition", metavar="NAME", help="condition of the first group, of several in its description"
    )
    compare.add_argument("--with-condition", metavar="NAME", help="condition of the second group")
    pairing = compare.add_alternatives()
    pairing.add_argument(
        "--paired", action="store_true", default=None, help="treat recordings with the same person name as paired"
    )
    pairing.add_argument("--unpaired", dest="paired", action="store_false", help="treat all people as independent")
    compare.add_argument("--permutations", type=int, default=999, metavar="N", help="relabellings of the tests (999)")
    add_figure_argument(compare, "both groups")
    compare.add_argument("--seed", type=int, default=0, help="random seed (default 0)")
    compare.add_argument("--fmax", type=float, metavar="HZ", help="highest frequency of recordings (default 8)")
    compare.add_argument(
        "--data", type=Path, metavar="DIR", help="folder of the data files named in a .toml (default: its own)"
    )
    add_output_arguments(compare, "comparison")
    compare.set_defaults(run=_compare)


def _next_arguments(parser: Parser) -> None:
    add_output_arguments(parser, "next_trial")
    add_recording_arguments(parser)
    _add_prior(parser)
    parser.add_argument(
        "--kind",
        action="append",
        default=[],
        metavar="KIND",
        help="kind of stimulus to consider (default: ankle_torque, hip_torque, platform_translation and those of REC); "
        "may be repeated",
    )
    parser.add_argument(
        "--amplitude",
        action="append",
        default=[],
        metavar="KIND=PEAK",
        help="amplitude to consider, in N m, m or rad (default: as recorded, or with no more sway than was recorded); "
        "may be repeated",
    )
    parser.add_argument(
        "--trials", action="append", type=int, default=[], metavar="N", help="number of trials (default 1 and 2)"
    )
    parser.add_argument("--cycles", type=int, default=6, metavar="N", help="periods of a trial (default 6)")
    add_figure_argument(parser, "which effects look alike before and after it")
    add_page_argument(parser, "also write a self-contained page with this figure")
    parser.set_defaults(run=_next)


def main(args: argparse.Namespace) -> Exit:
    """Run the sub-verb; returns the exit code."""
    code: Exit = args.run(args)
    return code


def _effects(args: argparse.Namespace) -> Exit:
    from mcstudy.effect_library.library import LIBRARY, library_of, table_text
    from mcstudy.recordings.columns import model_of

    model = model_of(args.model)
    print(table_text(LIBRARY if model is None else library_of(model)))
    return Exit.DONE


def _settings(args: argparse.Namespace, **further: Any) -> DiagnosisSettings:
    from mcstudy.gap.settings import DiagnosisSettings

    if args.prior_none is not None:
        further["prior_none"] = args.prior_none
    return DiagnosisSettings(seed=args.seed, fmax=args.fmax, discard=args.discard, accept=args.accept, **further)


def _diagnosed(args: argparse.Namespace, settings: DiagnosisSettings) -> DiagnosisRecord:
    """The diagnosis of the recordings; errors about them begin with the names of their files."""
    read = read_recordings(args)
    from mcstudy.gap.diagnose import diagnose  # slow to import; report a bad file first
    from mcstudy.scheduler.compiling import DIAGNOSIS, compile_kernels

    compile_kernels(DIAGNOSIS)
    with with_names(args):
        return diagnose(read, settings)


def _diagnose(args: argparse.Namespace) -> Exit:
    from mcstudy.gap.document import document
    from mcstudy.gap.tables import text
    from mcstudy.gap.verdict import wrapped
    from mcstudy.scheduler.activity import activity

    if args.html is not None:
        from mcstudy.report.style import require_matplotlib

        require_matplotlib()
    settings = _settings(args, fast=args.fast, bootstrap=args.bootstrap)
    with activity(f"{args.recordings[0]}: diagnosing"):
        diagnosis = _diagnosed(args, settings)
    if args.html is not None:
        from mcstudy.report.document import write_page

        write_page(args.html, lambda: _page(args, diagnosis, args.html))
    tell(args, "diagnosis", lambda: document(diagnosis), lambda: f"{wrapped(diagnosis)}\n\n{text(diagnosis)}")
    return Exit.DONE


def _page(args: argparse.Namespace, diagnosis: DiagnosisRecord, output: Path, planned: Any = None) -> str:
    """The page of a diagnosis, with the command that writes it alone."""
    from mcstudy.report.diagnosis.page import gap_page

    words = args.parser.command(args, without=("out", "json", "html", "output"))
    return gap_page(diagnosis, shlex.join(["mcstudy", "gap", "report", *words[3:], "-o", str(output)]), planned)


def _next(args: argparse.Namespace) -> Exit:
    from mcstudy.cli.figure_file import check_figure, write_figure
    from mcstudy.errors import InputError
    from mcstudy.gap.settings import CAUSE_ONLY
    from mcstudy.gap.trial_planning.choice import TRIALS, require_possible
    from mcstudy.gap.trial_planning.next_trial import next_trial
    from mcstudy.gap.trial_planning.recommendation import text
    from mcstudy.scheduler.activity import activity, doing

    amplitudes: dict[str, list[float]] = {}
    for given in args.amplitude:
        kind, _, value = given.partition("=")
        try:
            amplitudes.setdefault(kind, []).append(float(value))
        except ValueError:
            raise InputError(f"--amplitude: expected KIND=PEAK, e.g. hip_torque=2, got {given!r}") from None
    trials = args.trials or TRIALS
    require_possible(args.kind, amplitudes, trials=trials, cycles=args.cycles)
    check_figure(args.figure, args.html)
    with activity(f"{args.recordings[0]}: diagnosing"):
        d = _diagnosed(args, _settings(args, fast=True, asked=CAUSE_ONLY))
        doing(f"{args.recordings[0]}: simulating possible next trials")
        with with_names(args):
            found = next_trial(d, args.kind, amplitudes, trials=trials, cycles=args.cycles, seed=args.seed)
    if args.figure:
        from mcstudy.report.diagnosis.next_trial import twin_picture

        write_figure(twin_picture(found), args.figure)
    if args.html is not None:
        from mcstudy.report.document import write_page
        from mcstudy.report.next_page import next_page

        write_page(args.html, lambda: next_page(found, shown_command(args)))
    tell(args, "next_trial", found.to_dict, lambda: text(found))
    return Exit.DONE


def _report(args: argparse.Namespace) -> Exit:
    from mcstudy.cli.verbs.report import write_and_tell
    from mcstudy.report.document import page_of
    from mcstudy.report.style import require_matplotlib

    require_matplotlib()
    output = args.output or page_of(args.recordings[0])

    settings = _settings(args, fast=args.fast, bootstrap=args.bootstrap)

    def text() -> str:
        from mcstudy.gap.trial_planning.next_trial import next_trial

        diagnosis = _diagnosed(args, settings)
        return _page(args, diagnosis, output, next_trial(diagnosis, seed=args.seed) if args.next else None)

    return write_and_tell(output, text)


def _compare(args: argparse.Namespace) -> Exit:
    from mcstudy.api.compare import compare
    from mcstudy.cli.figure_file import check_figure, write_figure
    from mcstudy.cli.groups import groups_of
    from mcstudy.scheduler.activity import activity

    check_figure(args.figure)
    with activity(f"{args.group[0]}: comparing"):
        (a, name_a), (b, name_b) = groups_of(args)
        found = compare(
            a,
            b,
            paired=args.paired,
            names=(name_a, name_b),
            permutations=args.permutations,
            fmax=args.fmax,
            seed=args.seed,
        )
    tell(args, "comparison", found.to_dict, found.text)
    if args.figure:
        write_figure(found.plot(), args.figure)
    return Exit.DONE
