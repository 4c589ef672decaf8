"""The answer to which trial should be recorded next: a frozen object, its JSON form and its text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mcstudy.files import schema
from mcstudy.files.json_files import plain
from mcstudy.fitting.problem import Data
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.nearest_words import chance
from mcstudy.gap.planned.choice import CYCLES, TRIALS, Option, Plan, Situation, possible_trials, ranked
from mcstudy.gap.planned.trials import SPECTRA, PlannedTrial
from mcstudy.gap.planned.twins import Twins, twins, twins_after
from mcstudy.short_repr import Summary, shortened
from mcstudy.text_tables import fill, number, table

LEADING = 6
"""Causes among which the pair is sought that a trial decides."""

DECIDED = 0.6
"""Chance of naming the right one of two causes below which a trial does not decide between them."""

SHOWN = 12
"""Most trials that a table lists."""

HEADER = ["trial", "minutes", "bits", "P(true)", "if a gap", "causes", "would tell apart"]
"""Columns of the tables."""

NOTE = (
    "bits: expected information about the cause. P(true): expected posterior probability of the true cause, with the "
    "probabilities above, so that much of it may be that nothing is missing; if a gap: the same if something is. The "
    "upper end holds if the cause acts as a hypothesis of the diagnosis says; the lower end was reached on average by "
    "simulated recordings in which it may also be outside the library and look like an effect, or like nothing. "
    "causes: expected number of causes in the 95 % set. Last column: the two causes for which the trial matters most, "
    "and the chance that it names the right one of them (50 % by guessing). Amplitudes are peaks; where none was "
    "recorded or given, the one that evokes no more sway than was recorded, but shows a response."
)
"""What the columns mean."""

OPEN = 0.05
"""Entropy over the causes, bits, below which nothing is left to decide."""


@dataclass(frozen=True, repr=False)
class NextTrialRecord(Summary):
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

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        causes = "; ".join(f"{n} {chance(p)}" for n, p in self.causes[:4])
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
            return f"{described(option.plan)}: would decide between none of these causes"
        first, second, chance = decided
        return f"{described(option.plan)}: would tell {first} from {second} with {100 * chance:.0f} %"

    def decision(self, option: Option) -> str:
        """What a trial would tell apart, for a table."""
        decided = self.decides(option)
        return "nothing" if decided is None else f"{decided[0]}, {decided[1]}: {100 * decided[2]:.0f} %"

    @property
    def leading(self) -> tuple[Option, ...]:
        """The options of the tables: the most informative ones."""
        return self.options[:SHOWN]

    @property
    def rows(self) -> list[list[str]]:
        """The leading options under `HEADER`."""
        return [
            [
                described(o.plan),
                f"{o.duration_s / 60:.1f}",
                f"{o.told.bits:.2f}",
                expected(o.told.probability_low, o.told.probability),
                expected(o.told.probability_if_missing_low, o.told.probability_if_missing),
                f"{o.told.set_size:.1f}",
                self.decision(o),
            ]
            for o in self.leading
        ]

    @property
    def inseparable(self) -> tuple[tuple[str, str], ...]:
        """Pairs of the leading causes that none of the options tells apart."""
        return tuple(
            (self.causes[j][0], self.causes[i][0])
            for i in range(min(LEADING, len(self.causes)))
            for j in range(i)
            if max(o.told.separated[i, j] for o in self.options) < DECIDED
        )

    @property
    def twin_sentence(self) -> str:
        """How many effects have a twin, before and after."""
        before, after, effects = self.before.count, self.after.count, len(self.before.effects)
        return f"Of {effects} effects {before} cannot be told from another one in what was recorded, {after} with it."

    def text(self) -> str:
        """What `mcstudy gap next` prints."""
        now = self.best.told.entropy
        known = ", ".join(f"{n} ({chance(p)})" for n, p in self.causes)
        lines = [f"{self.name}. Possible causes: {known}; {number(now, 2)} bits are open."]
        if not self.open:
            lines.append("The cause is known from these recordings: no further trial is needed to name it.")
        lines.append(f"Recommended: {self.sentence(self.best)}.")
        lines.append(self.twin_sentence)
        if self.inseparable:
            pairs = "; ".join(" and ".join(pair) for pair in self.inseparable)
            lines.append(f"None of these trials tells apart: {pairs}.")
        left = len(self.options) - len(self.leading)
        note = NOTE + (f" {left} less informative ones are left out; --json lists them." if left else "")
        return "\n".join([*(fill(x) for x in lines), "", table(HEADER, self.rows, of_text=True), fill(note)])

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


def described(plan: Plan) -> str:
    """``hip_torque 1.2 N m prts, 2 trials``; ``... and ..., 1 trial each`` of two kinds."""
    many = "1 trial" if plan[0].trials == 1 else f"{plan[0].trials} trials"
    kinds = " and ".join(f"{t.kind} {t.amplitude:g} {t.unit} {t.spectrum}" for t in plan)
    return f"{kinds}, {many}{' each' if len(plan) > 1 else ''}"


def expected(low: float, high: float) -> str:
    """``0.70-0.86``, or one number if both ends are the same."""
    both = dict.fromkeys(f"{x:.2f}" for x in (low, high))
    return "-".join(both)


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
