"""Profile likelihood intervals: how far a quantity can move before every fit with it becomes too bad.

An end of an interval is the largest (or smallest) value of the quantity among all parameters within bounds whose
deviance stays below a ceiling. `mcstudy.fitting.outermost_kernel` solves this from every minimum below the ceiling;
the interval is the union. The same at lower ceilings gives the curve of the profile.

Three things guard against an end that is only local. The parameters at the end of one quantity lie below the ceiling of
every other, so each end is searched again from those of them that reach farthest towards it. None of them may lie
outside that one's interval; where one does, the search goes on from it. And a search that did not converge is repeated
over ceilings that rise in steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mcstudy.fitting.outermost_kernel import BOUND, DATA, GAVE_UP
from mcstudy.fitting.penalised import ENDED, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.fitting.standard_errors import wald_covariance
from mcstudy.identification.minimum import Minima
from mcstudy.models.quantities import Quantity
from mcstudy.stance.feedback import Model

CURVE = (1 / 6, 1 / 3, 1 / 2, 2 / 3, 5 / 6)
"""Lower ceilings at which the curve of a profile is computed, as roots of their share of the highest."""

STEPS = (0.25, 0.5, 0.75, 1.0)
"""The same for a search that is repeated."""

ROUNDS = 3
"""Times that a search goes on from the ends of other quantities."""

AROUND = 5
"""Ends of other quantities from which each end is searched again."""

OUTSIDE = 1e-6
"""How far outside an interval, in its widths, another quantity's end must lie for the search to go on from it."""

RELINEARISED, CURVED = 20, 1e-8
"""Most linearisations of a quantity that is not linear, and the change of its end, in widths, at which they stop."""

BISECTIONS = 20
"""Halvings of the ceiling of a quantity that is not finite, or has turned back, at its end."""

FROM = {DATA: "data", BOUND: "bound", GAVE_UP: "steps"}


@dataclass(frozen=True)
class Profile:
    """Profile of one quantity.

    Attributes
    ----------
    low, high: ends of the interval. low_from, high_from: what ends it: "data", "bound", "not finite" (the quantity is
    not defined beyond) or "steps" (the search did not converge). value, rise: (M,) points of the profile, ascending:
    ends of the intervals at lower ceilings, and the increase of the deviance there. theta: (M, P) parameters of the
    best fit at each of them. low_theta, high_theta: (P,) parameters at the ends.
    """

    low: float
    high: float
    low_from: str
    high_from: str
    value: np.ndarray = field(repr=False)
    rise: np.ndarray = field(repr=False)
    theta: np.ndarray = field(repr=False)
    low_theta: np.ndarray = field(repr=False)
    high_theta: np.ndarray = field(repr=False)


@dataclass(frozen=True)
class Linearised:
    """K quantities at a minimum, to first order.

    Attributes
    ----------
    free: (P,) which parameters no bound holds. covariance: (F, F) Gauss-Newton covariance of these.
    gradients: (K, P) of the quantities. tangent: (K, P) change of the parameters per unit of each quantity along its
    profile. variance: (K,) of Wald; nan for a quantity that no free parameter changes.
    """

    free: np.ndarray
    covariance: np.ndarray
    gradients: np.ndarray
    tangent: np.ndarray
    variance: np.ndarray

    @classmethod
    def at(cls, model: Model, minima: Minima, wanted: Sequence[Quantity]) -> Linearised:
        """At the lowest minimum."""
        theta = minima.theta[0]
        free = (theta > model.lower) & (theta < model.upper)
        covariance = wald_covariance(minima.information[0], free)
        gradients = np.array([q.gradient(theta) for q in wanted])
        tangent = np.zeros(gradients.shape)
        tangent[:, free] = gradients[:, free] @ covariance
        variance = np.einsum("kp,kp->k", tangent, gradients)
        moves = variance > 0
        tangent[moves] /= variance[moves, None]
        return cls(free, covariance, gradients, tangent, np.where(moves, variance, np.nan))


class _Points(NamedTuple):
    """Ends (M,): value, rise, status of the quantity, and parameters (M, P)."""

    value: np.ndarray
    rise: np.ndarray
    status: np.ndarray
    theta: np.ndarray


def profiles(
    fitter: Fitter,
    data: Data,
    minima: Minima,
    wanted: Sequence[Quantity],
    threshold: np.ndarray,
    curve: Sequence[float] = CURVE,
) -> list[Profile]:
    """Intervals of the ``wanted`` quantities where the deviance rises by less than ``threshold`` (K,).

    ``curve``: further ceilings, see `CURVE`; none where only the ends are wanted.
    """
    search = _Search(fitter, data, minima, wanted, threshold)
    quantity, side = np.repeat(np.arange(len(wanted)), 2), np.tile([-1, 1], len(wanted))
    last = search.from_minima(quantity, side, 1.0)
    search.go_on(quantity, side, last)
    search.from_others(quantity, side, last)
    search.go_on(quantity, side, last)
    inner = [search.from_minima(quantity, side, share**2) for share in curve]
    for lower in inner:  # on a bound the lowest deviance is the profile's
        same = (last.status == "bound") & (lower.value == last.value) & (lower.rise < last.rise)
        last.rise[same], last.theta[same] = lower.rise[same], lower.theta[same]
    return [_profile(2 * k, wanted[k].value(minima.theta[0]), minima.theta[0], last, inner) for k in range(len(wanted))]


