"""What a good diagnosis reaches, and whether this one does.

Every target states the cases it counts, its goal, and the ceiling: the mean over those very cases of what the ideal
method of `mcstudy.gap.challenge.ceiling` reaches (or the nominal rate, where one is nominal).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from mcstudy.gap.challenge.design import NOTHING as NOTHING_MISSING
from mcstudy.gap.challenge.judge import CONFIDENT, SET_SIZES, Judged
from mcstudy.gap.challenge.rates import PROBABILITY, Bounds, Figure, mean, rate

UPPER_FALSE_ALARMS = 0.065
"""The upper limit of a rate of false alarms that still counts as at most 5 %."""


@dataclass(frozen=True)
class Goal:
    """``low`` <= value <= ``high``; ``tolerance`` is the bound the interval must respect to be certain, where it is
    not the goal itself."""

    text: str
    low: float = -math.inf
    high: float = math.inf
    certain_high: float | None = None


@dataclass(frozen=True)
class Target:
    """A goal for one figure of the main series."""

    name: str
    goal: Goal
    figure: Callable[[Sequence[Judged]], Figure]
    percent: bool = True


Verdict = Literal["reached", "missed", "no cases"]


def verdict(goal: Goal, figure: Figure) -> tuple[Verdict, bool]:
    """Whether the figure reaches the goal, and whether its whole interval says so."""
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
    """Selects cases with nothing missing."""
    return j.kind in NOTHING_MISSING


def outside(j: Judged) -> bool:
    """Selects cases with an effect outside the library."""
    return j.kind == "outsider"


def share(which: Callable[[Judged], bool], hit: Callable[[Judged], bool], ceiling: str | float = math.nan) -> Any:
    """Figure: share of hits among the selected cases; the ceiling is a number, or a key of the cases' own."""

    def figure(judged: Sequence[Judged]) -> Figure:
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

    def figure(judged: Sequence[Judged]) -> Figure:
        own = [j for j in judged if which(j)]
        return mean((value(j) for j in own), (_ceiling(j, ceiling) for j in own), bounds)

    return figure


def _ceiling(j: Judged, ceiling: str | float) -> float:
    return float(j.ceiling.get(ceiling, math.nan)) if isinstance(ceiling, str) else ceiling


AT_MOST_5 = Goal("≤ 5 % (upper limit ≤ 6.5 %)", high=0.05, certain_high=UPPER_FALSE_ALARMS)

false_alarms = share(nothing, lambda j: j.detected, 0.05)

TARGETS: tuple[Target, ...] = (
    Target("false alarms", AT_MOST_5, false_alarms),
    Target(
        "detection at delta = 4", Goal("≥ 80 %", low=0.80), share(between(3.5, 4.5), lambda j: j.detected, "detected")
    ),
    Target("group top-1 at delta = 6", Goal("≥ 95 %", low=0.95), share(between(5.5, 6.5), lambda j: j.top, "top")),
    Target(
        "mean P(true group) at delta = 6",
        Goal("≥ 90 %", low=0.90),
        average(between(5.5, 6.5), lambda j: j.probability, "probability"),
    ),
    Target("95 % set holds the truth", Goal("≥ 95 %", low=0.95), share(known, lambda j: j.covered, "covered")),
    Target(
        "size of the 95 % set at delta = 6",
        Goal("≤ 1.3", high=1.3),
        average(between(5.5, 6.5), lambda j: j.set_size, "set_size", SET_SIZES),
        percent=False,
    ),
    Target(
        "unknown flagged at delta ≥ 10",
        Goal("≥ 80 %", low=0.80),
        share(between(10.0, math.inf, "outsider"), lambda j: j.flagged, "flagged"),
    ),
    Target("false unknown", Goal("≤ 5 %", high=0.05), share(lambda j: not outside(j), lambda j: j.flagged)),
    Target(
        "confidently wrong name for an outsider",
        Goal("≤ 10 %", high=0.10),
        share(outside, lambda j: j.confident > CONFIDENT),
    ),
    Target(
        "gap-closed intervals hold the truth",
        Goal("93 to 97 %", low=0.93, high=0.97),
        share(lambda j: j.closed_inside is not None, lambda j: bool(j.closed_inside), 0.95),
    ),
)
"""The targets of the benchmark, in the order they are printed."""
