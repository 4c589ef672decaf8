"""Frequency responses: Fig. 4A (torque to angles) and 4B (neural controllers), of the truth and of the fits."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from mcstudy.analysis.view import GroupView
from mcstudy.report.axes import axes, frequency_axis, log_axis
from mcstudy.report.figures.common import GroupLike, chosen_amplitude, chosen_fmax, view_of
from mcstudy.report.labels import CONTROLLERS, cell_label
from mcstudy.report.style import DASHES, MARKERS, SERIES
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import members
from mcstudy.stance.response import frf, neural_controllers

Response = Callable[[Model, np.ndarray, np.ndarray], dict[str, np.ndarray]]
"""(model, parameters (..., P), frequencies (N,)) -> named responses (..., N)."""

MOST_FITS = 500
"""Best fits a band is made of."""

FINE = 160
"""Frequencies at which lines and bands are drawn, besides the study's own."""

BAND = (0.1, 0.9)
"""Quantiles over realizations between which a band lies."""


def frf_of(model: Model, theta: np.ndarray, f: np.ndarray) -> dict[str, np.ndarray]:
    """Stimulus-to-angle FRFs by angle (and stimulus, of several), in the angle's unit per unit of stimulus."""
    responses = zip(model.stimulus_names, (frf(m, theta, f) for m in members(model)), strict=True)
    return {
        angle.replace("theta", "θ") + (f" from {stimulus}" if model.blocks else ""): H[..., i]
        for stimulus, H in responses
        for i, angle in enumerate(model.output_names)
    }


def controllers_of(model: Model, theta: np.ndarray, f: np.ndarray) -> dict[str, np.ndarray]:
    """Neural controllers by row and angle; of the paper's joints by its names, T12 = hip torque from theta1 (N m/rad).

    Those of other joints are called ``ROW from ANGLE``.
    """
    NC = neural_controllers(model, theta, f)
    responses = {
        CONTROLLERS.get((row, angle), f"{row} from {angle}"): NC[..., i, k]
        for k, angle in enumerate(model.angles)
        for i, row in reversed(list(enumerate(model.rows)))
    }
    return {name: response for name, response in responses.items() if np.abs(response).max() > 0}


def frf_gain(
    data: GroupLike, amplitude: float | None = None, fmax: float | None = None, ax: Axes | None = None
) -> Axes:
    """Fig. 4A, gain: line the truth; without noise, markers the best fit; with noise, band 10-90 % of best fits."""
    ax = _gain(data, amplitude, fmax, axes(ax), frf_of)
    model = view_of(data).model
    units = ", ".join(dict.fromkeys(model.output_units))
    ax.set_ylabel(f"gain ({units}/({model.stimulus_unit.replace(' ', '·')}))")
    return ax


def frf_phase(
    data: GroupLike, amplitude: float | None = None, fmax: float | None = None, ax: Axes | None = None
) -> Axes:
    """Fig. 4A, phase in degrees, of stable fits; see `frf_gain`."""
    return _phase(data, amplitude, fmax, axes(ax), frf_of)


def controller_gain(
    data: GroupLike, amplitude: float | None = None, fmax: float | None = None, ax: Axes | None = None
) -> Axes:
    """Fig. 4B, gain of the neural controllers; see `frf_gain`."""
    ax = _gain(data, amplitude, fmax, axes(ax), controllers_of)
    ax.set_ylabel("gain" if view_of(data).group.model.declared else "gain (N·m/rad)")
    return ax


def controller_phase(
    data: GroupLike, amplitude: float | None = None, fmax: float | None = None, ax: Axes | None = None
) -> Axes:
    """Fig. 4B, phase of the neural controllers in degrees, of stable fits; see `frf_gain`."""
    return _phase(data, amplitude, fmax, axes(ax), controllers_of)


