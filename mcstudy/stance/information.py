"""Fisher information of frequency responses on the parameters of a model, from the closed form's exact derivatives.

The errors of an FRF are circular complex Gaussian. With J the derivatives of the responses and C the covariance of
their errors, the information is 2 Re(J^H C^-1 J). At single lines the errors are independent, and lines add up; the
points of an averaged FRF may share lines, and then C is that of all of them. The inverse of the information is the
Cramér-Rao bound on the covariance of unbiased estimates. Bounds on parameters are left out. Derived.

For fits that end on bounds there is a bound that knows the box of allowed values. The constrained Cramér-Rao bound
(Gorman & Hero 1990) is none: at a truth inside the box no constraint is active, and it equals the unconstrained bound.
The inequality of van Trees (1968; Gill & Levit 1995) is one. With a prior that has the information matrix L, no
estimator, biased or not, has a mean squared error below (I + L)^-1 on average over that prior, I being the information
of the data averaged over it. The prior is the density on the box with the least information, the product of squared
cosines, for which L is (2 pi / width)^2 in each parameter (Bickel 1981); it gives the highest bound of all products. An
average over the box cannot exceed the largest value in it, so the bound is below the largest mean squared error of
every estimator in the box. I is that at the truth, as if the responses were linear in the parameters and the noise the
same over the box. At one single truth an estimator may fall below it, by pulling its estimates towards that truth.
"""

from __future__ import annotations

import numpy as np

from mcstudy.errors import InputError
from mcstudy.stance.feedback import Model
from mcstudy.stance.noise import Noise
from mcstudy.stance.response import frf_jacobian
from mcstudy.stance.simulate_spectral import sway_psd

HELD = 1e-3
"""Smallest change of the responses between the bounds of a parameter, in standard deviations of the noise; with a
smaller change the bounds, not the data, determine (hold) the parameter."""


def expected_line_covariance(
    model: Model,
    theta: np.ndarray,
    noise: Noise,
    f: np.ndarray,
    drive: np.ndarray,
    duration_s: float,
    measured: np.ndarray | None = None,
) -> np.ndarray:
    """Covariance of the FRF errors at single lines, (N, Y, Y), from theory; no leakage.

    A Fourier coefficient over ``duration_s`` (all averaged cycles together) of a record with one-sided density S has
    variance S / (2 duration); ``drive`` (N,) are the stimulus' Fourier coefficients at the same lines. ``measured``:
    density of the noise of the recording itself (`mcstudy.stance.noise.MeasurementNoise.psd`), (Y, Y).
    """
    density = sway_psd(model, theta, noise, f, measured)
    return density / (2 * duration_s) / (np.abs(drive) ** 2)[:, None, None]


def line_information(model: Model, theta: np.ndarray, f: np.ndarray, whitener: np.ndarray) -> np.ndarray:
    """Fisher information of every line, (N, P, P), in the inverse units of the parameters.

    Parameters
    ----------
    model, theta
        The closed loop and its parameters, (P,).
    f
        Frequencies of the lines, Hz, (N,).
    whitener
        W, (N, Y, Y), with W^H W / 2 the inverse covariance of the FRF errors, e.g. `unit_variance`.
    """
    slope = np.einsum("nij,njp->nip", whitener, frf_jacobian(model, theta, f)[1])
    return np.asarray(np.einsum("nip,niq->npq", slope.conj(), slope).real)


def unit_variance(covariance: np.ndarray) -> np.ndarray:
    """Matrices W (N, Y, Y) that give errors of ``covariance`` (N, Y, Y) real and imaginary parts of unit variance.

    Raises `numpy.linalg.LinAlgError` for a singular covariance.
    """
    return np.asarray(np.sqrt(2) * np.linalg.inv(np.linalg.cholesky(covariance)).astype(complex))


