"""The sensor noise of a fitted person, from the noise of the measured sway."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from mcstudy.errors import InputError
from mcstudy.identification.fit_record import FitRecord
from mcstudy.recordings.recording import Recording
from mcstudy.stance.noise import DEG2_TO_RAD2, TabulatedNoise
from mcstudy.stance.response import noise_response

KNOTS = 6
"""Most frequencies of the table of the noise."""

LOWEST, HIGHEST = 12.0, 3.0
"""How far below and above its start the logarithm of a density is sought."""

LIKE = 1.5
"""Largest factor between the RMS of the measured and of the evoked sway of an angle."""


def noise_of(fitted: FitRecord) -> TabulatedNoise:
    """The sensor noise that most likely evokes the measured noise of both angles in the fitted body.

    At a line the fitted body turns sensor densities s_j into sway densities sum_j |R_ij|^2 s_j. These are compared with
    the measured ones as means of gamma variables. The logarithm of s_j is a polygon over that of the frequency. What
    both angles have in common is not compared: it is very sensitive to errors of the fitted body.

    Raises `InputError` when the RMS of the sway that it evokes is not within `LIKE` of the measured one.
    """
    noise, ratio = fitted_noise(fitted)
    if (np.abs(np.log(ratio)) > np.log(LIKE)).any():
        raise InputError(
            f"{fitted.name}: noise: no sensor noise evokes the measured sway in the fitted body (RMS "
            f"{ratio[0]:.2f} and {ratio[1]:.2f} times the measured one); use more lines (fmax) or more trials"
        )
    return noise


def fitted_noise(fitted: FitRecord) -> tuple[TabulatedNoise, np.ndarray]:
    """The noise of `noise_of`, and the RMS of the sway that it evokes over the measured one, (2,) by angle."""
    lines, recording = fitted.lines, fitted.recording
    assert isinstance(recording, Recording)
    seconds = len(lines.repeats) * float(recording.period_s or 0.0)
    measured = np.einsum("nii->ni", lines.noise.C).real * (2 * seconds * lines.power)[:, None]
    response = np.abs(noise_response(fitted.model, fitted.theta, lines.f)[:, :2, :2]) ** 2
    knots = np.geomspace(lines.f[0], lines.f[-1], max(2, min(KNOTS, len(lines) // 4)))
    basis = np.array([np.interp(np.log(lines.f), np.log(knots), knot) for knot in np.eye(knots.size)]).T
    weight = lines.noise.dof[:, None] / lines.noise.dof.sum()

    def unlikely(x: np.ndarray) -> tuple[float, np.ndarray]:
        s = np.exp(basis @ x.reshape(-1, 2))
        level = np.einsum("nij,nj->ni", response, s)
        slope = np.einsum("ni,nij->nj", weight * (1 - measured / level) / level, response) * s
        return float((weight * (np.log(level) + measured / level)).sum()), (basis.T @ slope).ravel()

    # Without noise on the other sensor, a density explains each angle alone; half of it is a start for both.
    alone = (measured / np.einsum("nii->ni", response) / 2)[[np.abs(lines.f - k).argmin() for k in knots]]
    begin = np.log(alone).ravel()
    bounds = [(x - LOWEST, x + HIGHEST) for x in begin]
    minimum = optimize.minimize(unlikely, begin, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 2000})
    log_density = minimum.x.reshape(-1, 2)
    level = np.einsum("nij,nj->ni", response, np.exp(basis @ log_density))
    ratio = np.sqrt(level.sum(axis=0) / measured.sum(axis=0))
    density = np.exp(log_density).T / DEG2_TO_RAD2
    f_hz, *densities = (tuple(float(f"{x:.4g}") for x in values) for values in (knots, *density))
    return TabulatedNoise(f_hz, tuple(densities), fitted.model.angles), ratio
