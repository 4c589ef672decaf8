"""``mcstudy fit``: parameters of the person in a recording, or of many people, with confidence intervals."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcstudy.cli.options import add_page_argument, add_scheduler_arguments, cluster_options, shown_command
from mcstudy.cli.recording_options import (
    add_model_argument,
    add_output_arguments,
    add_recording_arguments,
    read_recordings,
    tell,
    with_names,
)
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser
    from mcstudy.identification.conditions.settings import ConditionSettings
    from mcstudy.identification.settings import FitSettings

TOPIC = "parameters"


def add_arguments(parser: Parser) -> None:
    """Declare the arguments."""
    add_recording_arguments(parser, "*")
    add_model_argument(parser)
    parser.add_argument(
        "--with",
        dest="effects",
        action="append",
        default=[],
        metavar="EFFECT",
        help="add a linear effect to the model (`mcstudy gap effects` lists them); may be repeated",
    )
    averaged = parser.add_alternatives()
    averaged.add_argument(
        "--causes",
        action="store_true",
        default=None,
        help="average parameters over the causes of `mcstudy gap diagnose` (default: where there is a gap)",
    )
    averaged.add_argument(
        "--model-as-is", dest="causes", action="store_false", help="only the model without effects, even with a gap"
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
    parser.add_argument(
        "--level",
        type=float,
        default=0.95,
        help="level of the intervals (default 0.95); estimates under the paper's cost have none, because that cost is "
        "no likelihood",
    )
    parser.add_argument(
        "--conventions",
        action="store_true",
        help="also print the estimates that Peterka (2002, 2018) and Assländer (2023) would state",
    )
    _condition_arguments(parser)
    _group_arguments(parser)
    add_output_arguments(parser, "fit")
    add_page_argument(parser)


def _condition_arguments(parser: Parser) -> None:
    group = parser.add_group(
        "several conditions",
        "With one of these options each recording is a condition (as it states, or by the name of its file) of one "
        "person, and all are fitted at once. -o writes conditions.json and conditions.txt.",
    )
    group.add_argument(
        "--per",
        nargs="+",
        metavar=("condition", "NAMES"),
        help="parameters with a value in each condition, as in `--per condition Wp,Kp`; all others are shared. "
        "`--per condition` alone: the sensory weights",
    )
    group.add_argument(
        "--shared",
        metavar="NAMES",
        help="parameters that all conditions share, as in `--shared Kp,Kd`, or all; without --per all others have a "
        "value in each condition",
    )
    group.add_argument(
        "--conditions",
        type=Path,
        metavar="FILE",
        help="a .toml that lists the recordings of each condition, and what is shared, instead of REC",
    )
    group.add_argument("--details", action="store_true", help="also print all that is said of the fit of one recording")


def _group_arguments(parser: Parser) -> None:
    group = parser.add_group(
        "many people",
        "Without these options all recordings are of one person. With them each person is fitted, then "
        "the population: means, spread between people, differences between conditions. -o writes group.json and "
        "group.txt.",
    )
    group.add_argument(
        "--people",
        type=Path,
        metavar="TABLE",
        help="CSV file with the columns file (relative to it), person and condition; without REC all of its rows",
    )
    group.add_argument(
        "--group",
        metavar="COLUMN",
        help="compare what this column of TABLE says (default: condition, if there is one); without TABLE: person or "
        "condition, as the recordings say",
    )
    paired = group.add_alternatives()
    paired.add_argument("--paired", action="store_true", default=None, help="every person is in every condition")
    paired.add_argument(
        "--unpaired", dest="paired", action="store_false", help="people in different conditions are different people"
    )
    add_scheduler_arguments(group)


def main(args: argparse.Namespace) -> Exit:
    """Fit and print; returns the exit code."""
    from mcstudy.errors import InputError

    if args.people or args.group:
        if args.html:
            raise InputError("--html: expected recordings of one person, not --people or --group")
        return _group(args)
    if args.per or args.shared or args.conditions:
        return _conditions(args)
    return _one_person(args)


def _settings(args: argparse.Namespace) -> FitSettings:
    from mcstudy.identification.settings import FitSettings

    return FitSettings(causes=args.causes, **_given(args))


def _given(args: argparse.Namespace) -> dict[str, Any]:
    """What both kinds of fit are told."""
    return {
        "effects": args.effects,
        "quantities": args.quantity,
        "bounds": _all_bounds(args.bounds),
        "level": args.level,
        "fmax": args.fmax,
        "discard": args.discard,
        "accept": args.accept,
        "seed": args.seed,
    }


def _condition_settings(args: argparse.Namespace) -> ConditionSettings:
    from mcstudy.errors import InputError
    from mcstudy.identification.conditions.settings import ConditionSettings

    by, *per = args.per or ["condition"]
    if by != "condition":
        raise InputError(f"--per {by}: expected condition, then names of parameters")
    return ConditionSettings(per=",".join(per), shared=args.shared or (), **_given(args))


def _conditions(args: argparse.Namespace) -> Exit:
    from mcstudy.errors import InputError
    from mcstudy.identification.conditions.fit import fit_conditions, names_of
    from mcstudy.identification.conditions.settings import ConditionSettings
    from mcstudy.identification.conditions.sheet import ConditionsSheet
    from mcstudy.results.conditions import ConditionsResult
    from mcstudy.scheduler.activity import activity
    from mcstudy.scheduler.compiling import PERSON, compile_kernels
    from mcstudy.text_tables import folded

    if args.html:
        raise InputError("--html: expected a fit of one condition")
    if args.conditions:
        sheet = ConditionsSheet.read(args.conditions)
        read, names = sheet.recordings(args.conditions.parent, args.data)
        if args.recordings or args.per or args.shared:
            raise InputError(f"{args.conditions}: expected neither REC, --per nor --shared beside --conditions")
        settings = ConditionSettings(per=sheet.per, shared=sheet.shared, **_given(args))
    else:
        _require(args)
        settings, read = _condition_settings(args), read_recordings(args)
        names = names_of(read, args.recordings)
    compile_kernels(PERSON)
    with activity(f"{len(read)} recordings: fitting"), with_names(args):
        result = ConditionsResult.of(fit_conditions(read, settings, names))
    tell(args, "conditions", result.to_dict, lambda: folded(result.text(details=args.details)))
    return Exit.DONE


def _group(args: argparse.Namespace) -> Exit:
    from mcstudy.errors import InputError
    from mcstudy.identification.people.fits import fit_members
    from mcstudy.identification.people.members import Member, members, named, read_people, rows_of
    from mcstudy.recordings.columns import model_of
    from mcstudy.recordings.io import read_recording
    from mcstudy.results.group_result import GroupResult
    from mcstudy.scheduler.compiling import PERSON, compile_kernels
    from mcstudy.text_tables import folded

    if args.html:
        raise InputError("--html: expected a fit of one person")
    known: Sequence[Member[Any]]
    if args.people:
        rows = rows_of(read_people(args.people, args.group), args.recordings, args.people)
        known = members([r.file for r in rows], [r.person for r in rows], [r.condition for r in rows])
    else:
        _require(args)
        known = named(
            [read_recording(path, data=args.data, model=args.model) for path in args.recordings],
            args.recordings,
            args.group,
        )
    settings = _condition_settings(args) if args.per or args.shared else _settings(args)
    settings = replace(settings, model=model_of(args.model))
    options = cluster_options(args)
    if options.here:
        compile_kernels(PERSON)
    result = GroupResult.of(fit_members(known, settings, options, pair=args.paired, data=args.data))
    tell(args, "group", result.to_dict, lambda: folded(result.text()))
    return Exit.FITS_FAILED if result.failed else Exit.DONE


def _require(args: argparse.Namespace) -> None:
    from mcstudy.errors import InputError

    if not args.recordings:
        raise InputError("REC: expected at least one recording, or --people TABLE")


def _one_person(args: argparse.Namespace) -> Exit:
    from mcstudy.errors import InputError
    from mcstudy.identification.fit import fit
    from mcstudy.report.style import require_matplotlib
    from mcstudy.results.fit import FitResult
    from mcstudy.scheduler.activity import activity
    from mcstudy.scheduler.compiling import PERSON, compile_kernels
    from mcstudy.text_tables import folded

    _require(args)
    if args.paired is not None:
        raise InputError("--paired, --unpaired: expected together with --people or --group")
    if args.html:
        require_matplotlib()
    settings = _settings(args)
    read = read_recordings(args)
    compile_kernels(PERSON)
    with activity(f"{args.recordings[0]}: fitting"), with_names(args):
        result = FitResult.of(fit(read, settings))
    if args.html:
        from mcstudy.report.document import write_page
        from mcstudy.report.person.page import fit_page

        write_page(args.html, lambda: fit_page(result, shown_command(args)))
    tables = [result.conventions().text(titled=True)] if args.conventions else []
    tell(args, "fit", result.to_dict, lambda: folded("\n\n".join([result.text(), *tables])))
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
