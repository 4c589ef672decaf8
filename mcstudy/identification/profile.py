"""Profile likelihood intervals: how far a quantity can move before the best fit with it becomes too bad.

From every minimum the profile of a quantity is followed outwards on both sides. A point is a fit in which a strong
restraint pulls the quantity to a target: wherever that fit ends, it is the best one with the value that the quantity
then has (the optimality conditions are those of the constrained problem), so the restraint needs no exactness. The
root of the deviance rises almost linearly with the quantity, which makes the secant rule find the end of an interval
in a few fits. All quantities, sides and minima advance together, as one queue of the compiled fits.

An end is looked at again from other starts: a lower valley found there is followed on, unless the closed loop is
unstable in it (the person stood). Along a valley a loop may become slightly unstable: the data then say nothing of its
slowest mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mcstudy.fitting.arguments import Restraint
from mcstudy.fitting.penalised import Data, Fitter
from mcstudy.identification.minimum import Minima
from mcstudy.identification.quantities import Quantity
from mcstudy.stance.feedback import Model
from mcstudy.stance.stability import growth_rate

TOLERANCE, ITERATIONS = 1e-9, 200

STIFFNESS = 1e8
"""Strength of the restraint, in inverse variances of the quantity."""

CLOSE = 1e-7
"""Relative difference between the deviance at an end and the threshold."""

MOST_STEPS = 40
OVERSHOOT = 1.02
"""Of a step that extrapolates, so that it brackets the end."""

LONGEST = 3.0
"""Longest step relative to the distance that was covered."""

STUCK = 1e-6
"""Step, relative to the one wanted, below which bounds hold a quantity."""

CLIFF = 1e-4
"""Width, in standard errors, of the gap between a point inside and one outside at which the search ends: there the
deviance jumps, because a valley ends."""

AGAIN = 6
"""Further random starts at every end, beside those from the other ends."""

NEAR, LOWER = 1e-3, 1e-4
"""A valley is followed on from a point that lies at most ``NEAR`` standard errors inside an end, and whose deviance is
lower than at the end by ``LOWER`` of the threshold."""

ROUNDS = 3
"""Times that an end which was not the last is followed on."""

RELINEARISED = 8
"""Most linearisations of a quantity at one point."""

CURVED = 1e-7
"""Error of the linearisation, in standard errors of the quantity, above which it is made again."""


@dataclass
class Walk:
    """The profile on one side of a minimum: points in walking order.

    Attributes
    ----------
    quantity, side: index, and -1 or +1. value, rise, theta: of every point inside: the quantity, increase of the
    deviance over the lowest minimum, parameters (P,). outside: value and rise of the nearest point outside; tried: the
    last point inside from which it was tried again. ended: what ended the walk: "data", "bound", "not finite" (a
    quantity that is not defined beyond), "steps".
    """

    quantity: int
    side: int
    value: list[float]
    rise: list[float]
    theta: list[np.ndarray]
    ended: str = ""
    outside: tuple[float, float] | None = None
    tried: int = -1

    def inside(self) -> int:
        """Index of the outermost point inside the interval: the last one."""
        return len(self.value) - 1

    def before(self) -> int:
        """Index of the point before it, or of itself if it is the first."""
        return max(len(self.value) - 2, 0)


@dataclass(frozen=True)
class Profile:
    """Profile of one quantity.

    Attributes
    ----------
    low, high: ends of the interval. low_from, high_from: what ends it, as in `Walk`. value, rise: (M,) points of the
    profile, ascending. theta: (M, P) parameters of the best fit at each of them. low_theta, high_theta: (P,) parameters
    at the ends.
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
        covariance = np.linalg.pinv(minima.information[0][np.ix_(free, free)], hermitian=True)
        gradients = np.array([q.gradient(theta) for q in wanted])
        tangent = np.zeros(gradients.shape)
        tangent[:, free] = gradients[:, free] @ covariance
        variance = np.einsum("kp,kp->k", tangent, gradients)
        moves = variance > 0
        tangent[moves] /= variance[moves, None]
        return cls(free, covariance, gradients, tangent, np.where(moves, variance, np.nan))


def profiles(
    fitter: Fitter,
    data: Data,
    minima: Minima,
    wanted: Sequence[Quantity],
    near: Linearised,
    threshold: np.ndarray,
    rng: np.random.Generator,
) -> list[Profile]:
    """Intervals of the ``wanted`` quantities where the deviance rises by less than ``threshold`` (K,).

    ``near``: the quantities at the lowest minimum.
    """
    at = _Fits(fitter, data, minima, wanted, near)
    walks = []
    for k in range(len(wanted)):
        for m in np.flatnonzero(minima.chi2 - minima.chi2[0] < threshold[k]):
            start = minima.theta[m], minima.chi2[m] - minima.chi2[0]
            walks += [at.begin(k, side, *start) for side in (-1, 1)]
    for _ in range(ROUNDS):
        _walk(at, walks, threshold)
        more = _further(at, walks, threshold, rng)
        if not more:
            break
        walks += more
    return [_profile([w for w in walks if w.quantity == k]) for k in range(len(wanted))]


