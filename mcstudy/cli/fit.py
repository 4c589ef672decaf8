"""``mcstudy fit``: parameters of the person in a recording, with confidence intervals."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.recording_options import (
    add_output_arguments,
    add_recording_arguments,
    read_recordings,
    tell,
    with_names,
)
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.identification.result import FitResult


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_recording_arguments(parser)
    parser.add_argument(
        "--with",
        dest="effects",
        action="append",
        default=[],
        metavar="EFFECT",
        help="add a linear effect to the model (`mcstudy gap effects` lists them); may be repeated",
    )
    parser.add_argument(
        "--quantity",
        action="append",
        default=[],
        metavar="EXPRESSION",
        help="a further quantity, e.g. 'K11 + Kpas1 - 490'; may be repeated",
    )
    parser.add_argument(
        "--bounds",
        action="append",
        default=[],
        metavar="NAME=LOW:HIGH",
        help="bounds of a parameter (default: gains 0 to 5 times typical values, delays 0.01:0.3 s); may be repeated",
    )
    parser.add_argument("--level", type=float, default=0.95, help="level of the intervals (default 0.95)")
    add_output_arguments(parser, "fit")
    parser.add_argument("--html", type=Path, metavar="PAGE", help="also write a self-contained page with all figures")


def main(args: argparse.Namespace) -> Exit:
    """Fit and print; returns the exit code."""
    from mcstudy.identification.fit import fit
    from mcstudy.report.style import require_matplotlib
    from mcstudy.scheduler.activity import activity
    from mcstudy.scheduler.compiling import DIAGNOSIS, compile_kernels
    from mcstudy.text_tables import folded

    if args.html:
        require_matplotlib()
    bounds = dict(_bounds(given) for given in args.bounds)
    read = read_recordings(args)
    compile_kernels(DIAGNOSIS)
    with activity(f"{args.recordings[0]}: fitting"), with_names(args):
        result = fit(
            read,
            effects=args.effects,
            wanted=args.quantity,
            bounds=bounds,
            level=args.level,
            fmax=args.fmax,
            discard=args.discard,
            accept=args.accept,
            seed=args.seed,
        )
    if args.html:
        _write_page(args, result)
    tell(args, "fit", result.to_dict, lambda: folded(result.text()))
    return Exit.DONE


def _write_page(args: argparse.Namespace, result: FitResult) -> None:
    from mcstudy.report.document import write_page
    from mcstudy.report.person.page import fit_page

    repeated = [
        *(w for e in args.effects for w in ("--with", e)),
        *(w for q in args.quantity for w in ("--quantity", q)),
        *(w for b in args.bounds for w in ("--bounds", b)),
        *(w for code in args.accept for w in ("--accept", code)),
    ]
    for name, default in (("level", 0.95), ("seed", 0), ("fmax", 8.0), ("discard", 1), ("data", None)):
        if getattr(args, name) != default:
            repeated += [f"--{name}", str(getattr(args, name))]
    command = shlex.join(["mcstudy", "fit", *map(str, args.recordings), *repeated, "--html", str(args.html)])
    write_page(args.html, lambda: fit_page(result, command))


def _bounds(given: str) -> tuple[str, tuple[float, float]]:
    from mcstudy.errors import InputError

    name, _, values = given.partition("=")
    try:
        low, high = map(float, values.split(":"))
    except ValueError:
        raise InputError(f"--bounds {given}: expected NAME=LOW:HIGH, e.g. Kpas1=0:600") from None
    return name.strip(), (low, high)
