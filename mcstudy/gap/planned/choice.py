"""Which trial to record next: possible trials, ranked by what they are expected to tell of the cause."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.errors import InputError
from mcstudy.fitting.penalised import Data, Fitted
from mcstudy.gap.diagnosis import Diagnosis
from mcstudy.gap.planned.gain import Told, told
from mcstudy.gap.planned.predictions import Belief, Recorded, moved, predictions
from mcstudy.gap.planned.trials import SPECTRA, PlannedTrial, SwayNoise
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.joint import JointRecording
from mcstudy.recordings.recording import AMPLITUDE
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import STIMULI
from mcstudy.stance.joint import under
from mcstudy.streams import stream

KINDS = ("ankle_torque", "hip_torque", "platform_translation")
"""Kinds of stimulus that are considered unless others are named, beside those recorded."""

TRIALS = (1, 2)
"""Numbers of trials that are considered unless others are named."""

CYCLES = 6
"""Periods of a planned trial."""

ALIKE = 0.02
"""Difference of expected information, bits, below which trials count as equally informative."""

DIGITS = 2
"""Significant digits of an amplitude that is chosen."""


@dataclass(frozen=True)
class Option:
    """A possible trial.

    Attributes
    ----------
    trial
        The trial (`PlannedTrial`).
    told
        What is expected after it (`Told`).
    """

    trial: PlannedTrial
    told: Told


@dataclass(frozen=True)
class Situation:
    """What is known before the trial: causes, noise, the model on its body, and how far the person sways."""

    belief: Belief
    noise: SwayNoise
    recorded: Recorded
    sway: np.ndarray
    amplitudes: Mapping[str, float]
    fmax: float

    @classmethod
    def of(cls, d: Diagnosis) -> Situation:
        """From a diagnosis of recordings; raises `InputError` for one of lines or of published responses."""
        recording = d.recording
        if recording is None or isinstance(recording, FrfRecording):
            raise InputError(f"{d.name}: expected recordings of sway over time, whose noise a new trial would have")
        parts = recording.parts if isinstance(recording, JointRecording) else (recording,)
        belief = Belief.of(d.hypotheses, d.unknown_probability, d.base, Data.of(d.lines))
        return cls(
            belief,
            SwayNoise.of(d.lines, d.name),
            Recorded(d.base, d.lines, recording.body, tuple(p.stimulus for p in parts)),
            np.max([_sway(part.lines, part.base) for part in d.parts], axis=0),
            {p.stimulus: float(np.median(p.amplitudes)) for p in parts},
            float(d.method["fmax"]),
        )

    def amplitude(self, kind: str, spectrum: str) -> float:
        """The recorded amplitude of a kind, else one that evokes no more sway of any angle than was recorded."""
        if kind in self.amplitudes and spectrum == "prts":
            return self.amplitudes[kind]
        unit = PlannedTrial(kind, 1.0, spectrum, 1, CYCLES, 1, self.fmax)
        base = moved(self.recorded.base, under(self.recorded.base.model, kind, self.recorded.body))[0]
        evoked = _rms(np.abs(unit.drive) ** 2, base.response(unit.f))
        most = float((self.sway / evoked).min())
        step = 10.0 ** (np.floor(np.log10(most)) + 1 - DIGITS)
        allowed = AMPLITUDE[STIMULI[kind]]
        return float(np.clip(round(np.floor(most / step) * step, 12), allowed.low, allowed.high))


def _sway(lines: Lines, base: Fitted) -> np.ndarray:
    return _rms(lines.power, base.response(lines.f))


def _rms(power: np.ndarray, response: np.ndarray) -> np.ndarray:
    """RMS sway (2,), rad, that a stimulus evokes."""
    return np.asarray(np.sqrt(2 * power @ np.abs(response) ** 2))


def possible_trials(
    now: Situation,
    kinds: Sequence[str] = (),
    amplitudes: Mapping[str, Sequence[float]] | None = None,
    spectra: Sequence[str] = SPECTRA,
    trials: Sequence[int] = TRIALS,
    cycles: int = CYCLES,
) -> list[PlannedTrial]:
    """Trials that could be recorded; raises `InputError` for a kind, amplitude, spectrum or number that cannot."""
    chosen = tuple(kinds) or tuple(dict.fromkeys((*KINDS, *now.amplitudes)))
    given = dict(amplitudes or {})
    for name, known in (*((k, STIMULI) for k in (*chosen, *given)), *((s, SPECTRA) for s in spectra)):
        if name not in known:
            raise InputError(f"next trial: expected {', '.join(known)}, got {name!r}")
    for kind, sizes in given.items():
        for a in sizes:
            if fault := AMPLITUDE[STIMULI[kind]].fault(a):
                raise InputError(f"next trial: amplitude of {kind}: {fault}")
    if not all(1 <= n <= 100 for n in trials) or not 2 <= cycles <= 100:
        raise InputError("next trial: expected 1 to 100 trials of 2 to 100 cycles")
    return [
        PlannedTrial(kind, a, spectrum, n, cycles, 1, now.fmax)
        for kind in chosen
        for spectrum in spectra
        for a in given.get(kind, (now.amplitude(kind, spectrum),))
        for n in trials
    ]


def ranked(now: Situation, trials: Sequence[PlannedTrial], seed: int = 0) -> tuple[Option, ...]:
    """The trials with what each is expected to tell, the most informative first, of those alike the shortest."""
    options = []
    for t in trials:
        found = predictions(t, now.noise, now.belief, now.recorded)
        options.append(Option(t, told(found, now.belief, stream(seed, "gap next"))))
    return tuple(sorted(options, key=lambda o: (-np.floor(o.told.bits / ALIKE), o.trial.duration_s, -o.told.bits)))
