"""Every mistake with a file of one sway angle ends in one line, which names file, field and the way on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sway_files import PERSON, write_table

from mcstudy.errors import RecordingError
from mcstudy.recordings.laboratory_import import Imported, import_files
from mcstudy.stance.stimulus import Prts

RATE, CYCLES = 20.0, 4

WAVE = Prts(stages=4, state_s=0.25, rate_hz=RATE, amplitude=np.deg2rad(2.0), convention="peak_to_peak")

TILT = np.tile(WAVE.waveform(), CYCLES)
N = TILT.size
NOISE = np.random.default_rng(0).normal(0, 0.002, N)
SWAY = 1.2 * np.roll(TILT, 5) + NOISE
TABLE = {"time": np.arange(N) / RATE, "tilt": np.rad2deg(TILT), "sway": np.rad2deg(SWAY)}

Text = Callable[[str], "str | bytes"]


def channels(sway: Mapping[str, Any] | None = None, tilt: str = "deg", column: Any = "tilt") -> dict[str, Any]:
    return {"stimulus": {"column": column, "unit": tilt}, "sway": {"column": "sway", "unit": "deg", **(sway or {})}}


def imported(
    folder: Path, table: Mapping[str, np.ndarray] | None = None, text: Text | None = None, **options: Any
) -> Imported:
    path = write_table(folder / "a.csv", {**TABLE, **(table or {})})
    if text is not None:
        changed = text(path.read_text(encoding="utf-8"))
        path.write_bytes(changed.encode() if isinstance(changed, str) else changed)
    given = {"model": "independent_channel", "body": PERSON, "channels": channels(), **options}
    return import_files([path], None, given)


def between(start: float, stop: float, value: float) -> np.ndarray:
    """Sway with another value from one second to another."""
    t = TABLE["time"]
    return np.where((t > start) & (t < stop), value, TABLE["sway"])


def back(text: str) -> str:
    """Time that runs back once."""
    return text.replace("\n25,", "\n4.5,", 1)


COM = {"unit": "m", "of": "com"}

CASES: dict[str, tuple[dict[str, Any], str]] = {
    "no line of names": ({"text": lambda t: t.split("\n", 1)[1]}, r"'tilt' is missing; .*give the number of a column"),
    "height in cm": ({"body": {"height": 171, "weight": 65.5}}, r"body.height: .* 171; is it in m\?"),
    "weight in g": ({"body": {"height": 1.71, "weight": 65500}}, r"body.weight: .* 65500; is it in kg\?"),
    "height alone": ({"body": {"height": 1.71}}, "body: weight missing"),
    "height below zero": ({"body": {"height": -1.71, "weight": 60}}, "body.height: expected greater than 0"),
    "no body": ({"body": {}}, "body: expected .* height and weight"),
    "empty cells": ({"table": {"sway": between(5, 6, np.nan)}}, r"sway: 19 of 1600 .* t = 5.05 s; .*--fill-gaps"),
    "a gap longer than declared": (
        {"table": {"sway": between(5, 6, np.nan)}, "fill_gaps_s": 0.2},
        r"a gap of 0.95 s at t = 5.05 s is not filled",
    ),
    "nothing but empty cells": ({"table": {"sway": np.full(N, np.nan)}}, "sway: 1600 of 1600 values are not numbers"),
    "an infinite number": ({"table": {"sway": between(5, 5.1, np.inf)}}, "sway: 1 of 1600 values are not numbers"),
    "time that runs back": ({"text": back}, r"time: does not increase after t = 24.95 s \(row 500\)"),
    "rows that are lost": (
        {"text": lambda t: "\n".join(t.split("\n")[:500] + t.split("\n")[560:])},
        r"60 rows are lost: gap of 3.05 s after t = 24.9 s.*--fill-gaps",
    ),
    "time in ms": ({"table": {"time": 1e3 * TABLE["time"]}}, "time: expected a rate from 1 to 100000 Hz"),
    "time in hours": (
        {"table": {"time": TABLE["time"] / 3600}},
        r"stimulus: repeats every 0.00556 s at 72000 Hz; is the unit of time right \(units.time\)\?",
    ),
    "two columns of one name": (
        {"text": lambda t: t.replace("time,tilt,sway", "time,sway,sway"), "channels": channels(column=1)},
        "column 'sway': 2 columns have this name, 1, 2 from 0; give the number of one",
    ),
    "a column that is not there": (
        {"channels": channels(column="tilt_deg")},
        r"'tilt_deg' is missing \(similar: tilt\)",
    ),
    "a column with another capital": ({"channels": channels(column="Tilt")}, r"'Tilt' is missing \(similar: tilt\)"),
    "a number of no column": ({"channels": channels(column=3)}, "column 3: the file has columns 0 to 2"),
    "a constant stimulus": ({"table": {"tilt": np.ones(N)}}, r"stimulus: constant \(0.0174533\)"),
    "a constant sway": ({"table": {"sway": np.ones(N)}}, r"sway: constant \(0.0174533\)"),
    "mm taken as m": (
        {"table": {"sway": 960 * np.sin(SWAY)}, "channels": channels(COM)},
        r"sway: moves by 2\d.* m about its mean, at a height of 0.96 m.*mm or cm taken as m",
    ),
    "m taken as mm": (
        {"table": {"sway": 0.96 * np.sin(SWAY)}, "channels": channels({**COM, "unit": "mm"})},
        r"sway: sways ±.*e-05 rad; expected at least 0.00087 rad; is the unit right\?",
    ),
    "deg taken as rad": (
        {"channels": channels({"unit": "rad"}, "rad")},
        r"sway: sways ±1\..* rad .* which no standing person does",
    ),
    "tilt in deg taken as rad": (
        {"channels": channels(tilt="rad")},
        "stimulus: reaches ±1 rad; expected less than 0.2",
    ),
    "tilt in rad taken as deg": ({"table": {"tilt": TILT}}, r"answers the tilt 6\d.* times as large; .*\(deg, rad\)"),
    "sway in rad taken as deg": ({"table": {"sway": SWAY}}, r"sways ±0.000\d+ rad; expected at least"),
    "no unit": (
        {"channels": {"stimulus": "tilt", "sway": "sway"}},
        r"expected the unit of stimulus \(--stimulus-unit\)",
    ),
    "a unit that is none": ({"channels": channels(tilt="furlong")}, "stimulus: unit: expected one of rad, .*'furlong'"),
    "a torque as tilt": ({"channels": channels(tilt="N m")}, "stimulus: unit: expected one of rad, .*'N m'"),
    "a displacement of nothing": (
        {"channels": channels({"unit": "cm"})},
        r"sway: expected an angle, got sway in cm; .*--sway-of com",
    ),
    "a height in cm": ({"channels": channels({**COM, "height": 95})}, r"sway.height: expected .* got 95; is it in m\?"),
    "a pressure without inertia": (
        {"body": {}, "constants": {"J": 60.0, "mgh": 500.0}, "channels": channels({"unit": "m", "of": "cop"})},
        r"body: expected .* height and weight",
    ),
    "the tilt as sway": (
        {"channels": channels({"column": "tilt"})},
        r"sway: is the stimulus itself, times 1; is it the right column\?",
    ),
    "two cycles": (
        {"text": lambda t: "\n".join(t.split("\n")[:801]), "period_s": 20},
        "at least 3 cycles of 20 s, got 2",
    ),
    "another period": ({"period_s": 19}, "does not repeat every 19 s .*; it repeats every 20 s"),
    "two periods": ({"period_s": 10}, "does not repeat every 10 s .*; it repeats every 20 s"),
    "a period between samples": (
        {"period_s": 20.003},
        r"20.003 s is 400.060 samples at 20 Hz; expected a whole number",
    ),
    "an empty file": ({"text": lambda _: ""}, "expected rows of numbers, found none"),
    "a line of names alone": ({"text": lambda t: t.split("\n")[0]}, "expected rows of numbers under the header"),
    "a word between numbers": ({"text": lambda t: t.replace("\n5,", "\nfive,")}, "line 102, column 'time': .*'five'"),
    "thousands with commas": (
        {"text": lambda t: t.replace(",", ";").replace("\n50;", "\n1,050;").replace("\n51;", "\n1,051;")},
        r"line 1002, column 'time': expected a number, got '1,050'",
    ),
    "a model that is none": ({"model": "independent_chanel"}, r"'independent_chanel' \(similar: independent_channel\)"),
    "no model": ({"model": None}, r"channels.sway: unknown key, .*model = \"sensorimotor_integration\", --model"),
    "two angles of one": ({"channels": {**channels(), "theta1": "sway"}}, "channels.theta1: unknown key, .*sway"),
    "a constant that is none": ({"constants": {"Jj": 5.0}}, r"constants.Jj: expected one of J, mgh, .*\(similar: J\)"),
    "a constant below zero": ({"constants": {"J": -5.0}}, "constants.J: expected greater than 0"),
    "one rod": ({"markers": {"hip": ["sway"], "columns": "{marker}"}}, "markers.shoulder: missing"),
    "a marker that is not there": (
        {"markers": {"hip": ["hip"], "shoulder": ["shld"], "columns": "{marker}_{axis}pos", "unit": "m"}},
        "column 'hip_xpos' is missing",
    ),
    "markers without a unit": (
        {"markers": {"hip": ["sway"], "shoulder": ["sway"], "columns": "{marker}"}},
        r"markers.unit: expected the unit of sway \(m, cm, mm\), got none",
    ),
    "one axis twice": (
        {"markers": {"hip": ["sway"], "shoulder": ["sway"], "forward": "+x", "up": "-x"}},
        "expected two different axes",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_mistake_is_one_line_that_says_what_to_do(tmp_path: Path, case: str) -> None:
    options, message = CASES[case]
    with pytest.raises(RecordingError, match=message) as caught:
        imported(tmp_path, **options)
    said = str(caught.value)
    assert "\n" not in said
    assert len(said) < 600
    assert "a" in said.split(":")[0]  # the file, or the recording called after it


ACCEPTED: dict[str, Text] = {
    "a byte order mark": lambda t: b"\xef\xbb\xbf" + t.encode(),
    "UTF-16": lambda t: t.encode("utf-16"),
    "semicolons at the end of lines": lambda t: t.replace(",", ";").replace("\n", ";;\n"),
    "decimal commas": lambda t: t.replace(",", ";").replace(".", ","),
    "lines of Windows": lambda t: t.replace("\n", "\r\n"),
    "quotes": lambda t: t.replace("time,tilt,sway", '"time","tilt","sway"'),
    "blanks around commas": lambda t: t.replace(",", " , "),
    "a unit below every name": lambda t: t.replace("sway\n", "sway\ns,deg,deg\n", 1),
    "thousands in a column that is not asked for": lambda t: "\n".join(
        f"{line};{'Fz' if line[0] == 't' else '1,234.5'}" for line in t.replace(",", ";").strip().split("\n")
    ),
}


@pytest.mark.parametrize("case", ACCEPTED)
def test_what_programs_write_in_other_ways_is_the_same_recording(tmp_path: Path, case: str) -> None:
    recording = imported(tmp_path, text=ACCEPTED[case]).recording
    np.testing.assert_allclose(recording.trials[0].stimulus, TILT, atol=1e-9)
    np.testing.assert_allclose(recording.trials[0].theta[:, 0], SWAY, atol=1e-9)
    assert recording.period_s == 20


def test_a_weight_in_pounds_is_told(tmp_path: Path) -> None:
    found = imported(tmp_path, body={"height": 1.71, "weight": 144.0})
    assert "(odd: 49.2 kg/m^2; is the weight in kg" in found.text()


def test_sway_against_the_tilt_is_told_with_the_way_on(tmp_path: Path) -> None:
    found = imported(tmp_path, table={"sway": -TABLE["sway"]})
    assert "sway: moves against the tilt below 0.3 Hz; if its sign is wrong: scale = -1" in found.text()
    turned = imported(tmp_path, table={"sway": -TABLE["sway"]}, channels=channels({"scale": -1.0}))
    assert not turned.recording.suspicions


def test_too_few_cycles_to_be_periodic_are_told(tmp_path: Path) -> None:
    found = imported(tmp_path, text=lambda t: "\n".join(t.split("\n")[:1001]))
    assert found.recording.period_s is None
    assert "the stimulus repeats every 20 s; with 3 cycles it would be periodic" in found.text()
