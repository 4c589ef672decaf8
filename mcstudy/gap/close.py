"""How far the gap shrinks when a cause is added.

Two views of the same question.

*Energies* come from the data alone: G = mean over pairs of independent repeats of r_i' r_j (whitened residuals of the
repeats in units of the covariance of their mean) is zero on average when only noise is left. It is taken inside the
space of smooth deviations and of the library's signatures, at right angles to the parameters of the model: a gap of a
linear body lives there, the other several hundred dimensions hold noise, and errors of the parameters do not enter.

The *share* that the leading cause closes is what it would close without noise, with an interval that knows what is
uncertain: that the cause is another one (each other hypothesis says what share the leading one closes if it is true),
that it is outside the library (what is left in the smooth space), and that something is left that is not smooth at
all, as nonlinear bodies do (a spike at zero and a slab). Derived.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from mcstudy.gap.evidence import Hypothesis
from mcstudy.gap.fitting import Data, Fitted, Fitter, whiten
from mcstudy.gap.lines import Lines
from mcstudy.gap.rough import Rough
from mcstudy.gap.small_linear import orthonormal
from mcstudy.stance.response import frf_jacobian

FLOOR = 0.1
"""Upper limit of the remaining share below which the gap is closed to the noise floor."""

WANTED_HALF_WIDTH = 0.15

LEAST = 0.05
"""Share of its length that a deviation must keep, at right angles to the parameters, to count as a dimension."""

CONSIDERED = 3e-3
"""Posterior probability from which another hypothesis has a say in the interval."""

SAMPLES = 8000


@dataclass(frozen=True)
class Closed:
    """Share of the gap that a cause closes: median and 95 % limits; energies between repeats before and after, in
    ``dimensions``; trials like these to know the share to +-15 %."""

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


@dataclass(frozen=True)
class Belief:
    """What the posterior says when the share is asked for: hypotheses with their probabilities, the unknown's, and the
    square of the whole residual (n,) under the null."""

    hypotheses: Sequence[tuple[Hypothesis, float]]
    unknown: float
    null_chi2: np.ndarray


def close(
    base: Fitted,
    added: Fitted,
    data: Data,
    lines: Lines,
    space: np.ndarray,
    belief: Belief,
    rng: np.random.Generator,
) -> Closed:
    """Share of the gap of ``base`` that ``added`` closes; ``space`` (4 N, M) holds the deviations that are smooth."""
    before, _ = energy(base, data, lines, space)
    after, k = energy(added, data, lines, space)
    residual = added.residual(data)
    inside = _basis(added, data, space).T @ residual
    smooth_square = float(inside @ inside)
    first = base.residual(data)
    explained = max(float(first @ first) - float(residual @ residual), 1.0)
    beside = max(float(residual @ residual) - smooth_square, 0.0)
    rough = Rough.of(belief.null_chi2, taken=k).draws(beside, rng, SAMPLES)
    fraction = _shares(base, added, data, belief, explained, _left(smooth_square, k, rng), rough, rng)
    low, middle, high = (float(x) for x in np.quantile(fraction, (0.025, 0.5, 0.975)))
    trials = int(np.unique(lines.trial).size)
    needed = int(np.ceil(trials * max(1.0, (high - low) / 2 / WANTED_HALF_WIDTH)))
    return Closed(middle, low, high, 1 - low < FLOOR, before, after, k, needed)


def _shares(
    base: Fitted,
    added: Fitted,
    data: Data,
    belief: Belief,
    explained: float,
    left: np.ndarray,
    rough: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Draws of the share, (`SAMPLES`,), over all hypotheses that have a gap."""
    weight, energies, shares = [], [], []
    for h, p in belief.hypotheses:
        if not h.effects or p < CONSIDERED:
            continue
        if h.fitted.model.name == added.model.name:
            total, remains = explained, 0.0
        else:
            clean = data.with_y(h.fitted.response(data.f))
            total = _remains(base, base, clean)
            remains = min(_remains(added, base, clean), total)
        weight.append(p)
        energies.append(max(total, 1e-6))
        shares.append(1 - remains / max(total, 1e-6))
    weight.append(belief.unknown)
    energies.append(np.nan)
    shares.append(np.nan)
    chosen = rng.choice(len(weight), SAMPLES, p=np.array(weight) / np.sum(weight))
    # the explained part of an unknown gap is a squared score, known to one standard deviation
    score = (np.sqrt(max(explained - 1.0, 0.0)) + rng.standard_normal(SAMPLES)) ** 2
    unknown = chosen == len(weight) - 1
    whole = np.where(unknown, score + left, np.array(energies)[chosen])
    closed = np.where(unknown, score, np.array(energies)[chosen] * np.array(shares)[chosen])
    return np.asarray(closed / np.maximum(whole + rough, 1e-9))


def _remains(fitted: Fitted, base: Fitted, clean: Data) -> float:
    """Square of the whitened residual that the model leaves in noise-free responses."""
    fitter = Fitter(fitted.model, base.model, clean.f)
    r = fitter.best(clean, fitted.theta).residual(clean)
    return float(r @ r)


def _left(total: float, k: int, rng: np.random.Generator) -> np.ndarray:
    """Draws (`SAMPLES`,) of the energy left in k smooth dimensions whose square is ``total``; flat prior on delta."""
    delta = np.linspace(0.0, np.sqrt(max(total, 0.0)) + 8.0, 600)[1:]
    log_p = stats.ncx2.logpdf(max(total, 1e-3), k, delta**2)
    p = np.exp(log_p - log_p.max())
    return np.asarray(rng.choice(delta, SAMPLES, p=p / p.sum()) ** 2)


def sway_rms_deg(fitted: Fitted, data: Data, lines: Lines) -> float:
    """Root-mean-square error of predicted sway over both angles and all lines, deg."""
    square = (np.abs(data.y - fitted.response(data.f)) ** 2).sum(axis=1)
    return float(np.rad2deg(np.sqrt((2 * lines.power * square).sum())))


def floor_rms_deg(fitted: Fitted, data: Data, lines: Lines) -> float:
    """The same error where nothing but noise is left: what noise the fit of these parameters does not absorb, deg."""
    J = np.moveaxis(frf_jacobian(fitted.model, fitted.theta, data.f)[1], -1, 0)
    # Not from the weights: where few lines tell the noise, their inverse is several times too large.
    noise = lines.noise.variance.sum(axis=1)
    taken = np.einsum("pni,pq,qni->n", J, fitted.covariance, J.conj(), optimize=True).real
    return float(np.rad2deg(np.sqrt((2 * lines.power * np.maximum(noise - taken, 0.05 * noise)).sum())))