def _gain(data: GroupLike, amplitude: float | None, fmax: float | None, ax: Axes, response: Response) -> Axes:
    def gain(truth: np.ndarray, fits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.abs(truth), np.abs(fits)

    _draw(data, amplitude, fmax, ax, response, gain)
    log_axis(ax.yaxis)
    return ax


def _phase(data: GroupLike, amplitude: float | None, fmax: float | None, ax: Axes, response: Response) -> Axes:
    def phase(truth: np.ndarray, fits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        line = np.unwrap(np.angle(truth))
        return np.degrees(line), np.degrees(line + phase_errors(fits / truth))

    _draw(data, amplitude, fmax, ax, response, phase, stable=True)
    ax.yaxis.set_major_locator(MaxNLocator(steps=[1, 3, 4.5, 9], nbins=6))
    ax.set_ylabel("phase (°)")
    return ax


def phase_errors(ratio: np.ndarray) -> np.ndarray:
    """Phases (R, N) in rad of complex ``ratio`` over R fits and N frequencies, without jumps of a whole turn.

    The mean direction over fits is continuous from one frequency to the next, and no fit is further than half a turn
    from it; so quantiles over fits do not jump where single fits pass half a turn from the truth.
    """
    if not len(ratio):
        return np.angle(ratio)
    direction = np.exp(1j * np.angle(ratio))
    centre = np.unwrap(np.angle(direction.mean(axis=0)))
    return np.asarray(centre + np.angle(direction * np.exp(-1j * centre)))


def _draw(
    data: GroupLike,
    amplitude: float | None,
    fmax: float | None,
    ax: Axes,
    response: Response,
    part: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]],
    *,
    stable: bool = False,
) -> None:
    """``stable``: leave out fits whose loop is unstable, whose phase turns the other way at a resonance."""
    view = view_of(data)
    a, limit = chosen_amplitude(view, amplitude), chosen_fmax(view, fmax)
    grid = np.unique(view.cube["frequency"].values)
    f, true, every_fit, is_stable = _responses(view, a, limit, response)
    at = np.searchsorted(f, grid)
    fits = {name: x[is_stable] if stable else x for name, x in every_fit.items()}
    for i, name in enumerate(true):
        colour = SERIES[i % len(SERIES)]
        line, fitted = part(true[name], fits[name])
        ax.plot(f, line, color=colour, linestyle=DASHES[i % len(DASHES)], label=name)
        if view.noisy and len(fitted):
            ax.fill_between(f, *np.quantile(fitted, BAND, axis=0), color=colour, alpha=0.22, linewidth=0)
        elif len(fitted):
            marker = MARKERS[i % len(MARKERS)]
            ax.plot(
                grid, fitted[0, at], marker, color=colour, markersize=4.5, markerfacecolor="none", label=f"{name}, fit"
            )
    if limit < f[-1] * 0.99:
        ax.axvline(limit, color="#57606a", linewidth=0.9, linestyle=(0, (4, 3)))
    frequency_axis(ax, f)
    ax.set_title(cell_label(view, a, limit))
    ax.legend(ncols=2)


@lru_cache(maxsize=8)
def _responses(
    view: GroupView, amplitude: float, fmax: float, response: Response
) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray]:
    """Frequencies (N,), responses of the truth (N,) and of the best fits (R, N), and which fits are stable (R,).

    Kept, because gain and phase are drawn from the same: two responses at three Fmax, some 30 MB at most.
    """
    grid = np.unique(view.cube["frequency"].values)
    f = np.union1d(grid, np.geomspace(grid[0], grid[-1], FINE))  # resonances lie between a study's frequencies
    cells = view.cells.sel(amplitude=amplitude, fmax=fmax).isel(realization=slice(0, MOST_FITS))
    estimate = cells["estimate"].transpose("realization", "parameter").values
    shown = np.isfinite(estimate).all(1)
    fits = response(view.model, estimate[shown], f)
    return f, response(view.simulated, view.simulated.truth, f), fits, cells["growth_rate"].values[shown] < 0
