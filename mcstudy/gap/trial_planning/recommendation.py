"""Which trial to record next, in words: the recommended trial, what it would decide, and a table of the others."""

from __future__ import annotations

from mcstudy.gap.nearest_words import chance
from mcstudy.gap.trial_planning.choice import Option, Plan
from mcstudy.gap.trial_planning.next_trial import NextTrialRecord
from mcstudy.text_tables import fill, number, table

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


def described(plan: Plan) -> str:
    """``hip_torque 1.2 N m prts, 2 trials``; ``... and ..., 1 trial each`` of two kinds."""
    many = "1 trial" if plan[0].trials == 1 else f"{plan[0].trials} trials"
    kinds = " and ".join(f"{t.kind} {t.amplitude:g} {t.unit} {t.spectrum}" for t in plan)
    return f"{kinds}, {many}{' each' if len(plan) > 1 else ''}"


def expected(low: float, high: float) -> str:
    """``0.70-0.86``, or one number if both ends are the same."""
    both = dict.fromkeys(f"{x:.2f}" for x in (low, high))
    return "-".join(both)


def sentence(d: NextTrialRecord, option: Option) -> str:
    """What a trial would decide, in words."""
    decided = d.decides(option)
    if decided is None:
        return f"{described(option.plan)}: would decide between none of these causes"
    first, second, probability = decided
    return f"{described(option.plan)}: would tell {first} from {second} with {100 * probability:.0f} %"


def rows(d: NextTrialRecord) -> list[list[str]]:
    """The most informative options under `HEADER`."""
    return [
        [
            described(option.plan),
            f"{option.duration_s / 60:.1f}",
            f"{option.told.bits:.2f}",
            expected(option.told.probability_low, option.told.probability),
            expected(option.told.probability_if_missing_low, option.told.probability_if_missing),
            f"{option.told.set_size:.1f}",
            "nothing" if (decided := d.decides(option)) is None else _pair(*decided),
        ]
        for option in d.options[:SHOWN]
    ]


def _pair(first: str, second: str, probability: float) -> str:
    return f"{first}, {second}: {100 * probability:.0f} %"


def twin_sentence(d: NextTrialRecord) -> str:
    """How many effects have a twin, before and after."""
    before, after, effects = d.before.count, d.after.count, len(d.before.effects)
    return f"Of {effects} effects {before} are indistinguishable from another in these data, {after} with it."


def text(d: NextTrialRecord) -> str:
    """What `mcstudy gap next` prints."""
    known = ", ".join(f"{name} ({chance(p)})" for name, p in d.causes)
    lines = [f"{d.name}. Possible causes: {known}; {number(d.best.told.entropy, 2)} bits are open."]
    if not d.open:
        lines.append("The cause is known from these recordings: no further trial is needed to name it.")
    lines += [f"Recommended: {sentence(d, d.best)}.", twin_sentence(d)]
    if d.inseparable:
        pairs = "; ".join(" and ".join(pair) for pair in d.inseparable)
        lines.append(f"None of these trials tells apart: {pairs}.")
    left = len(d.options) - SHOWN
    note = NOTE + (f" {left} less informative ones are left out; --json lists them." if left > 0 else "")
    return "\n".join([*(fill(line) for line in lines), "", table(HEADER, rows(d), of_text=True), fill(note)])
