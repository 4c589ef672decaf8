"""The same data twice are found by content; trials that only resemble each other are kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.errors import RecordingError
from mcstudy.lines.checked_recording import checked_recording
from mcstudy.lines.settings import LineSettings
from mcstudy.recordings.copies import numbered, refuse_copies
from mcstudy.recordings.recording import Recording, Trial

ONE = mc.simulate(amplitude=5.0, rate_hz=100.0, cycles=4, seed=1, name="monday")
OTHER = mc.simulate(amplitude=5.0, rate_hz=100.0, cycles=4, seed=2, name="tuesday")


def each(change: Callable[[Trial], Trial], recording: Recording = ONE) -> Recording:
    return replace(recording, trials=tuple(map(change, recording.trials)))


def rounded(x: np.ndarray, step_deg: float) -> np.ndarray:
    q = np.deg2rad(step_deg)
    return np.asarray(np.round(x / q) * q)


@pytest.mark.parametrize(
    "copy",
    [
        replace(ONE, name="other", person="p", condition="c", provenance="by hand"),
        each(lambda t: replace(t, theta=t.theta.astype("f4").astype(float))),
        each(lambda t: replace(t, theta=rounded(t.theta, 0.01))),
        each(lambda t: replace(t, theta=t.theta + 0.02)),
        each(lambda t: replace(t, theta=t.theta + np.linspace(0, 0.002, t.samples)[:, None])),
        each(lambda t: Trial(t.stimulus[7:], t.theta[7:])),
        each(lambda t: Trial(t.stimulus[4372:], t.theta[4372:])),
        replace(each(lambda t: Trial(t.stimulus[::2], t.theta[::2])), rate_hz=50.0),
    ],
    ids=[
        "other metadata",
        "single precision",
        "rounded",
        "offset",
        "trend",
        "cut by 7 samples",
        "cut by a cycle",
        "half the rate",
    ],
)
def test_a_copy_is_found_by_its_content(copy: Recording) -> None:
    with pytest.raises(RecordingError, match=r"recording 2 \(.*\): holds the same data as recording 1 \(monday\)"):
        refuse_copies(numbered([ONE, copy]))


@pytest.mark.parametrize("noise", [0.03, 0.3, 1.0])
def test_two_trials_under_one_stimulus_are_no_copies(noise: float) -> None:
    two = mc.simulate(amplitude=(5.0, 5.0, 4.0), rate_hz=50.0, cycles=4, noise=noise, seed=3)
    refuse_copies(numbered([two, mc.simulate(amplitude=5.0, rate_hz=50.0, cycles=4, noise=noise, seed=4)]))


def test_a_fit_of_copies_and_of_equal_trials_is_refused() -> None:
    with pytest.raises(RecordingError, match="holds the same data"):
        checked_recording([ONE, OTHER, replace(ONE, name="copy")])
    with pytest.raises(RecordingError, match="monday, trial 2: holds the same data as monday, trial 1"):
        checked_recording(replace(ONE, trials=ONE.trials * 2))
    lines = checked_recording([ONE, OTHER]).lines
    assert len(lines.repeats) == 6
    twice = checked_recording([ONE, ONE], LineSettings(accept=["copy"])).lines
    assert len(twice.repeats) == 6


def test_people_who_share_a_file_or_its_content_are_refused(tmp_path: Path) -> None:
    paths = [mc.write_recording(r, tmp_path / f"{k}.nc") for k, r in enumerate((ONE, OTHER, ONE))]
    with pytest.raises(RecordingError, match=r"2.nc \(c\): holds the same data as .*0.nc \(a\)"):
        mc.fit_group(paths, person=["a", "b", "c"])
    with pytest.raises(RecordingError, match=r"0.nc \(b\): the same file as .*0.nc \(a\)"):
        mc.fit_group([paths[0], paths[0]], person=["a", "b"])


def test_groups_that_share_a_person_are_not_compared() -> None:
    with pytest.raises(RecordingError, match="b: other: holds the same data as a: monday"):
        mc.compare([ONE, OTHER], [replace(ONE, name="other")])


def test_a_response_that_is_published_twice_is_a_copy() -> None:
    f = np.array([0.1, 0.2, 0.5, 1.0])
    C = np.tile(1e-6 * np.eye(2, dtype=complex), (4, 1, 1))
    first = mc.FrfRecording(f, np.full((4, 2), 0.01 + 0.01j), C, name="a")
    with pytest.raises(RecordingError, match=r"recording 2 \(b\): holds the same data as recording 1 \(a\)"):
        refuse_copies(numbered([first, replace(first, y=first.y * 1.0001, name="b")]))
    refuse_copies(numbered([first, replace(first, y=first.y + 1e-3, name="b")]))
