"""Figures of the probabilities, of the share of the gap that the cause closes, and of sway in time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from mcstudy.effect_library.library import library_of
from mcstudy.errors import InputError
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.verdict import added_name, effects_of, motion, p_words, shown_causes
from mcstudy.report.axes import axes, legend_below
from mcstudy.report.diagnosis.figures import AFTER, BEFORE, MEASURED
from mcstudy.report.diagnosis.traces import SwayTraces
from mcstudy.report.style import COLOURS, DASHES
from mcstudy.text_tables import number

MOST_CAUSES = 5
LINE = 0.65
"""Height of a line of a label, in rows of one line; longer labels get more room."""

POINTS = 600
"""Most plotted points of a trace."""


def place_bars(diagnosis: DiagnosisRecord, ax: Axes | None = None) -> Axes:
    """Probability of every location, and of no single location."""
    values = {**diagnosis.place, "no single location": diagnosis.place_abstained}
    return _bars(axes(ax), list(values), list(values.values()), "location")


def cause_bars(diagnosis: DiagnosisRecord, ax: Axes | None = None) -> Axes:
    """Probability of the leading causes, of a cause outside the library, and of no missing effect."""
    shown = [c for c in diagnosis.causes[:MOST_CAUSES] if c.probability > 0.005]
    names = [" + ".join(e + _others(c.alternatives[k]) for k, e in enumerate(c.effects)) for c in shown]
    rest = max(0.0, 1 - sum(c.probability for c in shown) - diagnosis.unknown_probability - diagnosis.none_probability)
    names += ["other causes", "outside the library", "no missing effect"]
    values = [c.probability for c in shown] + [rest, diagnosis.unknown_probability, diagnosis.none_probability]
    return _bars(axes(ax), names, values, "cause")


MARGIN, LABEL = 0.12, 0.33
"""Room beside the intervals of sizes, and for the label of a size, as shares of what the intervals span."""

BINS = 40
OFF_SCALE = 1.5
"""An observed value farther from the null samples than this many times their range is drawn at the edge."""


def null_statistic(diagnosis: DiagnosisRecord, ax: Axes | None = None) -> Axes:
    """The test for deviations of known shape: its value, and its distribution in recordings with noise alone."""
    t = diagnosis.detection
    ax = _against_null(axes(ax), t.null_statistic, t.statistic, number(t.statistic))
    ax.set_xlabel("ln Bayes factor of a deviation")
    ax.set_title(f"deviations of known shape: {p_words(t.p_value, 1 / (1 + t.draws))}")
    return ax


def null_residual(diagnosis: DiagnosisRecord, ax: Axes | None = None) -> Axes:
    """The squared residual of all lines, and its distribution in recordings with noise alone."""
    t = diagnosis.detection
    ax = _against_null(axes(ax), t.null_chi2, t.chi2, f"{t.chi2:.0f}")
    ax.set_xlabel("squared residual of all lines")
    ax.set_title(f"all lines: {p_words(t.fit_p_value, 1 / (1 + t.draws))}")
    return ax


def _against_null(ax: Axes, null: np.ndarray, observed: float, text: str) -> Axes:
    low, high = float(null.min()), float(null.max())
    edge = high + OFF_SCALE * (high - low)
    ax.hist(null, BINS, color=COLOURS["muted"], alpha=0.55, label=f"noise alone ({null.size} samples)")
    ax.axvline(float(np.quantile(null, 0.95)), color=COLOURS["muted"], linestyle=DASHES[2], label="95 % of them below")
    beyond = " (off the scale)" if observed > edge else ""
    ax.axvline(min(observed, edge), color=AFTER, linewidth=2.2, label=f"this recording: {text}{beyond}")
    ax.set_ylabel("null samples")
    legend_below(ax, 1, -0.2)
    return ax


def effect_sizes(diagnosis: DiagnosisRecord, ax: Axes | None = None) -> Axes:
    """Sizes of the leading cause and of those in the 95 % set, with 95 % intervals, in standard errors."""
    shapes = library_of(diagnosis.base.model).shape_parameters
    sizes = [
        (f"{s.name}\n{effects_of(c)}", s)
        for c in shown_causes(diagnosis)
        for s in c.sizes
        if s.se > 0 and s.name not in shapes
    ][:MOST_CAUSES]
    if not sizes:
        raise InputError(f"{diagnosis.name}: no cause leads or is in the 95 % set, so there is no size to show")
    ax = axes(ax)
    at, low, high = np.array([(s.estimate / s.se, s.low / s.se, s.high / s.se) for _, s in sizes]).T
    ax.errorbar(at, np.arange(at.size), xerr=[at - low, high - at], fmt="o", color=AFTER, capsize=4, elinewidth=1.4)
    for y, x in enumerate(at):
        away = -1 if x < 0 else 1  # a label on the other side would touch the line at zero
        text = f"{x:.0f}" if abs(x) >= 100 else f"{x:.3g}"
        ax.annotate(text, (x, y), (4 * away, 7), textcoords="offset points", ha="right" if x < 0 else "left")
    least, most = min(0.0, low.min()), max(0.0, high.max())
    span = most - least
    labels = at + np.where(at < 0, -LABEL, LABEL) * span
    ax.set_xlim(min(least - MARGIN * span, labels.min()), max(most + MARGIN * span, labels.max()))
    ax.axvline(0, color=MEASURED, linewidth=1.0, linestyle=DASHES[1], label="no effect")
    ax.set_ylim(len(sizes) - 0.4, -0.6)
    ax.set_yticks(range(len(sizes)), ["\n".join(_wrapped(part) for part in name.split("\n")) for name, _ in sizes])
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("size / its standard error")
    ax.set_title("sizes of the causes")
    legend_below(ax, 1)
    return ax


def closed_bar(diagnosis: DiagnosisRecord, ax: Axes | None = None) -> Axes:
    """Share of the gap that the leading cause closes, with its 95 % interval."""
    closed = diagnosis.closed
    if closed is None:
        raise InputError(f"{diagnosis.name}: expected a cause that was added to the model; see the verdict")
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


def sway_error_bars(diagnosis: DiagnosisRecord, ax: Axes | None = None) -> Axes:
    """RMS error of predicted sway of the base model and with the cause, and the range that noise alone gives."""
    d = diagnosis
    values = [("base model", d.sway_rms_deg["before"], BEFORE)]
    if d.added is not None:
        values.append((added_name(d), d.sway_rms_deg["after"], AFTER))
    shown = [(name, value, colour) for name, value, colour in values if value is not None]
    if not shown or d.sway_noise_deg is None:
        raise InputError(f"{d.name}: expected a diagnosis of time series, because the error of sway needs them")
    ax = axes(ax, (4.3, 1.9))
    low, high = d.sway_noise_deg
    ax.axvspan(low, high, color=COLOURS["muted"], alpha=0.25, linewidth=0, label="noise alone, 95 %")
    for y, (_, value, colour) in enumerate(shown):
        ax.barh(y, value, 0.6, color=colour, alpha=0.75)
        ax.annotate(f"{value:.3g}°", (value, y), (4, 0), textcoords="offset points", va="center")
    ax.set_xlim(0, 1.3 * max(high, *(v for _, v, _ in shown)))
    ax.set_yticks(range(len(shown)), [_wrapped(name) for name, _, _ in shown])
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel(f"RMS error of {motion(d)} (°)")
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1))
    return ax


def sway_trace(traces: SwayTraces, angle: int = 0, ax: Axes | None = None) -> Axes:
    """Measured sway of one angle, and what both models predict."""
    ax = axes(ax, (4.3, 2.8))
    step = slice(None, None, -(-traces.t.size // POINTS))
    t = traces.t[step]
    ax.plot(t, traces.measured[step, angle], color=MEASURED, linewidth=2.8, alpha=0.4, label="measured")
    ax.plot(t, traces.before[step, angle], color=BEFORE, linewidth=1.1, linestyle=DASHES[1], label="base model")
    if traces.after is not None:
        ax.plot(t, traces.after[step, angle], color=AFTER, linewidth=1.1, label=traces.added_name)
    ax.set_ylabel(f"{traces.names[angle]} ({traces.units[angle]})")
    return _in_time(ax)


def sway_left(traces: SwayTraces, angle: int = 0, ax: Axes | None = None) -> Axes:
    """Measured minus predicted sway of one angle, of both models, with the 95 % noise of the measured mean."""
    ax = axes(ax, (4.3, 2.8))
    step = slice(None, None, -(-traces.t.size // POINTS))
    t = traces.t[step]
    if np.isfinite(traces.error[angle]):
        limit = 1.96 * traces.error[angle]
        ax.axhspan(-limit, limit, color=MEASURED, alpha=0.14, linewidth=0, label="95 % noise")
    left = traces.measured - traces.before
    ax.plot(t, left[step, angle], color=BEFORE, linewidth=1.1, linestyle=DASHES[1], label="base model")
    if traces.after is not None:
        after = (traces.measured - traces.after)[step, angle]
        ax.plot(t, after, color=AFTER, linewidth=1.0, label=traces.added_name)
    ax.set_ylabel(f"error of predicted {traces.names[angle]} ({traces.units[angle]})")
    return _in_time(ax)


def _in_time(ax: Axes) -> Axes:
    ax.set_xlabel("time (s)")
    legend_below(ax, 2, -0.18)
    return ax


def _others(group: tuple[str, ...]) -> str:
    return f" (or {len(group) - 1} similar)" if len(group) > 1 else ""


def _bars(ax: Axes, names: list[str], values: list[float], what: str) -> Axes:
    labels = [_wrapped(n) for n in names]
    room = np.array([max(1.0, LINE * (label.count("\n") + 1)) for label in labels])
    y = np.cumsum(room) - room / 2
    ax.barh(y, 100 * np.array(values), 0.7, color=AFTER, alpha=0.75)
    for at, value in zip(y, values, strict=True):
        ax.annotate(f"{100 * value:.0f}", (100 * value, at), (4, 0), textcoords="offset points", va="center")
    ax.set_xlim(0, 112)
    ax.set_xticks([0, 25, 50, 75, 100])
    ax.set_yticks(y, labels)
    ax.set_ylim(float(room.sum()), 0)
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
