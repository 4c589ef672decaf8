"""What an estimated noise covariance adds to the uncertainty of estimates.

Were the covariance of the noise known, the likelihood ratio of a quantity would follow a chi-squared distribution with
one degree of freedom. It is estimated from few lines, so weights are wrong by chance: the ratio is larger by a factor
(Bartlett 1937) and has heavier tails (F with few degrees of freedom). Both are computed for each quantity from
simulated covariance estimates of the same uncertainty, in the linearised model, joint over lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import fdtri

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


def correction(jacobian: np.ndarray, gradients: np.ndarray, noise: LineNoise, rng: np.random.Generator) -> Correction:
    """The correction at an estimate.

    Parameters
    ----------
    jacobian: (4 N, F) whitened derivatives by the F parameters that no bound holds.
    gradients: (K, F) of the quantities.
    """
    K = len(gradients)
    factor, dof = np.ones(K), np.full(K, KNOWN_DOF)
    free = np.flatnonzero(gradients.any(axis=1))  # the others are held by bounds at the estimate
    N = noise.dof.size
    J = jacobian.reshape(2, N, 2, -1)
    J = (J[0] + 1j * J[1]) / np.sqrt(2)  # (N, 2, F)
    z, root = noise.joint_draws(rng, DRAWS)  # (N, 2, D) unit errors, (N, 2, 2, D) roots of estimated precisions
    known = _linear_fits(J, z, np.broadcast_to(np.eye(2)[..., None], root.shape), gradients[free])
    if noise.pooling is None:
        return Correction(factor, dof, known.chi2)
    estimated = _linear_fits(J, z, root, gradients[free])
    # Both ratios share the errors, so the difference of their means is known far better than either.
    factor[free] += np.maximum((estimated.ratio - known.ratio).mean(axis=0), 0.0)
    stated = estimated.variance / known.variance
    spread = stated.var(axis=0) / stated.mean(axis=0) ** 2
    dof[free] = np.clip(2.0 / spread, LEAST_DOF, KNOWN_DOF)
    return Correction(factor, dof, estimated.chi2)


class _Linear(NamedTuple):
    """D linear fits to noise: likelihood ratios (D, K), stated variances (D, K) of K quantities, deviances (D,)."""

    ratio: np.ndarray
    variance: np.ndarray
    chi2: np.ndarray


def _linear_fits(J: np.ndarray, z: np.ndarray, root: np.ndarray, gradients: np.ndarray) -> _Linear:
    """Linear fits to errors ``z`` (N, 2, D), weighted by precisions R^H R with ``root`` R (N, 2, 2, D).

    The Gram matrix of a draw is linear in the four real numbers of each line's precision, so that all draws are one
    product of matrices.
    """
    N, _, D = z.shape
    F = J.shape[2]
    R = np.moveaxis(root, -1, 0)
    precision = np.conj(np.swapaxes(R, 2, 3)) @ R  # (D, N, 2, 2)
    pulled = np.einsum("dnij,njd->dni", precision, z)
    deviance = 2 * np.einsum("njd,dnj->d", z.conj(), pulled).real
    parts = np.stack(
        [precision[..., 0, 0].real, precision[..., 1, 1].real, precision[..., 0, 1].real, precision[..., 0, 1].imag], -1
    ).reshape(D, 4 * N)
    upper = np.triu_indices(F)
    a, b = J[:, 0], J[:, 1]
    cross = a.conj()[:, :, None] * b[:, None, :]
    both = cross + np.conj(np.swapaxes(cross, 1, 2))
    turned = 1j * (cross - np.conj(np.swapaxes(cross, 1, 2)))
    squares = [(x.conj()[:, :, None] * x[:, None, :]).real for x in (a, b)]
    products = np.stack([*squares, both.real, turned.real], axis=1)[:, :, upper[0], upper[1]].reshape(4 * N, -1)
    gram = np.empty((D, F, F))
    gram[:, upper[0], upper[1]] = gram[:, upper[1], upper[0]] = 2 * (parts @ products)
    flat = J.reshape(2 * N, F)
    pulled = pulled.reshape(D, 2 * N)
    right = 2 * (pulled.real @ flat.real + pulled.imag @ flat.imag)
    solved = np.linalg.solve(gram, np.concatenate([right[..., None], _repeated(gradients.T, D)], axis=2))
    variance = np.einsum("dfk,kf->dk", solved[:, :, 1:], gradients)
    chi2 = deviance - np.einsum("df,df->d", solved[:, :, 0], right)
    return _Linear((solved[:, :, 0] @ gradients.T) ** 2 / variance, variance, chi2)


def _repeated(x: np.ndarray, n: int) -> np.ndarray:
    return np.broadcast_to(x, (n, *x.shape))
