"""The answer to which trial should be recorded next, as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mcstudy.files import schema
from mcstudy.files.json_files import plain
from mcstudy.fitting.problem import Data
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.trial_planning.choice import CYCLES, TRIALS, Option, Situation, possible_trials, ranked
from mcstudy.gap.trial_planning.trials import SPECTRA, PlannedTrial
from mcstudy.gap.trial_planning.twins import Twins, twins, twins_after

LEADING = 6
"""Causes among which the pair is sought that a trial decides."""

DECIDED = 0.6
"""Chance of naming the right one of two causes below which a trial does not decide between them."""

OPEN = 0.05
"""Entropy over the causes, bits, below which nothing is left to decide."""


@dataclass(frozen=True, repr=False)
class NextTrialRecord:
    """Possible next trials, ranked by what they are expected to tell of the cause.

    Attributes
    ----------
    name
        Name of the recording.
    causes
        What is still possible, with probabilities, the most probable first.
    options
        Possible trials (`Option`), the most informative first.
    before, after
        Effects that cannot be told apart (`Twins`) in what was recorded, and with the first of ``options``.
    """

    name: str
    causes: tuple[tuple[str, float], ...]
    options: tuple[Option, ...]
    before: Twins
    after: Twins

    @property
    def best(self) -> Option:
        """The most informative trial."""
        return self.options[0]

    @property
    def open(self) -> bool:
        """Whether something is left to decide."""
        return self.best.told.entropy >= OPEN

    def decides(self, option: Option) -> tuple[str, str, float] | None:
        """The two causes that a trial decides between, and the chance that it names the right one; None if none."""
        pairs = [
            (self.causes[i][1] * self.causes[j][1] * (option.told.separated[i, j] - 0.5), i, j)
            for i in range(min(LEADING, len(self.causes)))
            for j in range(i)
        ]
        if not pairs:
            return None
        _, i, j = max(pairs)
        chance = float(option.told.separated[i, j])
        return (self.causes[j][0], self.causes[i][0], chance) if chance >= DECIDED else None

    @property
    def inseparable(self) -> tuple[tuple[str, str], ...]:
        """Pairs of the leading causes that none of the options tells apart."""
        return tuple(
            (self.causes[j][0], self.causes[i][0])
            for i in range(min(LEADING, len(self.causes)))
            for j in range(i)
            if max(o.told.separated[i, j] for o in self.options) < DECIDED
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON data, valid under ``results_schema/1.0.0/next_trial.json``."""
        return plain(
            {
                "schema": schema.identifier("next_trial"),
                "name": self.name,
                "causes": [{"cause": n, "probability": p} for n, p in self.causes],
                "entropy_bits": self.best.told.entropy,
                "options": [
                    {
                        **_planned(o.plan[0]),
                        "beside": None if len(o.plan) == 1 else _planned(o.plan[1]),
                        "duration_s": o.duration_s,
                        "bits": o.told.bits,
                        "probability": o.told.probability,
                        "probability_if_missing": o.told.probability_if_missing,
                        "probability_low": o.told.probability_low,
                        "probability_if_missing_low": o.told.probability_if_missing_low,
                        "set_size": o.told.set_size,
                        "decides": None
                        if (d := self.decides(o)) is None
                        else {"first": d[0], "second": d[1], "chance": d[2]},
                    }
                    for o in self.options
                ],
                "inseparable": self.inseparable,
                "effects": self.before.effects,
                "similarity_before": self.before.cosine,
                "similarity_after": self.after.cosine,
                "twins_before": self.before.groups,
                "twins_after": self.after.groups,
            }
        )


def _planned(trial: PlannedTrial) -> dict[str, Any]:
    """A planned trial as plain data."""
    return {
        "stimulus": trial.kind,
        "amplitude": trial.amplitude,
        "unit": trial.unit,
        "spectrum": trial.spectrum,
        "trials": trial.trials,
        "cycles": trial.cycles,
    }


def next_trial(
    diagnosis: DiagnosisRecord,
    kinds: Sequence[str] = (),
    amplitudes: Mapping[str, Sequence[float]] | None = None,
    spectra: Sequence[str] = SPECTRA,
    trials: Sequence[int] = TRIALS,
    cycles: int = CYCLES,
    seed: int = 0,
) -> NextTrialRecord:
    """Possible next trials after a diagnosis of recordings; see `mcstudy.next_trial`."""
    now = Situation.of(diagnosis)
    options = ranked(now, possible_trials(now, kinds, amplitudes, spectra, trials, cycles), seed)
    belief, recorded = now.expected.belief, now.expected.recorded
    prior = belief.membership.T @ belief.probability
    return NextTrialRecord(
        diagnosis.name,
        tuple(zip(belief.labels, map(float, np.asarray(prior)), strict=True)),
        options,
        twins(recorded.base, Data.of(recorded.lines)),
        twins_after(recorded.base, recorded.lines, options[0].plan, now.noise, recorded.body),
    )
