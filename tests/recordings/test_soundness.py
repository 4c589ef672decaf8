"""Dropouts, spikes, steps, clipped angles and stimuli that stop are found, told, left out or filled."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import mcstudy as mc
from mcstudy.errors import RecordingError
from mcstudy.lines.checked_recording import checked_recording
from mcstudy.lines.settings import LineSettings
from mcstudy.recordings.checks import check
from mcstudy.recordings.faults import Fault, angle_faults, stimulus_faults
from mcstudy.recordings.recording import Recording, Trial
from mcstudy.recordings.soundness import fill_gaps, with_left_out

SOUND = mc.simulate(amplitude=(5.0, 5.0), rate_hz=100.0, cycles=4, seed=11)
APERIODIC = mc.simulate(amplitude=5.0, rate_hz=100.0, cycles=4, periodic=False, seed=5)
PERIOD = 4372


def changed(change: Callable[[Trial], object], recording: Recording = SOUND) -> Recording:
    """The recording whose first trial is changed in place."""
    first = recording.trials[0]
    own = Trial(first.stimulus.copy(), first.theta.copy(), first.amplitude)
    change(own)
    return replace(recording, trials=(own, *recording.trials[1:]))


def zero(theta: np.ndarray, start: int, n: int = 30) -> None:
    theta[start : start + n] = 0.0


def messages(recording: Recording) -> list[str]:
    return [s.message.partition("trial 1: ")[2] for s in check(recording)]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: zero(t.theta, 6000), "theta1, theta2: is exactly 0 for 0.3 s at t = 60 s"),
        (
            lambda t: [zero(t.theta, k) for k in range(5000, 8000, 1000)],
            "is exactly 0 3 times, 0.9 s in all .*at most 0.3 s",
        ),
        (lambda t: t.theta[6000:6100, 0].fill(t.theta[6000, 0]), "theta1: is constant for 1 s at t = 60 s"),
        (lambda t: t.theta[6000:6001, 1].__iadd__(np.deg2rad(3)), "theta2: jumps by 3 deg and back at t = 60 s"),
        (lambda t: t.theta[6000:, 0].__iadd__(np.deg2rad(5)), "theta1: steps by 5 deg and stays there"),
        (
            lambda t: np.clip(t.theta[:, 0], None, 0.6 * t.theta[:, 0].max(), out=t.theta[:, 0]),
            "theta1: .*clipped.* times",
        ),
        (lambda t: t.stimulus[15000:].fill(0.0), "stimulus: stops, at 0 N m, for 2[45] s"),
        (lambda t: t.stimulus[6000:6700].fill(0.0), "stimulus: is constant .* unlike in other cycles"),
        (lambda t: t.stimulus[6000:6700].__imul__(-1), "stimulus: differs from its other cycles"),
    ],
)
def test_a_fault_is_found_and_told(change: Callable[[Trial], object], message: str) -> None:
    found = messages(changed(change))
    assert len(found) == 1
    assert re.search(message, found[0]), found[0]


@pytest.mark.parametrize("step_deg", [0.001, 0.01, 0.05, 0.1, 90 / 4096])
@pytest.mark.parametrize("every", [1, 3])
def test_coarse_resolution_and_repeated_samples_are_no_faults(step_deg: float, every: int) -> None:
    q = np.deg2rad(step_deg)
    for trial in (*SOUND.trials, *APERIODIC.trials):
        for x in trial.theta.T:
            assert angle_faults(np.repeat(np.round(x[::every] / q) * q, every), 100.0) == ()


@pytest.mark.parametrize(
    ("kind", "amplitude"), [("platform_translation", 0.02), ("surface_tilt", 0.035), ("visual_tilt", 0.01)]
)
@pytest.mark.parametrize("noise", [0.1, 3.0])
def test_sound_recordings_have_no_faults(kind: str, amplitude: float, noise: float) -> None:
    recording = mc.simulate(stimulus=kind, amplitude=amplitude, rate_hz=50.0, cycles=3, noise=noise, seed=2)
    assert check(recording) == ()


def test_a_stimulus_that_is_constant_by_design_is_sound() -> None:
    """A PRTS of the platform holds its position in a third of its states."""
    u = SOUND.trials[0].stimulus
    assert (np.diff(u) == 0).mean() > 0.2
    assert stimulus_faults(u, PERIOD, 100.0) == ()


def test_a_wrong_period_is_no_stimulus_that_stops() -> None:
    assert stimulus_faults(SOUND.trials[0].stimulus, 4100, 100.0) == ()
    with pytest.raises(RecordingError, match=r"does not repeat every 41 s .*it repeats every 43.72 s"):
        check(replace(SOUND, period_s=41.0))


def test_cycles_with_a_fault_are_left_out_and_named() -> None:
    bad = changed(lambda t: zero(t.theta, 6000))
    checked = checked_recording(bad)
    one, lines = checked.recording, checked.lines
    assert one.trials[0].left_out == (1,)
    assert list(zip(lines.trial, lines.cycle, strict=True)) == [(0, 2), (0, 3), (1, 1), (1, 2), (1, 3)]
    assert "left out because a signal is unsound: cycle 2 of 4 of trial 1" in lines.notes
    kept = checked_recording(bad, LineSettings(accept=["stuck"])).lines
    assert len(kept.repeats) == 6


def test_samples_just_before_a_cycle_belong_to_it() -> None:
    assert with_left_out(changed(lambda t: t.theta[2 * PERIOD - 2 : 2 * PERIOD - 1].__iadd__(0.1))).trials[
        0
    ].left_out == (
        1,
        2,
    )


def test_what_follows_a_stimulus_that_failed_is_left_out_too() -> None:
    assert with_left_out(changed(lambda t: t.stimulus[6000:6700].fill(0.0))).trials[0].left_out == (1, 2)


def test_a_trial_without_two_sound_cycles_is_left_out_as_a_whole() -> None:
    bad = changed(lambda t: [zero(t.theta, k * PERIOD + 500) for k in (1, 2)])
    lines = checked_recording(bad).lines
    assert set(lines.trial) == {1}
    assert "left out because a signal is unsound: trial 1 as a whole" in lines.notes


def test_a_recording_without_sound_cycles_is_refused_with_the_way_on() -> None:
    bad = changed(lambda t: [zero(t.theta, k * PERIOD + 500) for k in (1, 2)], SOUND.select((0,)))
    with pytest.raises(RecordingError, match=r"is exactly 0 2 times.*--fill-gaps 0.3.*accept 'stuck'"):
        checked_recording(bad)
    with pytest.raises(RecordingError, match=r"no cycles that could be left out; to interpolate.*fill_gaps"):
        checked_recording(changed(lambda t: zero(t.theta, 6000), APERIODIC))


def test_filled_gaps_give_the_estimates_of_the_sound_recording() -> None:
    bad = changed(lambda t: [zero(t.theta, k) for k in range(4600, 17000, 500)], SOUND.select((0,)))
    whole = fill_gaps(bad, 0.3)
    assert check(whole) == ()
    assert "1500 values" in whole.provenance
    error = np.abs(whole.trials[0].theta - SOUND.trials[0].theta).max()
    assert error < 0.1 * np.ptp(SOUND.trials[0].theta)
    y, truth = (checked_recording(r).lines for r in (whole, SOUND.select((0,))))
    low = y.f < 0.5
    assert np.linalg.norm(y.y[low] - truth.y[low]) < 0.05 * np.linalg.norm(truth.y[low])


def test_longer_gaps_and_steps_are_not_filled() -> None:
    long = changed(lambda t: zero(t.theta, 6000, 40))
    assert fill_gaps(long, 0.3) is long
    moved = changed(lambda t: t.theta[6000:, 0].__iadd__(np.deg2rad(5)))
    assert fill_gaps(moved, 10.0) is moved


def test_a_fault_is_where_it_was_made() -> None:
    x = SOUND.trials[0].theta[:, 0].copy()
    x[7000:7030] = 0.0
    x[9000] += 0.05
    found = angle_faults(x, 100.0)
    assert [(f.start, f.stop, f.kind) for f in found] == [(7000, 7030, "held"), (9000, 9001, "spike")]
    assert isinstance(found[0], Fault)


def test_import_fills_gaps_before_it_resamples(tmp_path: Path) -> None:
    bad = changed(lambda t: [zero(t.theta, k) for k in range(4600, 17000, 500)], SOUND.select((0,)))
    folder = mc.write_recording(bad, tmp_path / "rec")
    fields: dict[str, Any] = {
        "units": {"angle": "deg", "stimulus": "N m"},
        "period_s": 43.72,
        "body": {"reference": "goodworth2018"},
        "resample_hz": 50.0,
    }
    with pytest.raises(RecordingError, match=r"theta1: 25 gaps or jumps .*resampling would spread; .*--fill-gaps 0.3"):
        mc.import_recording(folder.parent / "trial1.csv", **fields)
    whole = mc.import_recording(folder.parent / "trial1.csv", fill_gaps_s=0.3, **fields)
    assert whole.suspicions == ()
    assert "1500 missing, held or jumping values interpolated" in whole.provenance


def test_the_fit_and_the_diagnosis_say_what_was_left_out() -> None:
    bad = changed(lambda t: zero(t.theta, 6000))
    told = mc.diagnose(bad, fast=True, fmax=3.0).to_dict()["warnings"]
    assert any("is exactly 0 for 0.3 s" in w for w in told)
    assert any("cycle 2 of 4 of trial 1" in w for w in told)


def test_a_quiet_start_is_no_fault_unless_the_first_cycle_is_analysed() -> None:
    """With three cycles, of which the first is transient, two are left."""
    period = SOUND.period
    assert period is not None

    def start(trial: Trial) -> None:
        trial.stimulus[:300] = 0.0

    quiet = changed(start)
    assert messages(quiet) == []
    assert with_left_out(quiet).trials[0].left_out == ()
    assert with_left_out(quiet, discard=0).trials[0].left_out[0] == 0


def test_a_lost_value_far_outside_does_not_hide_itself() -> None:
    x = np.sin(np.arange(4000) / 40) + 0.01 * np.random.default_rng(1).standard_normal(4000)
    x[2000:2030] = 1e6
    assert [(f.kind, f.start, f.stop) for f in angle_faults(x, 100.0)] == [("held", 2000, 2030)]


def test_a_slow_turn_sampled_fast_is_not_held() -> None:
    """Near a turning point steps are smaller than single precision keeps, and yet the angle moves."""
    t = np.arange(0, 40, 0.01)
    slow = CubicSpline(t, 0.02 * np.sin(t) + 1e-5 * np.random.default_rng(2).standard_normal(t.size))
    assert angle_faults(slow(np.arange(0, 39.9, 1 / 5000)), 5000.0) == ()


def test_a_period_that_is_not_whole_names_a_rate() -> None:
    with pytest.raises(RecordingError, match=r"--resample 50\)"):
        _ = replace(SOUND, rate_hz=60.0, period_s=43.72).period
