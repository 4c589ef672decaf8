"""Text files as ordinary programs write them: what they hold is read, or one line says what to do."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from mcstudy.errors import RecordingError
from mcstudy.recordings.importing import Imported, import_files, listing

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

FILES: dict[str, tuple[str | bytes | Callable[[], str], dict[str, Any]]] = {
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
    "first values missing": (
        lines().replace("\n0,0,", "\n0,NA,").replace(f"{LEG[1]:.9g},", "nan,"),
        {"fill_gaps_s": 0.05, "channels": {"stimulus": "theta2", "theta1": "stimulus"}, "missing": True},
    ),
}


def imported(folder: Path, content: str | bytes, options: dict[str, Any], name: str = "a.csv") -> Imported:
    file = folder / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
    return import_files([file], None, {"units": DECLARED, "body": BODY, **options})


@pytest.mark.parametrize("name", [n for n in FILES if n != "first values missing"])
def test_a_file_of_an_ordinary_program_is_read_to_its_last_digit(tmp_path: Path, name: str) -> None:
    content, options = FILES[name]
    assert not callable(content)
    found = imported(tmp_path, content, options)
    (trial,) = found.recording.trials
    assert found.recording.rate_hz == RATE
    np.testing.assert_allclose(trial.stimulus, TORQUE, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(trial.theta, np.column_stack([LEG, HIP]) * DEG, rtol=1e-8, atol=1e-10)
