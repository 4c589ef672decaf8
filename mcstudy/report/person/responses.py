"""Figures over frequency: measured responses with their noise, and the fit with its range over the intervals."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.trades import bodies
from mcstudy.report.axes import axes, frequency_axis, legend_below, log_axis
from mcstudy.report.diagnosis.data import band_means
from mcstudy.report.diagnosis.figures import CURVE_POINTS, REAL, draw_measured, gain_unit
from mcstudy.report.style import COLOURS
from mcstudy.stance.response import frf

FIT = COLOURS["blue"]


def response_gain(fit: FitRecord, angle: int = 0, ax: Axes | None = None) -> Axes:
    """Gain of one angle: band means with a 95 % noise band, the fit, and its range over the bodies that fit as well."""
    ax = axes(ax)
    ratio, sd, at, best = _bands(fit, angle)
    gain, noise = np.abs(best * ratio), np.abs(best) * REAL * sd
    curves = np.abs(_responses(fit, _curve(fit), angle))
    draw_measured(ax, at, gain, noise, lowest=0.02 * gain)
    log_axis(ax.yaxis)
    ax.set_ylabel(f"gain ({gain_unit(fit.model)})")
    return _finished(fit, angle, ax, curves)


def response_phase(fit: FitRecord, angle: int = 0, ax: Axes | None = None) -> Axes:
    """Phase of one angle in degrees; see `response_gain`."""
    ax, f = axes(ax), _curve(fit)
    ratio, sd, at, _ = _bands(fit, angle)
    curves = np.unwrap(np.angle(_responses(fit, f, angle)), axis=1)
    curves += 2 * np.pi * np.round((curves[0] - curves).mean(axis=1) / (2 * np.pi))[:, None]
    phase = np.degrees(np.interp(at, f, curves[0]) + np.angle(ratio))
    noise = np.degrees(np.minimum(REAL * sd / np.abs(ratio), np.pi))
    draw_measured(ax, at, phase, noise)
    ax.set_ylabel("phase (°)")
    return _finished(fit, angle, ax, np.degrees(curves))


def _bands(fit: FitRecord, angle: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of B bands: measured over fitted response, its standard deviation, frequency, and fitted response, (B,) each."""
    means = band_means(fit.lines, frf(fit.model, fit.theta, fit.lines.f))
    return means.ratio[:, angle], means.sd[:, angle], means.f, frf(fit.model, fit.theta, means.f)[:, angle]


def _responses(fit: FitRecord, f: np.ndarray, angle: int) -> np.ndarray:
    """Responses (1 + M, K) of the best fit and of the bodies that fit as well."""
    everybody = np.concatenate([fit.theta[None], bodies(fit.estimates)])
    return np.asarray(frf(fit.model, everybody, f)[..., angle])


def _curve(fit: FitRecord) -> np.ndarray:
    return np.geomspace(fit.lines.f[0], fit.lines.f[-1], CURVE_POINTS)


def _finished(fit: FitRecord, angle: int, ax: Axes, curves: np.ndarray) -> Axes:
    """With the best fit, the first of the ``curves``, and the range of all."""
    f = _curve(fit)
    ax.fill_between(f, curves.min(axis=0), curves.max(axis=0), color=FIT, alpha=0.25, linewidth=0)
    ax.plot(f, curves[0], color=FIT, label="fit, range over the intervals")
    frequency_axis(ax, fit.lines.f)
    ax.set_title(f"θ{angle + 1}")
    legend_below(ax, 2)
    return ax
