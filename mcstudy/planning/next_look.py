"""Where the next look tells most: the design, the number of realizations, and that of the draws of the control.

How precise the answer will be after a look does not depend on what the look finds. So the local model tells it
beforehand, for looks at the answer and at both ends of its interval. The answer itself is the best place where the
measure is steep. Where it is nearly flat, what is uncertain is its value far from the answer, and a look there tells
more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.planning.arm import FIRST, Arm, Candidate
from mcstudy.planning.fits import FULL, Design
from mcstudy.planning.local_model import LocalModel
from mcstudy.planning.space import AMPLITUDE, CYCLES, Space

STEP = 1.5
"""Factor between the numbers of realizations, or of draws, that are considered."""

FEW = 3
"""Designs that must have been looked at before a measure is called flat: with fewer its slope is hardly known."""

LEAST = 2.0
"""Smallest growth, at one design, of a look that is not expected to suffice."""

GROWTH = 6.0
"""Largest growth of the number of realizations from one look to the next."""

MOST_DRAWS = 200
"""Draws of the control for every realization, at most."""

NEAR = 0.05
"""Designs that differ by less, in the logarithm of the amplitude, are not told apart."""

SAFETY = 0.95
"""A look is expected to suffice if it narrows the interval to this fraction of what was asked."""


def leading(space: Space) -> str | None:
    """The axis whose crossing is the answer: cycles, which cost time, before amplitude."""
    return next((axis for axis in (CYCLES, AMPLITUDE) if axis in space.over), None)


def uncertain(arm: Arm, cheapest: Candidate) -> str | None:
    """The same, but the amplitude where the cost alone decides the cycles, as one does that falls along them."""
    axis = leading(arm.space)
    if axis == CYCLES and AMPLITUDE in arm.space.over:
        low, _, high = crossing_ends(arm, CYCLES, cheapest)
        return AMPLITUDE if low == high else CYCLES
    return axis


@dataclass(frozen=True)
class Width:
    """How well an answer is known: half-widths of 95 % intervals, relative, of the axis and of the measure there.

    Both are 0 where it is decided that no design reaches the targets. ``looks``: designs that were looked at.

    A search ends when one of the two is as small as asked. Both are the same where the measure is inversely
    proportional to the axis. A bias, whose unit is its limit, is steeper than that where it ends.
    """

    axis: float
    measure: float
    looks: int = FEW

    @property
    def flat(self) -> bool:
        """Whether the measure is known better than the place on the axis, because it changes less than the axis."""
        return self.looks >= FEW and self.measure < self.axis

    @property
    def relative(self) -> float:
        """What the search reduces: the half-width of the axis or, if it is smaller, that of the measure."""
        return self.measure if self.flat else self.axis


def width(
    arm: Arm, cheapest: Candidate, expected: Sequence[LocalModel] | None = None, looks: int | None = None
) -> Width:
    """How well the answer of an Fmax is known; with the errors of ``expected`` models where given.

    Of the crossing on the leading axis, and of the measure there; without an axis, of the measure alone. Where the
    interval ends outside of the range, the part within it counts. ``looks``: designs, those of ``arm`` by default.
    """
    low, _, high = _at(arm, cheapest, expected)
    axis, measure = uncertain(arm, cheapest), float(high - low) / 2
    if not cheapest.reached:
        return Width(0.0, 0.0) if arm.hopeless else Width(measure, measure)
    if axis is None:
        return Width(0.0, 0.0) if high <= 0 else Width(measure, measure)
    lowest, middle, highest = crossing_ends(arm, axis, cheapest, expected)
    if lowest == highest and _at(arm, cheapest, expected)[2] > 0:
        return Width(measure, measure)  # the cost leaves one value, which may not be enough
    if axis == CYCLES:
        if math.ceil(lowest) == math.ceil(highest):
            return Width(0.0, measure)  # the same whole number
        low, _, high = _at(arm, cheapest, expected, cheapest.cycles if math.isnan(middle) else middle)
        measure = float(high - low) / 2
    return Width(float(np.log(highest / lowest) / 2), measure, len(arm.looks) if looks is None else looks)


def _at(
    arm: Arm, cheapest: Candidate, expected: Sequence[LocalModel] | None, cycles: float | None = None
) -> np.ndarray:
    """Excess at a design, or at other, not necessarily whole, cycles: lower end, middle, upper end."""
    count = np.array([cheapest.cycles if cycles is None else cycles])
    return arm.excess(count, np.array([cheapest.amplitude]), expected)[:, 0]


def next_look(arm: Arm, cheapest: Candidate, precision: float) -> tuple[Design, int, int]:
    """The cheapest look that is expected to suffice; where none is, the one that helps most for its cost.

    Design, realizations and draws of the control.
    """
    now = width(arm, cheapest).relative
    made = {look.design: (look.realizations, look.draws) for look in arm.looks}
    most = max(n for n, _ in made.values())
    best, choice = (math.inf, math.inf), None
    for design in _places(arm, cheapest):
        before = made.get(design, (0, 0))
        for more in _choices(arm, before, most):
            for n, draws in more:
                after = width(arm, cheapest, arm.expected(design, n, draws), len(made.keys() | {design})).relative
                enough = after <= SAFETY * precision
                cost = _cost(arm, n - before[0], draws - before[1])
                gain = max(np.log(now / max(after, 1e-9)), 1e-3)
                rank = (0.0, cost) if enough else (1.0, cost / gain)
                grown = n >= LEAST * before[0] or draws >= LEAST * before[1]
                if rank < best and (enough or grown):
                    best, choice = rank, (design, n, draws)
                if enough:
                    break
    assert choice is not None  # the answer itself is always a place
    return choice


def design_at(arm: Arm, cycles: float, amplitude: float) -> Design:
    """A design with an amplitude of three digits, if the amplitude is searched, in the allowed range."""
    if AMPLITUDE in arm.space.over:
        low, high = arm.space.amplitude
        amplitude = min(max(float(f"{amplitude:.3g}"), low), high)
    return Design(round(cycles), amplitude, arm.fmax)


def crossing_ends(
    arm: Arm, axis: str, cheapest: Candidate, expected: Sequence[LocalModel] | None = None
) -> tuple[float, float, float]:
    """The crossing of an axis with its interval, cut at the ends of the range."""
    first, last = arm.space.ends(axis)
    low, middle, high = arm.crossing(axis, cheapest, expected)
    return (first if math.isnan(low) else low, middle, last if math.isnan(high) else high)


def _places(arm: Arm, cheapest: Candidate) -> list[Design]:
    """The answer, the ends of its interval, and between them; looks that are near instead of new ones.

    Where no design is known to reach the targets, the one that still may.
    """
    places = [design_at(arm, cheapest.cycles, cheapest.amplitude)]
    axis = uncertain(arm, cheapest)
    if not cheapest.reached:
        hopeful = arm.cheapest(0)
        places.append(design_at(arm, hopeful.cycles, hopeful.amplitude))
    elif axis is not None:
        low, _, high = crossing_ends(arm, axis, cheapest)
        middle = cheapest.cycles if axis == CYCLES else cheapest.amplitude
        for value in (low, math.sqrt(low * middle), math.sqrt(middle * high), high):
            other = (value, cheapest.amplitude) if axis == CYCLES else (cheapest.cycles, value)
            places.append(design_at(arm, *other))
    return list(dict.fromkeys(_near(arm, place) for place in places))


def _near(arm: Arm, design: Design) -> Design:
    """A design that has been looked at instead of one that hardly differs."""
    for look in arm.looks:
        same = look.design.cycles == design.cycles
        if same and abs(np.log(look.design.amplitude / design.amplitude)) < NEAR:
            return look.design
    return design


def _choices(arm: Arm, before: tuple[int, int], most: int) -> Iterator[Iterator[tuple[int, int]]]:
    """Growing realizations and draws to consider at a design that has been looked at with those ``before``."""
    yield ((n, max(arm.draws(n), before[1])) for n in _numbers(before, most))
    if before[1]:  # what one of the two levels leaves of the error may need more of this level alone
        yield ((n, before[1]) for n in _numbers(before, most))
        yield _draws(before)


def _numbers(before: tuple[int, int], most: int) -> Iterator[int]:
    n, last = max(FIRST, math.ceil(1.2 * before[0])), max(GROWTH * most, 1.2 * before[0])
    while n <= last:
        yield n
        n = math.ceil(STEP * n)


def _draws(before: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """The same realizations with more draws of the control."""
    n, draws = before
    last = min(GROWTH * draws, MOST_DRAWS * n)
    while 0 < (draws := math.ceil(STEP * draws)) <= last:
        yield n, draws


def _cost(arm: Arm, realizations: int, draws: int) -> float:
    """Evaluations of the model behind realizations with all starts and draws of the control."""
    fitter = arm.fitter
    if arm.control in (None, FULL):
        return realizations * fitter.cost(FULL)
    return realizations * (fitter.cost(FULL) + fitter.cost(str(arm.control))) + draws * fitter.cost(str(arm.control))
