"""What an estimated noise covariance adds to the uncertainty of estimates.

Were the covariance of the noise known, the likelihood ratio of a quantity would follow a chi-squared distribution with
one degree of freedom. It is estimated from few lines, so weights are wrong by chance: the ratio is larger by a factor
(Bartlett 1937) and has heavier tails (F with few degrees of freedom). Both are computed for each quantity from
simulated covariance estimates of the same uncertainty, in the linearised model, joint over lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc, fdtri

from mcstudy.fitting.small_linear import likelihood_ratios
from mcstudy.spectra.line_noise import LineNoise

DRAWS = 400

KNOWN_DOF = 1e9
"""Degrees of freedom for a covariance that is known."""

LEAST_DOF = 5.0
"""Fewest degrees of freedom of the F distribution; fewer would come from chance in `DRAWS` draws."""


@dataclass(frozen=True)
class Correction:
    """What the estimated noise does to the statistics of a fit.

    Attributes
    ----------
    factor, dof: (K,) of the likelihood ratios of K quantities, which follow factor F(1, dof).
    null_chi2: (D,) deviances of fits to simulated noise alone.
    """

    factor: np.ndarray
    dof: np.ndarray
    null_chi2: np.ndarray

    def threshold(self, level: float) -> np.ndarray:
        """Increase of the deviance, (K,), up to which values of a quantity belong to its ``level`` interval."""
        return self.factor * fdtri(1.0, self.dof, level)


class Draws(NamedTuple):
    """D simulated errors of N lines, and estimates of their precision; they depend on the noise estimate's design only.

    Attributes
    ----------
    precision: (D, N Y^2), of every line the real numbers of the estimated precision of Y outputs: its diagonal, then
    real and imaginary part of every element above it. pulled: (D, N Y) complex, the errors times it. deviance: (D,) of
    the errors. exact, exact_deviance: the same for the true precision, which is one. known: whether the covariance is
    known, so that both are the same.
    """

    precision: np.ndarray
    pulled: np.ndarray
    deviance: np.ndarray
    exact: np.ndarray
    exact_deviance: np.ndarray
    known: bool


def simulated(noise: LineNoise, rng: np.random.Generator) -> Draws:
    """`DRAWS` draws for a noise estimate."""
    z, root = noise.joint_draws(rng, DRAWS)  # (N, Y, D) unit errors, (N, Y, Y, D) roots of estimated precisions
    D = z.shape[-1]
    R, z = np.moveaxis(root, -1, 0), np.moveaxis(z, -1, 0)
    precision = np.conj(np.swapaxes(R, 2, 3)) @ R  # (D, N, Y, Y)
    pulled = (precision @ z[..., None]).reshape(D, -1)
    diagonal, pairs = _elements(z.shape[-1])
    off = [part for i, j in pairs for part in (precision[..., i, j].real, precision[..., i, j].imag)]
    parts = np.stack([*(precision[..., i, i].real for i in diagonal), *off], axis=-1)
    exact = z.reshape(D, -1)
    deviance, exact_deviance = (2 * np.einsum("dn,dn->d", exact.conj(), x).real for x in (pulled, exact))
    return Draws(parts.reshape(D, -1), pulled, deviance, exact, exact_deviance, noise.known)


def correction(jacobian: np.ndarray, gradients: np.ndarray, draws: Draws) -> Correction:
    """The correction at an estimate.

    Parameters
    ----------
    jacobian: (2 N Y, F) whitened derivatives by the F parameters that no bound holds.
    gradients: (K, F) of the quantities. draws: of their noise.
    """
    K = len(gradients)
    factor, dof = np.ones(K), np.full(K, KNOWN_DOF)
    free = np.flatnonzero(gradients.any(axis=1))  # the others are held by bounds at the estimate
    if not jacobian.size:
        return Correction(factor, dof, draws.exact_deviance if draws.known else draws.deviance)
    known, estimated = _both_fits(jacobian, gradients[free], draws)
    if draws.known:
        return Correction(factor, dof, known.chi2)
    # Both ratios share the errors, so the difference of their means is known far better than either.
    factor[free] += np.maximum((estimated.ratio - known.ratio).mean(axis=0), 0.0)
    stated = estimated.variance / known.variance
    spread = stated.var(axis=0) / stated.mean(axis=0) ** 2
    dof[free] = np.clip(2.0 / spread, LEAST_DOF, KNOWN_DOF)
    return Correction(factor, dof, estimated.chi2)


@dataclass(frozen=True)
class Nested:
    """Twice the log likelihood ratio of two nested models: ``more`` ``factor`` F(``more``, ``dof``) if both are true.

    Attributes
    ----------
    more: parameters that one has more. factor, dof: as in `Correction`. null_chi2: (D,) deviances of the larger model.
    """

    more: int
    factor: float
    dof: float
    null_chi2: np.ndarray

    def p_value(self, ratio: float) -> float:
        """Chance of a larger ratio where the smaller model is true."""
        return float(fdtrc(self.more, self.dof, max(ratio, 0.0) / (self.more * self.factor)))


def nested(jacobian: np.ndarray, shared: np.ndarray, draws: Draws) -> Nested:
    """What an estimated covariance does to the likelihood ratio of two nested models.

    Both moments of the ratio are those of fits to the draws, relative to fits to the same errors with the true
    covariance, whose ratio is chi-squared.

    Parameters
    ----------
    jacobian: (2 N Y, F) whitened derivatives by the free parameters of the larger model, at the smaller one's estimate.
    shared: (F, S) derivative of these by the free parameters of the smaller model.
    """
    more = int(shared.shape[0] - shared.shape[1])
    pairs = [_both_fits(J, np.empty((0, J.shape[1])), draws) for J in (jacobian @ shared, jacobian)]
    known, estimated = ((small.chi2 - large.chi2) for small, large in zip(*pairs, strict=True))
    if draws.known:
        return Nested(more, 1.0, KNOWN_DOF, pairs[1][0].chi2)
    factor = 1 + max(float((estimated - known).mean()) / more, 0.0)
    # Of an F distribution, variance over squared mean is that of chi-squared times (more + dof - 2) / (dof - 4).
    spread = (estimated.var() / known.var()) * (known.mean() / estimated.mean()) ** 2
    dof = (more - 2 + 4 * spread) / (spread - 1) if spread > 1 else KNOWN_DOF
    dof = float(np.clip(dof, LEAST_DOF, KNOWN_DOF))
    return Nested(more, factor * (dof - 2) / dof, dof, pairs[1][1].chi2)


def _both_fits(jacobian: np.ndarray, gradients: np.ndarray, draws: Draws) -> tuple[_Linear, _Linear]:
    """Linear fits to the errors of all draws with the true and with each estimated precision; gradients (K, F)."""
    outputs = 2 * draws.precision.shape[1] // len(jacobian)
    J = jacobian.reshape(2, -1, outputs, jacobian.shape[1])
    J = (J[0] + 1j * J[1]) / np.sqrt(2)  # (N, Y, F)
    products = _products(J)
    one = np.tile(np.arange(outputs**2) < outputs, len(J)).astype(float)[None]
    known = _linear_fits(J, one @ products, draws.exact, draws.exact_deviance, gradients)
    if draws.known:
        return known, known
    return known, _linear_fits(J, draws.precision @ products, draws.pulled, draws.deviance, gradients)


class _Linear(NamedTuple):
    """D linear fits to noise: likelihood ratios (D, K), stated variances (D, K) of K quantities, deviances (D,)."""

    ratio: np.ndarray
    variance: np.ndarray
    chi2: np.ndarray


def _products(J: np.ndarray) -> np.ndarray:
    """Gram matrix per unit of each number of a line's precision, (N Y^2, F (F + 1) / 2), of J (N, Y, F).

    Lower triangles by rows. The Gram matrix of a draw is linear in these numbers, so that all draws are one product of
    matrices.
    """
    i, j = np.tril_indices(J.shape[2])
    diagonal, pairs = _elements(J.shape[1])
    parts = [(J[:, k].conj()[:, i] * J[:, k][:, j]).real for k in diagonal]
    for k, m in pairs:
        across, back = J[:, k].conj()[:, i] * J[:, m][:, j], J[:, m].conj()[:, i] * J[:, k][:, j]
        parts += [(across + back).real, -(across - back).imag]
    return 2 * np.stack(parts, axis=1).reshape(-1, i.size)


def _elements(outputs: int) -> tuple[range, list[tuple[int, int]]]:
    """Elements of a Hermitian matrix of so many rows: those of the diagonal, and those above it."""
    return range(outputs), list(combinations(range(outputs), 2))


def _linear_fits(
    J: np.ndarray, gram: np.ndarray, pulled: np.ndarray, deviance: np.ndarray, gradients: np.ndarray
) -> _Linear:
    """Linear fits to D errors ``pulled`` (D, N Y) by their precision, with ``gram`` (D or 1, F (F + 1) / 2)."""
    flat = J.reshape(-1, J.shape[2])
    right = 2 * (pulled.real @ flat.real + pulled.imag @ flat.imag)
    shape = len(right), len(gradients)
    out = _Linear(np.empty(shape), np.empty(shape), np.empty(len(right)))
    likelihood_ratios(np.ascontiguousarray(gram), right, np.ascontiguousarray(gradients), *out)
    return out._replace(chi2=deviance - out.chi2)
