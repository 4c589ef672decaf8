"""The targets of the benchmark and their verdicts.

Every target states the cases it counts, its goal, and the oracle bound: the mean performance of the ideal method of
`mcstudy_challenge.scores.oracle` on the same cases (or the nominal rate, where there is one).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from mcstudy_challenge.design import NOTHING_MISSING, OTHER_FORM, OUTSIDE
from mcstudy_challenge.scores.grade import CONFIDENT, FAILED, SET_SIZES, WRONG, Judged
from mcstudy_challenge.scores.rates import PROBABILITY, Bounds, Estimate, mean, rate

MOST = 0.5
"""Probability above which a hypothesis leads all others together."""

FAR = 6.0
"""Delta beside the nearest mechanism at which a cause is far from all: effects of that size are usually seen."""

UPPER_FALSE_ALARMS = 0.065
"""Largest upper limit of a false-alarm rate that still counts as at most 5 %."""


@dataclass(frozen=True)
class Goal:
    """``low`` <= value <= ``high``; ``tolerance`` is the bound that the interval must respect for a certain verdict, if
    it differs from the goal."""

    text: str
    low: float = -math.inf
    high: float = math.inf
    certain_high: float | None = None


@dataclass(frozen=True)
class Target:
    """A goal for one figure of the main series."""

    name: str
    goal: Goal
    figure: Callable[[Sequence[Judged]], Estimate]
    percent: bool = True


Attainment = Literal["reached", "missed", "no cases"]


def attained(goal: Goal, figure: Estimate) -> tuple[Attainment, bool]:
    """Whether the figure reaches the goal, and whether its whole interval agrees."""
    if figure.n == 0:
        return "no cases", False
    if goal.low <= figure.value <= goal.high:
        limit = goal.high if goal.certain_high is None else goal.certain_high
        return "reached", goal.low <= figure.low and figure.high <= limit
    return "missed", figure.high < goal.low or figure.low > goal.high


def between(low: float, high: float, kind: str = "known") -> Callable[[Judged], bool]:
    """Selects cases of a kind with delta in a range."""
    return lambda j: j.kind == kind and low <= j.delta <= high


def known(j: Judged) -> bool:
    """Selects cases with one effect of the library."""
    return j.kind == "known"


def nothing(j: Judged) -> bool:
    """Selects cases without a missing effect."""
    return j.kind in NOTHING_MISSING


def outside(j: Judged) -> bool:
    """Selects cases with an out-of-library effect."""
    return j.kind in OUTSIDE


def other_form(j: Judged) -> bool:
    """Selects cases with a mechanism of the library in another form than it declares."""
    return j.kind in OTHER_FORM


def left(j: Judged) -> float:
    """Delta that the nearest effect of the library leaves in any of its forms, as far as a smooth torque can produce
    it; 0 where the key does not know it."""
    return float(j.case.get("any_form", {}).get("smooth_residual", 0.0))


def far(j: Judged) -> bool:
    """Selects out-of-library effects of which no mechanism of the library comes near, in any of its forms."""
    return outside(j) and j.delta >= 10.0 and left(j) >= FAR


def of_kind(kind: str) -> Callable[[Judged], bool]:
    """Selects cases of one kind."""
    return lambda j: j.kind == kind


def share(which: Callable[[Judged], bool], hit: Callable[[Judged], bool], ceiling: str | float = math.nan) -> Any:
    """Figure: fraction of successes among the selected cases; ``ceiling`` is the oracle bound or its key in a case."""

    def figure(judged: Sequence[Judged]) -> Estimate:
        own = [j for j in judged if which(j)]
        return rate((hit(j) for j in own), (_ceiling(j, ceiling) for j in own))

    return figure


def average(
    which: Callable[[Judged], bool],
    value: Callable[[Judged], float],
    ceiling: str | float = math.nan,
    bounds: Bounds = PROBABILITY,
) -> Any:
    """Figure: mean over the selected cases of a value within ``bounds``."""

    def figure(judged: Sequence[Judged]) -> Estimate:
        own = [j for j in judged if which(j)]
        return mean((value(j) for j in own), (_ceiling(j, ceiling) for j in own), bounds)

    return figure


def _ceiling(j: Judged, ceiling: str | float) -> float:
    return float(j.ceiling.get(ceiling, math.nan)) if isinstance(ceiling, str) else ceiling


AT_MOST_5 = Goal("≤ 5 % (upper limit ≤ 6.5 %)", high=0.05, certain_high=UPPER_FALSE_ALARMS)

false_alarms = share(nothing, lambda j: j.detected, 0.05)


def _form_targets(words: str, kind: str) -> tuple[Target, ...]:
    """Goals for mechanisms of the library in another form, of one kind of cases."""
    return (
        Target(
            f"{words}: right mechanism most probable at delta ≥ 6",
            Goal("≥ 85 %", low=0.85),
            share(between(6.0, math.inf, kind), lambda j: j.top),
        ),
        Target(
            f"{words}: 95 % set contains the mechanism",
            Goal("≥ 93 %", low=0.93),
            share(of_kind(kind), lambda j: j.covered),
        ),
        Target(
            f"{words}: more than 50 % outside the library",
            Goal("≤ 8 %", high=0.08),
            share(of_kind(kind), lambda j: j.wrong[WRONG[1]] > MOST or j.top_name == FAILED),
        ),
    )


TARGETS: tuple[Target, ...] = (
    Target("false alarms", AT_MOST_5, false_alarms),
    Target(
        "detection at delta = 4", Goal("≥ 80 %", low=0.80), share(between(3.5, 4.5), lambda j: j.detected, "detected")
    ),
    Target(
        "true group most probable at delta = 6",
        Goal("≥ 95 %", low=0.95),
        share(between(5.5, 6.5), lambda j: j.top, "top"),
    ),
    Target(
        "mean P(true group) at delta = 6",
        Goal("≥ 90 %", low=0.90),
        average(between(5.5, 6.5), lambda j: j.probability, "probability"),
    ),
    Target("95 % set contains the truth", Goal("≥ 95 %", low=0.95), share(known, lambda j: j.covered, "covered")),
    Target(
        "size of the 95 % set at delta = 6",
        Goal("≤ 1.3", high=1.3),
        average(between(5.5, 6.5), lambda j: j.set_size, "set_size", SET_SIZES),
        percent=False,
    ),
    Target(
        "out-of-library effect recognized at delta ≥ 10",
        Goal("≥ 80 %", low=0.80),
        share(between(10.0, math.inf, "outsider"), lambda j: j.flagged, "flagged_any_form"),
    ),
    Target(
        "false unknown",
        Goal("≤ 5 %", high=0.05),
        share(lambda j: not (outside(j) or other_form(j)), lambda j: j.flagged),
    ),
    Target(
        "confidently wrong name, out-of-library effect",
        Goal("≤ 10 %", high=0.10),
        share(of_kind("outsider"), lambda j: j.confident > CONFIDENT),
    ),
    Target(
        "interval of the gap closed contains the truth",
        Goal("93 to 97 %", low=0.93, high=0.97),
        share(lambda j: j.closed_inside is not None and not other_form(j), lambda j: bool(j.closed_inside), 0.95),
    ),
    Target(
        "cause at delta ≥ 10 that no mechanism comes near (leaves delta ≥ 6): recognized",
        Goal("≥ 80 %", low=0.80),
        share(far, lambda j: j.flagged, "flagged_any_form"),
    ),
    Target(
        "the same: confidently wrong name",
        Goal("≤ 5 %", high=0.05),
        share(far, lambda j: j.confident > CONFIDENT),
    ),
    *_form_targets("misshapen", "misshapen"),
    Target("foreign body: false alarms", AT_MOST_5, share(of_kind("foreign"), lambda j: j.detected, 0.05)),
    *_form_targets("foreign body", "foreign_mechanism"),
    Target(
        "foreign body: out-of-library effect recognized at delta ≥ 10",
        Goal("≥ 80 %", low=0.80),
        share(between(10.0, math.inf, "foreign_outsider"), lambda j: j.flagged, "flagged_any_form"),
    ),
    Target(
        "foreign body: confidently wrong name, out-of-library effect",
        Goal("≤ 5 %", high=0.05),
        share(of_kind("foreign_outsider"), lambda j: j.confident > CONFIDENT),
    ),
)
"""The targets of the benchmark, in the order they are printed."""
