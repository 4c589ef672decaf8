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
    weighted = np.einsum("nijd,njp->dnip", root, J)
    error = np.einsum("nijd,njd->dni", root, z)
    D, F = weighted.shape[0], weighted.shape[-1]
    columns, error = weighted.reshape(D, -1, F), error.reshape(D, -1, 1)
    adjoint = np.conj(np.swapaxes(columns, 1, 2))
    gram, right = 2 * (adjoint @ columns).real, 2 * (adjoint @ error).real
    both = np.concatenate([right, np.broadcast_to(gradients.T, (D, *gradients.T.shape))], axis=2)
    solved = np.linalg.solve(gram, both)
    variance = np.einsum("dfk,kf->dk", solved[:, :, 1:], gradients)
    chi2 = 2 * (np.abs(error) ** 2).sum(axis=(1, 2)) - np.einsum("df,df->d", solved[:, :, 0], right[:, :, 0])
    return _Linear((solved[:, :, 0] @ gradients.T) ** 2 / variance, variance, chi2)
