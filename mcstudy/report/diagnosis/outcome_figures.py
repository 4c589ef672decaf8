"""Figures of the probabilities, of the share of the gap that the cause closes, and of sway in time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from mcstudy.errors import InputError
from mcstudy.gap.diagnosis import Diagnosis
from mcstudy.gap.verdict import words
from mcstudy.report.diagnosis.figures import AFTER, BEFORE, MEASURED
from mcstudy.report.diagnosis.traces import SwayTraces
from mcstudy.report.figures.common import axes, legend_below
from mcstudy.report.style import COLOURS, DASHES

MOST_CAUSES = 5
POINTS = 600
"""Most plotted points of a trace."""


def place_bars(diagnosis: Diagnosis, ax: Axes | None = None) -> Axes:
    """Probability of every location, and of no single location."""
    values = {**diagnosis.place, "no single location": diagnosis.place_abstained}
    return _bars(axes(ax), list(values), list(values.values()), "location")


def cause_bars(diagnosis: Diagnosis, ax: Axes | None = None) -> Axes:
    """Probability of the leading causes, of a cause outside the library, and of no missing effect."""
    shown = [c for c in diagnosis.causes[:MOST_CAUSES] if c.probability > 0.005]
    names = [" + ".join(words(e) + _others(c.alternatives[k]) for k, e in enumerate(c.effects)) for c in shown]
    rest = max(0.0, 1 - sum(c.probability for c in shown) - diagnosis.unknown_probability - diagnosis.none_probability)
    names += ["other causes", "outside the library", "no missing effect"]
    values = [c.probability for c in shown] + [rest, diagnosis.unknown_probability, diagnosis.none_probability]
    return _bars(axes(ax), names, values, "cause")


def closed_bar(diagnosis: Diagnosis, ax: Axes | None = None) -> Axes:
    """Share of the gap that the leading cause closes, with its 95 % interval."""
    closed = diagnosis.closed
    if closed is None:
        raise InputError(f"{diagnosis.name}: no gap was detected, so no cause was added")
    ax = axes(ax, (4.3, 1.9))
    ax.barh(0, 100 * closed.fraction, 0.5, color=AFTER, alpha=0.75)
    ax.errorbar(
        100 * closed.fraction,
        0,
        xerr=[[100 * (closed.fraction - closed.low)], [100 * (closed.high - closed.fraction)]],
        color=MEASURED,
        capsize=5,
        elinewidth=1.4,
    )
    ax.set_xlim(0, 103)
    ax.set_ylim(-0.6, 0.6)
    ax.set_yticks([0], ["closed"])
    ax.set_xlabel("share of the gap (%)")
    ax.grid(axis="y", visible=False)
    ax.set_title(f"{100 * closed.fraction:.0f} % [{100 * closed.low:.0f}, {100 * closed.high:.0f}]")
    return ax


NAMES = {"before": "base model", "after": "with the cause", "floor": "noise floor"}
"""Labels of the entries of ``Diagnosis.sway_rms_deg``."""


def sway_error_bars(diagnosis: Diagnosis, ax: Axes | None = None) -> Axes:
    """RMS error of predicted sway for the base model and with the cause, and the noise floor."""
    shown = [(k, v) for k in ("before", "after", "floor") if (v := diagnosis.sway_rms_deg[k]) is not None]
    if not shown:
        raise InputError(f"{diagnosis.name}: expected a diagnosis of time series, because the error of sway needs them")
    ax = axes(ax, (4.3, 1.9))
    colours = {"before": BEFORE, "after": AFTER, "floor": COLOURS["muted"]}
    for y, (name, value) in enumerate(shown):
        ax.barh(y, value, 0.7, color=colours[name], alpha=0.75)
        ax.annotate(f"{value:.3g}°", (value, y), (4, 0), textcoords="offset points", va="center")
    ax.set_xlim(0, 1.2 * max(v for _, v in shown))
    ax.set_yticks(range(len(shown)), [NAMES[k] for k, _ in shown])
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("RMS error of sway (°)")
    return ax


def sway_trace(traces: SwayTraces, angle: int = 0, ax: Axes | None = None) -> Axes:
    """Measured sway of one angle, and what both models predict."""
    ax = axes(ax, (4.3, 2.8))
    every = slice(None, None, -(-traces.t.size // POINTS))
    t = traces.t[every]
    ax.plot(t, traces.measured[every, angle], color=MEASURED, linewidth=1.0, label="measured")
    ax.plot(t, traces.before[every, angle], color=BEFORE, linewidth=1.1, linestyle=DASHES[1], label="base model")
    if traces.after is not None:
        ax.plot(t, traces.after[every, angle], color=AFTER, linewidth=1.1, label="with the cause")
    ax.set_ylabel(f"θ{angle + 1} (°)")
    return _in_time(ax)


def sway_left(traces: SwayTraces, angle: int = 0, ax: Axes | None = None) -> Axes:
    """Measured minus predicted sway of one angle, of both models, with the 95 % noise of the measured mean."""
    ax = axes(ax, (4.3, 2.8))
    every = slice(None, None, -(-traces.t.size // POINTS))
    t = traces.t[every]
    if np.isfinite(traces.error[angle]):
        limit = 1.96 * traces.error[angle]
        ax.axhspan(-limit, limit, color=MEASURED, alpha=0.14, linewidth=0, label="95 % noise")
    left = traces.measured - traces.before
    ax.plot(t, left[every, angle], color=BEFORE, linewidth=1.0, label="base model")
    if traces.after is not None:
        ax.plot(t, (traces.measured - traces.after)[every, angle], color=AFTER, linewidth=1.0, label="with the cause")
    ax.set_ylabel(f"measured minus predicted θ{angle + 1} (°)")
    return _in_time(ax)


def _in_time(ax: Axes) -> Axes:
    ax.set_xlabel("time (s)")
    legend_below(ax, 3, -0.18)
    return ax


def _others(group: tuple[str, ...]) -> str:
    return f" (or {len(group) - 1} similar)" if len(group) > 1 else ""


def _bars(ax: Axes, names: list[str], values: list[float], what: str) -> Axes:
    y = np.arange(len(names))
    ax.barh(y, 100 * np.array(values), 0.7, color=AFTER, alpha=0.75)
    for k, value in enumerate(values):
        ax.annotate(f"{100 * value:.0f}", (100 * value, k), (4, 0), textcoords="offset points", va="center")
    ax.set_xlim(0, 112)
    ax.set_xticks([0, 25, 50, 75, 100])
    ax.set_yticks(y, [_wrapped(n) for n in names])
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel(f"probability of the {what} (%)")
    return ax


def _wrapped(text: str, most: int = 24) -> str:
    lines = [""]
    for word in text.split():
        if lines[-1] and len(lines[-1]) + len(word) + 1 > most:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return "\n".join(lines)
