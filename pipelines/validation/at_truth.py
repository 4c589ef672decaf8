"""Whether intervals contain the true values, for many simulated recordings at once and without the ends of intervals.

A profile likelihood interval contains a value if the deviance of the best fit with the quantity at that value is below
the threshold. So 14 fits with one quantity held at its true value decide what 28 searches for ends decide, at a tenth
of the cost. All fits of all recordings are one queue of the compiled solver.

The truth is known here, so it is one start of every search, and few random ones are enough: a lower minimum matters
only as far as it raises the deviance at the truth. Recordings are searched up to each highest frequency in turn, and
minima up to one frequency are starts up to the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from mcstudy.fitting.arguments import Restraint
from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.identification.correction import Draws
from mcstudy.identification.minimum import ITERATIONS, TOLERANCE, Minima, distinct, standing
from mcstudy.identification.profile import Linearised
from mcstudy.identification.threshold import threshold
from mcstudy.lines.base_fit import drawn_starts
from mcstudy.models.quantities import Quantity
from mcstudy.spectra.lines import Lines
from mcstudy.stance.stability import growth_rate

AHEAD, LEFT = 12, 6
"""Evaluations of every start, and how many of each recording then go on to a minimum."""

KEPT = 3
"""Minima of a recording that are starts up to the next highest frequency."""

ROUGH, ENOUGH = 1e-2, 60
"""Tolerance and most evaluations of the first fit with a quantity at its true value."""

STIFF = 1e9
"""Weight that holds a sum of parameters, times the square of its true value: its deviance is exact to 1e-4."""


class Judged(NamedTuple):
    """Of R recordings with K quantities.

    contained: (R, K), whether the interval contains the truth. rise: (R, K) deviance of the best fit with the quantity
    at its true value, above the lowest minimum. near: (R,) the quantities to first order. minima: (R,).
    """

    contained: np.ndarray
    rise: np.ndarray
    near: list[Linearised]
    minima: list[Minima]


def judged(
    fitter: Fitter,
    lines: Sequence[Lines],
    wanted: Sequence[Quantity],
    truth: np.ndarray,
    draws: Draws,
    level: float,
    further: np.ndarray,
    exact: bool = False,
) -> Judged:
    """Test intervals of ``wanted`` linear quantities at the parameters ``truth`` (P,).

    ``lines``: of R recordings, at the frequencies of ``fitter``. ``further``: (R, S, P) starts beside the truth.
    ``exact``: find all rises exactly; otherwise those of intervals that contain the truth are upper limits.
    """
    data, model = [Data.of(x) for x in lines], fitter.model
    packed = np.array([fitter.packed(d) for d in data])
    starts = np.concatenate([np.broadcast_to(truth, (len(lines), 1, truth.size)), further], axis=1)
    minima = _searched(fitter, packed, starts, 2 * data[0].y.size)
    near = [Linearised.at(model, m, wanted) for m in minima]
    lowest = np.array([m.chi2[0] for m in minima])[:, None]
    least = float(ndtri(0.5 + level / 2)) ** 2  # no threshold is lower: every correction raises it
    reach = lowest + np.full(len(wanted), least)
    enough = np.broadcast_to(lowest, reach.shape) if exact else reach
    rise = _held(fitter, packed, wanted, truth, minima, near, enough, reach) - lowest
    contained = rise <= least
    for r in np.flatnonzero(~contained.all(axis=1)):
        contained[r] = rise[r] <= threshold(model, data[r], minima[r], wanted, draws, level).rise
    return Judged(contained, rise, near, minima)


def starts(fitter: Fitter, seeds: Sequence[int], n: int, before: Judged | None = None) -> np.ndarray:
    """``n`` random starts of each recording, after the minima that were found ``before``; (R, S, P)."""
    drawn = np.array([drawn_starts(fitter.model, seed, n + 1)[1:] for seed in seeds])
    if before is None:
        return drawn
    kept = np.array([m.theta[np.minimum(np.arange(KEPT), len(m.theta) - 1)] for m in before.minima])
    return np.concatenate([kept, drawn], axis=1)


def _searched(fitter: Fitter, packed: np.ndarray, starts: np.ndarray, size: int) -> list[Minima]:
    """Minima of each recording from starts (R, S, P), of which the first counts as aimed, to ``size`` real numbers."""
    R, S, P = starts.shape
    problem = np.repeat(np.arange(R), S)
    first = fitter.fits(packed, starts.reshape(-1, P), problem, tolerance=TOLERANCE, max_iterations=AHEAD)
    reached = np.where(np.isfinite(first.chi2), first.chi2, np.inf).reshape(R, S)
    going = np.sort(np.argsort(reached, axis=1)[:, :LEFT], axis=1)
    going[:, 0] = 0  # the truth goes on in any case
    flat = (going + S * np.arange(R)[:, None]).ravel()
    last = fitter.fits(packed, first.estimate[flat], problem[flat], tolerance=TOLERANCE, max_iterations=ITERATIONS)
    m = going.shape[1]
    chi2 = np.where(np.isfinite(last.chi2), last.chi2, np.inf).reshape(R, m)
    stable = (growth_rate(fitter.model, last.estimate) < 0).reshape(R, m)
    out = []
    for r in range(R):
        stood = standing(stable[r], chi2[r], size)
        best, hits = distinct(np.where(stood, chi2[r], np.inf) if stood.any() else chi2[r], 1)
        at = best + m * r
        out.append(
            Minima(last.estimate[at], last.chi2[at], last.information[at], hits, S - 1, len(best), np.sort(chi2[r]))
        )
    return out


def _held(
    fitter: Fitter,
    packed: np.ndarray,
    wanted: Sequence[Quantity],
    truth: np.ndarray,
    minima: list[Minima],
    near: list[Linearised],
    enough: np.ndarray,
    reach: np.ndarray,
) -> np.ndarray:
    """Least deviance (R, K) with each quantity at its true value; below what is ``enough`` (R, K) only roughly.

    Starts are the truth and the minima below ``reach`` (R, K).
    """
    R, K = reach.shape
    gradient, goal = near[0].gradients, np.array([q.value(truth) for q in wanted])
    least = np.full((R, K), np.inf)

    def fit(which: np.ndarray, begin: np.ndarray, tolerance: float, most: int) -> np.ndarray:
        """Deviances of the tests ``which`` (M, 2), recording and quantity, from ``begin`` (M, P)."""
        r, k = which.T
        alone = np.count_nonzero(gradient, axis=1)[k] == 1
        found = np.empty(len(which))
        for mine in (alone, ~alone):
            if not mine.any():
                continue
            lower, upper = (np.tile(x, (int(mine.sum()), 1)) for x in (fitter.model.lower, fitter.model.upper))
            restraint = None
            if mine is alone:
                rows, p = np.arange(len(lower)), gradient[k[mine]].argmax(axis=1)
                lower[rows, p] = upper[rows, p] = goal[k[mine]] / gradient[k[mine], p]
            else:
                restraint = Restraint(gradient[k[mine]], goal[k[mine]], STIFF / goal[k[mine]] ** 2)
            fits = fitter.fits(packed, begin[mine], r[mine], lower, upper, tolerance, most, restraint)
            found[mine] = fits.objective
            begin[mine] = fits.estimate
        np.minimum.at(least, (r, k), found)
        return begin

    which = np.argwhere(least > enough)
    reached = fit(which, np.tile(truth, (len(which), 1)), ROUGH, ENOUGH)
    open_ = least[tuple(which.T)] > enough[tuple(which.T)]
    which, reached = which[open_], reached[open_]
    if len(which):
        fit(which, reached, TOLERANCE, ITERATIONS)
    for n in range(max(len(m.chi2) for m in minima)):
        which = np.argwhere(least > enough)
        which = which[[n < len(minima[r].chi2) and minima[r].chi2[n] < reach[r, k] for r, k in which]]
        if not len(which):
            continue
        begin = np.array(
            [minima[r].theta[n] + near[r].tangent[k] * (goal[k] - gradient[k] @ minima[r].theta[n]) for r, k in which]
        )
        fit(which, np.clip(begin, fitter.model.lower, fitter.model.upper), TOLERANCE, ITERATIONS)
    return least
