"""What a comparison of two groups found, in words and tables."""

from __future__ import annotations

import math

from mcstudy.group_comparison.changes import OTHER
from mcstudy.group_comparison.result import LEVEL, Cause, ComparisonRecord
from mcstudy.text_tables import fill, number, p_value, p_words, table

COMPARABLE = 0.1
"""Share of the highest probability from which another change is named beside the most probable one."""

LEAST_SHOWN = 0.005
"""Hypotheses that are less probable are left out of the table, unless it would have fewer than five rows."""


def verdict(c: ComparisonRecord) -> str:
    """The answer in a few sentences."""
    d = c.detection
    who = f"{c.people[0]} people, each in both" if c.paired else f"{c.people[0]} and {c.people[1]} people"
    means = f"{p_of(c, d.p_mean, 'p of equal means')}, {d.relabellings} relabellings, {who}"
    if not c.differs:
        parts = [
            f"No difference between the mean responses of {c.a} and {c.b} was found ({means}). Not found does not mean "
            "that there is none."
        ]
        if d.least_p > LEVEL:
            parts.append(
                f"So few people cannot show one: the smallest p-value of their relabellings is {d.least_p:.2g}, above "
                f"{LEVEL:g}."
            )
        return " ".join([*parts, *_scatter(c)])
    places = [
        f"{r.segment} body, {r.low:.3g} to {r.high:.3g} Hz (gain x {r.gain:.2f})" for r in d.regions if r.p <= LEVEL
    ]
    where = f"It is in the {'; '.join(places)}." if places else "Which band of which segment it is in is not told."
    ratio = p_of(c, d.p_ratio, "p of equal ratios")
    if c.kind == "alike":
        segments = (
            f"Upper body relative to lower body: no change found ({ratio}), as when the ankle loop or the weight of "
            "the sensed stimulus changes."
        )
    else:
        segments = (
            f"The upper body moves differently relative to the lower body ({ratio}), as when the control of the upper "
            "body changes, for example with vision."
        )
    return " ".join(
        [f"{c.b} differs from {c.a} in its mean responses ({means}).", where, segments, *_scatter(c), _cause(c)]
    )


def p_of(c: ComparisonRecord, p: float, name: str) -> str:
    """``name = 0.03``, or a limit where no other relabelling that was drawn is as extreme."""
    return p_words(p, 1 / c.detection.relabellings, name)


def _scatter(c: ComparisonRecord) -> list[str]:
    """What the test of scatter says, which is no test of the means."""
    d = c.detection
    if d.p_scatter > LEVEL:
        return []
    return [
        f"A question of its own: the variance between people is {d.scatter_ratio:.2f} times as large "
        f"({p_of(c, d.p_scatter, 'p of equal scatter')}); noise of FRFs falls with the amplitude of the stimulus."
    ]


def _cause(c: ComparisonRecord) -> str:
    best, other = c.best, next((cause for cause in c.causes if cause.name == OTHER), None)
    if best is None:
        return ""
    if other is not None and other.probability > best.probability:
        return (
            f"None of the named changes of parameters is probable ({OTHER}: {other.probability:.0%}); the most "
            f"probable of them is {best.name}{_closed(best)}."
        )
    named = [cause for cause in c.causes if cause.name != OTHER]
    near = [cause for cause in named[1:] if cause.probability > best.probability * COMPARABLE]
    others = "".join(f"; {cause.name} ({cause.probability:.0%}){_closed(cause)}" for cause in near)
    return f"Most probable change: {best.name} ({best.probability:.0%}){_closed(best)}{others}."


def _closed(cause: Cause) -> str:
    if cause.closed is None or cause.closed_se is None or not math.isfinite(cause.closed):
        return ""
    return f", which closes {100 * cause.closed:.0f} ± {100 * cause.closed_se:.0f} % of it in people not used for it"


def text(c: ComparisonRecord) -> str:
    """Verdict and tables."""
    d = c.detection
    tests = [
        ["equal means of all points (decides)", f"{d.p_mean:.3f}"],
        ["equal ratio of upper to lower body", f"{d.p_ratio:.3f}"],
        ["equal scatter between people", f"{d.p_scatter:.3f}"],
    ]
    regions = [
        [
            f"{r.segment} {r.band}",
            f"{r.low:.3g} to {r.high:.3g}",
            f"{r.gain:.2f}",
            f"{r.phase_deg:.0f}",
            p_value(r.p, 1 / d.relabellings),
        ]
        for r in d.regions
    ]
    causes = [
        [
            cause.name,
            f"{100 * cause.probability:.1f}",
            "-" if cause.closed is None else f"{100 * cause.closed:.0f} ± {100 * (cause.closed_se or 0):.0f}",
            ", ".join(f"{name} {number(a)} to {number(b)}" for name, a, b in cause.parameters) or "-",
        ]
        for k, cause in enumerate(c.causes)
        if k < 5 or cause.probability >= LEAST_SHOWN
    ]
    blocks = [
        fill(verdict(c)),
        *(fill(note) for note in c.notes),
        f"Tests: {d.relabellings} relabellings, smallest p possible {d.least_p:.2g}\n\n"
        + table(["what is tested", "p"], tests),
        f"Where: {c.b} relative to {c.a}, p of equal means in a region, corrected for all regions\n\n"
        + table(["segment, band", "Hz", "gain ratio", "phase (deg)", "p"], regions),
        "What: changes of parameters by probability, given that the means differ, and share closed in people not "
        "used for the\nestimate\n\n"
        + table(["change", "probability (%)", "closed (%)", f"from {c.a} to {c.b}"], causes)
        if causes
        else "What: no change of a parameter is named, because no difference of the means was found.",
    ]
    return "\n\n".join(blocks)
