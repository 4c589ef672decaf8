"""A folder of many people is read as it is: bodies from its table, and its quality flags decide what is used."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from sway_files import write_table

from mcstudy.cli import main
from mcstudy.errors import RecordingError
from mcstudy.exits import Exit
from mcstudy.recordings.formats.workbook import sheet_rows
from mcstudy.recordings.io import read_recording
from mcstudy.recordings.people_folder import Found, import_people
from mcstudy.stance.body import Body
from mcstudy.stance.stimulus import Prts

RATE = 20.0

WAVE = np.tile(Prts(stages=4, state_s=0.25, rate_hz=RATE, amplitude=np.deg2rad(2.0)).waveform(), 4)

PEOPLE = """Subject ID,body_height_m,body_weight_kg,age_years,sex,c1: eyes open,c2: scene 2 deg,c3: scene 4 deg
AB01,1.71,65.5,24,w,1,2,3
B01,1.80,80,30,m,-1,2,3
"""

FLAGS = """subject_id,condition_name,flag_code,trial_code,screened_at,note
AB01,c2: scene 2 deg,0,t2,2026-01-01,
AB01,c3: scene 4 deg,1,t3,2026-01-01,moved a foot
B01,c2: scene 2 deg,,t2,,
B01,c3: scene 4 deg,2,t3,2026-01-01,fell
"""


def headset(path: Path, tilt: np.ndarray, seed: int) -> None:
    """A trial at the regular rate; hip 0.8 m and shoulder 1.4 m above the floor."""
    sway = 0.4 * np.roll(WAVE, 4) + np.random.default_rng(seed).normal(0, 0.002, WAVE.size)
    still = np.zeros(tilt.size)
    columns = {"time": np.arange(tilt.size) / RATE, "stim_pitch": np.rad2deg(tilt)}
    for name, high in (("shld", 1.4), ("hip", 0.8)):
        columns |= {f"{name}_ypos": still + high, f"{name}_zpos": (high - 0.067) * np.sin(sway)}
    write_table(path, columns)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    data = tmp_path / "project" / "data"
    (data / "raw" / "day1").mkdir(parents=True)
    (data / "metadata.csv").write_text(PEOPLE, encoding="utf-8")
    (data / "quality_flags.csv").write_text(FLAGS, encoding="utf-8")
    for k, person in enumerate(("AB01", "B01")):
        for trial, tilt in ((1, 0 * WAVE), (2, WAVE), (3, 2 * WAVE)):
            headset(data / "raw" / "day1" / f"study_s{person}_t{trial}.csv", tilt, 10 * k + trial)
    return tmp_path / "project"


def outcomes(found: list[Found]) -> Mapping[tuple[str, str], str]:
    return {(f.person, f.condition[:2]): "used" if f.imported else f.why for f in found}


def test_flags_2_and_3_are_left_out_and_1_is_used_and_told(project: Path) -> None:
    found = import_people(project, options={"resample_hz": None})
    assert outcomes(found) == {
        ("AB01", "c1"): "trial 1: stimulus: constant (0) over the whole trial",
        ("AB01", "c2"): "used",
        ("AB01", "c3"): "used",
        ("B01", "c1"): "no trial (table of people)",
        ("B01", "c2"): "used",
        ("B01", "c3"): "flag: do not use (fell)",
    }
    assert [f.quality for f in found] == ["not rated", "good", "doubtful", "missing", "not rated", "do not use"]
    doubtful = found[2].recording
    assert "quality: doubtful" in doubtful.provenance
    assert (doubtful.person, doubtful.condition) == ("AB01", "c3: scene 4 deg")


def test_doubtful_ones_may_be_left_out_and_conditions_chosen(project: Path) -> None:
    found = import_people(project, options={"resample_hz": None}, conditions=["c2", "c3"], doubtful=False)
    used = {key for key, why in outcomes(found).items() if why == "used"}
    assert used == {("AB01", "c2"), ("B01", "c2")}


def test_everybody_has_the_body_of_the_table(project: Path) -> None:
    found = import_people(project, options={"resample_hz": None}, conditions=["c2"])
    for f, person in zip(found, ({"height": 1.71, "weight": 65.5}, {"height": 1.80, "weight": 80.0}), strict=True):
        assert f.recording.constants["mgh"] == pytest.approx(Body.from_person(**person).mgh)


def test_the_command_writes_recordings_and_a_table_for_the_fit_of_many_people(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["import", str(project), "--conditions", "c2", "c3", "--resample", "20", "-o", str(tmp_path / "out")])
        == Exit.DONE
    )
    said = capsys.readouterr().out
    assert said.startswith("3 of 4 recordings imported, of 2 people")
    assert "1 of them are doubtful by their flag" in said
    with (tmp_path / "out" / "people.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(r["person"], r["condition"], r["quality"]) for r in rows] == [
        ("AB01", "c2: scene 2 deg", "good"),
        ("AB01", "c3: scene 4 deg", "doubtful"),
        ("B01", "c2: scene 2 deg", "not rated"),
    ]
    assert read_recording(tmp_path / "out" / rows[0]["file"]).person == "AB01"


MISTAKES = {
    "flags for unknown people": (
        "quality_flags.csv",
        "AB01,c2",
        "AB02,c2",
        r"line 2: subject_id 'AB02' is not among .*\(similar: AB01\)",
    ),
    "flags of unknown conditions": (
        "quality_flags.csv",
        "c2: scene 2 deg,0",
        "c2,0",
        r"condition_name 'c2' is no column of the people",
    ),
    "a flag that is none": ("quality_flags.csv", "deg,1", "deg,4", r"line 3: flag_code: expected 0 \(good\).* got '4'"),
    "two flags of one": ("quality_flags.csv", "AB01,c3: scene 4", "AB01,c2: scene 2", "line 3: a second flag for AB01"),
    "no column of flags": ("quality_flags.csv", "flag_code", "flag", "expected one column 'flag_code'"),
    "no height": ("metadata.csv", "1.71", "", r"AB01: body_height_m: expected a number, got ''"),
    "a height in cm": ("metadata.csv", "1.71", "171", r"body.height: .* 171; is it in m\?"),
    "a column called otherwise": (
        "metadata.csv",
        "body_weight_kg",
        "body_weight",
        r"expected one column 'body_weight_kg'.*\(similar: body_weight\)",
    ),
    "one person twice": ("metadata.csv", "\nB01", "\nAB01", "line 3: Subject ID: .* a second row of AB01"),
    "no conditions": ("metadata.csv", "c", "k", "expected one column 'Subject ID'"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_mistake_in_the_tables_is_one_line(project: Path, case: str) -> None:
    name, old, new, message = MISTAKES[case]
    path = project / "data" / name
    path.write_text(path.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    try:  # the mistake of one person leaves the others
        said = import_people(project, options={"resample_hz": None}, conditions=["c2"])[0].why
    except RecordingError as error:
        said = str(error)
    assert re.search(message, said)
    assert "\n" not in said


def test_a_missing_and_a_second_file_of_a_trial_are_told(project: Path) -> None:
    raw = project / "data" / "raw"
    (raw / "day1" / "study_sB01_t2.csv").unlink()
    (raw / "sAB01_t2.csv").write_bytes((raw / "day1" / "study_sAB01_t2.csv").read_bytes())
    found = import_people(project, options={"resample_hz": None}, conditions=["c2", "c3"])
    told = outcomes(found)
    assert told["B01", "c2"] == "no file ..B01_t2.csv"
    assert told["AB01", "c2"] == "2 files ..AB01_t2.csv"


def test_without_anything_to_use_the_reasons_are_one_line(project: Path) -> None:
    with pytest.raises(RecordingError, match="no recording of 2 can be used: trial 1: stimulus: constant"):
        import_people(project, options={"resample_hz": None}, conditions=["c1"])


def workbook(path: Path, rows: list[list[object]]) -> Path:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.save(path)
    return path


def test_a_workbook_is_read_as_the_same_table_is_as_text(project: Path) -> None:
    cells = [line.split(",") for line in PEOPLE.strip().split("\n")]
    numbers = [[float(c) if c.replace(".", "").lstrip("-").isdigit() else c for c in row] for row in cells[1:]]
    workbook(project / "data" / "metadata.xlsx", [cells[0], *numbers])
    (project / "data" / "metadata.csv").unlink()
    found = import_people(project, options={"resample_hz": None}, conditions=["c2"])
    assert [f.recording.constants["mgh"] for f in found] == pytest.approx(
        [Body.from_person(1.71, 65.5).mgh, Body.from_person(1.80, 80).mgh]
    )


def test_workbooks_that_are_none_locked_or_empty_are_one_line(tmp_path: Path) -> None:
    pytest.importorskip("openpyxl")
    locked, other, cut = (tmp_path / f"{name}.xlsx" for name in ("locked", "other", "cut"))
    locked.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600))
    other.write_bytes(b"Subject ID,body_height_m\n")
    cut.write_bytes(workbook(tmp_path / "whole.xlsx", [["a", 1]]).read_bytes()[:900])
    for path, message in (
        (locked, "is locked by a password, or an old .xls"),
        (other, r"expected a workbook \(.xlsx\), found other bytes"),
        (cut, "cannot be read as a workbook"),
        (workbook(tmp_path / "empty.xlsx", []), "the first sheet is empty"),
        (tmp_path / "missing.xlsx", "cannot be read as a workbook: .*No such file"),
    ):
        with pytest.raises(RecordingError, match=message) as caught:
            sheet_rows(path)
        assert "\n" not in str(caught.value)
