"""Markers, rates, gaps and starts: what an import does to the data, against what is known exactly."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c3d_writer import write_c3d
from scipy.io import savemat

from mcstudy.cli import main
from mcstudy.errors import RecordingError
from mcstudy.exits import Exit
from mcstudy.recordings.laboratory_import import Imported, import_files
from mcstudy.recordings.resampling import filled, resampled

RATE = 100.0

BODY = {"reference": "goodworth2018"}

N = 3000


def motion(rate_hz: float = RATE, n: int = N) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A torque and two angles in space, rad, as sums of sines of known frequencies."""
    t = np.arange(n) / rate_hz
    torque = 5 * np.sin(2 * np.pi * 0.3 * t) + np.sin(2 * np.pi * 7.9 * t)
    return torque, 0.010 * np.sin(2 * np.pi * 0.3 * t - 1), 0.015 * np.sin(2 * np.pi * 0.5 * t)


def body_markers(leg: np.ndarray, trunk: np.ndarray, forward: int = 0, up: int = 2) -> dict[str, np.ndarray]:
    """Markers on both sides of a person of given segment angles, mm; the leg is 850 long, hip to shoulder 500."""

    def along(angle: np.ndarray, length: float) -> np.ndarray:
        out = np.zeros((angle.size, 3))
        out[:, forward], out[:, up] = length * np.sin(angle), length * np.cos(angle)
        return out

    ankle = along(0 * leg, 80.0)
    hip = ankle + along(leg, 850.0)
    side = np.zeros(3)
    side[3 - forward - up] = 100.0
    places = {"ANK": ankle, "HIP": hip, "SHO": hip + along(trunk, 500.0)}
    return {f"{s}{n}": v + (side if s == "L" else -side) for n, v in places.items() for s in "LR"}


def described(**changes: Any) -> dict[str, Any]:
    markers = {"ankle": ["LANK", "RANK"], "hip": ["LHIP", "RHIP"], "shoulder": ["LSHO", "RSHO"]}
    return {
        "channels": {"stimulus": "Motor"},
        "body": BODY,
        "markers": markers | {"forward": "+x", "up": "+z"},
        **changes,
    }


@pytest.mark.parametrize(("forward", "up", "axes"), [(0, 2, ("+x", "+z")), (1, 2, ("-y", "+z")), (2, 1, ("+z", "+y"))])
def test_angles_from_markers_are_those_that_placed_the_markers(
    tmp_path: Path, forward: int, up: int, axes: tuple[str, str]
) -> None:
    torque, leg, trunk = motion()
    sign = -1.0 if axes[0][0] == "-" else 1.0
    write_c3d(tmp_path / "a.c3d", body_markers(sign * leg, sign * trunk, forward, up), {"Motor": torque}, RATE,
              analog_units=["N m"])  # fmt: skip
    sheet = described()
    sheet["markers"] |= {"forward": axes[0], "up": axes[1]}
    (trial,) = import_files([tmp_path / "a.c3d"], None, sheet).recording.trials
    np.testing.assert_allclose(trial.theta, np.column_stack([leg, trunk - leg]), atol=2e-6)


def test_markers_in_a_mat_file_are_arrays_of_three_columns(tmp_path: Path) -> None:
    torque, leg, trunk = motion()
    savemat(tmp_path / "a.mat", {"Motor": torque, "m": body_markers(leg, trunk)})
    sheet = described(rate_hz=RATE, units={"stimulus": "N m"})
    sheet["markers"] |= {"ankle": ["m.LANK", "m.RANK"], "hip": ["m.LHIP", "m.RHIP"], "shoulder": ["m.LSHO", "m.RSHO"]}
    (trial,) = import_files([tmp_path / "a.mat"], None, sheet).recording.trials
    np.testing.assert_allclose(trial.theta, np.column_stack([leg, trunk - leg]), atol=1e-12)


def test_a_marker_that_is_lost_for_a_moment_is_interpolated_only_when_allowed(tmp_path: Path) -> None:
    torque, leg, trunk = motion()
    markers = body_markers(leg, trunk)
    markers["LHIP"][500:505] = np.nan
    write_c3d(tmp_path / "a.c3d", markers, {"Motor": torque}, RATE, analog_units=["N m"])
    with pytest.raises(RecordingError, match=r"LHIP\.x: 5 of 3000 values are missing; a gap of 0\.05 s at t = 5 s"):
        import_files([tmp_path / "a.c3d"], None, described())
    (trial,) = import_files([tmp_path / "a.c3d"], None, described(fill_gaps_s=0.1)).recording.trials
    np.testing.assert_allclose(trial.theta[500:505, 0], leg[500:505], atol=2e-5)


