"""Which trial to record next: possible trials, ranked by what they are expected to tell of the cause."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from mcstudy.errors import InputError
from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.questions.evidence import Hypothesis
from mcstudy.gap.trial_planning.gain import Told, told
from mcstudy.gap.trial_planning.predictions import Belief, Expected, Recorded, moved, predictions
from mcstudy.gap.trial_planning.response import SURE, chances, least_amplitude
from mcstudy.gap.trial_planning.trials import SPECTRA, PlannedTrial, SwayNoise
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.joint_recording import JointRecording
from mcstudy.recordings.recording import AMPLITUDE, Recording
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import KINDS, STIMULI, standing
from mcstudy.stance.joint import members, under
from mcstudy.stance.response import frf
from mcstudy.streams import stream

CONSIDERED = tuple(name for name, kind in KINDS.items() if kind.considered)
"""Kinds of stimulus that are considered unless others are named, beside those recorded."""

TRIALS = (1, 2)
"""Numbers of trials that are considered unless others are named."""

CYCLES = 6
"""Periods of a planned trial."""

Plan = tuple[PlannedTrial, ...]
"""What is recorded next."""

ALIKE = 0.02
"""Difference of expected information, bits, below which trials count as equally informative."""

LEADERS = 2
"""Single kinds of trials that are also considered together with every other one."""

DIGITS = 2
"""Significant digits of an amplitude that is chosen."""


@dataclass(frozen=True)
class Option:
    """A possible trial.

    Attributes
    ----------
    plan
        The trials (`PlannedTrial`): one kind of them, or two that are recorded one after the other.
    told
        What is expected after them (`Told`).
    """

    plan: Plan
    told: Told

    @property
    def duration_s(self) -> float:
        """Time of recording, s."""
        return sum(t.duration_s for t in self.plan)


@dataclass(frozen=True)
class Situation:
    """What is known before the trial: what causes make expect, noise, and how far the person sways."""

    expected: Expected
    noise: SwayNoise
    sway: np.ndarray
    amplitudes: Mapping[str, float]
    fmax: float

    @classmethod
    def of(cls, d: DiagnosisRecord) -> Situation:
        """From a diagnosis of recordings.

        Raises `InputError` for one of lines or of published responses, and of a declared model, which has one stimulus.
        """
        recording = d.recording
        if not standing(d.base.model):
            raise InputError(
                f"{d.name}: expected a standing body, for which kinds of stimulus are known, got the model "
                f"{d.base.model.name}, which declares one stimulus; record more of it, or declare another"
            )
        if recording is None or isinstance(recording, FrfRecording) or d.method.fmax is None:
            raise InputError(f"{d.name}: expected recordings of sway over time, whose noise a new trial would have")
        return cls.after(recording, d.lines, d.base, d.hypotheses, d.unknown_probability, d.method.fmax, d.prior)

    @classmethod
    def after(
        cls,
        recording: Recording | JointRecording,
        lines: Lines,
        base: Fitted,
        hypotheses: Sequence[tuple[Hypothesis, float]],
        unknown: float,
        fmax: float,
        prior: Mapping[str, float],
    ) -> Situation:
        """From what a diagnosis finds out of the causes: ``lines``, base fit, ``hypotheses`` and ``unknown`` cause.

        ``prior``: the probabilities that it assumes before it sees the data.
        """
        parts = recording.parts if isinstance(recording, JointRecording) else (recording,)
        fits = [replace(base, model=m) for m in members(base.model)]
        return cls(
            Expected(
                Belief.of(hypotheses, unknown, base, Data.of(lines), prior),
                Recorded(base, lines, recording.body, tuple(p.stimulus for p in parts)),
            ),
            SwayNoise.of(lines, recording.name),
            np.max([_sway(part, fit) for part, fit in zip(lines.parts, fits, strict=True)], axis=0),
            {p.stimulus: float(np.median(p.amplitudes)) for p in parts},
            fmax,
        )

    def amplitude(self, kind: str, spectrum: str, cycles: int = CYCLES) -> float:
        """The recorded amplitude of a kind, else one that evokes no more sway of any angle than was recorded.

        It is larger only where a trial of so many ``cycles`` would show no response otherwise.
        """
        if kind in self.amplitudes and spectrum == "prts":
            return self.amplitudes[kind]
        unit = PlannedTrial(kind, 1.0, spectrum, 1, cycles, 1, self.fmax)
        most = float((self.sway / _rms(np.abs(unit.drive) ** 2, self.responses(unit)[0])).min())
        least = least_amplitude(unit, self.shown)
        size, rounded = (most, np.floor) if most >= least else (least, np.ceil)
        step = 10.0 ** (np.floor(np.log10(size)) + 1 - DIGITS)
        allowed = AMPLITUDE[STIMULI[kind]]
        return float(np.clip(round(float(rounded(size / step)) * step, 12), allowed.low, allowed.high))

    def responses(self, trial: PlannedTrial) -> np.ndarray:
        """Of the fitted body, the nominal one and all hypotheses, (B, N, 2), rad per unit of the stimulus."""
        recorded = self.expected.recorded
        model = under(recorded.base.model, trial.kind, recorded.body)
        fitted, nominal = moved(recorded.base, model)[0].response(trial.f), frf(model, model.truth, trial.f)
        return np.array([fitted, nominal, *self.expected.responses(trial)])

    @property
    def dof(self) -> float:
        """Complex degrees of freedom of the noise at a line of one trial, of the recording with the fewest."""
        parts = self.expected.recorded.lines.parts
        return min(float(np.median(p.noise.dof)) / np.unique(p.trial).size for p in parts)

    def shown(self, trial: PlannedTrial) -> float:
        """Chance that a trial shows a response, without which its recording is refused."""
        fitted, nominal, *by_hypothesis = chances(trial, self.noise, self.responses(trial), self.dof).tolist()
        return min(fitted, nominal, float(self.expected.belief.probability @ by_hypothesis))


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
) -> list[Plan]:
    """What could be recorded next: so many trials of one kind, or half of them of one kind and half of another.

    Trials whose recording would be refused, because it shows no response, are left out. Raises `InputError` for a kind,
    amplitude, spectrum or number that cannot be recorded, and when no trial is left.
    """
    given = dict(amplitudes or {})
    require_possible(kinds, given, spectra, trials, cycles)
    chosen = tuple(kinds) or tuple(dict.fromkeys((*CONSIDERED, *now.amplitudes)))
    alone = [
        PlannedTrial(kind, a, spectrum, 1, cycles, 1, now.fmax)
        for kind in chosen
        for spectrum in spectra
        for a in given.get(kind) or (now.amplitude(kind, spectrum, cycles),)
    ]
    single: list[Plan] = [(replace(t, trials=n),) for t in alone for n in trials]
    halves = [n // 2 for n in trials if n % 2 == 0]
    mixed = [(replace(a, trials=n), replace(b, trials=n)) for a, b in combinations(alone, 2) for n in halves]
    plans = [plan for plan in (*single, *mixed) if min(map(now.shown, plan)) >= SURE]
    if not plans:
        said = ", ".join(f"{t.kind} {t.amplitude:g} {t.unit} {100 * now.shown(t):.0f} %" for t in alone)
        raise InputError(
            f"next trial: expected a response beyond noise with a chance of {100 * SURE:g} %, got {said}; "
            "give larger amplitudes or more cycles"
        )
    return plans


def require_possible(
    kinds: Sequence[str],
    amplitudes: Mapping[str, Sequence[float]],
    spectra: Sequence[str] = SPECTRA,
    trials: Sequence[int] = TRIALS,
    cycles: int = CYCLES,
) -> None:
    """Raise `InputError` for a kind, amplitude, spectrum or number that cannot be recorded."""
    for name, known in (*((k, STIMULI) for k in (*kinds, *amplitudes)), *((s, SPECTRA) for s in spectra)):
        if name not in known:
            raise InputError(f"next trial: expected {', '.join(known)}, got {name!r}")
    for kind, sizes in amplitudes.items():
        for a in sizes:
            if fault := AMPLITUDE[STIMULI[kind]].fault(a):
                raise InputError(f"next trial: amplitude of {kind}: {fault}")
    for n in trials:
        if not 1 <= n <= 100:
            raise InputError(f"next trial: expected 1 to 100 trials, got {n}")
    if not 2 <= cycles <= 100:
        raise InputError(f"next trial: expected 2 to 100 cycles, got {cycles}")


def ranked(now: Situation, plans: Sequence[Plan], seed: int = 0) -> tuple[Option, ...]:
    """The plans with what each is expected to tell, the most informative first, of those alike the shortest.

    Plans of two kinds are valued only if one of them is among the `LEADERS` most informative single kinds of ``plans``.
    """
    belief = now.expected.belief

    def valued(some: Iterable[Plan]) -> list[Option]:
        expected = ((p, predictions(p, now.noise, now.expected)) for p in some)
        return [Option(p, told(predicted, belief, stream(seed, "gap next"))) for p, predicted in expected]

    single = valued(p for p in plans if len(p) == 1)
    leading: list[PlannedTrial] = []
    for o in sorted(single, key=lambda o: -o.told.bits):
        kind = replace(o.plan[0], trials=1)
        if kind not in leading:
            leading.append(kind)
    mixed = valued(p for p in plans if len(p) > 1 and any(replace(t, trials=1) in leading[:LEADERS] for t in p))
    return tuple(sorted([*single, *mixed], key=lambda o: (-np.floor(o.told.bits / ALIKE), o.duration_s, -o.told.bits)))
