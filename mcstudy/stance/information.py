"""Fisher information of frequency responses on the parameters of a model, from the closed form's exact derivatives.

The errors of an FRF at single lines are circular complex Gaussian and independent from line to line. With J the
derivatives of the responses at a line and C the covariance of their errors, the information of that line is
2 Re(J^H C^-1 J); lines add up. The inverse of the sum is the Cramer-Rao bound on the covariance of unbiased estimates.
Bounds on parameters are left out. Derived.
"""

from __future__ import annotations

import numpy as np

from mcstudy.stance.feedback import Model
from mcstudy.stance.noise import Noise
from mcstudy.stance.response import frf_jacobian
from mcstudy.stance.simulate_spectral import sway_psd


def expected_line_covariance(
    model: Model, theta: np.ndarray, noise: Noise, f: np.ndarray, drive: np.ndarray, duration_s: float
) -> np.ndarray:
    """Covariance of the FRF errors at single lines, (N, 2, 2), from theory; no leakage.

    A Fourier coefficient over ``duration_s`` (all averaged cycles together) of sway with one-sided density S has
    variance S / (2 duration); ``drive`` (N,) are the stimulus' Fourier coefficients at the same lines.
    """
    return sway_psd(model, theta, noise, f) / (2 * duration_s) / (np.abs(drive) ** 2)[:, None, None]


def line_information(model: Model, theta: np.ndarray, f: np.ndarray, whitener: np.ndarray) -> np.ndarray:
    """Fisher information of every line, (N, P, P), in the inverse units of the parameters.

    Parameters
    ----------
    model, theta
        The closed loop and its parameters, (P,).
    f
        Frequencies of the lines, Hz, (N,).
    whitener
        W, (N, 2, 2), with W^H W / 2 the inverse covariance of the FRF errors, e.g. `unit_variance`.
    """
    slope = np.einsum("nij,njp->nip", whitener, frf_jacobian(model, theta, f)[1])
    return np.asarray(np.einsum("nip,niq->npq", slope.conj(), slope).real)


def unit_variance(covariance: np.ndarray, n_angles: int = 2) -> np.ndarray:
    """Matrices W (N, 2, 2) that give errors of ``covariance`` (N, 2, 2) real and imaginary parts of unit variance.

    Angles beyond the first ``n_angles`` get no weight. Raises `numpy.linalg.LinAlgError` for a singular covariance.
    """
    weight = np.zeros(covariance.shape, dtype=complex)
    angles = np.s_[:, :n_angles, :n_angles]
    weight[angles] = np.sqrt(2) * np.linalg.inv(np.linalg.cholesky(covariance[angles]))
    return weight


def standard_errors(information: np.ndarray, gradients: np.ndarray, known: int | None = None) -> np.ndarray:
    """Standard errors (K,) of quantities with ``gradients`` (K, P), without bounds; one parameter may be ``known``."""
    keep = np.arange(len(information)) != (-1 if known is None else known)
    information, gradients = information[np.ix_(keep, keep)], gradients[:, keep]
    scale = 1 / np.sqrt(np.diag(information))
    covariance = np.linalg.pinv(information * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
    return np.sqrt(np.einsum("kp,pq,kq->k", gradients, covariance, gradients))