def test_a_marker_upside_down_is_noticed(tmp_path: Path) -> None:
    torque, leg, trunk = motion()
    write_c3d(tmp_path / "a.c3d", body_markers(leg, trunk), {"Motor": torque}, RATE, analog_units=["N m"])
    sheet = described()
    sheet["markers"] |= {"up": "-z"}
    with pytest.raises(RecordingError, match="lie below LANK, RANK along -z"):
        import_files([tmp_path / "a.c3d"], None, sheet)


@pytest.mark.parametrize("rates", [(1000.0, 100.0), (1000.0, 120.0), (500.0, 200.0), (100.0, 1000.0)])
def test_resampling_keeps_what_is_below_its_band_and_its_phase(rates: tuple[float, float]) -> None:
    high, low = rates
    f = np.array([0.1, 1.0, 8.0, 0.8 * min(rates) / 2])
    t, s = np.arange(round(20 * high)) / high, np.arange(round(20 * low)) / low
    for each in f:
        found = resampled(np.sin(2 * np.pi * each * t + 0.4), high, low, "x")
        inside = slice(round(low), -round(low))  # the filter's ends
        np.testing.assert_allclose(found[inside], np.sin(2 * np.pi * each * s + 0.4)[inside], atol=1e-4)


def test_resampling_removes_what_would_fold() -> None:
    t = np.arange(20_000) / 1000
    found = resampled(np.sin(2 * np.pi * 92.0 * t), 1000.0, 100.0, "x")  # would appear at 8 Hz
    assert np.abs(found[100:-100]).max() < 1e-4


def test_a_fast_stimulus_is_brought_to_the_rate_of_the_markers_and_that_is_told(tmp_path: Path) -> None:
    torque, leg, trunk = motion()
    fast = motion(1000.0, 10 * N)[0]
    write_c3d(tmp_path / "a.c3d", body_markers(leg, trunk), {"Motor": 1e3 * fast}, RATE, analog_units=["N mm"])
    found = import_files([tmp_path / "a.c3d"], None, described())
    (trial,) = found.recording.trials
    np.testing.assert_allclose(trial.stimulus[100:-100], torque[100:-100], atol=1e-3)
    assert found.recording.rate_hz == RATE
    assert "stimulus resampled from 1000 to 100 Hz by a zero-phase FIR filter" in found.text()
    assert "stimulus resampled" in found.recording.provenance


def test_rates_without_a_simple_ratio_are_refused() -> None:
    with pytest.raises(RecordingError, match="no simple ratio"):
        resampled(np.zeros(1_000_000), 100.0, 100.0 * np.pi, "x")


def test_a_rate_that_rounded_time_stamps_give_is_resampled() -> None:
    t = np.arange(6000) / 59.94
    found = resampled(np.sin(t), 59.94 * (1 + 1e-8), 50.0, "x")
    np.testing.assert_allclose(found[200:-200], np.sin(np.arange(found.size) / 50.0)[200:-200], atol=1e-4)


def test_gaps_are_filled_up_to_the_stated_length_only() -> None:
    clean = np.sin(np.arange(300) / 20)
    gapped = clean.copy()
    gapped[[50, 51, 200]] = np.nan
    values, count = filled(gapped, 2, "x", 100.0)
    assert count == 3
    np.testing.assert_allclose(values, clean, atol=1e-3)
    for longest, bad in ((1, gapped), (5, np.append(np.nan, clean)), (5, np.append(clean, np.nan))):
        with pytest.raises(RecordingError, match="missing"):
            filled(bad, longest, "x", 100.0)


def long_record(folder: Path) -> Path:
    """Three trials of 25 s in one file of 100 s, with a trigger at their starts (10, 40 and 70 s)."""
    torque, leg, trunk = motion(n=10_000)
    trigger = np.zeros(torque.size)
    for start in (10, 40, 70):
        trigger[start * 100 : start * 100 + 50] = 5.0
    savemat(
        folder / "long.mat",
        {"u": torque, "a": leg, "b": trunk, "trigger": trigger, "onsets": np.array([10.0, 40.0, 70.0])},
    )
    return folder / "long.mat"


