"""The sensor noise of a fitted person, from the noise of the measured sway."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from mcstudy.errors import InputError
from mcstudy.identification.fit_record import FitRecord
from mcstudy.recordings.recording import Recording
from mcstudy.recordings.units import as_shown
from mcstudy.stance.body import standing
from mcstudy.stance.noise import TabulatedNoise
from mcstudy.stance.response import noise_response

KNOTS = 6
"""Most frequencies of the table of the noise."""

LOWEST, HIGHEST = 12.0, 3.0
"""How far below and above its start the logarithm of a density is sought."""

LIKE = 1.5
"""Largest factor between the RMS of the measured and of the evoked sway of an angle."""


@dataclass(frozen=True)
class FittedNoise:
    """The noise of a fitted person.

    Attributes
    ----------
    f_hz: (M,) of the table. densities: by angle, (R, M), one-sided, deg^2/Hz, or in the unit of a declared model.
    angles: their names. measurement_sd: of white noise of each output, in its unit (deg for rad); none for a standing
        body.
    """

    f_hz: tuple[float, ...]
    densities: tuple[tuple[float, ...], ...]
    angles: tuple[str, ...]
    measurement_sd: tuple[float, ...]

    @property
    def sensors(self) -> TabulatedNoise:
        """The noise of the sensors of a standing body."""
        return TabulatedNoise(self.f_hz, self.densities, self.angles)

    def section(self) -> dict[str, Any]:
        """The same as ``[noise]`` of a study file."""
        noisy = {angle: d for angle, d in zip(self.angles, self.densities, strict=True) if any(d)}
        if not self.measurement_sd:
            names = (f"theta{k}" for k in range(1, 1 + len(self.densities)))
            return {"table": {"f_hz": self.f_hz, **dict(zip(names, self.densities, strict=True))}}
        sensed = {"table": {"f_hz": self.f_hz, "psd": noisy}} if noisy else {"psd": [0.0]}
        return {**sensed, "measurement": {"sd": self.measurement_sd}}


def noise_of(fitted: FitRecord) -> FittedNoise:
    """The sensor noise that most likely evokes the measured noise of what was measured in the fitted body.

    Of a declared model white noise of what is recorded is added to it.

    At a line the fitted body turns sensor densities s_j into sway densities sum_j |R_ij|^2 s_j. These are compared with
    the measured ones as means of gamma variables. The logarithm of s_j is a polygon over that of the frequency. What
    both angles have in common is not compared: it is very sensitive to errors of the fitted body.

    Raises `InputError` when the RMS of the sway that it evokes is not within `LIKE` of the measured one.
    """
    noise, ratio = fitted_noise(fitted)
    if (np.abs(np.log(ratio)) > np.log(LIKE)).any():
        raise InputError(
            f"{fitted.name}: noise: no sensor noise evokes the measured sway in the fitted body (RMS "
            f"{' and '.join(f'{x:.2f}' for x in ratio)} times the measured one); use more lines (fmax) or more trials"
        )
    return noise


def fitted_noise(fitted: FitRecord) -> tuple[FittedNoise, np.ndarray]:
    """The noise of `noise_of`, and the RMS of the sway that it evokes over the measured one, (Y,) by output."""
    lines, recording, model = fitted.lines, fitted.recording, fitted.model
    assert isinstance(recording, Recording)
    body = standing(model)
    seconds = len(lines.repeats) * float(recording.period_s or 0.0)
    measured = np.einsum("nii->ni", lines.noise.C).real * (2 * seconds * lines.power)[:, None]
    response = np.abs(noise_response(model, fitted.theta, lines.f)) ** 2  # (N, Y, S)
    knots = np.geomspace(lines.f[0], lines.f[-1], max(2, min(KNOTS, len(lines) // 4)))
    polygon = np.array([np.interp(np.log(lines.f), np.log(knots), knot) for knot in np.eye(knots.size)]).T
    sensors = np.flatnonzero(response.any(axis=(0, 1)))
    sources = [(response[:, :, j], polygon) for j in sensors]
    if not body:  # and white noise of what is recorded
        sources += [(np.tile(unit, (len(lines), 1)), np.ones((len(lines), 1))) for unit in np.eye(measured.shape[1])]
    weight = lines.noise.dof[:, None] / lines.noise.dof.sum()
    ends = np.cumsum([basis.shape[1] for _, basis in sources])[:-1]

    def levels(x: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Densities (N, Y) of the sway that log densities evoke, and those of every source."""
        s = [np.exp(basis @ part) for (_, basis), part in zip(sources, np.split(x, ends), strict=True)]
        total = sum((gain * density[:, None] for (gain, _), density in zip(sources, s, strict=True)), 0.0 * measured)
        return np.asarray(total), s

    def unlikely(x: np.ndarray) -> tuple[float, np.ndarray]:
        level, s = levels(x)
        off = weight * (1 - measured / level) / level
        slopes = [
            basis.T @ ((off * gain).sum(axis=1) * density) for (gain, basis), density in zip(sources, s, strict=True)
        ]
        return float((weight * (np.log(level) + measured / level)).sum()), np.concatenate(slopes)

    # Without other noise, a density explains one output alone; half of it is a start for both.
    begin = []
    for k, (gain, basis) in enumerate(sources):
        ratio = np.divide(measured, gain, out=np.full_like(measured, np.inf), where=gain > 0)
        alone = ratio[:, k] if body else ratio.min(axis=1)
        at = [np.abs(lines.f - f).argmin() for f in knots] if basis.shape[1] > 1 else [int(alone.argmin())]
        begin.append(np.log(alone[at] / 2))
    start = np.concatenate(begin)
    bounds = [(x - LOWEST, x + HIGHEST) for x in start]
    minimum = optimize.minimize(unlikely, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 2000})
    level = levels(minimum.x)[0]
    parts = [np.exp(x) for x in np.split(minimum.x, ends)]
    density = np.zeros((response.shape[2], knots.size))
    density[sensors] = np.reshape(parts[: sensors.size], (-1, knots.size))
    density *= as_shown(model.unit)[0] ** 2
    per = np.array([as_shown(unit)[0] for unit in model.output_units])
    white = np.sqrt(np.array([float(x[0]) for x in parts[sensors.size :]]) * recording.rate_hz / 2)
    sd = (per * white).tolist() if white.size else ()
    return (
        FittedNoise(_rounded(knots), tuple(map(_rounded, density)), model.angles, _rounded(sd)),
        np.sqrt(level.sum(axis=0) / measured.sum(axis=0)),
    )


def _rounded(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(float(f"{x:.4g}") for x in values)
