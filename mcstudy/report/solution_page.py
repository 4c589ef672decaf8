"""A solution as a page: the cheapest design, its measures along the axis, the designs that were fitted."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture
from matplotlib.ticker import MaxNLocator

from mcstudy.planning import words
from mcstudy.planning.arm import Arm
from mcstudy.planning.fits import Design
from mcstudy.planning.local_model import QUANTILE
from mcstudy.planning.next_look import leading
from mcstudy.planning.solution import SolutionRecord
from mcstudy.planning.space import CYCLES
from mcstudy.report.axes import axes, legend_below, log_axis, picture
from mcstudy.report.document import document
from mcstudy.report.figure import Figure, Panel, figure
from mcstudy.report.html import commands, joined, paragraphs, table, tiles
from mcstudy.report.labels import with_units
from mcstudy.report.style import COLOURS, DASHES
from mcstudy.text_tables import number

BAND, TARGET = COLOURS["orange"], COLOURS["blue"]
POINTS = 81


def solution_page(solution: SolutionRecord, command: str = "mcstudy solve STUDY --html page.html") -> str:
    """The page of a solution; ``command``: the command that makes this page, as displayed on it."""
    parts = [
        ("measures", "Measures and target", _measures(solution, command)),
        ("spent", "Designs that were fitted", _fitted(solution)),
        ("made", "Provenance", commands(command)),
    ]
    footer = (
        "Intervals are of 95 %. They cover the Monte Carlo error and that of the local model, not errors of the model "
        "of the body."
    )
    return document(f"The cheapest design: {solution.study.study.name}", _introduction(solution), parts, footer)


def _introduction(solution: SolutionRecord) -> Markup:
    d, answer = solution.nearest, solution.answer
    entries = [
        ("Cheapest design" if answer else "Nearest design", f"{d.cycles} cycles", f"{_seconds(solution)} s recorded."),
        ("Amplitude", f"{d.amplitude:g} {words.stimulus_unit(solution)}", _interval(solution, "amplitude")),
        ("Highest frequency", f"{d.fmax:g} Hz", "of the fits."),
        *(
            (
                r.target.name,
                f"{number(r.value)} {r.target.unit}",
                f"{number(r.low)} to {number(r.high)}; target at most {words.limit_text(r)}.",
            )
            for r in solution.readings
        ),
        ("Fits", f"{solution.spent.fits:,}".replace(",", "\u202f"), "spent by the search."),
    ]
    return paragraphs([words.statement(solution)]) + tiles(entries)


def _seconds(solution: SolutionRecord) -> str:
    return f"{solution.nearest.cycles * solution.space.period_s:.4g}"


def _interval(solution: SolutionRecord, axis: str) -> str:
    if axis not in solution.interval:
        return "as in the study." if axis not in solution.space.over else "the nearest to the target."
    low, high = solution.interval[axis]
    return f"95 % interval {low:.4g} to {high:.4g}."


def _measures(solution: SolutionRecord, command: str) -> Markup:
    shown = table(words.readings_table(solution), "rows")
    axis, arm = leading(solution.space), solution.arm
    if axis is None or arm is None:
        return shown
    drawn = Figure(
        "curve",
        f"Measures against the {axis}",
        [
            "Orange: the local model with its 95 % band. Circles: designs that were fitted, with two standard errors. "
            "Dashed: the target. Blue band: 95 % interval of the answer. Designs with other values on the other axes "
            "are left out.",
        ],
        [Panel(t.name, partial(measure_along, solution, k)) for k, t in enumerate(arm.targets)],
        python="found.to_html('page.html')",
    )
    return figure(drawn, command) + shown


def measure_along(solution: SolutionRecord, k: int, ax: Axes | None = None) -> Axes:
    """The measure of target ``k`` along the leading axis, with its limit and the interval of the answer."""
    ax, axis, arm = axes(ax), leading(solution.space), solution.arm
    assert axis is not None
    assert arm is not None
    target, curve = arm.targets[k], curve_of(solution, arm, axis, k)
    low, middle, high = curve.curves
    ax.fill_between(curve.values, low, high, color=BAND, alpha=0.2, linewidth=0)
    ax.plot(curve.values, middle, color=BAND, label="local model")
    for at, value, error in curve.looks:
        ax.plot([at, at], [value - 2 * error, value + 2 * error], color=COLOURS["ink"], linewidth=1.0)
    ax.plot(*(zip(*((at, v) for at, v, _ in curve.looks), strict=True)), "o", color=COLOURS["ink"], label="fitted")
    for limit in (target.limit, -target.limit) if target.measure.signed else (target.limit,):
        ax.axhline(limit, color=TARGET, linestyle=DASHES[1], label="target" if limit > 0 else None)
    for crossing in solution.answer.crossings if solution.answer else ():
        if crossing.axis == axis:
            ax.axvspan(crossing.low, crossing.high, color=TARGET, alpha=0.15, linewidth=0)
    unit = f" ({with_units(words.stimulus_unit(solution))})" if axis == "amplitude" else ""
    ax.set_xlabel(f"{axis}{unit}")
    ax.set_ylabel(f"{target.name} ({with_units(target.unit)})")
    ax.set_xlim(curve.values[0], curve.values[-1])
    log_axis(ax.xaxis)
    ax.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    legend_below(ax, 3, -0.2)
    return ax


def _fitted(solution: SolutionRecord) -> Markup:
    return paragraphs([words.spent_words(solution)]) + joined(map(table, words.search_tables(solution)))


@dataclass(frozen=True)
class Curve:
    """A measure along an axis, in its target's unit, with the others as in the answer.

    Attributes
    ----------
    values: of the axis, (n,). curves: lower end, middle and upper end of the local model's 95 % band, (3, n).
    looks: fitted designs on the axis: its value, the measure, one standard error.
    """

    values: np.ndarray
    curves: np.ndarray
    looks: list[tuple[float, float, float]]


def curve_of(solution: SolutionRecord, arm: Arm, axis: str, k: int) -> Curve:
    """The measure of target ``k`` along ``axis``."""
    target, d = arm.targets[k], solution.nearest
    low, high = map(float, solution.space.cycles if axis == CYCLES else solution.space.amplitude)
    values = np.geomspace(low, high, POINTS)
    cycles = values if axis == CYCLES else np.full(POINTS, float(d.cycles))
    amplitude = np.full(POINTS, d.amplitude) if axis == CYCLES else values
    band = arm.bands(cycles, amplitude)[k]
    ends = np.stack([band.value + side * QUANTILE * band.error for side in (-1, 0, 1)])
    curves = (ends if target.measure.signed else np.exp(ends)) * target.limit
    looks = [
        (at, look.found[k].value * target.limit, look.found[k].error * target.limit)
        for look in arm.looks
        if (at := _along(look.design.cycles, look.design.amplitude, axis, d)) is not None
    ]
    return Curve(values, curves, looks)


def _along(cycles: int, amplitude: float, axis: str, at: Design) -> float | None:
    """Where a design lies on the axis; None where its other value is not that of the answer."""
    if axis == CYCLES:
        return float(cycles) if abs(amplitude / at.amplitude - 1) < 0.02 else None
    return amplitude if cycles == at.cycles else None


def solution_picture(solution: SolutionRecord) -> Picture:
    """The measure of every target along the leading axis; without such an axis, the picture says so."""
    arm, title = solution.arm, f"{solution.study.study.name}. Blue: target, and 95 % interval of the answer."
    if arm is None or leading(solution.space) is None:
        return picture([lambda ax: ax.set_axis_off()], "No axis along which a measure could be drawn.")
    return picture([partial(measure_along, solution, k) for k in range(len(arm.targets))], title)