STARTS: dict[str, Any] = {
    "times": [10.0, 40.0, 70.0],
    "a variable": {"column": "onsets"},
    "a trigger": {"column": "trigger", "above": 2.5},
}


@pytest.mark.parametrize("how", STARTS)
def test_trials_are_cut_where_they_start(tmp_path: Path, how: str) -> None:
    sheet = {
        "rate_hz": RATE,
        "units": {"angle": "rad", "stimulus": "N m"},
        "body": BODY,
        "channels": {"stimulus": "u", "theta1": "a", "theta2": "b"},
        "split": {"starts": STARTS[how], "length_s": 25.0},
    }
    trials = import_files([long_record(tmp_path)], None, sheet).recording.trials
    torque, leg, trunk = motion(n=10_000)
    assert len(trials) == 3
    for trial, start in zip(trials, (1000, 4000, 7000), strict=True):
        own = slice(start, start + 2500)
        assert (trial.stimulus == torque[own]).all()
        assert (trial.theta == np.column_stack([leg, trunk])[own]).all()
    (last,) = import_files([tmp_path / "long.mat"], None, {**sheet, "split": {"starts": [70.0]}}).recording.trials
    assert last.samples == 3000
    with pytest.raises(RecordingError, match="the trial at 70 s ends at 110 s, after 100 s"):
        import_files([tmp_path / "long.mat"], None, {**sheet, "split": {"starts": [70.0], "length_s": 40.0}})


def test_events_of_a_c3d_file_mark_starts(tmp_path: Path) -> None:
    torque, leg, trunk = motion()
    write_c3d(tmp_path / "a.c3d", body_markers(leg, trunk), {"Motor": torque}, RATE, analog_units=["N m"],
              events={"begin": [2.0, 16.0], "other": [1.0]})  # fmt: skip
    sheet = described(split={"starts": {"column": "EVENT.begin"}, "length_s": 10.0})
    trials = import_files([tmp_path / "a.c3d"], None, sheet).recording.trials
    assert [t.samples for t in trials] == [1000, 1000]
    np.testing.assert_allclose(trials[1].stimulus, torque[1600:2600], atol=1e-5)


def test_the_command_takes_starts_and_lengths(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = "--stimulus u --theta1 a --theta2 b --rate 100 --unit rad --stimulus-unit Nm --height 1.8 --weight 75"
    starts = "--starts-in trigger --above 2.5 --length 25"
    assert main(["import", str(long_record(tmp_path)), *words.split(), *starts.split()]) == Exit.DONE
    assert "nothing written" in (out := capsys.readouterr().out)
    assert re.findall(r"^(\d) +stimulus", out, re.MULTILINE) == ["1", "2", "3"]


def test_units_that_the_file_contradicts_are_refused(tmp_path: Path) -> None:
    torque, leg, trunk = motion()
    (tmp_path / "a.csv").write_text(
        "stimulus [N m],theta1 [deg],theta2 [deg]\n"
        + "\n".join(f"{u},{a},{b}" for u, a, b in zip(torque, np.rad2deg(leg), np.rad2deg(trunk), strict=True))
    )
    sheet = {"rate_hz": RATE, "body": BODY, "units": {"angle": "rad", "stimulus": "N m"}}
    with pytest.raises(RecordingError, match="theta1: unit: declared rad, but the file states deg"):
        import_files([tmp_path / "a.csv"], None, sheet)


def test_a_map_and_options_join(tmp_path: Path) -> None:
    (tmp_path / "lab.toml").write_text(
        'rate_hz = 50\nunits = {angle = "rad", stimulus = "N m"}\nbody = {reference = "goodworth2018"}\n'
        'channels = {stimulus = "u", theta1 = "a", theta2 = "trigger"}\n'
    )
    found: Imported = import_files(
        [long_record(tmp_path)], tmp_path / "lab.toml", {"rate_hz": RATE, "channels": {"theta2": "b"}}
    )
    assert found.recording.rate_hz == RATE
    (trial,) = found.recording.trials
    assert (trial.theta[:, 1] == motion(n=10_000)[2]).all()
