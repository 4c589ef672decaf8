"""The answer to which trial should be recorded next: a frozen object, its JSON form and its text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mcstudy.files import schema
from mcstudy.files.json_files import plain
from mcstudy.fitting.penalised import Data
from mcstudy.gap.diagnosis import Diagnosis
from mcstudy.gap.planned.choice import CYCLES, TRIALS, Option, Situation, possible_trials, ranked
from mcstudy.gap.planned.trials import SPECTRA, PlannedTrial
from mcstudy.gap.planned.twins import Twins, twins, twins_after
from mcstudy.short_repr import Summary, shortened
from mcstudy.text_tables import fill, number, table

LEADING = 6
"""Causes among which the pair is sought that a trial decides."""

DECIDED = 0.6
"""Chance of naming the right one of two causes below which a trial does not decide between them."""

OPEN = 0.05
"""Entropy over the causes, bits, below which nothing is left to decide."""


@dataclass(frozen=True, repr=False)
class NextTrial(Summary):
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

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        causes = "; ".join(f"{n} {100 * p:.0f} %" for n, p in self.causes[:4])
        return [("name", shortened(self.name)), ("causes", causes), ("next", self.sentence(self.best))]

    def decides(self, option: Option) -> tuple[str, str, float] | None:
        """The two causes that a trial decides between, and the chance that it names the right one; None if none."""
        found = [
            (self.causes[i][1] * self.causes[j][1] * (option.told.separated[i, j] - 0.5), i, j)
            for i in range(min(LEADING, len(self.causes)))
            for j in range(i)
        ]
        if not found:
            return None
        _, i, j = max(found)
        chance = float(option.told.separated[i, j])
        return (self.causes[j][0], self.causes[i][0], chance) if chance >= DECIDED else None

    def sentence(self, option: Option) -> str:
        """What a trial would decide, in words."""
        decided = self.decides(option)
        if decided is None:
            return f"{described(option.trial)}: would decide between none of these causes"
        first, second, chance = decided
        return f"{described(option.trial)}: would tell {first} from {second} with {100 * chance:.0f} %"

    def text(self) -> str:
        """What `mcstudy gap next` prints."""
        now = self.best.told.entropy
        known = ", ".join(f"{n} ({100 * p:.0f} %)" for n, p in self.causes)
        lines = [f"{self.name}. Possible causes: {known}; {number(now, 2)} bits are open."]
        if now < OPEN:
            lines.append("The cause is known from these recordings: no further trial is needed to name it.")
        lines.append(f"Recommended: {self.sentence(self.best)}.")
        before, after, effects = self.before.count, self.after.count, len(self.before.effects)
        lines.append(
            f"Of {effects} effects {before} cannot be told from another one in what was recorded, {after} with it."
        )
        header = ("trial", "minutes", "bits", "P(true)", "95 % set", "would tell apart")
        rows = [
            (
                described(o.trial),
                f"{o.trial.duration_s / 60:.1f}",
                f"{o.told.bits:.2f}",
                f"{o.told.probability:.2f}",
                f"{o.told.set_size:.1f}",
                "nothing" if (d := self.decides(o)) is None else f"{d[0]}, {d[1]}: {100 * d[2]:.0f} %",
            )
            for o in self.options
        ]
        note = (
            "bits: expected information about the cause. P(true), 95 % set: expected posterior probability of the true "
            "cause, and number of causes in the 95 % set. Amplitudes are peaks; where none was recorded or given, the "
            "one that evokes no more sway than was recorded."
        )
        return "\n".join([*(fill(x) for x in lines), "", table(header, rows, of_text=True), fill(note)])

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
                        "stimulus": o.trial.kind,
                        "amplitude": o.trial.amplitude,
                        "unit": o.trial.unit,
                        "spectrum": o.trial.spectrum,
                        "trials": o.trial.trials,
                        "cycles": o.trial.cycles,
                        "duration_s": o.trial.duration_s,
                        "bits": o.told.bits,
                        "probability": o.told.probability,
                        "set_size": o.told.set_size,
                        "decides": None
                        if (d := self.decides(o)) is None
                        else {"first": d[0], "second": d[1], "chance": d[2]},
                    }
                    for o in self.options
                ],
                "twins_before": self.before.groups,
                "twins_after": self.after.groups,
            }
        )


def described(trial: PlannedTrial) -> str:
    """``hip_torque 1.2 N m prts, 2 trials``."""
    many = "1 trial" if trial.trials == 1 else f"{trial.trials} trials"
    return f"{trial.kind} {trial.amplitude:g} {trial.unit} {trial.spectrum}, {many}"


def next_trial(
    diagnosis: Diagnosis,
    kinds: Sequence[str] = (),
    amplitudes: Mapping[str, Sequence[float]] | None = None,
    spectra: Sequence[str] = SPECTRA,
    trials: Sequence[int] = TRIALS,
    cycles: int = CYCLES,
    seed: int = 0,
) -> NextTrial:
    """Possible next trials after a diagnosis of recordings; see `mcstudy.next_trial`."""
    now = Situation.of(diagnosis)
    options = ranked(now, possible_trials(now, kinds, amplitudes, spectra, trials, cycles), seed)
    prior = now.belief.membership.T @ now.belief.probability
    recorded = now.recorded
    return NextTrial(
        diagnosis.name,
        tuple(zip(now.belief.labels, map(float, np.asarray(prior)), strict=True)),
        options,
        twins(recorded.base, Data.of(recorded.lines)),
        twins_after(recorded.base, recorded.lines, options[0].trial, now.noise, recorded.body),
    )
