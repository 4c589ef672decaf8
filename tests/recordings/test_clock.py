"""Time stamps: regular ones give a rate, others are refused with every way out, or used as the user says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mcstudy.errors import RecordingError
from mcstudy.recordings.clock import clock_of, rate_of
from mcstudy.recordings.laboratory_import import Imported, import_files

RATE, N = 100.0, 2000

TIME = np.arange(N) / RATE


def signals(t: np.ndarray) -> np.ndarray:
    """Stimulus and two angles at times (n,), of known frequencies up to 4 Hz, (n, 3)."""
    return np.column_stack(
        [
            5 * np.sin(2 * np.pi * 0.5 * t) + np.sin(2 * np.pi * 4 * t),
            0.01 * np.sin(2 * np.pi * 0.5 * t - 1),
            0.02 * np.sin(2 * np.pi * 3.1 * t),
        ]
    )


def imported(folder: Path, stamps: np.ndarray, values: np.ndarray, **options: Any) -> Imported:
    np.savetxt(
        folder / "a.csv",
        np.column_stack([stamps, values]),
        fmt="%.12g",
        delimiter=",",
        header="time,stimulus,theta1,theta2",
        comments="",
    )
    sheet = {"units": {"angle": "rad", "stimulus": "N m"}, "body": {"reference": "goodworth2018"}, **options}
    return import_files([folder / "a.csv"], None, sheet)


def jittered(sd: float, seed: int = 0) -> np.ndarray:
    return TIME + np.clip(np.random.default_rng(seed).normal(0, sd, N), -0.0045, 0.0045)


def test_the_refusal_says_how_irregular_the_clock_is_and_every_way_out(tmp_path: Path) -> None:
    stamps = jittered(1.4e-3)
    with pytest.raises(RecordingError, match=r"not uniform: gap of .* expected steps of 0\.0\d+ s") as caught:
        imported(tmp_path, stamps, signals(stamps))
    told = str(caught.value)
    assert f"their SD is {np.diff(stamps).std():.2g} s" in told
    assert all(option in told for option in ("--rate", "--resample", "rate_hz", "resample_hz"))


def test_a_stated_rate_overrides_stamps_that_scatter(tmp_path: Path) -> None:
    found = imported(tmp_path, jittered(1.4e-3), signals(TIME), rate_hz=RATE)
    (trial,) = found.recording.trials
    np.testing.assert_allclose(trial.stimulus, signals(TIME)[:, 0], atol=1e-9)
    assert "time stamps are not used, because a rate of 100 Hz is stated: not uniform" in found.text()


def test_a_stated_rate_overrides_stamps_that_come_in_bursts(tmp_path: Path) -> None:
    bursts = np.floor(np.arange(N) / 10) / 10 + 0.001 * (np.arange(N) % 10)
    found = imported(tmp_path, bursts, signals(TIME), rate_hz=RATE)
    np.testing.assert_allclose(found.recording.trials[0].theta, signals(TIME)[:, 1:], atol=1e-9)
    rounded = np.round(TIME, 1)
    found = imported(tmp_path, rounded, signals(TIME), rate_hz=RATE)
    np.testing.assert_allclose(found.recording.trials[0].theta, signals(TIME)[:, 1:], atol=1e-9)
    with pytest.raises(RecordingError, match=r"does not increase after t = 0 s .*state the rate \(rate_hz, --rate\)"):
        imported(tmp_path, rounded, signals(TIME))


def test_a_stated_rate_must_be_that_of_the_stamps_on_average(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="rate_hz: stated 90 Hz, but the time column has"):
        imported(tmp_path, jittered(1e-3), signals(TIME), rate_hz=90.0)


@pytest.mark.parametrize("sd", [1e-3, 1.4e-3])
@pytest.mark.parametrize("resample_hz", [100.0, 50.0, 120.0])
def test_stamps_that_scatter_are_followed_when_resampling(tmp_path: Path, resample_hz: float, sd: float) -> None:
    stamps = jittered(sd)
    stamps[0] = 0.0
    found = imported(tmp_path, stamps, signals(stamps), resample_hz=resample_hz)
    (trial,) = found.recording.trials
    assert found.recording.rate_hz == resample_hz
    expected = signals(np.arange(trial.samples) / resample_hz)
    inside = slice(40, -40)  # the filter's ends
    np.testing.assert_allclose(trial.stimulus[inside], expected[inside, 0], atol=5e-3)
    np.testing.assert_allclose(trial.theta[inside], expected[inside, 1:], atol=2e-5)
    assert "values interpolated by their time stamps" in found.text()


@pytest.mark.parametrize("lost", [[700], [700, 701, 1200], [3, 1996]])
@pytest.mark.parametrize("sd", [0.0, 3e-4])
def test_lost_rows_are_found_and_interpolated_on_request(tmp_path: Path, lost: list[int], sd: float) -> None:
    left = np.delete(np.arange(N), lost)
    stamps = jittered(sd)[left]
    if sd == 0:
        assert rate_of(jittered(sd), None, "x") == RATE
    words = "1 row is lost" if len(lost) == 1 else f"{len(lost)} rows are lost"
    for options in ({}, {"rate_hz": RATE}):
        with pytest.raises(RecordingError, match=rf"{words}: gap of .*--fill-gaps\) of at least 0\.0"):
            imported(tmp_path, stamps, signals(TIME)[left], **options)
    found = imported(tmp_path, stamps, signals(TIME)[left], fill_gaps_s=0.03)
    (trial,) = found.recording.trials
    assert trial.samples == N
    np.testing.assert_allclose(trial.theta, signals(TIME)[:, 1:], atol=2e-3)
    np.testing.assert_allclose(np.delete(trial.theta, lost, axis=0), signals(TIME)[left, 1:], atol=1e-9)
    assert f"{len(lost)} lost rows (longest gap" in found.text()
    assert f"{3 * len(lost)} missing, held or jumping values interpolated" in found.text()


def test_stamps_that_scatter_a_little_are_told_and_rounded_ones_are_not(tmp_path: Path) -> None:
    assert (
        "scatter by 0.001 s (SD) about a regular clock, 10 %"
        in imported(tmp_path, jittered(1e-3), signals(TIME)).text()
    )
    for rate in (60.0, 120.0, 240.0):
        stamps = np.round(np.arange(N) / rate, 3)
        for options in ({}, {"resample_hz": rate / 2}):
            found = imported(tmp_path, stamps, signals(np.arange(N) / rate), **options)
            assert "stamps" not in found.text()


def test_a_gap_longer_than_allowed_is_refused_whatever_else_is_stated(tmp_path: Path) -> None:
    left = np.delete(np.arange(N), range(500, 600))
    for options in ({"fill_gaps_s": 0.5}, {"resample_hz": 50.0}, {"rate_hz": RATE}):
        with pytest.raises(RecordingError, match=r"100 rows are lost: gap of 1\.01 s after t = 4\.99 s"):
            imported(tmp_path, TIME[left], signals(TIME)[left], **options)


def test_a_missing_value_under_scattering_stamps_stays_missing(tmp_path: Path) -> None:
    stamps = jittered(1e-3)
    values = signals(stamps)
    values[300, 1] = np.nan
    with pytest.raises(RecordingError, match=r"theta1: 2 of 2000 values are not numbers, the first at t = 3 s"):
        imported(tmp_path, stamps, values, resample_hz=RATE)
    found = imported(tmp_path, stamps, values, resample_hz=RATE, fill_gaps_s=0.05)
    np.testing.assert_allclose(found.recording.trials[0].theta[295:305, 0], signals(TIME)[295:305, 1], atol=1e-3)


def test_time_that_runs_backwards_has_no_way_in(tmp_path: Path) -> None:
    stamps = TIME.copy()
    stamps[50] = 0.3
    for options in ({}, {"rate_hz": RATE}, {"resample_hz": 50.0}):
        with pytest.raises(RecordingError, match=r"does not increase after t = 0\.49 s"):
            imported(tmp_path, stamps, signals(TIME), **options)


def test_the_rate_of_a_clock_that_lost_rows_is_that_of_all_rows() -> None:
    left = np.delete(np.arange(N), [5, 6, 1500])
    clock = clock_of(TIME[left] + 12.5, None, None, 0.1, "x")
    assert clock.rate_hz == RATE
    assert clock.rows is not None
    assert (clock.rows == left).all()
