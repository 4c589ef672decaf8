"""The search for the cheapest design: look, fit the local model, look again where it crosses the target.

For every Fmax, a prediction over all amplitudes and cycles comes from a few fits that start at the true values. Then
designs are looked at with more and more realizations, each where the model expects the cheapest design that meets the
targets. An Fmax whose most optimistic cost is above the most pessimistic one of another is given up. The search ends
when the crossing is known as precisely as asked, or when the budget of fits is spent.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mcstudy.planning.arm import DRAWS_A_REALIZATION, FIRST, Arm, Candidate, Look
from mcstudy.planning.fits import FULL, Design
from mcstudy.planning.local_model import log_signal
from mcstudy.planning.space import AMPLITUDE, CYCLES, Space

GROWTH = 6.0
"""Largest growth of the number of realizations from one look to the next."""

MARGIN = 1.1
"""Safety factor on the number of realizations that a precision is expected to need."""

NEAR = 0.1
"""The last look must be this near to the answer, in the logarithm of the signal."""

DOUBT = 1.5
"""A cheaper design is looked at if its measure is so many times less certain than that of the answer."""

MOST_LOOKS = 12
MOST_REALIZATIONS = 20_000


@dataclass(frozen=True)
class Rules:
    """When to end: half-width of the 95 % interval of the answer, relative; largest number of fits."""

    precision: float
    budget: int


def search(arms: list[Arm], rules: Rules, say: Callable[[str], object] = str) -> list[Arm]:
    """Look at designs until every Fmax that may still be the cheapest is known well enough; returns these.

    ``say``: called with a line before every look.
    """
    for arm in arms:
        say(f"predicting, Fmax {arm.fmax:g} Hz")
        arm.predict()
    going = list(arms)
    for _ in range(MOST_LOOKS):
        wanted = {arm.fmax: n for arm in going if (n := _wanted(arm, rules)) is not None}
        if not wanted:
            break
        for arm in going:
            if arm.fmax in wanted and (n := _affordable(arm, wanted[arm.fmax], rules)) is not None:
                design = next_design(arm)
                if (doubtful := _doubtful(arm)) is not None:
                    design, n = doubtful
                say(f"{n} realizations of {design.cycles} cycles, {design.amplitude:g}, Fmax {design.fmax:g} Hz")
                arm.look(design, n)
            else:
                wanted.pop(arm.fmax, None)
        if not wanted:
            break
        going = _promising(going)
    return going


def next_design(arm: Arm) -> Design:
    """Where the model expects the answer."""
    found = arm.cheapest()
    amplitude = found.amplitude
    if AMPLITUDE in arm.space.over:
        amplitude = float(f"{amplitude:.3g}")
    return Design(found.cycles, amplitude, arm.fmax)


def _doubtful(arm: Arm) -> tuple[Design, int] | None:
    """A cheaper design, away from the answer, of which the model knows too little to rule it out; and realizations.

    More realizations at the answer would tell nothing of it. None where there is no such design.
    """
    found, hopeful = arm.cheapest(1), arm.cheapest(0)
    if not arm.looks or not (found.reached and hopeful.reached):
        return None
    points = arm.points([found.cycles, hopeful.cycles], [found.amplitude, hopeful.amplitude])
    excess = arm.excess(np.exp(points[:, 1]) + arm.space.discard, np.exp(points[:, 0]))
    sure, unsure = (excess[2] - excess[0]) / 2
    if abs(np.diff(log_signal(points))[0]) < NEAR or unsure < DOUBT * sure:
        return None
    amplitude = hopeful.amplitude
    if AMPLITUDE in arm.space.over:
        amplitude = max(float(f"{amplitude:.3g}"), arm.space.amplitude[0])
    design = Design(hopeful.cycles, amplitude, arm.fmax)
    before = max((look.realizations for look in arm.looks if look.design == design), default=0)
    return design, max(FIRST, 2 * before)


def leading(space: Space) -> str | None:
    """The axis whose crossing is the answer: cycles, which cost time, before amplitude."""
    return next((axis for axis in (CYCLES, AMPLITUDE) if axis in space.over), None)


def width(arm: Arm, found: Candidate) -> float:
    """Half-width of the 95 % interval of the answer, relative; 0 where it is decided that there is none.

    Of the crossing on the leading axis; without one, of the measure itself. Where the interval ends outside of the
    range, the part within it counts.
    """
    low, _, high = arm.excess(np.array([found.cycles]), np.array([found.amplitude]))[:, 0]
    axis = leading(arm.space)
    if not found.reached:
        return 0.0 if low > 0 else float(high - low) / 2
    if axis is None:
        return 0.0 if high <= 0 else float(high - low) / 2
    first, last = map(float, arm.space.cycles if axis == CYCLES else arm.space.amplitude)
    ends = arm.crossing(axis, found)
    lowest = first if math.isnan(ends[0]) else ends[0]
    highest = last if math.isnan(ends[2]) else ends[2]
    if axis == CYCLES and math.ceil(lowest) == math.ceil(highest):
        return 0.0  # the same whole number
    return float(np.log(highest / lowest) / 2)


def _wanted(arm: Arm, rules: Rules) -> int | None:
    """Realizations of the next look; None where none is needed."""
    if not arm.looks:
        return FIRST
    found = arm.cheapest()
    last = min(arm.looks, key=lambda look: _apart(arm, found, look))
    half, n = width(arm, found), last.realizations
    if _apart(arm, found, last) >= NEAR:  # what is uncertain is the way from the last looks to the answer
        return FIRST
    if half <= rules.precision:
        return None
    more = MARGIN * n * (half / rules.precision) ** 2
    return int(min(MOST_REALIZATIONS, max(min(more, GROWTH * n), 1.2 * n)))


def _apart(arm: Arm, found: Candidate, look: Look) -> float:
    """Distance of a look from the answer, in the logarithm of the signal."""
    signals = (arm.space.signal(d.cycles, d.amplitude) for d in (found, look.design))
    first, second = signals
    return abs(float(np.log(first / second)))


def _affordable(arm: Arm, realizations: int, rules: Rules) -> int | None:
    """So many realizations, or as many as the budget allows; None where it allows no more than were looked at."""
    starts, control = arm.fitter.group.starts, arm.control not in (None, FULL)
    each = starts + 1 + min(DRAWS_A_REALIZATION, 1 / max(arm.share, 1e-9)) if control else starts + 2
    left = int((rules.budget - arm.fitter.spent.fits) / each)
    before = max((look.realizations for look in arm.looks), default=0)
    if left >= realizations:
        return realizations if realizations > 0 and before < MOST_REALIZATIONS else None
    return left if left > max(before, FIRST) else None


def _promising(arms: list[Arm]) -> list[Arm]:
    """Those of which a design may be the cheapest that meets the targets; all while none is known to."""
    surely = [c.cost for arm in arms if (c := arm.cheapest(2)).reached]
    if not surely:
        return arms
    return [arm for arm in arms if (c := arm.cheapest(0)).reached and c.cost <= min(surely) * (1 + 1e-9)]
