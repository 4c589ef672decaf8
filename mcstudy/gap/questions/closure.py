"""The share of the gap that a cause closes.

Two quantities answer this question.

The *energies* come from the data alone. G is the mean over pairs of independent repeats of r_i' r_j, with the whitened
residuals of the repeats in units of the covariance of their mean. Its expectation is zero when only noise is left. G
is computed in the space of smooth deviations and library signatures, orthogonal to the parameters of the model. The
gap of a linear body lies in this space; the other several hundred dimensions contain only noise, and errors of the
parameters have no influence.

The *share* is the part of the gap that the leading cause would close without noise. Its interval includes three
uncertainties: the cause may be another one (each other hypothesis implies a share that the leading cause closes if that
hypothesis is true); it may be outside the library (energy left in the smooth space); and an unstructured residual may
be left, as nonlinear bodies produce it (spike-and-slab prior). Derived.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ive, xlogy

from mcstudy.fitting.penalised import Fitted, Fitter, whiten
from mcstudy.fitting.problem import Data
from mcstudy.fitting.small_linear import orthonormal
from mcstudy.gap.candidates.unstructured_residual import UnstructuredResidual
from mcstudy.gap.questions.departure import left_energies
from mcstudy.gap.questions.detection import as_complex, linear_null
from mcstudy.gap.questions.evidence import Hypothesis
from mcstudy.gap.questions.interval import Interval
from mcstudy.spectra.lines import Lines
from mcstudy.stance.response import frf_jacobian

FLOOR = 0.1
"""The gap counts as closed to the noise floor when the upper limit of the remaining share is below this."""

WANTED_HALF_WIDTH = 0.15
"""Half-width of the interval of the share for which the number of trials is computed."""

LEAST = 0.05
"""Share of its length that a deviation must keep, orthogonal to the parameters, to count as a dimension."""

CONSIDERED = 3e-3
"""Posterior probability from which another hypothesis contributes to the interval."""

SAMPLES = 8000
"""Posterior samples of the share."""

SWAY_SAMPLES = 400
"""Null samples of the error of predicted sway."""


@dataclass(frozen=True)
class Closure:
    """Share of the gap that a cause closes.

    Attributes
    ----------
    fraction, low, high
        Median and 95 % limits of the share.
    at_noise_floor
        Whether the gap is closed to the noise floor: the upper 95 % limit of what is left is below 10 %.
    before, after
        Energy of the residual without and with the cause, noise subtracted.
    trials_needed
        Total number of such trials needed to know the share to ±15 percentage points.
    """

    fraction: float
    low: float
    high: float
    at_noise_floor: bool
    before: float
    after: float
    trials_needed: int


def smooth_directions(fitted: Fitted, data: Data, space: np.ndarray) -> np.ndarray:
    """Orthonormal basis (4 N, K) of ``space`` (4 N, M), orthogonal to the parameters of the fit."""
    J = fitted.jacobian(data) * fitted.prior.scale
    return np.asarray(orthonormal(np.ascontiguousarray(J.T), np.ascontiguousarray(space.T), LEAST).T)


def energy(fitted: Fitted, data: Data, lines: Lines, basis: np.ndarray) -> float:
    """Energy of the residual along ``basis`` (4 N, K) of `smooth_directions`, between repeats.

    With a single repeat of a recording: the energy of the mean residual minus its expected noise.
    """
    H = fitted.response(data.f)
    by_line = basis.reshape(2, len(lines), H.shape[1], -1)
    total, means = 0.0, []
    for part, block in zip(lines.parts, lines.blocks, strict=True):
        directions = by_line[:, block].reshape(-1, basis.shape[1])
        b = np.array([directions.T @ whiten(data.weight[block], y - H[block]) for y in part.repeats])
        w = part.weight.mean(axis=1)
        mean = w @ b
        means.append(mean)
        if len(w) < 2:
            total += float(mean @ mean) - float((directions**2).sum())
            continue
        same = float((w**2) @ (b**2).sum(axis=1))
        total += (float(mean @ mean) - same) / (1 - float((w**2).sum()))
    across = np.sum(means, axis=0)  # errors of different recordings are independent
    return total + float(across @ across) - float(sum(m @ m for m in means))


@dataclass(frozen=True)
class Belief:
    """Posterior on which the share is based: hypotheses with their probabilities, the probability of the unknown, and
    null
    samples (n,) of the squared whole residual."""

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
) -> Closure:
    """Share of the gap of ``base`` that ``added`` closes; ``space`` (4 N, M) spans the smooth deviations."""
    before = energy(base, data, lines, smooth_directions(base, data, space))
    basis = smooth_directions(added, data, space)
    after, k = energy(added, data, lines, basis), basis.shape[1]
    residual = added.residual(data)
    inside = basis.T @ residual
    smooth_square = float(inside @ inside)
    first = base.residual(data)
    explained = max(float(first @ first) - float(residual @ residual), 1.0)
    beside = max(float(residual @ residual) - smooth_square, 0.0)
    unstructured = UnstructuredResidual.of(belief.null_chi2, taken=k).samples(beside, rng, SAMPLES)
    left = _left(smooth_square, k, rng), left_energies(base, added, data, rng, SAMPLES)
    fraction = _shares(base, added, data, belief, explained, *left, unstructured, rng)
    share = Interval.of(fraction)
    trials = int(np.unique(lines.trial).size)
    needed = int(np.ceil(trials * max(1.0, (share.high - share.low) / 2 / WANTED_HALF_WIDTH)))
    return Closure(share.estimate, share.low, share.high, 1 - share.low < FLOOR, before, after, needed)


def _shares(
    base: Fitted,
    added: Fitted,
    data: Data,
    belief: Belief,
    explained: float,
    left: np.ndarray,
    small: np.ndarray,
    unstructured: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Posterior samples of the share, (`SAMPLES`,), over all hypotheses with a gap.

    Energy beside the leading cause, (`SAMPLES`,): ``left`` if the cause is outside the library, else ``small``.
    """
    weight, energies, shares = [], [], []
    for h, p in belief.hypotheses:
        if not h.effects or p < CONSIDERED:
            continue
        if h.fitted.model.name == added.model.name:
            total, remains = explained, 0.0
        else:
            clean = data.with_y(h.fitted.response(data.f))
            total = _remains(base, clean)
            remains = min(_remains(added, clean), total)
        weight.append(p)
        energies.append(max(total, 1e-6))
        shares.append(1 - remains / max(total, 1e-6))
    weight.append(belief.unknown)
    energies.append(np.nan)
    shares.append(np.nan)
    chosen = rng.choice(len(weight), SAMPLES, p=np.array(weight) / np.sum(weight))
    # the explained part of an unknown gap is a squared score with a standard error of 1
    score = (np.sqrt(max(explained - 1.0, 0.0)) + rng.standard_normal(SAMPLES)) ** 2
    unknown = chosen == len(weight) - 1
    beside = np.where(unknown, left, small)
    whole = np.where(unknown, score, np.array(energies)[chosen]) + beside
    closed = np.where(unknown, score, np.array(energies)[chosen] * np.array(shares)[chosen])
    return np.asarray(closed / np.maximum(whole + unstructured, 1e-9))


