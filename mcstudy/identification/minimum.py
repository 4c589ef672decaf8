"""The best fit of many starts, and how likely it is that a lower minimum was missed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.fitting.arguments import PenalisedFits, Prior
from mcstudy.fitting.certainty import missed
from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.lines.base_fit import drawn_starts, linearised_starts
from mcstudy.lines.priors import weak_prior
from mcstudy.stance.feedback import Model
from mcstudy.stance.stability import growth_rate

BATCH, MOST = 16, 1920
"""Random starts per round, and the most that are drawn."""

MISSED = 0.01
"""Wanted chance that one further start would end in a minimum not seen yet."""

TOLERANCE, ITERATIONS = 1e-7, 300
"""Decrease of the deviance at which a fit has converged, and the most evaluations of one fit."""

FIRST, HOPELESS = 40, 300.0
"""Evaluations after which a random start is given up whose deviance is still so far above the lowest one known."""

APART = 1e-3
"""Fits whose deviances differ by less are of one minimum."""

PASS, ROUGH, ROUNDS = 50.0, 1e-3, 3
"""Rise of the deviance up to which a minimum's valley is followed to find others, how exactly (of the rise), and how
often from a new lowest one."""

PATIENCE = 160
"""Random starts after which a search ends that found no stable minimum within `REACH` of the lowest."""

SEARCHES = 300
"""Simulated recordings in which searches with ten times the random starts looked for a lower minimum, and found none
(``pipelines/validation/missed_minima.py --recordings 100``)."""

REACH = 20.0
"""Rise of the deviance above the lowest minimum up to which minima count one by one, and all higher ones as one."""

TOLD = 10.0
"""Rise of the deviance up to which other minima are told."""


@dataclass(frozen=True)
class Minima:
    """Distinct minima of the deviance that S random starts found, the lowest first.

    The person stood, so minima with an unstable closed loop are left out, unless no stable one is within `REACH` of the
    lowest (times its deviance per datum, where that is above one): then the model is wrong.

    Attributes
    ----------
    theta: (K, P). chi2: (K,). information: (K, P, P), J^T J of the whitened data. hits: (K,) random starts that ended
    there; a minimum found only from a linearised start has none. starts: S. found: minima that they reached, unstable
    ones among them; all above `REACH` count as one. waterfall: (S,) deviances, ascending. linear: deviance at which
    the start from the linear structure of the equations ended; inf without one.
    """

    theta: np.ndarray
    chi2: np.ndarray
    information: np.ndarray
    hits: np.ndarray
    starts: int
    found: int
    waterfall: np.ndarray
    linear: float = np.inf

    @property
    def missed(self) -> float:
        """Expected share of starts that would end in a minimum not seen yet; see `unseen`."""
        return unseen(self.found, self.starts)

    @property
    def lowest_from(self) -> str:
        """Which starts ended in the lowest minimum: "random", "linear" or, if neither did, "across" (see `_across`)."""
        return "random" if self.hits[0] else "linear" if self.linear < self.chi2[0] + APART else "across"

    @property
    def missed_lowest(self) -> float | None:
        """Chance that as many new random starts alone miss the lowest minimum; None if none of these ended there.

        This is not the chance that the search missed it, see `SEARCHES`.
        """
        return float(missed(self.hits[0] / self.starts, self.starts)) if self.hits[0] else None


def without_prior(model: Model, base: Model) -> Prior:
    """No prior; steps are scaled with what is typical of people. ``base``: ``model`` without effects."""
    return weak_prior(model, base)._replace(weight=0.0)


def search(fitter: Fitter, data: Data, seed: int, least: int = 0) -> Minima:
    """Starts from the linear structure and at random, until `Minima.missed` is below `MISSED` or `MOST` are drawn.

    Then starts around the lowest minimum, see `_across`. ``least``: random starts that are drawn in any case.
    """
    model, drawn = fitter.model, drawn_starts(fitter.model, seed, MOST)
    aimed = linearised_starts(model, data, seed, 1)
    fits = [_converged(fitter, data, aimed)] if len(aimed) else []
    linear = float(np.nan_to_num(fits[0].chi2, nan=np.inf).min()) if fits else np.inf
    begun = len(aimed)  # starts that are not random; their fits come first
    for first in range(0, MOST, BATCH):
        fits.append(
            _hopeful(fitter, data, drawn[first : first + BATCH], min((f.chi2.min() for f in fits), default=np.inf))
        )
        chi2, best, hits = _minima(fits, begun)
        near = chi2[best] - chi2[best[0]] < REACH
        found = int((hits[near] > 0).sum() + (hits[~near] > 0).any())
        waterfall = np.sort(chi2[begun:])
        enough = waterfall.size >= least and unseen(found, waterfall.size) < MISSED
        if enough or first + BATCH >= MOST:
            theta = np.concatenate([f.estimate for f in fits])
            stood = standing(growth_rate(model, theta[best]) < 0, chi2[best], 2 * model.n_outputs * len(data.f))
            if stood.any() or waterfall.size >= PATIENCE:
                break
    for _ in range(ROUNDS):
        lowest = best[stood][0] if stood.any() else best[0]
        below = chi2[lowest]
        fits.insert(0, _across(fitter, data, theta[lowest], below))
        begun += len(fits[0].chi2)
        chi2, best, hits = _minima(fits, begun)
        theta = np.concatenate([f.estimate for f in fits])
        stood = standing(growth_rate(model, theta[best]) < 0, chi2[best], 2 * model.n_outputs * len(data.f))
        if chi2[best[stood][0] if stood.any() else best[0]] > below - APART:
            break
    information = np.concatenate([f.information for f in fits])
    if stood.any():
        best, hits = best[stood], hits[stood]
    return Minima(theta[best], chi2[best], information[best], hits, waterfall.size, found, waterfall, linear)


def from_starts(fitter: Fitter, data: Data, starts: np.ndarray) -> Minima:
    """Minima at which fits from given ``starts`` (S, P) end, those of a body that stands if there are such."""
    model = fitter.model
    fits = _converged(fitter, data, np.clip(starts, model.lower, model.upper))
    chi2, best, hits = _minima([fits], 0)
    found = best.size
    stood = standing(growth_rate(model, fits.estimate[best]) < 0, chi2[best], 2 * model.n_outputs * len(data.f))
    if stood.any():
        best, hits = best[stood], hits[stood]
    return Minima(fits.estimate[best], chi2[best], fits.information[best], hits, len(starts), found, np.sort(chi2))


def _minima(fits: list[PenalisedFits], begun: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Deviances of all fits, and `distinct` of them; the first ``begun`` are not from random starts."""
    chi2 = np.concatenate([f.chi2 for f in fits])
    chi2 = np.where(np.isfinite(chi2), chi2, np.inf)
    return chi2, *distinct(chi2, begun)


