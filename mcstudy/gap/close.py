"""How far the gap shrinks when a cause is added: residual energy between independent repeats.

The energy of a gap, G = mean over pairs of independent repeats of r_i' r_j (whitened residuals of the repeats in units
of the covariance of their mean), is zero on average when only noise is left. It is taken inside the space of smooth
deviations and of the library's signatures, at right angles to the parameters of the model: a gap lives there, the
other several hundred dimensions hold noise only, and estimation errors of the parameters do not enter. Derived.

The interval combines what is certain about the explained part (a squared normal score) and about what is left (a
noncentral chi-squared).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from mcstudy.gap.fitting import Data, Fitted, whiten
from mcstudy.gap.lines import Lines
from mcstudy.gap.small_linear import orthonormal
from mcstudy.stance.response import frf_jacobian

FLOOR = 0.1
"""Upper limit of the remaining share below which the gap is closed to the noise floor."""

WANTED_HALF_WIDTH = 0.15

LEAST = 0.05
"""Share of its length that a deviation must keep, at right angles to the parameters, to count as a dimension."""


@dataclass(frozen=True)
class Closed:
    """Share of the gap that a cause explains, with 95 % limits; energies before and after; trials for +-15 %."""

    fraction: float
    low: float
    high: float
    at_noise_floor: bool
    before: float
    after: float
    dimensions: int
    trials_needed: int


def _basis(fitted: Fitted, data: Data, space: np.ndarray) -> np.ndarray:
    """Orthonormal basis (4 N, K) of ``space`` (4 N, M) without what the parameters of the fit can give."""
    J = fitted.jacobian(data) * fitted.prior.scale
    return np.asarray(orthonormal(np.ascontiguousarray(J.T), np.ascontiguousarray(space.T), LEAST).T)


def energy(fitted: Fitted, data: Data, lines: Lines, space: np.ndarray) -> tuple[float, int]:
    """Energy of the residual between repeats, and the dimensions it was taken in.

    With a single repeat, the energy of the mean residual less its expected noise.
    """
    basis = _basis(fitted, data, space)
    H = fitted.response(data.f)
    b = np.array([basis.T @ whiten(data.weight, y - H) for y in lines.repeats])
    w = lines.weight.mean(axis=1)
    mean = w @ b
    if len(w) < 2:
        return float(mean @ mean) - basis.shape[1], basis.shape[1]
    same = float((w**2) @ (b**2).sum(axis=1))
    return (float(mean @ mean) - same) / (1 - float((w**2).sum())), basis.shape[1]


def close(base: Fitted, added: Fitted, data: Data, lines: Lines, space: np.ndarray, rng: np.random.Generator) -> Closed:
    """Share of the gap of ``base`` that ``added`` closes; ``space`` (4 N, M) holds the deviations that count."""
    before, _ = energy(base, data, lines, space)
    after, k = energy(added, data, lines, space)
    explained = max(before - after, 0.0)
    n = 4000
    score = np.sqrt(explained) + rng.standard_normal(n)
    left = _left(max(after + k, 0.0), k, rng.random(n))
    fraction = score**2 / np.maximum(score**2 + left, 1e-9)
    low, high = (float(x) for x in np.quantile(fraction, (0.025, 0.975)))
    point = float(np.clip(explained / max(explained + max(after, 0.0), 1e-9), 0.0, 1.0))
    trials = int(np.unique(lines.trial).size)
    half = (high - low) / 2
    needed = int(np.ceil(trials * max(1.0, half / WANTED_HALF_WIDTH)))
    return Closed(point, low, high, 1 - low < FLOOR, before, after, k, needed)


def _left(total: float, k: int, u: np.ndarray) -> np.ndarray:
    """Draws of the noncentrality whose confidence distribution a noncentral chi-squared ``total`` gives."""
    grid = np.concatenate([[0.0], np.geomspace(1e-2, max(4 * total, 40.0), 300)])
    cdf = stats.ncx2.sf(total, k, np.maximum(grid, 1e-12))
    return np.interp(u, np.maximum.accumulate(cdf), grid)


def sway_rms_deg(fitted: Fitted, data: Data, lines: Lines) -> float:
    """Root-mean-square error of predicted sway over both angles and all lines, deg."""
    square = (np.abs(data.y - fitted.response(data.f)) ** 2).sum(axis=1)
    return float(np.rad2deg(np.sqrt((2 * lines.power * square).sum())))


def floor_rms_deg(fitted: Fitted, data: Data, lines: Lines) -> float:
    """The same error where nothing but noise is left: what noise the fit of these parameters does not absorb, deg."""
    colour = np.linalg.inv(data.weight)
    J = np.moveaxis(frf_jacobian(fitted.model, fitted.theta, data.f)[1], -1, 0)
    noise = 2 * np.einsum("nij,nij->n", colour, colour.conj()).real
    taken = np.einsum("pni,pq,qni->n", J, fitted.covariance, J.conj(), optimize=True).real
    return float(np.rad2deg(np.sqrt((2 * lines.power * np.maximum(noise - taken, 0.05 * noise)).sum())))
