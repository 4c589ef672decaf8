"""Text files as ordinary programs write them: what they hold is read, or one line says what to do."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from mcstudy.errors import RecordingError
from mcstudy.recordings.formats import open_source
from mcstudy.recordings.formats.text_layout import Dialect
from mcstudy.recordings.laboratory_import import Imported, import_files, listing
from mcstudy.recordings.units import at_end, factor, kind_of

RATE, N = 100.0, 400

BODY = {"reference": "goodworth2018"}

TIME = np.arange(N) / RATE
TORQUE = 5 * np.sin(2 * np.pi * 0.5 * TIME) + np.sin(2 * np.pi * 3 * TIME)
LEG = 0.8 * np.sin(2 * np.pi * 0.5 * TIME - 1)
HIP = 1.3 * np.sin(2 * np.pi * 0.75 * TIME)
NAMES = ("time", "stimulus", "theta1", "theta2")
DEG = np.pi / 180


def frame() -> pd.DataFrame:
    return pd.DataFrame(dict(zip(NAMES, (TIME, TORQUE, LEG, HIP), strict=True)))


def lines(delimiter: str = ",", header: str = "", decimal: str = ".", ending: str = "", names: bool = True) -> str:
    """The recording with nine digits; ``header`` are lines above the names, ``ending`` stands behind every row."""
    rows = [delimiter.join(f"{v:.9g}".replace(".", decimal) for v in row) + ending for row in frame().to_numpy()]
    return "\n".join([*([header] if header else []), *([delimiter.join(NAMES)] if names else []), *rows]) + "\n"


def saved(**options: Any) -> str:
    file = io.StringIO()
    np.savetxt(file, frame().to_numpy(), fmt="%.9g", **options)
    return file.getvalue()


def quoted(quoting: int) -> str:
    file = io.StringIO()
    frame().to_csv(file, index=False, quoting=quoting, float_format="%.9g")
    return file.getvalue()


def r_table(delimiter: str, corner: bool) -> str:
    """R's write.csv names the column of row names "", its write.table does not name it at all."""
    names = ([""] if corner else []) + list(NAMES)
    rows = [delimiter.join([f'"{k}"', *(f"{v:.9g}" for v in row)]) for k, row in enumerate(frame().to_numpy(), start=1)]
    return "\n".join([delimiter.join(f'"{n}"' for n in names), *rows]) + "\n"


def with_columns(**columns: Any) -> str:
    return frame().assign(**columns).to_csv(index=False, float_format="%.9g")


def stamped(stamps: list[str]) -> str:
    return frame().assign(time=stamps).to_csv(index=False, float_format="%.9g")


def opensim(in_degrees: bool) -> str:
    head = f"Coordinates\nversion=1\nnRows={N}\nnColumns=4\ninDegrees={'yes' if in_degrees else 'no'}\n\n"
    head += (
        "Units are S.I. units (second, meters, Newtons, ...)\nIf the header above contains a line with inDegrees,\n\n"
    )
    return head + "endheader\n" + lines("\t")


def octave() -> str:
    head = "# Created by Octave 6.4.0, Mon Jan 05 2026 <a@b>\n# name: x\n# type: matrix\n# rows: 400\n# columns: 4\n"
    return head + "\n".join(" " + " ".join(f"{v:.9g}" for v in row) for row in frame().to_numpy()) + "\n\n\n"


def vicon() -> str:
    """Two segments with X, Y and Z each; the second holds the angles."""
    head = "Model Outputs\n100\n,,Motor,S1:LeftSway,,,S1:RightSway,,\nFrame,Sub Frame,T,X,Y,Z,X,Y,Z\n"
    head += ",,N.m,deg,deg,deg,deg,deg,deg\n"
    rows = (f"{k + 1},0,{u:.9g},9,8,7,{a:.9g},{b:.9g},0" for k, (_, u, a, b) in enumerate(frame().to_numpy()))
    return head + "\n".join(rows) + "\n"


def stamps(form: str, step_ms: int = 10) -> list[str]:
    start = np.datetime64("2026-01-05T09:59:59.000")
    times = start + step_ms * np.arange(N).astype("timedelta64[ms]")
    return [str(t).replace("T", " ") + form if form != "time" else str(t).split("T")[1] for t in times]


DECLARED = {"angle": "deg", "stimulus": "N m"}