def _across(fitter: Fitter, data: Data, theta: np.ndarray, chi2: float) -> PenalisedFits:
    """Fits from the ends of every parameter's range in which the deviance rises less than `PASS` above a minimum.

    Minima that fit about as well often lie in one long valley with low passes, and few random starts end in each.
    """
    P = theta.size
    height = np.full(2 * P, PASS * max(1.0, chi2 / (2 * fitter.model.n_outputs * len(data.f))))
    outwards = np.concatenate([np.eye(P), -np.eye(P)])
    starts, ceiling = np.tile(theta, (2 * P, 1)), chi2 + height
    ends = fitter.ends(fitter.packed(data), starts, outwards, ceiling, height, tolerance=ROUGH)
    return _converged(fitter, data, ends.estimate)


def standing(stable: np.ndarray, chi2: np.ndarray, values: int) -> np.ndarray:
    """Which minima (K,) are a person's who stood: the ``stable`` ones; none unless one of them is near the lowest.

    ``chi2``: (K,) deviances of fits to so many real ``values``.
    """
    lowest = chi2.min()
    reach = REACH * max(1.0, lowest / values)
    return np.asarray(stable & (stable & (chi2 < lowest + reach)).any())


def _converged(fitter: Fitter, data: Data, starts: np.ndarray) -> PenalisedFits:
    return fitter.fits(fitter.packed(data), starts, tolerance=TOLERANCE, max_iterations=ITERATIONS)


def _hopeful(fitter: Fitter, data: Data, starts: np.ndarray, lowest: float) -> PenalisedFits:
    """Fits from ``starts``, those that become hopeless left where they are."""
    fits = fitter.fits(fitter.packed(data), starts, tolerance=TOLERANCE, max_iterations=FIRST)
    go_on = np.flatnonzero(fits.chi2 < min(lowest, np.nan_to_num(fits.chi2, nan=np.inf).min()) + HOPELESS)
    if go_on.size:
        for mine, new in zip(fits, _converged(fitter, data, fits.estimate[go_on]), strict=True):
            mine[go_on] = new
    return fits


def distinct(chi2: np.ndarray, aimed: int) -> tuple[np.ndarray, np.ndarray]:
    """Index of one fit per minimum, the lowest first, and the random starts (all but the first ``aimed``) in each."""
    order = np.argsort(chi2)
    order = order[np.isfinite(chi2[order])]
    group = np.cumsum(np.diff(chi2[order], prepend=chi2[order[0]]) > APART)
    first = np.searchsorted(group, np.arange(group[-1] + 1))
    return order[first], np.bincount(group, weights=order >= aimed).astype(int)


def unseen(found: int, starts: int) -> float:
    """Expected share of starts that would end in a minimum not seen yet, W (W + 1) / (S (S - 1)).

    W: minima that S random starts ``found`` (Boender & Rinnooy Kan 1987, uniform prior on their number and shares).
    """
    return min(1.0, found * (found + 1) / (starts * (starts - 1)))
