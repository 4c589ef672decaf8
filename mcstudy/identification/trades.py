"""Parameters that trade for each other: found in the bodies that fit as well as the best one.

The points of all profiles are such bodies. Two parameters trade if these bodies lie along a line in their plane: the
recording then determines a combination of the two and neither of them. Pairs that share a parameter form a valley.
Valleys come from these bodies, not from the curvature at the estimate, because they bend and bounds cut them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.sparse.csgraph import connected_components

from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.identification.correction import simulated
from mcstudy.identification.estimate import Estimate
from mcstudy.identification.minimum import Minima, without_prior
from mcstudy.identification.profile import Profile, profiles
from mcstudy.identification.threshold import threshold
from mcstudy.models.quantities import Quantity, expression
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.streams import stream

ELONGATED = 4.0
"""Length over width of the bodies in a plane of two parameters, relative to their intervals, from which these trade."""

WIDE = 0.2
"""Half-width of an interval relative to the estimate from which a parameter counts as poorly determined."""

PLAIN = 1.25
"""A plain sum or difference is stated if the bodies scatter along it by at most this factor more."""

SHARPER = 3.0
"""A combination counts as determined if its interval is narrower than that of the opposite one by this factor."""

MOST = 4
"""Combinations that are tried, those of the most elongated pairs first."""

MOVES = 0.25
"""Share of its own interval that a parameter moves along the profile of another one, from which it is named."""


@dataclass(frozen=True)
class Combination:
    """Two parameters of one unit of which the recording determines a combination.

    Attributes
    ----------
    name, unit
        The determined combination, e.g. ``K11 + Kpas1``, and its unit.
    estimate, low, high, low_from, high_from
        Its estimate and profile likelihood interval, as in `Estimate`.
    opposite, opposite_low, opposite_high
        The opposite combination, e.g. ``K11 - Kpas1``, and its interval.
    """

    name: str
    unit: str
    estimate: float
    low: float
    high: float
    low_from: str
    high_from: str
    opposite: str
    opposite_low: float
    opposite_high: float


@dataclass(frozen=True)
class Valley:
    """Parameters that trade for each other.

    Attributes
    ----------
    names
        The parameters.
    first, second
        Their values in the two bodies at the ends of the valley, which both fit as well as the best one.
    combinations
        What the recording determines of pairs of one unit (`Combination`).
    """

    names: tuple[str, ...]
    first: tuple[float, ...]
    second: tuple[float, ...]
    combinations: tuple[Combination, ...] = ()


def bodies(estimates: Sequence[Estimate]) -> np.ndarray:
    """Parameters (M, P) of bodies that fit as well as the best one: the points of all profiles."""
    return np.concatenate([e.profile.theta for e in estimates])


def valleys(
    model: Model, base: Model, lines: Lines, minima: Minima, estimates: Sequence[Estimate], level: float, seed: int
) -> tuple[Valley, ...]:
    """Groups of parameters of a fit that trade for each other.

    ``estimates``: of all quantities, those of the parameters first. ``base``: ``model`` without effects.
    """
    theta, P = bodies(estimates), len(model.names)
    width = np.array([e.high - e.low for e in estimates[:P]])
    pairs = elongations(theta, width, [_poor(e) for e in estimates[:P]])
    joined = np.zeros((P, P))
    for (i, j), _ in pairs:
        joined[i, j] = 1
    count, group = connected_components(joined, directed=False)
    same = [(i, j) for (i, j), _ in pairs if model.units[i] == model.units[j]][:MOST]
    wanted = [q for i, j in same for q in _combinations(model, theta, i, j)]
    profile = {e.name: e.profile for e in estimates}
    further = [q for q in wanted if q.name not in profile]
    combined = _profiles_of(model, base, lines, minima, further, level, seed)
    profile |= {q.name: p for q, p in zip(further, combined, strict=True)}
    known: list[tuple[int, Combination]] = []
    for (i, _), q, opposite in zip(same, wanted[::2], wanted[1::2], strict=True):
        p, o = profile[q.name], profile[opposite.name]
        if SHARPER * (p.high - p.low) < o.high - o.low:
            ends = p.low, p.high, p.low_from, p.high_from
            known.append(
                (
                    int(group[i]),
                    Combination(q.name, q.unit, q.value(minima.theta[0]), *ends, opposite.name, o.low, o.high),
                )
            )
    out = []
    for g in range(count):
        members = np.flatnonzero(group == g)
        if members.size > 1:
            first, second = _ends(theta[:, members], width[members])
            names = tuple(model.names[k] for k in members)
            out.append(Valley(names, first, second, tuple(c for k, c in known if k == g)))
    return tuple(out)


def elongations(theta: np.ndarray, width: np.ndarray, poor: Sequence[bool]) -> list[tuple[tuple[int, int], float]]:
    """Pairs of parameters along whose plane the bodies ``theta`` (M, P) lie on a line, the most elongated first.

    ``width``: (P,) of the intervals. ``poor``: (P,) which are poorly determined; pairs without one are left out.
    """
    elongated = []
    for i, j in combinations(range(width.size), 2):
        both_move = np.ptp(theta[:, [i, j]], axis=0).all()  # else one of them is the same in all bodies, on its bound
        if (poor[i] or poor[j]) and width[i] > 0 and width[j] > 0 and both_move:
            along, across = _principal(theta[:, [i, j]] / width[[i, j]])
            elongation = float(np.ptp(along) / max(np.ptp(across), 1e-12))
            if elongation >= ELONGATED:
                elongated.append(((i, j), elongation))
    return sorted(elongated, key=lambda p: -p[1])


def moving(model: Model, estimates: Sequence[Estimate], e: Estimate) -> dict[str, tuple[float, float]]:
    """Parameters that move along the profile of ``e``, with their values at its lower and upper end.

    Named are those that move by at least `MOVES` of their own interval, the largest move first.
    """
    moves = []
    for k, other in enumerate(estimates[: len(model.names)]):
        width = other.high - other.low
        low, high = float(e.profile.low_theta[k]), float(e.profile.high_theta[k])
        if other.name != e.name and width > 0 and abs(high - low) >= MOVES * width:
            moves.append((abs(high - low) / width, other.name, (low, high)))
    return {name: ends for _, name, ends in sorted(moves, reverse=True)}


def _poor(e: Estimate) -> bool:
    return e.verdict != "identifiable" or (e.high - e.low) / 2 > WIDE * abs(e.estimate)


def _principal(points: np.ndarray) -> np.ndarray:
    """Positions (K, M) of ``points`` (M, K) along their principal axes, the longest first."""
    centred = points - points.mean(axis=0)
    return np.asarray((centred @ np.linalg.svd(centred, full_matrices=False)[2].T).T)


def _ends(theta: np.ndarray, width: np.ndarray) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The two bodies of ``theta`` (M, K) at the ends of their longest axis, in units of ``width`` (K,)."""
    along = _principal(theta / width)[0]
    first, second = (tuple(map(float, theta[k])) for k in (along.argmin(), along.argmax()))
    return first, second


