"""A recording: one or more trials with a known stimulus and what was measured, and the body of the person.

Inside the program angles of a standing body are in rad, the stimulus is in the unit of its kind
(`mcstudy.stance.body.STIMULI`), and the columns of ``theta`` are the joint angles: lower body in space and hip. Those
of a declared model are its outputs, in its units (`mcstudy.recordings.columns`). `mcstudy.recordings.io` reads and
writes recordings; `mcstudy.recordings.checks` checks them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.columns import Columns
from mcstudy.recordings.refusals import require_known, require_within
from mcstudy.short_repr import Summary, shortened
from mcstudy.stance.body import STIMULI, Body, two_segment, with_scaled_gains
from mcstudy.stance.feedback import Model
from mcstudy.stance.ranges import LARGEST_TILT, Range
from mcstudy.stance.stimulus import CONVENTIONS
from mcstudy.text_tables import escaped

EXPECTED = (
    "expected a recording (a stimulus and two sway angles over time): .nc, .zarr, or a .toml that describes .csv "
    "files; to read a laboratory's files (.mat, .c3d, .csv): mcstudy import; to simulate one: mcstudy simulate"
)
"""What a recording is, for somebody who gave something else."""

MINIMUM_CYCLES = 3
"""Fewest periods of a periodic stimulus that can be analysed (one is lost to the transient)."""

LEAST_CYCLES = 2
"""Fewest cycles of a trial that are analysed."""

LEAST_LINES = 4
"""Fewest lines that can be analysed."""

MOST_TRIALS = 1000
"""Most trials of a recording; a body does not stay in one state for more."""

MOST_SAMPLES = 20_000_000
"""Most samples of a recording over all trials, more than a day at 200 Hz."""

MOST_CYCLES = 1000
"""Most periods of a trial. The noise is well known from so many, and computing time grows with their cube."""

MOST_CYCLES_IN_ALL = 10_000
"""Most periods of a recording."""

RATE_HZ = Range(1.0, 1e5, "Hz")
"""Sampling rates."""

PERIOD_S = Range(0.1, 1e5, "s")
"""Periods of a stimulus."""

AMPLITUDE = {
    "N m": Range(1e-4, 600.0, "N m"),
    "m": Range(1e-6, 2.0, "m"),
    "rad": Range(1e-6, 2 * LARGEST_TILT, "rad"),
}
"""Range of the stated amplitude of a trial by unit of the stimulus; a peak-to-peak value may be twice a peak."""

ANY_AMPLITUDE = Range(1e-30, 1e30)
"""The same for a declared model, whose unit may be any."""


@dataclass(frozen=True)
class Suspicion:
    """A possible error in a recording, which must not be interpreted as physiology.

    Attributes
    ----------
    code
        Kind of error in one word: "swapped", "degrees", "radians", "sign", "space_angle", "amplitude", "stuck", ...
    channel
        The field concerned.
    message
        One line of text.
    odds
        Natural logarithm of the odds against the labels as given; inf when the error is certain.
    """

    code: str
    channel: str
    message: str
    odds: float = math.inf


@dataclass(frozen=True, repr=False)
class Trial(Summary):
    """One uninterrupted record.

    Attributes
    ----------
    stimulus
        (n,), in the unit of its kind: N m, m for a translation, rad for a tilt.
    theta
        (n, Y), what was measured: of a standing body its two angles in rad, the lower body in space and the hip; of a
        declared model its outputs.
    amplitude
        Amplitude as stated for the trial, in the unit of the stimulus, or None.
    left_out
        Cycles, from 0, that are not analysed because a signal is unsound in them (`mcstudy.recordings.soundness`).
    """

    stimulus: np.ndarray
    theta: np.ndarray
    amplitude: float | None = None
    left_out: tuple[int, ...] = ()

    @property
    def samples(self) -> int:
        """Number of samples, n."""
        return int(self.stimulus.shape[0])

    @cached_property
    def peak(self) -> float:
        """Half the range of the stimulus, which is its amplitude as a peak value."""
        return float(np.ptp(self.stimulus) / 2)

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        sway = np.ptp(self.theta, axis=0) / 2 if self.samples else np.full(self.theta.shape[1:], np.nan)
        peak = self.peak if self.samples else np.nan
        return [
            ("samples", str(self.samples)),
            (
                "stimulus",
                f"±{peak:.4g}, stated amplitude {'none' if self.amplitude is None else f'{self.amplitude:g}'}",
            ),
            ("measured", ", ".join(f"±{x:.3g}" for x in sway)),
        ]


def escape_texts(record: Any, *names: str) -> None:
    """Escape what a terminal or a file cannot hold in the texts of a frozen ``record``, which may be file names."""
    for name in names:
        object.__setattr__(record, name, escaped(getattr(record, name)))


def sentences(*texts: str) -> str:
    """Texts as one, without the empty ones."""
    return "; ".join(filter(None, texts))


def refuse_size(trials: int, samples: int, where: str) -> None:
    """Raise `RecordingError` for more trials or samples than a recording may have."""
    if trials > MOST_TRIALS:
        raise RecordingError(f"{where}: trials: expected at most {MOST_TRIALS}, got {trials}")
    if samples > MOST_SAMPLES:
        raise RecordingError(f"{where}: trials: expected at most {MOST_SAMPLES} samples in all, got {samples}")


@dataclass(frozen=True, repr=False)
class Recording(Summary):
    """Trials of one person with one kind of stimulus.

    Attributes
    ----------
    trials
        At least one `Trial`.
    rate_hz
        Sampling rate of every trial, Hz.
    period_s
        Period of the stimulus, s; None when it is not periodic.
    stimulus
        Kind of stimulus: ``"ankle_torque"`` (N m), ``"hip_torque"`` (N m), ``"platform_translation"`` (m),
        ``"surface_tilt"`` or ``"visual_tilt"`` (rad).
    body
        Inertia and gravity of the person.
    convention
        Meaning of the trials' amplitudes, ``"peak"`` or ``"peak_to_peak"``.
    name, provenance
        Text for people.
    suspicions
        Possible errors that the checks found but could not prove.
    person, condition
        Who was recorded and in which condition, for groups of people; empty when not stated.
    model
        The declared model whose outputs were measured; None for a standing body. With a model, ``body`` and the kind of
        stimulus have no meaning.
    constants
        Numbers of the person that the declared model took in place of its own, such as ``{"J": 66.0, "mgh": 610.7}``;
        another model that is given by its name takes them, too.

    Raises
    ------
    RecordingError
        Shapes or fields contradict each other, or a value is outside its range.
    """

    trials: tuple[Trial, ...]
    rate_hz: float = field(metadata={"within": RATE_HZ})
    period_s: float | None = field(metadata={"within": PERIOD_S})
    stimulus: str = "ankle_torque"
    body: Body = field(default_factory=Body)
    convention: str = "peak"
    name: str = "recording"
    provenance: str = ""
    suspicions: tuple[Suspicion, ...] = ()
    person: str = ""
    condition: str = ""
    model: Model | None = None
    constants: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        escape_texts(self, "name", "provenance", "person", "condition")
        if not self.trials:
            raise RecordingError(f"{self.name}: trials: expected at least one")
        if self.model is None:
            require_known(self.stimulus, STIMULI, f"{self.name}: stimulus kind")
        else:
            object.__setattr__(self, "stimulus", "stimulus")
        require_known(self.convention, CONVENTIONS, f"{self.name}: convention")
        refuse_size(len(self.trials), sum(t.samples for t in self.trials), self.name)
        for f in fields(self):
            if "within" in f.metadata:
                require_within(f.metadata["within"], getattr(self, f.name), f"{self.name}: {f.name}")
        for k, trial in enumerate(self.trials, start=1):
            allowed = AMPLITUDE[self.stimulus_unit] if self.model is None else ANY_AMPLITUDE
            require_within(allowed, trial.amplitude, f"{self.name}: trial {k}: amplitude")
            measured = len(self.columns.outputs)
            if trial.stimulus.ndim != 1 or trial.theta.shape != (trial.samples, measured):
                what = "angles" if self.model is None else self.columns.names
                raise RecordingError(
                    f"{self.name}: trial {k}: expected a stimulus (n,) and {what} (n, {measured}), "
                    f"got {trial.stimulus.shape} and {trial.theta.shape}"
                )

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        period = "not periodic" if self.period_s is None else f"period {self.period_s:g} s"
        noted = "; ".join(s.message for s in self.suspicions)
        facts = [
            ("name", shortened(self.name)),
            ("stimulus", f"{self.stimulus} ({self.stimulus_unit}), {period}, amplitudes stated as {self.convention}"),
            ("trials", f"{len(self.trials)}, {self.duration_s:g} s in all at {self.rate_hz:g} Hz"),
            ("amplitudes", f"{spread(self.amplitudes)} {self.stimulus_unit} (peak)"),
            told_subject(self),
        ]
        facts += [("provenance", shortened(self.provenance))] if self.provenance else []
        facts += [(n, shortened(t)) for n, t in (("person", self.person), ("condition", self.condition)) if t]
        return facts + ([("odd", shortened(noted, 600))] if noted else [])

    @property
    def columns(self) -> Columns:
        """Names and units of what was measured, and the unit of the stimulus."""
        return Columns.of(self.model, self.stimulus)

    @property
    def stimulus_unit(self) -> str:
        """Unit of the stimulus."""
        return self.columns.stimulus_unit

    @property
    def period(self) -> int | None:
        """Samples in a period, None when the stimulus is not periodic; `RecordingError` when it is not whole."""
        if self.period_s is None:
            return None
        samples = self.period_s * self.rate_hz
        if abs(samples - round(samples)) > 0.01 or round(samples) < 2:
            raise RecordingError(
                f"{self.name}: period_s: {self.period_s:g} s is {samples:.3f} samples at {self.rate_hz:g} Hz; "
                f"expected a whole number{self._rate_of_whole_samples(samples)}"
            )
        return round(samples)

    def _rate_of_whole_samples(self, samples: float) -> str:
        """The way on where a period is not a whole number of ``samples``: the next lower rate with whole ones."""
        seconds = samples / self.rate_hz
        for rate in range(int(self.rate_hz), int(max(self.rate_hz / 2, RATE_HZ.low)), -1):
            if abs(seconds * rate - round(seconds * rate)) < 1e-6 and round(seconds * rate) >= 2:
                return f"; resample the recording to {rate} Hz (resample_hz, --resample {rate})"
        return "; resample the recording to a multiple of the frequency of the stimulus (resample_hz, --resample)"

    @property
    def cycles(self) -> tuple[int, ...]:
        """Whole periods in every trial; zeros when the stimulus is not periodic."""
        period = self.period
        return tuple(t.samples // period if period else 0 for t in self.trials)

    def analysed(self, discard: int) -> tuple[tuple[int, ...], ...]:
        """Cycles of every trial, from 0, without the first ``discard`` and those left out."""
        return tuple(
            tuple(c for c in range(discard, n) if c not in t.left_out)
            for t, n in zip(self.trials, self.cycles, strict=True)
        )

    @property
    def duration_s(self) -> float:
        """Total duration, s."""
        return sum(t.samples for t in self.trials) / self.rate_hz

    @property
    def amplitudes(self) -> np.ndarray:
        """Amplitude of every trial as a peak, in the unit of the stimulus, (trials,), from the waveform itself."""
        return np.array([t.peak for t in self.trials])

    def base_model(self) -> Model:
        """The declared model, or that on this body and stimulus, its gains scaled to the body's weight.

        Gains and their bounds are those of `two_segment` times the ratio of m g h to the paper's.
        """
        if self.model is not None:
            return self.model
        return with_scaled_gains(two_segment(self.body, self.stimulus), self.body.mgh / Body().mgh)

    def with_columns(self, model: Model, at: Sequence[int], factor: np.ndarray, drive: float) -> Self:
        """The same as a recording of a declared model: its outputs (Y,) are the columns ``at`` times a ``factor``.

        ``drive``: factor of the stimulus.
        """
        trials = tuple(
            replace(
                t,
                stimulus=t.stimulus * drive,
                theta=t.theta[:, list(at)] * factor,
                amplitude=None if t.amplitude is None else t.amplitude * drive,
            )
            for t in self.trials
        )
        return replace(self, trials=trials, model=model)

    def select(self, trials: tuple[int, ...]) -> Recording:
        """The recording with some of its trials, given by their positions, (0, 2) for the first and third."""
        return replace(self, trials=tuple(self.trials[k] for k in trials))


def told_subject(recording: Any) -> tuple[str, str]:
    """What a prompt shows of the body, or of the declared model, of a recording."""
    if recording.model is None:
        return "body", f"m g h = {recording.body.mgh:.4g} N m/rad"
    told = f"{recording.model.name}: {recording.columns.names} ({recording.columns.unit})"
    return "model", "; ".join([told, *(f"{n} = {x:.4g}" for n, x in recording.constants.items())])


def spread(values: Iterable[float]) -> str:
    """Values by their range: "3 to 5", or "5" when all are equal to four digits."""
    texts = [f"{v:.4g}" for v in sorted(values)]
    return texts[0] if len(set(texts)) == 1 else f"{texts[0]} to {texts[-1]}"
