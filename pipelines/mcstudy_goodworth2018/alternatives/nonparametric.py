"""Nonparametric neural controllers: closed-loop identification from sway and corrective torques.

The alternative that Goodworth & Peterka 2018 discuss: Boonstra et al. 2013 and Engelhart et al. 2015
apply two independent stimuli to different segments and relate total corrective torque to sway. The torques come from
inverse dynamics, T = body(s) theta - b(s) u, and by the model's own definition T = -NC theta + noise (derived from
`mcstudy.stance.feedback`; body and NC are the parts of A(s) without and with gains).

- `indirect`: cross-spectra with the stimuli, NC = -S_Tu S_thetau^-1. Feedback noise is uncorrelated with the stimuli
  and averages out. Needs two independent stimuli: with one, S_thetau has rank one and there is no inverse.
- `one_angle`: with one stimulus, the ratio of each torque to one angle, as if that angle alone had caused it.
- `direct`: NC = -S_Ttheta S_thetatheta^-1. Solvable with one stimulus because noise moves the angles too, but in a
  closed loop that noise is also in the torque, so the estimate is biased towards minus the dynamics of the body where
  noise dominates.

Arrays: spectra of R trials at L lines, (R, L, 2), angles in rad as (theta1, theta2), torques in N m as (hip, ankle);
controllers (N, row, angle), N m/rad, as `mcstudy.stance.response.neural_controllers` gives them.
"""

from __future__ import annotations

import numpy as np

from mcstudy.errors import InputError
from mcstudy.spectra.bands import Bands
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import system


def corrective_torque(model: Model, sway: np.ndarray, external: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Total corrective torques by inverse dynamics, N m, (R, L, 2) as (hip, ankle).

    Parameters
    ----------
    model: only its inertia and gravity are used, the terms without a gain.
    sway: spectra of the angles, rad, (R, L, 2).
    external: spectra of external torques on the two rows, N m, (R, L, 2).
    f: frequencies of the lines, Hz, (L,).
    """
    gains = {name for term in model.terms for name in term.gain}
    theta = np.array([0.0 if p.name in gains else p.value for p in model.parameters])
    body = system(model, theta, 2j * np.pi * np.asarray(f, dtype=float))[0]
    return np.einsum("lij,rlj->rli", body, sway) - external


def indirect(sway: np.ndarray, torque: np.ndarray, stimuli: np.ndarray, bands: Bands) -> np.ndarray:
    """Controllers from the cross-spectra with two stimuli, (N, 2, 2).

    Parameters
    ----------
    sway, torque: spectra, (R, L, 2).
    stimuli: spectra of the two stimuli, (R, L, 2).
    bands: points; cross-spectra are summed over their lines and over trials.

    Raises `InputError` where the stimuli are not independent over the trials and lines of a point.
    """
    power = _cross(stimuli, stimuli, bands)
    scale = np.sqrt(np.einsum("nii->ni", power).real)
    singular = np.linalg.det(power).real <= 1e-9 * np.prod(scale**2, axis=-1)
    if singular.any():
        where = bands.f[singular][0]
        raise InputError(
            f"stimuli: expected two independent ones, at {where:.3f} Hz they are not; "
            "one stimulus cannot tell apart the controllers of one torque"
        )
    return _ratio(_cross(torque, stimuli, bands), _cross(sway, stimuli, bands))


def direct(sway: np.ndarray, torque: np.ndarray, bands: Bands) -> np.ndarray:
    """Controllers from the spectra of sway itself, as if the loop were open, (N, 2, 2); biased in a closed loop.

    Trials and lines of a point together must be at least two.
    """
    return _ratio(_cross(torque, sway, bands), _cross(sway, sway, bands))


def one_angle(sway: np.ndarray, torque: np.ndarray, stimulus: np.ndarray, bands: Bands) -> np.ndarray:
    """Each torque over each angle alone with one stimulus (R, L): entry (row, angle) is -S_Tu / S_thetau, (N, 2, 2).

    With a second controller on the same row the entry is NC_ij + NC_ik theta_k / theta_j (derived), not NC_ij.
    """
    u = stimulus[..., None]
    return -_cross(torque, u, bands) / np.swapaxes(_cross(sway, u, bands), -1, -2)


def _cross(x: np.ndarray, y: np.ndarray, bands: Bands) -> np.ndarray:
    """Cross-spectra summed over trials and averaged over the lines of each point, (N, X, Y)."""
    products = np.einsum("rli,rlj->lij", x, y.conj())
    flat = bands.average(products.reshape(products.shape[0], -1))
    return flat.reshape(-1, *products.shape[1:])


def _ratio(torque: np.ndarray, sway: np.ndarray) -> np.ndarray:
    return -np.swapaxes(np.linalg.solve(np.swapaxes(sway, -1, -2), np.swapaxes(torque, -1, -2)), -1, -2)
