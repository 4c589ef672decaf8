"""``mcstudy import``: a recording from a laboratory's files, checked and written for ``fit`` and ``gap diagnose``."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcstudy.cli.options import add_out_argument
from mcstudy.exits import Exit
from mcstudy.recordings.formats import accepted

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser
    from mcstudy.recordings.recording import Recording

TOPIC = "recordings"


def add_arguments(parser: Parser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "files",
        nargs="*",
        metavar="FILE",
        help=f"{accepted()}; one per trial, unless --map or --split says otherwise; or a folder of people",
    )
    add_out_argument(parser, "REC", "recording to write (.nc or .zarr)", dest="output")
    parser.add_argument(
        "--map",
        type=Path,
        metavar="TOML",
        help="description of the files (`mcstudy help recordings`); options override it",
    )
    parser.add_argument("--list", action="store_true", help="list the variables in each FILE and exit")
    what = parser.add_group("which variable is which")
    for name, meaning in {
        "stimulus": "stimulus",
        "theta1": "angle of the lower body in space",
        "theta2": "hip angle, or angle of the upper body in space (--upper-body)",
        "time": "time, if the file has it",
    }.items():
        what.add_argument(f"--{name}", metavar="VARIABLE", help=meaning)
    what.add_argument(
        "--model", metavar="NAME|FILE", help="declared model whose outputs are read (default: two angles)"
    )
    what.add_argument(
        "--channel",
        action="append",
        default=[],
        metavar="NAME=VARIABLE",
        help="variable of an output of that model, e.g. sway=COM; may be repeated",
    )
    what.add_argument("--upper-body", choices=("hip", "space"), help="what theta2 is in the files (default hip)")
    _add_sway(parser)
    units = parser.add_group("units and rates")
    units.add_argument("--unit", metavar="UNIT", help="of the angles: deg, rad, mrad")
    units.add_argument("--stimulus-unit", metavar="UNIT", help="of the stimulus: N m, N mm, kgf m; m, cm, mm; deg, rad")
    units.add_argument(
        "--stated-units",
        choices=("checked", "ignored"),
        help="whether units that the file states must agree with those declared here (default checked)",
    )
    units.add_argument(
        "--kind", help="ankle_torque (default), hip_torque, platform_translation, surface_tilt or visual_tilt"
    )
    units.add_argument(
        "--rate",
        type=float,
        metavar="HZ",
        help="samples per second: where the file does not state it, or its time stamps are not regular",
    )
    units.add_argument("--period", type=float, metavar="S", help="period of the stimulus")
    units.add_argument(
        "--resample",
        type=float,
        metavar="HZ",
        help="common rate (default: the lowest of the channels'); time stamps that are not regular are followed",
    )
    units.add_argument(
        "--fill-gaps",
        type=float,
        metavar="S",
        help="longest gap of missing values or lost rows that is interpolated (default: none)",
    )
    trials = parser.add_group("several trials in one file")
    trials.add_argument(
        "--split", choices=("columns", "rows", "elements"), help="trials are columns or rows of matrices, or elements"
    )
    trials.add_argument("--starts", type=float, nargs="+", metavar="S", help="times at which trials start")
    trials.add_argument("--starts-in", metavar="VARIABLE", help="variable that holds these times, in s")
    trials.add_argument("--above", type=float, help="trials start where that variable rises above this level")
    trials.add_argument("--length", type=float, metavar="S", help="duration of a trial (default: to the next start)")
    text = parser.add_group("text files")
    text.add_argument("--delimiter", help="comma, semicolon, tab, blank or a character (default: found)")
    text.add_argument("--decimal", choices=(".", ","), help="decimal sign (default: found)")
    text.add_argument("--skip", type=int, metavar="N", help="lines above the header (default: found)")
    person = parser.add_group("the person")
    person.add_argument("--height", type=float, metavar="M", help="body height, m")
    person.add_argument("--weight", type=float, metavar="KG", help="body mass, kg")
    person.add_argument("--sex", choices=("female", "male"), help="chooses de Leva's table; without it Winter's")
    person.add_argument("--name", help="name of the recording")
    people = parser.add_group(
        "a folder of people",
        "FILE is a folder with metadata.xlsx (or .csv): Subject ID, body_height_m, body_weight_kg and a column per "
        "condition (c1: ...) with the number of the trial; quality_flags.csv; and the trials, ..SUBJECT_t3.csv, below "
        "it. REC is then a folder of recordings with people.csv, for fit --people.",
    )
    people.add_argument(
        "--conditions", nargs="+", default=[], metavar="C", help="only these, e.g. c1 c3 (default: all)"
    )
    people.add_argument(
        "--quality",
        choices=("usable", "good"),
        default="usable",
        help="flags that are used: 0 and 1 (usable, default), or without 1, the doubtful ones (good)",
    )


def _add_sway(parser: Parser) -> None:
    sway = parser.add_group(
        "one sway angle",
        "With --model sensorimotor_integration, or another model of one angle whose output is called sway.",
    )
    sway.add_argument("--sway", metavar="VARIABLE", help="the angle, or a displacement of which it is made")
    sway.add_argument("--sway-unit", metavar="UNIT", help="of a displacement: m, cm, mm (default: as the file states)")
    sway.add_argument("--sway-of", choices=("com", "cop"), help="displacement of the centre of mass, or of pressure")
    sway.add_argument("--sway-height", type=float, metavar="M", help="height of the displacement above the ankle, m")
    sway.add_argument("--hip-rod", metavar="VARIABLE", help="displacement of the hip, with --shoulder-rod")
    sway.add_argument("--shoulder-rod", metavar="VARIABLE", help="displacement of the shoulder")
    sway.add_argument(
        "--hip-height", type=float, metavar="M", help="of the rod above the floor (default: by the table)"
    )
    sway.add_argument("--shoulder-height", type=float, metavar="M", help="the same at the shoulder")


def main(args: argparse.Namespace) -> Exit:
    """Read, check, print and write; returns the exit code."""
    from mcstudy.errors import InputError
    from mcstudy.recordings.io import write_recording
    from mcstudy.recordings.laboratory_import import import_files, listing
    from mcstudy.recordings.sheets.recording_sheet import Sheet
    from mcstudy.recordings.sheets.tables import described
    from mcstudy.text_tables import escaped, folded

    options = _options(args)
    if args.list:
        if not args.files:
            raise InputError("--list: expected a FILE")
        dialect = described(Sheet, {"text": options.get("text", {})}, "import").text.dialect()
        print("\n\n".join(listing(file, dialect) for file in args.files))
        return Exit.DONE
    if not args.files and args.map is None:
        raise InputError("import: expected a FILE, or --map with trials")
    if args.starts and args.starts_in:
        raise InputError("--starts: expected either times or --starts-in, got both")
    if args.above is not None and not args.starts_in:
        raise InputError("--above: expected together with --starts-in")
    if len(args.files) == 1 and Path(args.files[0]).is_dir():
        return _people(args, options)
    imported = import_files(args.files, args.map, options)
    written = None if args.output is None else write_recording(imported.recording, args.output)
    print(folded(imported.text()))  # nothing may be lost with a reader (head) that stops after some lines
    _print_doubts(imported.recording)
    print("nothing written (no -o)" if written is None else f"written: {escaped(str(written))}")
    return Exit.DONE


def _people(args: argparse.Namespace, options: dict[str, Any]) -> Exit:
    """Import a folder of people, print what was found, and write recordings and their table."""
    from mcstudy.recordings.people_folder import import_people, told, write_people
    from mcstudy.text_tables import escaped, folded

    found = import_people(Path(args.files[0]), args.map, options, args.conditions, args.quality == "usable")
    written = None if args.output is None else write_people(found, args.output)
    print(folded(told(found)))
    print("nothing written (no -o)" if written is None else f"written: {escaped(str(written))}")
    return Exit.DONE


def _options(args: argparse.Namespace) -> dict[str, Any]:
    """The options as fields of a description."""
    starts: Any = args.starts
    if args.starts_in:
        starts = _given(column=args.starts_in, above=args.above)
    return _given(
        name=args.name,
        rate_hz=args.rate,
        period_s=args.period,
        stimulus=args.kind,
        model=args.model,
        upper_body=args.upper_body,
        resample_hz=args.resample,
        fill_gaps_s=args.fill_gaps,
        units=_given(angle=args.unit, stimulus=args.stimulus_unit, stated=args.stated_units),
        channels=_channels(args),
        markers=_rods(args),
        split=_given(by=args.split, starts=starts, length_s=args.length),
        text=_given(delimiter=args.delimiter, decimal=args.decimal, skip=args.skip),
        body=_given(height=args.height, weight=args.weight, sex=args.sex),
    )


def _channels(args: argparse.Namespace) -> dict[str, Any]:
    """Which variable is which."""
    from mcstudy.errors import InputError

    outputs = {}
    for text in args.channel:
        name, sign, variable = text.partition("=")
        if not (name and sign and variable):
            raise InputError(f"--channel: expected NAME=VARIABLE, got {text!r}")
        outputs[name] = variable
    sway = _given(column=args.sway, unit=args.sway_unit, of=args.sway_of, height=args.sway_height)
    if sway and not args.sway:
        raise InputError("--sway-unit, --sway-of, --sway-height: expected together with --sway")
    one = {"stimulus": args.stimulus, "theta1": args.theta1, "theta2": args.theta2, "time": args.time, "sway": sway}
    return _given(**one, **outputs)


def _rods(args: argparse.Namespace) -> dict[str, Any]:
    """Sway rods as markers with one coordinate."""
    from mcstudy.errors import InputError

    places = {"hip": args.hip_rod, "shoulder": args.shoulder_rod}
    heights = _given(hip=args.hip_height, shoulder=args.shoulder_height)
    if not all(places.values()):
        if any(places.values()) or heights:
            raise InputError("--hip-rod, --shoulder-rod: expected both of them")
        return {}
    rods = {place: [variable] for place, variable in places.items()}
    return {**rods, "columns": "{marker}", **_given(unit=args.sway_unit, heights=heights)}


def _given(**fields: Any) -> dict[str, Any]:
    return {k: v for k, v in fields.items() if v is not None and not (isinstance(v, Mapping) and not v)}


def _print_doubts(recording: Recording) -> None:
    """What the responses say against the labels; `fit` and `gap` refuse such a recording, the import only says so."""
    from mcstudy.errors import RecordingError
    from mcstudy.lines.checked_recording import checked_recording

    try:
        checked = checked_recording(recording).recording
    except RecordingError as error:
        print(f"doubtful: {error}")
        return
    for suspicion in getattr(checked, "suspicions", ()):
        if suspicion not in recording.suspicions:
            print(f"doubtful: {suspicion.message}")
