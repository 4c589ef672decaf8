"""Figures over frequency: measured and modelled responses, and their differences."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from mcstudy.report.axes import axes, frequency_axis, legend_below, log_axis
from mcstudy.report.diagnosis.data import GapData
from mcstudy.report.style import COLOURS, DASHES
from mcstudy.stance.feedback import Model

BEFORE, AFTER, MEASURED = COLOURS["orange"], COLOURS["blue"], COLOURS["ink"]

REAL = 1.96 / np.sqrt(2)
"""95 % limit of the real part of a complex error, in units of its RMS magnitude."""

CURVE_POINTS = 200

Z_STEPS = (0.8, 1.2, 1.6, 2.4)
"""Edges of the shades of the map, as RMS |z| of the lines in a cell; noise alone gives 1."""

SHADES = (0.03, 0.12, 0.3, 0.55, 0.9)


def _curve(data: GapData) -> np.ndarray:
    return np.geomspace(data.lines.f[0], data.lines.f[-1], CURVE_POINTS)


def response_gain(data: GapData, angle: int = 0, ax: Axes | None = None) -> Axes:
    """Gain of one angle: band means of the measurement with a 95 % noise band, and both models."""
    ax = axes(ax)
    a, f = data.averages, _curve(data)
    level = np.abs(data.before(a.f)[:, angle])
    gain, noise = level * np.abs(a.ratio[:, angle]), level * REAL * a.sd[:, angle]
    draw_measured(ax, a.f, gain, noise, lowest=0.02 * gain)
    _models(
        ax, data, f, np.abs(data.before(f)[:, angle]), None if (h := data.after(f)) is None else np.abs(h[:, angle])
    )
    log_axis(ax.yaxis)
    frequency_axis(ax, data.lines.f)
    ax.set_ylabel(f"gain ({gain_unit(data.model, angle)})")
    return _titled(ax, data, angle)


def response_phase(data: GapData, angle: int = 0, ax: Axes | None = None) -> Axes:
    """Phase of one angle in degrees; see `response_gain`."""
    ax = axes(ax)
    a, f = data.averages, _curve(data)
    phases = data.phases(f, angle)
    noise = np.degrees(_phase_noise(a.sd[:, angle], a.ratio[:, angle]))
    draw_measured(ax, a.f, np.degrees(phases.measured), noise)
    _models(ax, data, f, np.degrees(phases.base), None if phases.added is None else np.degrees(phases.added))
    frequency_axis(ax, data.lines.f)
    ax.set_ylabel("phase (°)")
    return _titled(ax, data, angle)


def misfit_gain(data: GapData, angle: int = 0, ax: Axes | None = None) -> Axes:
    """Measured gain minus that of the base model, in percent of it, with a 95 % band; and the model with the cause."""
    ax = axes(ax)
    a = data.averages
    draw_measured(ax, a.f, 100 * (np.abs(a.ratio[:, angle]) - 1), 100 * REAL * a.sd[:, angle])
    moved = _moved(data, angle)
    _models(ax, data, _curve(data), np.zeros(CURVE_POINTS), None if moved is None else 100 * (np.abs(moved) - 1))
    _clipped(ax, 100 * (np.abs(np.stack([a.ratio[:, angle], a.after[:, angle]])) - 1), 8.0, lowest=-105)
    frequency_axis(ax, data.lines.f)
    ax.set_ylabel("difference of gain (%)")
    return _titled(ax, data, angle)


def misfit_phase(data: GapData, angle: int = 0, ax: Axes | None = None) -> Axes:
    """Measured phase minus that of the base model, degrees; see `misfit_gain`."""
    ax = axes(ax)
    a, f = data.averages, _curve(data)
    phases = data.phases(f, angle)
    measured = np.degrees(phases.measured - np.interp(a.f, f, phases.base))
    moved = None if phases.added is None else np.degrees(phases.added - phases.base)
    draw_measured(ax, a.f, measured, np.degrees(_phase_noise(a.sd[:, angle], a.ratio[:, angle])))
    _models(ax, data, f, np.zeros(CURVE_POINTS), moved)
    _clipped(ax, measured if moved is None else np.concatenate([measured, moved]), 5.0)
    frequency_axis(ax, data.lines.f)
    ax.set_ylabel("difference of phase (°)")
    return _titled(ax, data, angle)


def z_map(data: GapData, ax: Axes | None = None) -> Axes:
    """Standardised residuals by angle and frequency, of the base model and with the cause.

    A cell's shade is the root-mean-square |z| of its lines; a cross marks cells with a line beyond the 95 % limit of
    the largest |z| on the whole map.
    """
    ax = axes(ax, (4.3, 2.9))
    f, rows = data.lines.f, []
    for label, z in (("base", data.z_before), ("with the cause", data.z_after)):
        rows += [] if z is None else [(f"{n} {label}", z[:, k]) for k, n in enumerate(data.angles)]
    edges = np.geomspace(f[0] * 0.97, f[-1] * 1.03, 3 * 12 + 1)
    cell = np.digitize(f, edges) - 1
    drawn = np.unique(cell)
    width, left = np.diff(edges)[drawn], edges[drawn]
    texts = [f"< {Z_STEPS[0]:g}", *(f"> {s:g}" for s in Z_STEPS)]
    rms = np.array([[np.sqrt(np.mean(z[cell == c] ** 2)) for c in drawn] for _, z in rows])
    largest = np.array([[z[cell == c].max() for c in drawn] for _, z in rows])
    shade = np.searchsorted(Z_STEPS, rms, side="right")
    for step in np.unique(shade):
        y, c = np.nonzero(shade == step)
        ax.barh(y, width[c], 0.86, left=left[c], color=BEFORE, alpha=SHADES[step], linewidth=0, label=texts[step])
    y, c = np.indices(shade.shape).reshape(2, -1)
    ax.barh(y, width[c], 0.86, left=left[c], fill=False, edgecolor=COLOURS["grid"], linewidth=0.5)
    y, c = np.nonzero(largest > data.diagnosis.detection.z_limit)
    if y.size:
        ax.plot(np.sqrt(left[c] * (left + width)[c]), y, "x", color=MEASURED, markersize=5)
    frequency_axis(ax, f)
    ax.set_xlim(edges[0], edges[-1])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_yticks(range(len(rows)), [label for label, _ in rows])
    ax.grid(visible=False)
    keys = [
        Patch(facecolor=(BEFORE, a), edgecolor=COLOURS["muted"], linewidth=0.6, label=t)
        for a, t in zip(SHADES, texts, strict=True)
    ]
    ax.legend(
        handles=keys,
        loc="upper center",
        bbox_to_anchor=(0.45, -0.22),
        ncols=5,
        title="rms |z|",
        handlelength=1.1,
        columnspacing=0.9,
    )
    return ax


def z_lines(data: GapData, angle: int = 0, ax: Axes | None = None) -> Axes:
    """|z| of all lines of one angle for both models; noise alone exceeds the limit in 1 of 20 recordings."""
    ax = axes(ax)
    f = data.lines.f
    ax.plot(f, data.z_before[:, angle], "o", color=BEFORE, markersize=3.2, label="base model")
    if data.z_after is not None:
        ax.plot(f, data.z_after[:, angle], "+", color=AFTER, markersize=4.5, label=data.added_name)
    ax.axhline(data.diagnosis.detection.z_limit, color=MEASURED, linewidth=1.0, linestyle=DASHES[1], label="limit")
    frequency_axis(ax, f)
    ax.set_ylim(0, 1.15 * max(data.diagnosis.detection.z_limit, float(data.z_before.max())))
    ax.set_ylabel("|z|")
    legend_below(ax, 2, -0.19)
    ax.set_title(data.angles[angle])
    return ax


def _moved(data: GapData, angle: int) -> np.ndarray | None:
    """The model with the cause over the base model, (`CURVE_POINTS`,) complex."""
    f = _curve(data)
    return None if (h := data.after(f)) is None else h[:, angle] / data.before(f)[:, angle]


def _phase_noise(sd: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    return np.asarray(np.minimum(REAL * sd / np.abs(ratio), np.pi))


def draw_measured(
    ax: Axes, f: np.ndarray, value: np.ndarray, noise: np.ndarray, lowest: np.ndarray | None = None
) -> None:
    """Measured values with their 95 % noise band, which does not go below ``lowest``."""
    low = value - noise if lowest is None else np.maximum(value - noise, lowest)  # a log axis has no zero
    ax.fill_between(f, low, value + noise, color=MEASURED, alpha=0.16, linewidth=0)
    ax.plot(f, value, "o", color=MEASURED, markersize=3.5, markerfacecolor="none", label="measured, 95 % noise")


def _models(ax: Axes, data: GapData, f: np.ndarray, before: np.ndarray, after: np.ndarray | None) -> None:
    ax.plot(f, before, color=BEFORE, linestyle=DASHES[1], label="base model")
    if after is not None:
        ax.plot(f, after, color=AFTER, label=data.added_name)


def _clipped(ax: Axes, values: np.ndarray, least: float, lowest: float = -np.inf) -> None:
    """Axis limits from the values alone; the wide noise band of a noisy line would flatten the rest."""
    most = max(1.25 * float(np.abs(values).max()), least)
    ax.set_ylim(max(-most, lowest), most)


def gain_unit(model: Model, angle: int = 0) -> str:
    """Unit of the gain of an angle or another output."""
    unit, out = model.stimulus_unit.replace(" ", "·"), model.output_units[angle].replace(" ", "·")
    return f"{out}/({unit})" if "·" in unit else f"{out}/{unit}"


def _titled(ax: Axes, data: GapData, angle: int) -> Axes:
    ax.set_title(data.angles[angle])
    legend_below(ax, 2)
    return ax
