"""``mcstudy import``: a recording from a laboratory's files, checked and written for ``fit`` and ``gap diagnose``."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
        help=f"{accepted()}; one per trial, unless --map or --split says otherwise",
    )
    parser.add_argument(
        "-o", "--out", "--output", dest="output", type=Path, metavar="REC", help="recording to write (.nc or .zarr)"
    )
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
    what.add_argument("--upper-body", choices=("hip", "space"), help="what theta2 is in the files (default hip)")
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
    imported = import_files(args.files, args.map, options)
    written = None if args.output is None else write_recording(imported.recording, args.output)
    print(folded(imported.text()))  # nothing may be lost with a reader (head) that stops after some lines
    _print_doubts(imported.recording)
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
        upper_body=args.upper_body,
        resample_hz=args.resample,
        fill_gaps_s=args.fill_gaps,
        units=_given(angle=args.unit, stimulus=args.stimulus_unit, stated=args.stated_units),
        channels=_given(stimulus=args.stimulus, theta1=args.theta1, theta2=args.theta2, time=args.time),
        split=_given(by=args.split, starts=starts, length_s=args.length),
        text=_given(delimiter=args.delimiter, decimal=args.decimal, skip=args.skip),
        body=_given(height=args.height, weight=args.weight, sex=args.sex),
    )


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
