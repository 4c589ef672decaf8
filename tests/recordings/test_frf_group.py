"""Groups of FRFs: a table is read as it is described, and a wrong one is refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from many_people import comtest, needs_comtest

import mcstudy as mc
from mcstudy.errors import RecordingError
from mcstudy.recordings.frf_group import body_of_group

SHEET = """
stimulus = "surface_tilt"
upper_body = "space"
units = {angle = "deg", stimulus = "deg"}
body = {height = 1.75, weight = 72}

[frf_group]
file = "frf.csv"
conditions = ["eyes", "tilt"]
gain = "gain_*Hz"
phase = "phase_*Hz"
period_s = 20.0
points = [[1], [2], [3, 4]]
prts_state_s = 0.25
"""

TABLE = """person,eyes,tilt,segment,gain_0.05Hz,gain_0.15Hz,gain_0.30Hz,phase_0.05Hz,phase_0.15Hz,phase_0.30Hz
ann,open,0.5,lower,1,2,3,0,90,-90
ann,open,0.5,upper,2,2,2,180,-180,-540
bob,open,0.5,lower,1,1,1,0,0,0
bob,open,0.5,upper,1,1,1,0,0,0
bob,closed,0.5,lower,1,1,2,0,0,0
bob,closed,0.5,upper,1,1,2,0,0,0
"""


def read(folder: Path, sheet: str = SHEET, table: str = TABLE) -> xr.Dataset:
    (folder / "frf.csv").write_text(table)
    (folder / "group.toml").write_text(sheet)
    return mc.read_frf_group(folder / "group.toml")


def test_a_table_is_read_by_person_condition_segment_and_point(tmp_path: Path) -> None:
    group = read(tmp_path)
    assert dict(group.sizes) == {"person": 2, "condition": 2, "segment": 2, "point": 3, "line": 4}
    ann = group["frf"].sel(person="ann", condition="open, 0.5")
    np.testing.assert_allclose(ann, [[1, 2j, -3j], [-2, -2, -2]], atol=1e-12)
    assert np.isnan(group["frf"].sel(person="ann", condition="closed, 0.5")).all()
    assert group["eyes"].values.tolist() == ["open", "closed"]
    np.testing.assert_allclose(group["f"], [0.05, 0.15, 0.30])
    np.testing.assert_allclose(group["f_line"], [0.05, 0.15, 0.25, 0.35])
    assert body_of_group(group) == mc.Body.from_person(1.75, 72)


def test_a_point_weights_its_harmonics_with_the_power_of_the_stimulus(tmp_path: Path) -> None:
    from mcstudy.stance.stimulus import Prts

    computed = read(tmp_path)["average"].values
    waveform = Prts(stages=4, state_s=0.25, rate_hz=400.0).waveform()
    power = np.abs(np.fft.rfft(waveform)[1:8:2]) ** 2
    np.testing.assert_allclose(computed[2, 2:], power[2:] / power[2:].sum(), rtol=1e-3)
    stated = read(tmp_path, SHEET.replace("prts_state_s = 0.25", "power = [[5], [4], [3, 1]]"))["average"].values
    np.testing.assert_allclose(stated, [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0.75, 0.25]])


def test_a_hip_angle_becomes_the_upper_body_in_space(tmp_path: Path) -> None:
    space = read(tmp_path)["frf"]
    hip = read(tmp_path, SHEET.replace('"space"', '"hip"'))["frf"]
    np.testing.assert_allclose(hip[:, :, 1], space[:, :, 1] + space[:, :, 0])
    np.testing.assert_allclose(hip[:, :, 0], space[:, :, 0])


def test_units_are_converted(tmp_path: Path) -> None:
    torque = SHEET.replace("surface_tilt", "ankle_torque").replace('stimulus = "deg"', 'stimulus = "N m"')
    in_deg = read(tmp_path, torque)["frf"]
    np.testing.assert_allclose(in_deg, np.pi / 180 * read(tmp_path)["frf"])


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('phase = "phase_*Hz"', "", "frf_group: expected gain and phase, or real and imaginary, got gain"),
        ("[3, 4]]", "[3, 4], [4]]", "gain: expected 4 columns 'gain_*Hz', one per point, found 3"),
        ("[3, 4]]", "[4, 3]]", "expected points of ascending numbers of harmonics"),
        ("[3, 4]]", "[3]]", "column 'gain_0.30Hz': expected 0.25 Hz, the mean of the harmonics of its point"),
        ("prts_state_s = 0.25", "", "expected prts_state_s or power, because a point averages several harmonics"),
        ("prts_state_s = 0.25", "power = [[1], [1], [1]]", "expected power in the form of points, positive"),
        ('"gain_*Hz"', '"gain"', "expected gain with one *, which stands for the point"),
        ('conditions = ["eyes"', 'conditions = ["vision"', "expected one column 'vision' in the first line, found"),
        ("surface_tilt", "tilt", "stimulus: expected one of ankle_torque"),
        ('angle = "deg", ', "", "units: expected both angle and stimulus"),
        ("period_s = 20.0", "", "frf_group.period_s: missing"),
        ('file = "frf.csv"', 'file = "../frf.csv"', "../frf.csv"),
    ],
)
def test_a_wrong_description_is_refused_in_one_line(tmp_path: Path, old: str, new: str, line: str) -> None:
    assert old in SHEET
    with pytest.raises(RecordingError) as refused:
        read(tmp_path, SHEET.replace(old, new))
    assert line in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("ann,open,0.5,lower,1,2", "ann,open,0.5,lower,x,2", "line 2, column 'gain_0.05Hz': expected a number"),
        ("ann,open,0.5,upper,2,2,2,180,-180,-540\n", "", "ann, open, 0.5: the row of upper is missing"),
        ("ann,open,0.5,upper", "ann,open,0.5,lower", "line 3: a second row of ann, open, 0.5, lower"),
        ("ann,open,0.5,upper", "ann,open,0.5,trunk", "line 3: segment: expected lower or upper, got 'trunk'"),
        ("ann,open,0.5,upper", ",open,0.5,upper", "line 3: person: expected a value"),
        ("lower,1,2,3,0,90,-90", "lower,1,2", "line 2: expected 10 columns, got 6"),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(tmp_path: Path, old: str, new: str, line: str) -> None:
    with pytest.raises(RecordingError) as refused:
        read(tmp_path, table=TABLE.replace(old, new, 1))
    assert str(refused.value).startswith(str(tmp_path / "frf.csv"))
    assert line in str(refused.value)


def test_a_description_of_a_group_is_no_recording_and_says_what_reads_it(tmp_path: Path) -> None:
    read(tmp_path)
    with pytest.raises(RecordingError, match="description of the FRFs of a group \\(for mcstudy gap compare\\)"):
        mc.read_recording(tmp_path / "group.toml")


@needs_comtest
def test_the_published_group_is_read_with_its_medians() -> None:
    """Median gain of the lower body at 0.30 Hz, as its description states them."""
    group = comtest()
    assert group["frf"].shape == (49, 4, 2, 11)
    gain = abs(group["frf"].sel(segment="lower").isel(point=2)).median("person")
    stated = {"closed, 0.5": 3.6, "closed, 1.0": 2.6, "open, 0.5": 2.8, "open, 1.0": 2.0}
    for condition, value in stated.items():
        assert float(gain.sel(condition=condition)) == pytest.approx(value, abs=0.06)
