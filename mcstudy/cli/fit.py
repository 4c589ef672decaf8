"""``mcstudy fit``: parameters of the person in a recording, with confidence intervals."""

from __future__ import annotations

import argparse

from mcstudy.cli.recording_options import (
    add_output_arguments,
    add_recording_arguments,
    read_recordings,
    tell,
    with_names,
)
from mcstudy.exits import Exit


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


def main(args: argparse.Namespace) -> Exit:
    """Fit and print; returns the exit code."""
    from mcstudy.identification.fit import fit
    from mcstudy.scheduler.activity import activity
    from mcstudy.scheduler.compiling import DIAGNOSIS, compile_kernels
    from mcstudy.text_tables import folded

    bounds = _all_bounds(args.bounds)
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
    tell(args, "fit", result.to_dict, lambda: folded(result.text()))
    return Exit.DONE


def _all_bounds(given: list[str]) -> dict[str, tuple[float, float]]:
    from mcstudy.errors import InputError

    bounds: dict[str, tuple[float, float]] = {}
    for words in given:
        name, ends = _bounds(words)
        if name in bounds:
            raise InputError(f"--bounds {words}: expected one pair of bounds for {name}, got two")
        bounds[name] = ends
    return bounds


def _bounds(given: str) -> tuple[str, tuple[float, float]]:
    from mcstudy.errors import InputError

    name, _, values = given.partition("=")
    try:
        low, high = map(float, values.split(":"))
    except ValueError:
        raise InputError(f"--bounds {given}: expected NAME=LOW:HIGH, e.g. Kpas1=0:600") from None
    return name.strip(), (low, high)