def _remains(fitted: Fitted, clean: Data) -> float:
    """Squared whitened residual of the model fitted to noise-free responses."""
    fitter = Fitter(fitted.model, fitted.prior, clean.f)
    r = fitter.best(clean, fitted.theta).residual(clean)
    return float(r @ r)


def _left(total: float, k: int, rng: np.random.Generator) -> np.ndarray:
    """Posterior samples (`SAMPLES`,) of the energy left in k smooth dimensions with sum of squares ``total``.

    The prior on delta is flat.
    """
    delta = np.linspace(0.0, np.sqrt(max(total, 0.0)) + 8.0, 600)[1:]
    log_p = _log_noncentral_chi2(max(total, 1e-3), k, delta**2)
    p = np.exp(log_p - log_p.max())
    return np.asarray(rng.choice(delta, SAMPLES, p=p / p.sum()) ** 2)


def _log_noncentral_chi2(x: float, k: int, nc: np.ndarray) -> np.ndarray:
    """Log density at ``x`` of chi-squared with k degrees of freedom and noncentrality ``nc`` > 0.

    As `scipy.stats.ncx2` computes it, to the last bit: to import that package takes longer than a fast diagnosis.
    """
    order, xs, ns = k / 2.0 - 1.0, np.sqrt(x), np.sqrt(nc)
    bessel = ive(order, xs * ns) / 2.0
    with np.errstate(divide="ignore"):
        return np.asarray(xlogy(order / 2.0, x / nc) - 0.5 * (xs - ns) ** 2 + np.log(bessel))


def sway_rms_deg(fitted: Fitted, data: Data, lines: Lines) -> float:
    """Root-mean-square error of predicted sway over both angles and all lines, deg."""
    square = (np.abs(data.y - fitted.response(data.f)) ** 2).sum(axis=1)
    return float(np.rad2deg(np.sqrt((2 * lines.power * square).sum())))


def floor_rms_deg(fitted: Fitted, data: Data, lines: Lines) -> float:
    """The same error, deg, when only noise is left: the noise minus the part that the fitted parameters absorb."""
    J = np.moveaxis(frf_jacobian(fitted.model, fitted.theta, data.f)[1], -1, 0)
    # Not from the weights, whose inverse is several times too large when the noise is estimated from few lines.
    noise = lines.noise.variance.sum(axis=1)
    taken = np.einsum("pni,pq,qni->n", J, fitted.covariance, J.conj(), optimize=True).real
    return float(np.rad2deg(np.sqrt((2 * lines.power * np.maximum(noise - taken, 0.05 * noise)).sum())))


def noise_rms_deg(fitted: Fitted, data: Data, lines: Lines, rng: np.random.Generator) -> tuple[float, float]:
    """The range, deg, that holds the error of predicted sway in 95 % of recordings with nothing but noise.

    From null samples through the linearised fit, which include the uncertainty of the noise estimate.
    """
    null = linear_null(fitted, data, lines.noise.draw(rng, SWAY_SAMPLES))
    errors = np.einsum("nij,njk->nik", np.linalg.inv(data.weight), as_complex(null, data.f.size))
    square = 2 * lines.power @ (np.abs(errors) ** 2).sum(axis=1)
    low, high = np.rad2deg(np.sqrt(np.quantile(square, (0.025, 0.975))))
    return float(low), float(high)
