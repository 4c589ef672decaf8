"""A recording: one or more trials of a known stimulus and two sway angles, and the body that swayed.

Inside the program angles are rad, the stimulus is in the unit of its kind (`mcstudy.stance.body.STIMULI`), and the
columns of ``theta`` are the joint angles (theta1, theta2): lower body in space and hip. The reading functions are in
`mcstudy.gap.read`; what makes a recording usable is checked in `mcstudy.gap.checks`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.stance.body import STIMULI, Body, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.stimulus import CONVENTIONS

MINIMUM_CYCLES = 3
"""Fewest periods of a periodic stimulus that can be analysed (one is lost to the transient)."""


@dataclass(frozen=True)
class Suspicion:
    """Something about a recording that may be wrong and must not be explained by physiology.

    Attributes
    ----------
    code: what, in one word: "swapped", "degrees", "radians", "sign", "space_angle", "amplitude", "stuck", ...
    channel: the field it is about.
    message: one line for people.
    odds: natural logarithm of the odds against the recording as labelled; inf when it is certain.
    """

    code: str
    channel: str
    message: str
    odds: float = math.inf


@dataclass(frozen=True)
class Trial:
    """One uninterrupted record.

    Attributes
    ----------
    stimulus: (n,) in the unit of its kind; theta: (n, 2) joint angles, rad.
    amplitude: amplitude as stated for the trial, in the unit of the stimulus, or None.
    """

    stimulus: np.ndarray
    theta: np.ndarray
    amplitude: float | None = None

    @property
    def samples(self) -> int:
        """Number of samples, n."""
        return int(self.stimulus.shape[0])

    @cached_property
    def peak(self) -> float:
        """Half the distance between the extremes of the stimulus: its amplitude read as a peak."""
        return float(np.ptp(self.stimulus) / 2)


@dataclass(frozen=True)
class Recording:
    """Trials of one person with one kind of stimulus.

    Attributes
    ----------
    trials: at least one.
    rate_hz: sampling rate of every trial, Hz.
    period_s: period of the stimulus, s; None when it is not periodic.
    stimulus: kind of stimulus, a key of `mcstudy.stance.body.STIMULI`.
    body: inertia and gravity of the person.
    convention: how the trials' amplitudes are to be read, "peak" or "peak_to_peak".
    name, provenance: for people.
    suspicions: what the checks did not like but could not prove; see `mcstudy.gap.checks`.

    Raises `RecordingError` when shapes or fields contradict each other.
    """

    trials: tuple[Trial, ...]
    rate_hz: float
    period_s: float | None
    stimulus: str = "ankle_torque"
    body: Body = field(default_factory=Body)
    convention: str = "peak"
    name: str = "recording"
    provenance: str = ""
    suspicions: tuple[Suspicion, ...] = ()

    def __post_init__(self) -> None:
        if not self.trials:
            raise RecordingError(f"{self.name}: trials: expected at least one")
        if self.stimulus not in STIMULI:
            raise RecordingError(
                f"{self.name}: stimulus kind: expected one of {', '.join(STIMULI)}, got {self.stimulus!r}"
            )
        if self.convention not in CONVENTIONS:
            raise RecordingError(
                f"{self.name}: convention: expected one of {', '.join(CONVENTIONS)}, got {self.convention!r}"
            )
        for label, value in (("rate_hz", self.rate_hz), ("period_s", self.period_s)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise RecordingError(f"{self.name}: {label}: expected a positive number, got {value!r}")
        for k, trial in enumerate(self.trials, start=1):
            if trial.stimulus.ndim != 1 or trial.theta.shape != (trial.samples, 2):
                raise RecordingError(
                    f"{self.name}: trial {k}: expected a stimulus (n,) and angles (n, 2), "
                    f"got {trial.stimulus.shape} and {trial.theta.shape}"
                )

    @property
    def stimulus_unit(self) -> str:
        """Unit of the stimulus."""
        return STIMULI[self.stimulus]

    @property
    def period(self) -> int | None:
        """Samples in a period, None when the stimulus is not periodic; `RecordingError` when it is not whole."""
        if self.period_s is None:
            return None
        samples = self.period_s * self.rate_hz
        if abs(samples - round(samples)) > 0.01 or round(samples) < 2:
            raise RecordingError(
                f"{self.name}: period_s: {self.period_s:g} s is {samples:.3f} samples at {self.rate_hz:g} Hz; "
                "expected a whole number"
            )
        return round(samples)

    @property
    def cycles(self) -> tuple[int, ...]:
        """Whole periods in every trial; zeros when the stimulus is not periodic."""
        period = self.period
        return tuple(t.samples // period if period else 0 for t in self.trials)

    @property
    def duration_s(self) -> float:
        """Total duration, s."""
        return sum(t.samples for t in self.trials) / self.rate_hz

    @property
    def amplitudes(self) -> np.ndarray:
        """Amplitude of every trial as a peak, in the unit of the stimulus, (trials,), from the waveform itself."""
        return np.array([t.peak for t in self.trials])

    def base_model(self) -> Model:
        """The 12-parameter model on this body and stimulus, its gains scaled to the body's weight.

        Gains and their bounds are those of `two_segment` times the ratio of m g h to the paper's.
        """
        model = two_segment(self.body, self.stimulus)
        ratio = self.body.mgh / Body().mgh
        scaled = tuple(
            p
            if p.name in model.delays
            else replace(p, value=p.value * ratio, lower=p.lower * ratio, upper=p.upper * ratio)
            for p in model.parameters
        )
        return replace(model, parameters=scaled)

    def select(self, trials: tuple[int, ...]) -> Recording:
        """The recording with some of its trials."""
        return replace(self, trials=tuple(self.trials[k] for k in trials))
