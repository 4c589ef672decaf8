"""The sway that a fitted body predicts, beside the measured one: evoked by the stimulus, and by sensor noise.

Both are root mean squares over the frequencies of the fit. The measured sway that the stimulus evokes is that of the
mean response, minus the noise in it; the sway that noise evokes comes from the noise covariance of the lines. Noise of
the sensors has the shape that Goodworth & Peterka (2018, Methods) assume, and its two levels are fitted to the measured
noise, because no recording states them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mcstudy.recordings.units import as_shown
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import standing
from mcstudy.stance.feedback import Model
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf, noise_response


@dataclass(frozen=True)
class AngleSway:
    """RMS sway of one angle, deg; of an output of a declared model in its unit.

    Attributes
    ----------
    angle
        Name of the angle.
    stimulus, stimulus_low, stimulus_high
        Evoked by the stimulus: predicted at the estimate, and its range over the bodies that fit as well.
    measured, measured_se
        The measured one, noise subtracted, and its standard error.
    noise, noise_low, noise_high, noise_measured
        The same for the sway that noise evokes; None for a recording without a period, and for a declared model, whose
        noise has no known shape.
    unit
        Unit of all of these.
    """

    angle: str
    stimulus: float
    stimulus_low: float
    stimulus_high: float
    measured: float
    measured_se: float
    noise: float | None = None
    noise_low: float | None = None
    noise_high: float | None = None
    noise_measured: float | None = None
    unit: str = "deg"


@dataclass(frozen=True)
class PredictedSway:
    """Predicted and measured sway of all outputs.

    Attributes
    ----------
    angles
        One `AngleSway` per angle.
    noise_levels
        Levels of the two sensor noises relative to those of Goodworth & Peterka (2018), in power; None without a
        period.
    """

    angles: tuple[AngleSway, ...]
    noise_levels: tuple[float, float] | None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for ``fit.json``; deg need not be said."""
        angles = [{k: v for k, v in vars(a).items() if (k, v) != ("unit", "deg")} for a in self.angles]
        return {"angles": angles, "noise_levels": self.noise_levels}


def predicted_sway(model: Model, theta: np.ndarray, bodies: np.ndarray, lines: Lines) -> PredictedSway | None:
    """Sway at ``theta`` (P,) and over ``bodies`` (M, P), all stable; None for responses without a stimulus in time."""
    if not np.isfinite(lines.power).all():
        return None
    everybody = np.concatenate([theta[None], bodies])
    per, units = zip(*map(as_shown, model.output_units), strict=True)
    stimulus = _rms(lines.power, np.abs(frf(model, everybody, lines.f)) ** 2) * per  # (1 + M, Y)
    measured, error = (x * per for x in _measured(lines))
    noise = _noise(model, everybody, lines) if standing(model) else None
    by_noise: list[tuple[float | None, float | None, float | None, float | None]]
    by_noise = [(None, None, None, None)] * len(units)
    if noise is not None:
        by_noise = [(*_with_range(rms), float(x)) for rms, x in zip(noise.rms.T, noise.measured, strict=True)]
    angles = tuple(
        AngleSway(angle, *_with_range(stimulus[:, k]), float(measured[k]), float(error[k]), *by_noise[k], units[k])
        for k, angle in enumerate(model.output_names)
    )
    return PredictedSway(angles, None if noise is None else (float(noise.levels[0]), float(noise.levels[1])))


def _with_range(values: np.ndarray) -> tuple[float, float, float]:
    """The first value, and the range of all."""
    return float(values[0]), float(values.min()), float(values.max())


def _rms(power: np.ndarray, square: np.ndarray) -> np.ndarray:
    """RMS of responses with squared gains (..., N, Y) to a stimulus with ``power`` (N,)."""
    return np.asarray(np.sqrt(2 * np.einsum("n,...nk->...k", power, square)))


def _measured(lines: Lines) -> tuple[np.ndarray, np.ndarray]:
    square, variance = np.abs(lines.y) ** 2, lines.noise.variance
    mean_square = 2 * lines.power @ np.maximum(square - variance, 0.0)
    # of |y|^2 with a complex error of variance v: 2 |y|^2 v + v^2
    error = np.sqrt((2 * lines.power) ** 2 @ (2 * np.maximum(square - variance, 0.0) * variance + variance**2))
    rms = np.sqrt(mean_square)
    return rms, error / (2 * np.maximum(rms, 1e-300))


ROUNDS = 200
"""Steps of the search for the levels of the sensor noises."""


def _levels(unit: np.ndarray, density: np.ndarray) -> np.ndarray:
    """Levels (M, 2) with which densities ``unit`` (M, L, 2) of two sources add up to a measured ``density`` (L,).

    Maximum likelihood for densities with relative errors of equal size, by multiplicative steps, which keep levels
    positive (Fevotte, Bertin & Durrieu 2009, Neural Comput 21:793-830).
    """
    levels = density.mean() / unit.mean(axis=1) / 2
    for _ in range(ROUNDS):
        total = np.einsum("mls,ms->ml", unit, levels)
        levels *= np.einsum("mls,ml->ms", unit, density / total**2) / np.einsum("mls,ml->ms", unit, 1 / total)
    return levels


class _Noise(NamedTuple):
    """RMS sway (M, 2) that noise evokes in M bodies and the measured one (2,), deg; levels (2,) of the first body."""

    rms: np.ndarray
    measured: np.ndarray
    levels: np.ndarray


def _noise(model: Model, bodies: np.ndarray, lines: Lines) -> _Noise | None:
    """Sway that sensor noise evokes; for every body with the two levels that agree best with the measured noise."""
    if lines.harmonic is None:
        return None
    period_s = float((lines.harmonic / lines.f).mean())
    # The power of one repeat at a line is that of the mean over all, times their effective number.
    repeats = 1 / (lines.weight**2).sum(axis=0)
    density = 2 * period_s * lines.noise.variance * (lines.power * repeats)[:, None]  # rad^2/Hz, (N, 2)
    width = np.gradient(lines.f)
    unit = np.abs(noise_response(model, bodies, lines.f)) ** 2 * SensorNoise().psd(lines.f)[:, None, :]  # (M, N, 2, 2)
    levels = _levels(unit.reshape(len(bodies), -1, 2), density.reshape(-1))
    square = np.einsum("n,mnks,ms->mk", width, unit, levels)
    return _Noise(np.rad2deg(np.sqrt(square)), np.rad2deg(np.sqrt(width @ density)), levels[0])
