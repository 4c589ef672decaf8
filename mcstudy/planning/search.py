"""The search for the cheapest design: look, fit the local model, look again where it crosses the target.

For every Fmax, a prediction over all amplitudes and cycles comes from a few fits that start at the true values. Then
designs are looked at with more and more realizations: first where the model expects the cheapest design that meets the
targets, then where a look narrows its interval most (`mcstudy.planning.next_look`). An Fmax whose most optimistic cost
is above the most pessimistic one of another is given up. The search ends when the answer, or the measure there, is
known as precisely as asked, or when the budget of fits is spent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.planning.arm import FIRST, Arm, Candidate, Look
from mcstudy.planning.fits import Design
from mcstudy.planning.local_model import log_signal
from mcstudy.planning.next_look import design_at, next_look, width

NEAR = 0.1
"""The last look must be this near to the answer, in the logarithm of the signal."""

DOUBT = 1.5
"""A cheaper design is looked at if its measure is so many times less certain than that of the answer."""

MOST_LOOKS = 16
MOST_REALIZATIONS = 20_000


@dataclass(frozen=True)
class Rules:
    """When to end: half-width of a 95 % interval, relative, of the answer or the measure there
    (`mcstudy.planning.next_look.Width`); largest number of fits, at least `least_fits`."""

    precision: float
    budget: int


def least_fits(arms: Sequence[Arm]) -> int:
    """Fits that the smallest search makes: a prediction and a first look for every Fmax."""
    return sum(arm.prediction_fits() + arm.least_fits() for arm in arms)


def search(arms: list[Arm], rules: Rules, say: Callable[[str], object] = str) -> list[Arm]:
    """Look at designs until every Fmax that may still be the cheapest is known well enough; returns these.

    ``say``: called with a line before every look.
    """
    for arm in arms:
        say(f"predicting, Fmax {arm.fmax:g} Hz")
        arm.predict()
    going = list(arms)
    for _ in range(MOST_LOOKS):
        looked = False
        for arm in going:
            wanted = _wanted(arm, rules)
            if wanted is None:
                continue
            doubtful = _doubtful(arm)
            design, n, draws = wanted if doubtful is None else (doubtful, FIRST, 0)
            waiting = sum(other.least_fits() for other in going if other is not arm and not other.looks)
            left = rules.budget - arm.fitter.spent.fits - waiting
            if (allowed := _affordable(arm, design, n, draws, left)) is None:
                continue
            n, draws = allowed
            say(f"{n} realizations of {design.cycles} cycles, amplitude {design.amplitude:g}, Fmax {design.fmax:g} Hz")
            arm.look(design, n, draws, left)
            looked = True
        if not looked:
            break
        going = _promising(going)
    return going


def next_design(arm: Arm) -> Design:
    """Where the model expects the answer."""
    cheapest = arm.cheapest()
    return design_at(arm, cheapest.cycles, cheapest.amplitude)


def _doubtful(arm: Arm) -> Design | None:
    """A cheaper design, away from the answer and from all looks, of which the model knows too little to rule it out.

    More realizations at the answer would tell nothing of it. None where there is no such design, and where it is the
    measure that is asked for (`Width.flat`).
    """
    cheapest, hopeful = arm.cheapest(1), arm.cheapest(0)
    if not arm.looks or not (cheapest.reached and hopeful.reached) or width(arm, cheapest).flat:
        return None
    points = arm.points([cheapest.cycles, hopeful.cycles], [cheapest.amplitude, hopeful.amplitude])
    excess = arm.excess(np.exp(points[:, 1]) + arm.space.discard, np.exp(points[:, 0]))
    sure, unsure = (excess[2] - excess[0]) / 2
    if abs(np.diff(log_signal(points))[0]) < NEAR or unsure < DOUBT * sure:
        return None
    if any(_apart(arm, hopeful, look) < NEAR for look in arm.looks):
        return None
    return design_at(arm, hopeful.cycles, hopeful.amplitude)


def _wanted(arm: Arm, rules: Rules) -> tuple[Design, int, int] | None:
    """The next look: design, realizations and draws of the control; None where none is needed."""
    if not arm.looks:
        return next_design(arm), FIRST, 0
    cheapest = arm.cheapest()
    known = width(arm, cheapest)
    if known.flat and known.measure <= rules.precision:
        return None
    last = min(arm.looks, key=lambda look: _apart(arm, cheapest, look))
    if _apart(arm, cheapest, last) >= NEAR:  # what is uncertain is the way from the last looks to the answer
        return next_design(arm), FIRST, 0
    if known.relative <= rules.precision:
        return None
    design, n, draws = next_look(arm, cheapest, rules.precision)
    return design, min(n, MOST_REALIZATIONS), draws


def _apart(arm: Arm, cheapest: Candidate, look: Look) -> float:
    """Distance of a look from the answer, in the logarithm of the signal."""
    signals = (arm.space.signal(d.cycles, d.amplitude) for d in (cheapest, look.design))
    first, second = signals
    return abs(float(np.log(first / second)))


def _affordable(arm: Arm, design: Design, n: int, draws: int, left: int) -> tuple[int, int] | None:
    """So many realizations and draws, or the share of them that ``left`` fits allow; None where that is nothing new."""
    if not arm.looks:
        return (n, draws) if arm.least_fits(n) <= left else None
    before = next(((k.realizations, k.draws) for k in arm.looks if k.design == design), (0, 0))
    draws = draws or arm.draws(n)
    each = arm.fitter.group.starts + min(len(arm.fitter.controls), 1)
    fits = (n - before[0]) * each + max(draws - before[1], 0)
    if left <= 0 or fits <= 0:
        return None
    if fits <= left:
        return n, draws
    n, draws = (b + int((w - b) * left / fits) for b, w in zip(before, (n, draws), strict=True))
    return (n, draws) if n >= FIRST else None


def _promising(arms: list[Arm]) -> list[Arm]:
    """Those of which a design may be the cheapest that meets the targets; all while none is known to."""
    surely = [c.cost for arm in arms if (c := arm.cheapest(2)).reached]
    if not surely:
        return arms
    least = min(surely)
    return [arm for arm in arms if (c := arm.cheapest(0)).reached and c.cost <= least + 1e-9 * abs(least)]
