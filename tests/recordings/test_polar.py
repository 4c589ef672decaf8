"""Gains in dB, gains with a sign, and phases in rad are refused with the remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.errors import RecordingError
from mcstudy.recordings.gain_and_phase import response
from mcstudy.stance.body import one_segment, two_segment
from mcstudy.stance.response import frf

F = np.array([0.02, 0.05, 0.1, 0.2, 0.4, 0.8])
GAIN = np.array([0.155, 0.15, 0.14, 0.115, 0.06, 0.025])
PHASE = np.array([-4.0, -10, -20, -40, -80, -110])


def read(folder: Path, gain: np.ndarray = GAIN, phase: np.ndarray = PHASE, sd: float = 0.01) -> mc.FrfRecording:
    rows = "\n".join(f"{f},{g},{p},{sd}" for f, g, p in zip(F, gain, phase, strict=True))
    (folder / "frf.csv").write_text(f"f,gain1,phase1,sd1\n{rows}\n")
    text = 'units = {angle = "deg"}\nbody = {reference = "goodworth2018"}\nfrf = {file = "frf.csv"}\n'
    (folder / "frf.toml").write_text(text)
    found = mc.read_recording(folder / "frf.toml")
    assert isinstance(found, mc.FrfRecording)
    return found


def test_a_gain_is_a_magnitude(tmp_path: Path) -> None:
    np.testing.assert_allclose(np.rad2deg(np.abs(read(tmp_path).y[:, 0])), GAIN)
    with pytest.raises(RecordingError, match=r"gain1: expected a magnitude, 0 or more, got -51.*10\^\(dB/20\)"):
        read(tmp_path, 20 * np.log10(np.deg2rad(GAIN)))
    with pytest.raises(RecordingError, match=r"gain1: .* got -0.155; .*add 180 to the phase"):
        read(tmp_path, np.where(F == 0.02, -1, 1) * GAIN)


def test_a_phase_is_in_degrees(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"phase1: expected deg, got at most 1.92 .*convert them by 180/pi"):
        read(tmp_path, phase=np.deg2rad(PHASE))
    with pytest.raises(RecordingError, match=r"phase1: expected deg, at most 3600"):
        read(tmp_path, phase=100 * PHASE)


@pytest.mark.parametrize("sd", [0.0, -0.01])
def test_a_standard_error_is_positive(tmp_path: Path, sd: float) -> None:
    with pytest.raises(RecordingError, match=r"sd1: expected positive numbers, got .*standard error"):
        read(tmp_path, sd=sd)


@pytest.mark.parametrize("kind", ["ankle_torque", "surface_tilt", "visual_tilt"])
def test_responses_of_bodies_are_never_taken_for_radians(kind: str) -> None:
    for model in (one_segment(stimulus=kind), two_segment(stimulus=kind)):
        for top in (0.5, 1.0, 8.0):
            y = frf(model, model.truth, np.geomspace(0.02, top, 12)).T
            np.testing.assert_allclose(response(np.abs(y), np.rad2deg(np.angle(y)), "frf"), y)


def test_a_row_of_a_group_is_read_by_the_same_rules(tmp_path: Path) -> None:
    header = "person,segment,gain_a,gain_b,gain_c,phase_a,phase_b,phase_c\n"
    (tmp_path / "group.toml").write_text(
        'stimulus = "surface_tilt"\nupper_body = "space"\nunits = {angle = "deg", stimulus = "deg"}\n'
        'body = {height = 1.75, weight = 72}\n[frf_group]\nfile = "frf.csv"\ngain = "gain_*"\nphase = "phase_*"\n'
        "period_s = 20.0\npoints = [[1], [2], [3]]\n"
    )

    def group(*rows: str) -> None:
        (tmp_path / "frf.csv").write_text(header + "\n".join(rows) + "\n")
        mc.read_frf_group(tmp_path / "group.toml")

    upper = "upper,1,2,1.5,0,-10,-30"
    group("ann,lower,1,2,3,0,-10,-30", f"ann,{upper}", "bob,lower,1,2,2,0,-10,-30", f"bob,{upper}")
    with pytest.raises(RecordingError, match="line 2: gain: expected a magnitude"):
        group("ann,lower,-1,2,3,0,-10,-30", f"ann,{upper}")
    with pytest.raises(RecordingError, match="bob: has the same responses as ann"):
        group("ann,lower,1,2,3,0,-10,-30", f"ann,{upper}", "bob,lower,1,2,3,0,-10,-30", f"bob,{upper}")
