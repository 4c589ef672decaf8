"""The command line: one module a verb, imported only when the verb is used, so that help is immediate."""

from __future__ import annotations

import argparse
import importlib
import os
import shlex
import sys
from collections.abc import Sequence

from mcstudy.errors import InputError, Interrupted

DONE, BAD_INPUT, INTERRUPTED, FITS_FAILED = 0, 2, 3, 4
"""Exit codes: done, bad input, interrupted and resumable, some fits failed."""

VERBS = {
    "run": "run a study file into a results cube, or resume it",
    "plan": "what a study will cost and how precise it will be, before running it",
    "status": "how far a results cube is",
    "extend": "grow a results cube; only the new cells are run",
    "replay": "run one stored fit again, iteration by iteration, and compare it with what is stored",
    "verify": "check every chunk of a results cube, and recompute a sample",
    "show": "print the tables of a results cube",
    "report": "write a results cube as one page with figures",
    "simulate": "write a recording of a simulated body, with any effects",
    "gap": "where a model fails on a recording, which effect is missing, how far adding it closes the gap",
}
"""Verbs and their one-line help; verb ``x`` lives in ``mcstudy.cli.x`` (``add_arguments(parser)``, ``main(args)``)."""

EPILOG = (
    "exit codes: 0 done; 2 bad input (one line: file, field, what was expected); "
    "3 interrupted, the same command resumes; 4 some fits failed (listed)"
)

RESUMES = "run the same command again to resume"
"""How a message of what can be resumed ends; the command itself is printed behind it."""

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""Variables that are set to 1 unless the user has set them."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="mcstudy",
        description="Monte Carlo studies of parameter identification in human balance.",
        epilog=EPILOG,
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB")
    for verb, text in VERBS.items():
        verbs.add_parser(verb, help=text, add_help=False)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words[:1] and words[0] in VERBS:
        return _run(words[0], words[1:])
    parser = _parser()
    args = parser.parse_args(words)
    if args.version:
        from mcstudy import __version__

        print(f"mcstudy {__version__}")
        return DONE
    parser.print_help()
    return DONE if not words else BAD_INPUT


def _run(verb: str, words: Sequence[str]) -> int:
    # One thread for linear algebra, set before numpy is imported: parallel work is by fits, and sums that are split
    # differently on another machine would give other last digits.
    for variable in ONE_THREAD:
        os.environ.setdefault(variable, "1")
    try:
        module = importlib.import_module(f"mcstudy.cli.{verb}")
        parser = argparse.ArgumentParser(prog=f"mcstudy {verb}", description=VERBS[verb], epilog=EPILOG)
        module.add_arguments(parser)
        return int(module.main(parser.parse_args(words)))
    except InputError as error:
        print(f"mcstudy: {_one_line(error)}", file=sys.stderr)
        return BAD_INPUT
    except (Interrupted, KeyboardInterrupt) as error:
        message = _one_line(error) if isinstance(error, Interrupted) else f"stopped; {RESUMES}"
        again = f": {shlex.join(['mcstudy', verb, *words])}" if message.endswith(RESUMES) else ""
        print(f"mcstudy: {message}{again}", file=sys.stderr, flush=True)
        # Threads that are still computing have nothing to add: whatever they write is whole or absent.
        sys.stdout.flush()
        os._exit(INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output (head, less) has seen enough.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())