def standard_errors(information: np.ndarray, gradients: np.ndarray, known: int | None = None) -> np.ndarray:
    """Standard errors (K,) of quantities with ``gradients`` (K, P), without bounds; one parameter may be ``known``."""
    keep = np.arange(len(information)) != (-1 if known is None else known)
    information, gradients = information[np.ix_(keep, keep)], gradients[:, keep]
    scale = 1 / np.sqrt(np.diag(information))
    covariance = np.linalg.pinv(information * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
    return np.sqrt(np.einsum("kp,pq,kq->k", gradients, covariance, gradients))


def cramer_rao(model: Model, theta: np.ndarray, f: np.ndarray, joint: np.ndarray) -> np.ndarray:
    """Cramér-Rao bound on the covariance of unbiased estimates, (P, P), for FRF errors ``joint`` (N Y, N Y).

    NaN in the rows and columns of parameters that their bounds fix (`fixed_by_bounds`); the others are bounded with
    those known.
    Raises `InputError` where the points do not determine the parameters.
    """
    white, scale = _white(model, theta, f, joint)
    free = np.flatnonzero(~_held(white))
    # QR instead of the normal matrix: the condition number at low Fmax is not squared
    R = np.asarray(np.linalg.qr(np.concatenate([white[:, free].real, white[:, free].imag]), mode="r"))
    diagonal = np.abs(np.diag(R))
    if R.shape[0] < free.size or diagonal.min(initial=np.inf) <= 1e-13 * diagonal.max(initial=0.0):
        raise InputError(f"frequency: {f.size} points do not determine {free.size} parameters")
    inverse = np.linalg.inv(R) * scale[free, None]
    return among_all(inverse @ inverse.T, free, theta.size)


def van_trees(model: Model, theta: np.ndarray, f: np.ndarray, joint: np.ndarray) -> np.ndarray:
    """Bound (P, P) on the mean squared errors within the box of allowed values, for FRF errors ``joint`` (N Y, N Y).

    See the module. It exists where the points do not determine the parameters, and never exceeds the Cramér-Rao bound.
    """
    white, scale = _white(model, theta, f, joint)
    # QR of data and prior together: the condition number is not squared, and the prior bounds it
    R = np.linalg.qr(np.concatenate([white.real, white.imag, 2 * np.pi * np.eye(theta.size)]), mode="r")
    inverse = np.linalg.inv(R) * scale[:, None]
    return np.asarray(inverse @ inverse.T)


def fixed_by_bounds(model: Model, theta: np.ndarray, f: np.ndarray, joint: np.ndarray) -> np.ndarray:
    """Which parameters (P,) are held by their bounds: the change from one bound to the other is smaller than the noise.

    Their estimates reflect the bounds, so the Cramér-Rao bound on their variance has no meaning.
    """
    return _held(_white(model, theta, f, joint)[0])


def _white(model: Model, theta: np.ndarray, f: np.ndarray, joint: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (M, P) of the responses per distance between the bounds, in units of the noise, whose information is
    the real part of white^H white; and the distances (P,)."""
    scale = model.upper - model.lower
    derivatives = frf_jacobian(model, theta, f)[1].reshape(-1, theta.size)
    return np.sqrt(2) * _whitener(joint) @ (derivatives * scale), scale


def _held(white: np.ndarray) -> np.ndarray:
    """From derivatives (M, P) of the responses, in standard deviations per distance between the bounds."""
    return np.asarray(np.linalg.norm(white, axis=0) < HELD)


def among_all(matrix: np.ndarray, free: np.ndarray, size: int) -> np.ndarray:
    """A matrix of the free parameters as one of all, NaN elsewhere."""
    out = np.full((size, size), np.nan)
    out[np.ix_(free, free)] = matrix
    return out


def _whitener(joint: np.ndarray) -> np.ndarray:
    """A matrix (M, N Y) that turns errors of covariance ``joint`` into M <= N Y independent ones of unit variance.

    Points that average the same lines can repeat each other exactly (without the averaging exception, 19 less 18 and
    23 less 24 are the same line); what is repeated carries no information of its own and is left out.
    """
    size = np.sqrt(np.diag(joint).real)
    value, vector = np.linalg.eigh(joint / size[:, None] / size)
    keep = value > 1e-10 * value[-1]
    return np.asarray((vector[:, keep] / np.sqrt(value[keep])).conj().T / size)