class _Fits:
    """Fits with a restrained quantity."""

    def __init__(
        self, fitter: Fitter, data: Data, minima: Minima, wanted: Sequence[Quantity], near: Linearised
    ) -> None:
        self.fitter, self.wanted = fitter, wanted
        self.model, self._packed, self._least = fitter.model, data.packed, minima.chi2[0]
        # Of a quantity that bounds hold the first step is a tenth of what is typical of people.
        typical = ((0.1 * near.gradients * fitter.prior.scale) ** 2).sum(axis=1)
        self.tangent, self.variance = near.tangent, np.where(np.isnan(near.variance), typical, near.variance)

    def admissible(self, theta: np.ndarray) -> np.ndarray:
        """Whether the closed loop is stable with parameters (S, P): the person stood."""
        return np.asarray(growth_rate(self.model, theta) < 0)

    def begin(self, k: int, side: int, theta: np.ndarray, rise: float) -> Walk:
        """A walk that begins at a point inside."""
        return Walk(k, side, [self.wanted[k].value(theta)], [float(rise)], [theta])

    def __call__(
        self, k: np.ndarray, target: np.ndarray, starts: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values (S,), rises (S,) and parameters (S, P) of fits of quantities ``k`` (S,) towards ``target`` (S,)."""
        theta = np.clip(starts, self.model.lower, self.model.upper)
        rise = np.empty(len(k))
        todo = np.arange(len(k))
        for _ in range(RELINEARISED):
            near = theta[todo]
            slope = np.array([self.wanted[i].gradient(x) for i, x in zip(k[todo], near, strict=True)])
            offset = self._values(k[todo], near) - np.einsum("sp,sp->s", slope, near)
            restraint = Restraint(slope, target[todo] - offset, STIFFNESS / self.variance[k[todo]])
            fits = self.fitter.fits(
                self._packed, near, tolerance=TOLERANCE, max_iterations=ITERATIONS, restraint=restraint
            )
            theta[todo], rise[todo] = fits.estimate, fits.chi2 - self._least
            linear = offset + np.einsum("sp,sp->s", slope, fits.estimate)
            curved = np.abs(self._values(k[todo], fits.estimate) - linear) > CURVED * np.sqrt(self.variance[k[todo]])
            todo = todo[curved]
            if not todo.size:
                break
        return self._values(k, theta), rise, theta

    def best(self, k: np.ndarray, target: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As a call, from several starts (S, A, P) each; the best fit of each."""
        S, A, _ = starts.shape
        value, rise, theta = self(np.repeat(k, A), np.repeat(target, A), starts.reshape(S * A, -1))
        off = STIFFNESS / self.variance[np.repeat(k, A)] * (value - np.repeat(target, A)) ** 2
        pick = np.arange(S) * A + np.nan_to_num(rise + off, nan=np.inf).reshape(S, A).argmin(axis=1)
        return value[pick], rise[pick], theta[pick]

    def _values(self, k: np.ndarray, theta: np.ndarray) -> np.ndarray:
        return np.array([self.wanted[i].value(x) for i, x in zip(k, theta, strict=True)])


def _walk(at: _Fits, walks: list[Walk], threshold: np.ndarray) -> None:
    """Follow all walks until they have ended."""
    for _ in range(MOST_STEPS):
        going = [w for w in walks if not w.ended]
        if not going:
            return
        target = np.array([_target(w, threshold[w.quantity], at.variance[w.quantity]) for w in going])
        k = np.array([w.quantity for w in going])
        starts = np.stack([_starts(w, t, at.tangent[w.quantity]) for w, t in zip(going, target, strict=True)])
        step = target - np.array([w.value[w.inside()] for w in going])
        value, rise, theta = at.best(k, target, starts)
        for n, w in enumerate(going):
            goal, scale = threshold[w.quantity], np.sqrt(at.variance[w.quantity])
            _take(w, step[n], float(value[n]), float(rise[n]), theta[n], goal, scale)
    for w in walks:
        w.ended = w.ended or "steps"


def _starts(w: Walk, target: float, tangent: np.ndarray) -> np.ndarray:
    """Start values (3, P) for the next point: the last one, moved as at the minimum, and as between the last two."""
    i, j = w.inside(), w.before()
    step = target - w.value[i]
    moved = tangent if i == j else (w.theta[i] - w.theta[j]) / (w.value[i] - w.value[j])
    return np.array([w.theta[i], w.theta[i] + step * tangent, w.theta[i] + step * moved])


def _target(w: Walk, threshold: float, variance: float) -> float:
    """Next value to try: where the root of the rise, continued as a line, reaches that of the threshold.

    A point outside brackets it. It is tried again if the points inside say that it should be inside: the fit may have
    ended in another valley.
    """
    i, j = w.inside(), w.before()
    value, root, goal = w.value[i], np.sqrt(max(w.rise[i], 0.0)), np.sqrt(threshold)
    longest = LONGEST * abs(value - w.value[0])
    if i == j:
        step = np.sqrt(variance) * max(0.5 * (goal - root), 0.1 * goal)
    else:
        slope = w.side * (root - np.sqrt(max(w.rise[j], 0.0))) / (value - w.value[j])
        step = min(OVERSHOOT * (goal - root) / slope, longest) if slope > 0 else longest
    if w.outside is None:
        return float(value + w.side * step)
    far, rise = w.outside
    if w.tried != i and step > 1.1 * abs(far - value):
        w.tried = i
        return far
    share = (goal - root) / (np.sqrt(rise) - root)
    return float(value + np.clip(share, 0.2, 0.98) * (far - value))


def _take(w: Walk, step: float, value: float, rise: float, theta: np.ndarray, threshold: float, scale: float) -> None:
    """Enter a fit into a walk."""
    i = w.inside()
    if not np.isfinite(value):
        w.ended = "not finite"
        return
    if rise > threshold:
        if abs(rise - threshold) < CLOSE * threshold:
            rise = threshold
        else:
            w.outside = (value, rise) if w.outside is None or w.side * (w.outside[0] - value) > 0 else w.outside
            if abs(w.outside[0] - w.value[i]) < CLIFF * scale:
                w.ended = "data"
            return
    if w.side * (value - w.value[i]) < STUCK * abs(step):
        w.ended = "bound" if w.outside is None else "data"
        return
    if w.outside is not None and w.side * (value - w.outside[0]) >= 0:
        w.outside = None
    w.value.append(value)
    w.rise.append(rise)
    w.theta.append(theta)
    if abs(rise - threshold) <= CLOSE * threshold:
        w.ended = "data"


def _further(at: _Fits, walks: list[Walk], threshold: np.ndarray, rng: np.random.Generator) -> list[Walk]:
    """Walks that go on from lower valleys at the present ends."""
    last = _last(walks)
    ends = [w for w in last.values() if w.ended == "data"]
    if not ends:
        return []
    others = np.array([w.theta[w.inside()] for w in last.values()])
    starts = []
    for w in ends:
        drawn = w.theta[w.inside()] + at.fitter.prior.scale * rng.standard_normal((AGAIN, others.shape[1]))
        starts.append(np.concatenate([drawn, others[rng.permutation(len(others))[:AGAIN]]]))
    each = [len(s) for s in starts]
    quantity = np.repeat([w.quantity for w in ends], each)
    value, rise, theta = at(quantity, np.repeat([w.value[w.inside()] for w in ends], each), np.concatenate(starts))
    rise = np.where(at.admissible(theta), rise, np.inf)
    begun: dict[tuple[int, int], Walk] = {}
    for n in np.argsort(rise):
        k = int(quantity[n])
        for side in (-1, 1):
            w = last[k, side]
            reached = side * (value[n] - w.value[w.inside()]) > -NEAR * np.sqrt(at.variance[k])
            if w.ended == "data" and reached and rise[n] < threshold[k] * (1 - LOWER) and (k, side) not in begun:
                begun[k, side] = at.begin(k, side, theta[n], float(rise[n]))
    return list(begun.values())


def _last(walks: list[Walk]) -> dict[tuple[int, int], Walk]:
    """The walk that came furthest, by quantity and side."""
    out: dict[tuple[int, int], Walk] = {}
    for w in walks:
        key = w.quantity, w.side
        if key not in out or w.side * (w.value[w.inside()] - out[key].value[out[key].inside()]) > 0:
            out[key] = w
    return out


def _profile(walks: list[Walk]) -> Profile:
    low, high = (w for _, w in sorted(_last(walks).items()))
    value = np.concatenate([w.value for w in walks])
    rise = np.concatenate([w.rise for w in walks])
    theta = np.concatenate([w.theta for w in walks])
    value, first = np.unique(value, return_index=True)
    i, j = low.inside(), high.inside()
    return Profile(
        low=low.value[i],
        high=high.value[j],
        low_from=low.ended,
        high_from=high.ended,
        value=value,
        rise=rise[first],
        theta=theta[first],
        low_theta=low.theta[i],
        high_theta=high.theta[j],
    )