FILES: dict[str, tuple[str | bytes, dict[str, Any]]] = {
    "plain": (lines(), {}),
    "blanks": (lines(" "), {}),
    "tab": (lines("\t"), {}),
    "fixed width": (lines("   "), {}),
    "quoted header (MATLAB writetable, R)": (quoted(csv.QUOTE_NONNUMERIC), {}),
    "everything quoted": (quoted(csv.QUOTE_ALL), {}),
    "row names of R, named nothing": (r_table(",", True), {}),
    "row names of R, one more than the header": (r_table(" ", False), {}),
    "row names of R, semicolon": (r_table(";", False), {}),
    "index of a data frame": (frame().to_csv(float_format="%.9g"), {}),
    "data frame without names": (
        pd.DataFrame(frame().to_numpy()).to_csv(index=False, float_format="%.9g"),
        {"channels": {"time": 0, "stimulus": 1, "theta1": 2, "theta2": 3}},
    ),
    "trailing comma in rows": (lines(ending=","), {}),
    "trailing comma everywhere": (lines(ending=",").replace("theta2\n", "theta2,\n"), {}),
    "trailing tab": (lines("\t", ending="\t"), {}),
    "trailing semicolons": (lines(";", ending=";"), {}),
    "names in a comment (savetxt)": (saved(header=" ".join(NAMES)), {}),
    "names in a comment, comma": (saved(header=",".join(NAMES), delimiter=","), {}),
    "names in a comment, blanks over commas": (saved(header=" ".join(NAMES), delimiter=","), {}),
    "names in the last of many comments": (saved(header="subject 1\nrate 100\n" + " ".join(NAMES)), {}),
    "names in a comment of MATLAB": (saved(header="\t".join(NAMES), delimiter="\t", comments="% "), {}),
    "names in a comment with units": (
        saved(header="time (s) stimulus (N m) theta1 (deg) theta2 (deg)"),
        {"units": {}},
    ),
    "Octave": (octave(), {"channels": {"time": 0, "stimulus": 1, "theta1": 2, "theta2": 3}}),
    "text column, mostly empty": (with_columns(event=["", *["perturb"] * 2, *[""] * (N - 3)]), {}),
    "text column in front": ("trial," + with_columns().replace("\n", "\nS01,")[: -len("S01,")], {}),
    "Boolean column": (with_columns(foot=[k % 2 == 0 for k in range(N)]), {}),
    "quoted text with a delimiter": (with_columns(remark=['fast, left "leg"'] * N), {}),
    "ISO time stamps": (stamped(stamps("")), {}),
    "ISO time stamps, UTC": (stamped(stamps("Z")), {}),
    "ISO time stamps of a zone": (stamped(stamps("+01:00")), {}),
    "times of the day": (stamped(stamps("time")), {}),
    "mark of UTF-8": (("\ufeff" + lines()).encode("utf-8"), {}),
    "UTF-16 with a mark": (lines().encode("utf-16"), {}),
    "UTF-16 without a mark": (lines().encode("utf-16-le"), {}),
    "Windows' code page": (lines(header="Prüfer: Müller").encode("cp1252"), {}),
    "lines of Windows": (lines().replace("\n", "\r\n"), {}),
    "lines of an old Macintosh": (lines().replace("\n", "\r"), {}),
    "sep=; and decimal comma (Excel)": ("sep=;\n" + lines(";", decimal=","), {}),
    "decimal comma, semicolon": (lines(";", decimal=","), {}),
    "decimal comma, tab": (lines("\t", decimal=","), {}),
    "decimal comma, blanks": (lines(" ", decimal=","), {}),
    "decimal comma, quoted": (
        lines(";", decimal=",").replace(";", '";"').replace("\n", '"\n"')[:-1].join(['"', ""]),
        {},
    ),
    "comma in a name": (
        lines(";").replace("stimulus", "torque, ankle"),
        {"channels": {"stimulus": "torque, ankle"}},
    ),
    "footer": (lines() + "End of file\n", {}),
    "footer with delimiters": (lines() + "\nMean,0.1,0.2,0.3\nSD,1,1,1\n,,,\n", {}),
    "lines above the header": (lines(header="Laboratory 1\nsubject,S01\nrate,100\n\n"), {}),
    "empty lines of commas above": (lines(header=",,,\nLaboratory 1,,,\n,,,"), {}),
    "Time with a capital": (lines().replace("time", "Time"), {}),
    "time in ms": (frame().assign(time=1000 * TIME).to_csv(index=False).replace("time", "time (ms)"), {}),
    "time_ms": (frame().assign(time=1000 * TIME).to_csv(index=False).replace("time", "time_ms"), {}),
    "units in the header": (
        lines().replace("stimulus,theta1,theta2", "stimulus (Nm),theta1 [deg],theta2 (°)"),
        {"units": {}},
    ),
    "units below the header": (
        lines().replace("theta2\n", "theta2\ns,N.m,deg,deg\n"),
        {"units": {}},
    ),
    "units at the end of the names": (
        lines().replace("stimulus,theta1,theta2", "motor_Nm,leg_deg,hip_deg"),
        {"units": {}, "channels": {"stimulus": "motor_Nm", "theta1": "leg_deg", "theta2": "hip_deg"}},
    ),
    "OpenSim in degrees": (opensim(True), {"units": {"stimulus": "N m"}}),
    "Vicon": (vicon(), {"units": {}, "rate_hz": RATE, "channels": {"stimulus": 2, "theta1": 6, "theta2": 7}}),
    "Vicon by names": (
        vicon(),
        {
            "units": {},
            "rate_hz": RATE,
            "channels": {"stimulus": "T", "theta1": "S1:RightSway.x", "theta2": "S1:RightSway.y"},
        },
    ),
    "Vicon with lines counted": (
        vicon(),
        {
            "units": DECLARED,
            "rate_hz": RATE,
            "text": {"skip": 3},
            "channels": {"stimulus": 2, "theta1": 6, "theta2": 7},
        },
    ),
}