def _combinations(model: Model, theta: np.ndarray, i: int, j: int) -> list[Quantity]:
    """The combination of two parameters that stays the same along the line of bodies, and the opposite one."""
    a, b = theta[:, i], theta[:, j]
    centred = np.stack([a - a.mean(), b - b.mean()], axis=1)
    along = np.linalg.svd(centred, full_matrices=False)[2][0]
    factor = float(-along[0] / along[1])
    plain = float(np.sign(factor))
    if np.ptp(a + plain * b) <= PLAIN * np.ptp(a + factor * b):
        factor = plain
    names = model.names[i], model.names[j]
    return [replace(expression(model, _text(names, c)), unit=model.units[i]) for c in (factor, -factor)]


def _text(names: tuple[str, str], factor: float) -> str:
    size = abs(factor)
    second = names[1] if size == 1 else f"{size:.2g} * {names[1]}"
    return f"{names[0]} {'+' if factor > 0 else '-'} {second}"


def _profiles_of(
    model: Model, base: Model, lines: Lines, minima: Minima, wanted: Sequence[Quantity], level: float, seed: int
) -> list[Profile]:
    """Profiles of the ``wanted`` quantities of a fit of ``model`` to ``lines`` that found the ``minima``.

    ``base``: ``model`` without effects. ``seed``: of the fit, whose correction is drawn again.
    """
    if not wanted:
        return []
    data, draws = Data.of(lines), simulated(lines.noise, stream(seed, "fit correction"))
    rise = threshold(model, data, minima, wanted, draws, level).rise
    return profiles(Fitter(model, without_prior(model, base), lines.f), data, minima, wanted, rise)