class _Search:
    """Ends of intervals of one recording."""

    def __init__(
        self, fitter: Fitter, data: Data, minima: Minima, wanted: Sequence[Quantity], threshold: np.ndarray
    ) -> None:
        self._fitter, self._packed, self._minima, self._wanted = fitter, fitter.packed(data), minima, wanted
        self._threshold, self._least = np.asarray(threshold, dtype=float), minima.chi2[0]
        self._linear = np.array([q.linear for q in wanted])
        self._gradient = np.array([q.gradient(minima.theta[0]) for q in wanted])

    def from_minima(self, quantity: np.ndarray, side: np.ndarray, share: float) -> _Points:
        """The outermost of the ends from all minima below ``share`` of the thresholds; quantities and sides (M,)."""
        which, begun = np.nonzero(self._minima.chi2 - self._least < share * self._threshold[quantity, None])
        found = self._ends(quantity[which], side[which], share, self._minima.theta[begun])
        return _outermost(found, side[which], which)

    def from_others(self, quantity: np.ndarray, side: np.ndarray, last: _Points) -> None:
        """Search linear quantities from the `AROUND` ends that reach farthest, and move their ends in ``last``.

        Some of these lie a little above the ceiling, because that of their own quantity is higher.
        """
        linear = np.flatnonzero(self._linear[quantity])
        values = np.array([[q.value(theta) for q in self._wanted] for theta in last.theta]).T[quantity[linear]]
        begun = np.argsort(-side[linear, None] * values, axis=1)[:, :AROUND]
        at = np.repeat(linear, begun.shape[1])
        found = self._ends(quantity[at], side[at], 1.0, last.theta[begun.ravel()])
        found.value[found.rise > self._threshold[quantity[at]] * (1 + OUTSIDE)] = np.nan
        _move(last, side, linear, _outermost(found, side[at], at))

    def go_on(self, quantity: np.ndarray, side: np.ndarray, last: _Points) -> None:
        """Search from ends of other quantities that lie outside an interval, and move its end in ``last``."""
        for _ in range(ROUNDS):
            begun, which = [], []
            for n, out in enumerate(self._reached(quantity, side, last)):
                width = abs(last.value[n] - self._wanted[quantity[n]].value(self._minima.theta[0]))
                if last.status[n] != "not finite" and out.max() - side[n] * last.value[n] > OUTSIDE * width:
                    begun.append(int(out.argmax()))
                    which.append(n)
            if not which:
                return
            at = np.array(which, dtype=int)
            _move(last, side, at, self._ends(quantity[at], side[at], 1.0, last.theta[begun]))

    def _reached(self, quantity: np.ndarray, side: np.ndarray, last: _Points) -> np.ndarray:
        """How far outwards all ends lie for the quantity of each, (M, M); -inf for those above its ceiling."""
        below = last.rise[:, None] <= self._threshold * (1 + OUTSIDE)
        values = np.array([[q.value(theta) for q in self._wanted] for theta in last.theta])
        outwards = side[:, None] * values.T[quantity]
        return np.where((below & np.isfinite(values)).T[quantity], outwards, -np.inf)

    def _ends(self, quantity: np.ndarray, side: np.ndarray, share: float, starts: np.ndarray) -> _Points:
        """Ends from ``starts`` (M, P) below ``share`` of the thresholds."""
        height = share * self._threshold[quantity]
        out = self._linear_ends(self._gradient[quantity], quantity, side, height, starts)
        for m in np.flatnonzero(~self._linear[quantity]):
            one = self._curved_end(int(quantity[m]), side[m], height[m], starts[m])
            for mine, new in zip(out, one, strict=True):
                mine[m] = new
        return out

    def _linear_ends(
        self, gradient: np.ndarray, quantity: np.ndarray, side: np.ndarray, height: np.ndarray, starts: np.ndarray
    ) -> _Points:
        """Ends of quantities with constant ``gradient`` (M, P)."""

        def solve(which: np.ndarray, part: float, begin: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            goal = part * height[which]
            found = self._fitter.ends(
                self._packed, begin, side[which, None] * gradient[which], self._least + goal, goal, tolerance=ENDED
            )
            return found.estimate, found.chi2 - self._least, found.status

        everything = np.arange(len(quantity))
        theta, rise, status = solve(everything, 1.0, starts)
        again = np.flatnonzero(status == GAVE_UP)
        if again.size:
            begin = starts[again]
            for part in STEPS:
                reached, new_rise, new_status = solve(again, part**2, begin)
                fine = new_rise <= height[again] * (1 + OUTSIDE)
                begin = np.where(fine[:, None], reached, begin)
            # Of the two searches the one that came further within the ceiling, or converged.
            gain = side[again] * np.einsum("mp,mp->m", gradient[again], reached - theta[again])
            within = rise[again] <= height[again] * (1 + OUTSIDE)
            better = fine & ((gain > 0) | ~within)
            take = again[better]
            theta[take], rise[take], status[take] = reached[better], new_rise[better], new_status[better]
            lost = status == GAVE_UP
            lost &= rise > height * (1 + OUTSIDE)
            theta[lost], rise[lost] = starts[lost], 0.0
        value = np.array([self._wanted[k].value(x) for k, x in zip(quantity, theta, strict=True)])
        return _Points(value, rise, np.array([FROM[int(s)] for s in status], dtype=object), theta)

    def _curved_end(self, k: int, side: int, height: float, start: np.ndarray) -> tuple[float, float, str, np.ndarray]:
        """End of a quantity that is not linear, by linearising it again and again."""
        best = self._relinearised(k, side, height, start)
        if np.isfinite(best[0]):
            return best
        low, high, inside = 0.0, height, (self._wanted[k].value(start), 0.0, "", start)
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            found = self._relinearised(k, side, middle, inside[3])
            low, high, inside = (middle, high, found) if np.isfinite(found[0]) else (low, middle, inside)
        return (*inside[:2], best[2], inside[3])

    def _relinearised(
        self, k: int, side: int, height: float, start: np.ndarray
    ) -> tuple[float, float, str, np.ndarray]:
        q, theta, direction = self._wanted[k], start, np.zeros_like(start)
        origin, before, status, rise = q.value(start), q.value(start), "steps", 0.0
        for n in range(RELINEARISED):
            new = q.gradient(theta)
            # A mean of two directions, once they have had time to settle: they may swing from side to side.
            direction = new if n < RELINEARISED // 2 else (direction + new) / 2
            if not np.isfinite(direction).all():
                return np.nan, rise, "not finite", theta
            found = self._linear_ends(direction[None], np.array([k]), np.array([side]), np.array([height]), theta[None])
            theta, rise = found.theta[0], float(found.rise[0])
            value = q.value(theta)
            if not np.isfinite(value):
                return np.nan, rise, "not finite", theta
            settled = abs(value - before) <= CURVED * max(abs(value - origin), 1e-300)
            before = value
            if settled:
                status = str(found.status[0])
                break
        if side * (before - origin) < -CURVED * abs(origin):  # beyond its largest value, or beyond a pole
            return np.nan, rise, "steps", theta
        return before, rise, status, theta


def _move(last: _Points, side: np.ndarray, at: np.ndarray, found: _Points) -> None:
    """Put the ends ``found`` into places ``at`` of ``last`` where they lie farther out."""
    for m, n in enumerate(at):
        if side[n] * (found.value[m] - last.value[n]) > 0:
            for mine, new in zip(last, found, strict=True):
                mine[n] = new[m]


def _outermost(points: _Points, side: np.ndarray, which: np.ndarray) -> _Points:
    """The outermost of the points with the same ``which`` (M,), which ascends."""
    pick = []
    for n in np.unique(which):
        own = np.flatnonzero(which == n)
        reach = np.where(np.isfinite(points.value[own]), side[own] * points.value[own], -np.inf)
        pick.append(own[int(reach.argmax())])
    return _Points(*(field[pick] for field in points))


def _profile(n: int, estimate: float, best: np.ndarray, last: _Points, inner: list[_Points]) -> Profile:
    """Profile of the quantity whose ends are points ``n`` and ``n + 1``; ``best``: (P,) parameters of the estimate."""
    value = np.array([estimate, *(p.value[i] for p in (*inner, last) for i in (n, n + 1))])
    rise = np.array([0.0, *(p.rise[i] for p in (*inner, last) for i in (n, n + 1))])
    theta = np.array([best, *(p.theta[i] for p in (*inner, last) for i in (n, n + 1))])
    order = np.lexsort((rise, value))
    value, rise = value[order], rise[order]
    value, first = np.unique(value, return_index=True)
    return Profile(
        low=float(last.value[n]),
        high=float(last.value[n + 1]),
        low_from=str(last.status[n]),
        high_from=str(last.status[n + 1]),
        value=value,
        rise=rise[first],
        theta=theta[first],
        low_theta=last.theta[n],
        high_theta=last.theta[n + 1],
    )