def imported(folder: Path, content: str | bytes, options: dict[str, Any], name: str = "a.csv") -> Imported:
    file = folder / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
    return import_files([file], None, {"units": DECLARED, "body": BODY, **options})


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_an_ordinary_program_is_read_to_its_last_digit(tmp_path: Path, name: str) -> None:
    content, options = FILES[name]
    found = imported(tmp_path, content, options)
    (trial,) = found.recording.trials
    assert found.recording.rate_hz == RATE
    np.testing.assert_allclose(trial.stimulus, TORQUE, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(trial.theta, np.column_stack([LEG, HIP]) * DEG, rtol=1e-8, atol=1e-10)


def trc() -> str:
    """Markers in mm at 100 Hz as motion capture writes them; shank and trunk of constant length, z up, x forward."""
    leg, trunk = LEG * DEG, (LEG + HIP) * DEG
    hip = np.column_stack([850 * np.sin(leg), 0 * leg, 850 * np.cos(leg)])
    shoulder = hip + np.column_stack([500 * np.sin(trunk), 0 * trunk, 500 * np.cos(trunk)])
    marks = {"ANK": np.zeros((N, 3)), "HIP": hip, "SHO": shoulder}
    head = "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\n"
    head += f"100.00\t100.00\t{N}\t3\tmm\t100.00\nFrame#\tTime\t" + "\t\t\t".join(marks) + "\t\t\n"
    head += "\t\t" + "\t".join(f"{axis}{k}" for k in (1, 2, 3) for axis in "XYZ") + "\n\n"
    rows = zip(range(1, N + 1), TIME, *(values for values in marks.values()), strict=True)
    return head + "\n".join(
        "\t".join([str(k), f"{t:.5f}", *(f"{v:.9g}" for point in points for v in point)]) for k, t, *points in rows
    )


def test_markers_of_a_trc_file_are_named_as_in_c3d_and_have_its_unit_and_rate(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "torque.csv", TORQUE, header="motor", comments="")
    (tmp_path / "a.trc").write_text(trc())
    described = tmp_path / "a.toml"
    described.write_text(
        'units = {stimulus = "N m"}\nrate_hz = 100\nbody = {reference = "goodworth2018"}\n'
        'channels = {stimulus = {file = "torque.csv", column = "motor"}}\n'
        '[markers]\nankle = ["ANK"]\nhip = ["HIP"]\nshoulder = ["SHO"]\nforward = "+x"\nup = "+z"\n'
        '[[trials]]\nfile = "a.trc"\n'
    )
    (trial,) = import_files([], described).recording.trials
    np.testing.assert_allclose(trial.theta, np.column_stack([LEG, HIP]) * DEG, atol=1e-9)
    told = listing(tmp_path / "a.trc")
    assert [line.split() for line in told.splitlines() if line.startswith("HIP.z")] == [
        ["HIP.z", "7", "400", "mm", "100"]
    ]


def test_a_marker_is_never_an_angle(tmp_path: Path) -> None:
    channels = {"stimulus": "ANK.x", "theta1": "HIP.x", "theta2": "SHO.x"}
    for unit in ("mrad", "deg", "rad"):
        with pytest.raises(
            RecordingError, match=r"theta1: unit: expected an angle, but the file states mm \(a length\)"
        ):
            imported(
                tmp_path,
                trc(),
                {"stimulus": "platform_translation", "channels": channels, "units": {"angle": unit, "stimulus": "mm"}},
                "a.trc",
            )


REFUSED: dict[str, tuple[str | bytes, dict[str, Any], str]] = {
    "a repeated name": (
        vicon(),
        {"channels": {"stimulus": "T", "theta1": "X", "theta2": "Y"}, "rate_hz": RATE},
        r"a\.csv: column 'X': 2 columns have this name, 3, 6 from 0; give the number of one$",
    ),
    "a repeated name that is not asked for by name": (
        lines().replace("time,", "theta1,"),
        {"rate_hz": RATE},
        r"column 'theta1': 2 columns have this name, 0, 2 from 0",
    ),
    "a number behind the last column": (
        lines(),
        {"channels": {"theta1": 4}},
        r"column 4: the file has columns 0 to 3",
    ),
    "a volt for a torque": (
        lines().replace("stimulus", "stimulus (V)"),
        {},
        r"stimulus: unit: expected a torque, but the file states V \(a voltage\) for stimulus",
    ),
    "a length for an angle": (
        lines().replace("theta2", "theta2 [mm]"),
        {},
        r"theta2: unit: expected an angle, but the file states mm \(a length\) for theta2",
    ),
    "a length for an angle, units below": (
        lines().replace("theta2\n", "theta2\ns,N m,mm,deg\n"),
        {},
        r"theta1: unit: expected an angle, but the file states mm",
    ),
    "a length for an angle, by the end of its name": (
        lines().replace("theta1", "marker_mm"),
        {"channels": {"theta1": "marker_mm"}, "units": {"angle": "mrad", "stimulus": "N m"}},
        r"theta1: unit: expected an angle, but the file states mm",
    ),
    "an angular velocity": (
        lines().replace("theta1", "theta1 (deg/s)"),
        {},
        r"theta1: unit: expected an angle, but the file states deg/s \(an angle per s\)",
    ),
    "a torque per mass": (
        lines().replace("stimulus", "stimulus (Nm/kg)"),
        {},
        r"stimulus: unit: expected a torque, but the file states Nm/kg \(a torque per kg\)",
    ),
    "radians declared as degrees": (
        lines().replace("theta1", "theta1 (rad)"),
        {},
        r"theta1: unit: declared deg, but the file states rad for theta1",
    ),
    "the other unit with a scale of -1": (
        lines().replace("theta1", "theta1 (rad)"),
        {"channels": {"theta1": {"column": "theta1", "scale": -1.0}}},
        r"theta1: unit: declared deg, but the file states rad",
    ),
    "degrees of OpenSim declared as radians": (
        opensim(True),
        {"units": {"angle": "rad", "stimulus": "N m"}},
        r"theta1: unit: declared rad, but the file states deg",
    ),
    "samples for time": (
        lines().replace("time", "time (frames)"),
        {},
        r"time: unit: expected a time, but the file states frames \(a count\)",
    ),
    "no unit": (
        lines(),
        {"units": {"stimulus": "N m"}},
        r"units\.angle: expected the unit of theta1 \(--unit\), got none",
    ),
    "text that is asked for": (
        with_columns(event=["a"] * N),
        {"channels": {"theta2": "event"}},
        r"a\.csv: line 2, column 'event': expected a number, got 'a'$",
    ),
    "a wrong number": (
        lines().replace(f"{LEG[2]:.9g}", "0.0O1"),
        {},
        r"a\.csv: line 4, column 'theta1': expected a number, got '0\.0O1'$",
    ),
    "a thousand or a comma": (
        "time;stimulus;theta1;theta2\n" + "\n".join(f"{k};1,234;5,678;9,012" for k in range(40)),
        {},
        r"is the comma of '1,234' a decimal sign or between thousands\? state decimal",
    ),
    "a row cut off": (lines().rstrip("\n")[:-14] + "\n", {}, r"a\.csv: line 401: expected 4 columns, got 3$"),
    "a second table below": (
        lines() + "\nDevices\n1000\nFrame,Force\n1,2.5\n2,2.5\n",
        {},
        r"a\.csv: line 403: expected 4 columns, got 1",
    ),
    "an Excel workbook": (
        b"PK\3\4" + bytes(100),
        {},
        r"a\.csv: expected text, found a workbook .*; save the sheet as CSV$",
    ),
    "an old Excel workbook": (
        b"\xd0\xcf\x11\xe0" + bytes(100),
        {},
        r"found a workbook \(\.xls\); save the sheet as CSV$",
    ),
    "several variables of Octave": (
        octave() + octave().replace("name: x", "name: y"),
        {},
        r"found a file of Octave with several variables; save it with -v7",
    ),
    "time stamps of two kinds": (
        stamped([*stamps("")[:-1], "later"]),
        {},
        r"line 401, column 'time': expected a time stamp as in the lines above, got 'later'",
    ),
    "more names than columns": (
        lines().replace("theta2\n", "theta2,theta3\n"),
        {},
        r"line 1: the header names 5 columns, the rows have 4",
    ),
    "a quote that is not closed": (
        with_columns(remark=["a"] * N).replace("a\n", '"a\n', 1),
        {},
        "a quoted cell is not closed",
    ),
    "a quote alone": ("1 2 3 4\n" * 5 + '"\n', {}, "column 'stimulus' is missing"),
    "an endless cell": ('1,"' + "a" * 200_000 + '",3,4\n1,2,3,4\n', {}, "expected cells of text or numbers"),
    "no numbers": ("a,b,c\nd,e,f\n", {}, "expected rows of numbers under the header, found none"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_gets_one_line_that_says_where_and_what_to_do(tmp_path: Path, name: str) -> None:
    content, options, message = REFUSED[name]
    with pytest.raises(RecordingError, match=message) as caught:
        imported(tmp_path, content, options)
    assert "\n" not in str(caught.value)


def test_a_column_number_is_a_position(tmp_path: Path) -> None:
    """Also where names repeat, are numbers themselves, or are not there."""
    values = np.arange(40.0).reshape(8, 5) + 0.5
    headers = ("X,Y,X,Y,X", "4,3,2,1,0", "1,2,3,4,5", "0,1,2,3,4", "a,b,c,d,e", ",,,,", "time,X,X,X,X", "")
    for header in headers:
        rows = "\n".join(",".join(map(str, row)) for row in values)
        (tmp_path / "a.csv").write_text(f"{header}\n{rows}\n")
        source = open_source(tmp_path / "a.csv", Dialect())
        for k in range(5):
            for key in (k, str(k)):
                assert source.pick(key).values[-1] == values[-1, k], (header, key)
        assert len(source.variables) == 5


def test_the_list_shows_every_column_with_its_number(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,X,Y,X,Y,X\n" + "\n".join("0,1,2,3,4,5" for _ in range(5)))
    rows = [line.rsplit(maxsplit=4)[:2] for line in listing(tmp_path / "a.csv").splitlines()[4:]]
    assert [(name.strip(), number) for name, number in rows] == [
        ("t", "0"), ("X [1]", "1"), ("Y [2]", "2"), ("X [3]", "3"), ("Y [4]", "4"), ("X [5]", "5")
    ]  # fmt: skip


def test_a_calibrated_voltage_and_a_wrong_header_have_a_way_in(tmp_path: Path) -> None:
    volts = lines().replace("stimulus", "stimulus (V)")
    found = imported(tmp_path, volts, {"channels": {"stimulus": {"column": "stimulus", "unit": "N m", "scale": 2.0}}})
    np.testing.assert_allclose(found.recording.trials[0].stimulus, 2 * TORQUE, rtol=1e-8, atol=1e-9)
    found = imported(tmp_path, volts, {"units": {**DECLARED, "stated": "ignored"}})
    np.testing.assert_allclose(found.recording.trials[0].stimulus, TORQUE, rtol=1e-8, atol=1e-9)
    assert "units that the files state are ignored, as declared" in found.notes


@pytest.mark.parametrize(
    ("unit", "kind"),
    [
        ("N·m", "a torque"),
        ("N.m", "a torque"),
        ("[N-m]", "a torque"),
        ("newton metre", "a torque"),
        ("nm", None),
        ("Deg", "an angle"),
        ("(degrees)", "an angle"),
        ("RAD", "an angle"),
        ("mV", "a voltage"),
        ("deg/s^2", "an angle per s^2"),
        ("m/s2", "a length per s2"),
        ("deg s-1", "an angle per s"),
        ("rad·s⁻¹", "an angle per s"),
        ("ft-lb", "a torque"),
        ("in-lbf", "a torque"),
        ("J", "an energy"),
        ("gon", "an angle"),
        ("left", None),
        ("", None),
        ("1", None),
    ],
)
def test_what_a_unit_measures(unit: str, kind: str | None) -> None:
    assert kind_of(unit) == kind


@pytest.mark.parametrize(
    ("amount", "unit", "same", "target"),
    [
        (360, "deg", 2 * math.pi, "rad"),
        (400, "gon", 2 * math.pi, "rad"),
        (21_600, "arcmin", 2 * math.pi, "rad"),
        (1000, "mrad", 1, "rad"),
        (1, "kgf m", 9.80665, "N m"),
        (12, "lbf in", 0.45359237 * 9.80665 * 0.3048, "N m"),
        (1, "lbf ft", 0.45359237 * 9.80665 * 0.3048, "N m"),
        (1, "min", 60, "s"),
        (10, "mm", 0.01, "m"),
    ],
)
def test_a_unit_is_as_large_as_its_definition_says(amount: float, unit: str, same: float, target: str) -> None:
    assert amount * factor(unit, target, "") == pytest.approx(same, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("moment / N m", "N m"),
        ("angle/deg/s", "deg/s"),
        ("time,s", "s"),
        ("Weg in mm", "mm"),
        ("hip angle deg", "deg"),
        ("hip angle deg/s", "deg/s"),
        ("motor: V", None),  # one letter behind a colon or a blank is a name
        ("motor: mV", "mV"),
        ("plate A", None),
        ("S1:LeftAnkle", None),
        ("LASI.x", None),
        ("theta1_°", "°"),
        ("left/right", None),
        ("/ deg", None),
    ],
)
def test_a_unit_at_the_end_of_a_name(name: str, unit: str | None) -> None:
    assert at_end(name) == unit


def test_units_behind_a_slash_or_a_comma_are_taken_and_may_not_be_contradicted(tmp_path: Path) -> None:
    named = lines(names=False)
    for header in ("time,stimulus / N m,theta1 / deg,theta2 / deg", 'time,"stimulus, N m","theta1, deg","theta2, deg"'):
        channels = {"time": 0, "stimulus": 1, "theta1": 2, "theta2": 3}
        found = imported(tmp_path, f"{header}\n{named}", {"units": {}, "channels": channels})
        np.testing.assert_allclose(found.recording.trials[0].stimulus, TORQUE, rtol=1e-8, atol=1e-9)
        with pytest.raises(RecordingError, match="declared rad, but the file states deg"):
            imported(tmp_path, f"{header}\n{named}", {"units": {"angle": "rad"}, "channels": channels})


def test_lines_that_programs_write_among_the_numbers_are_no_numbers(tmp_path: Path) -> None:
    """OptiTrack's numbers above the names, LabVIEW's column of comments, LabChart's comments in rows."""
    named = lines(names=False).splitlines()
    optitrack = ["Format Version,1.23", ',"1","1","2"', ",Rotation,Rotation,Rotation", "Time,X,Y,X"]
    labview = ["time,stimulus,theta1,theta2,Comment"]
    labchart = ["time,stimulus,theta1,theta2"]
    for head, rows in (
        (optitrack, named),
        (labview, named),
        (labchart, [named[0], named[1] + ",#* start", *named[2:]]),
    ):
        channels = {"time": 0, "stimulus": 1, "theta1": 2, "theta2": 3}
        found = imported(tmp_path, "\n".join([*head, *rows]), {"channels": channels})
        np.testing.assert_allclose(found.recording.trials[0].stimulus, TORQUE, rtol=1e-8, atol=1e-9)
