"""Figures of the estimates: intervals, profiles, correlations, minima, information and sway."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from scipy.special import ndtri

from mcstudy.errors import InputError
from mcstudy.identification.estimate import Estimate
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.simulated_coverage import LEAST, MOST
from mcstudy.identification.tables import band_names
from mcstudy.report.axes import axes, legend_below, log_axis
from mcstudy.report.figures.pairs import draw_correlations
from mcstudy.report.labels import with_units
from mcstudy.report.style import COLOURS, DASHES, HATCHES, SERIES

PROFILE, WALD, OTHER = COLOURS["blue"], COLOURS["orange"], COLOURS["muted"]

LEAST_RISE = 1e-3
"""Increases of the squared residual below this are drawn at it."""


def intervals(fit: FitRecord, ax: Axes | None = None) -> Axes:
    """Estimates and intervals of all quantities with a typical value, in units of it.

    Filled: the profile interval, hollow ends where a bound ends it; above it the Gauss-Newton interval.
    """
    ax = axes(ax, (6.4, 4.6))
    typical = dict(zip(fit.model.names, fit.model.truth, strict=True))
    shown = [(e, sum(typical[t] for t in e.name.split(" + "))) for e in fit.estimates if _known(e, typical)]
    for y, (e, scale) in enumerate(shown):
        ax.plot(
            [e.low / scale, e.high / scale], [y, y], color=PROFILE, linewidth=2.2, label="profile" if not y else None
        )
        for end, ended in ((e.low, e.low_from), (e.high, e.high_from)):
            fill = PROFILE if ended == "data" else COLOURS["panel"]
            ax.plot(end / scale, y, "o", color=PROFILE, markerfacecolor=fill, markersize=5)
        if np.isfinite(e.wald_low):
            ends = np.clip([e.wald_low / scale, e.wald_high / scale], -1, 6)
            ax.plot(ends, [y - 0.28] * 2, color=WALD, linewidth=1.4, linestyle=DASHES[1], label=_once(ax, "Wald"))
        ax.plot(e.estimate / scale, y, "D", color=COLOURS["ink"], markersize=4.5, label="estimate" if not y else None)
        paper = fit.paper_value(e.name)
        if paper is not None:
            ax.plot(paper / scale, y, "x", color=COLOURS["purple"], markersize=6, label=_once(ax, "paper's cost"))
    ax.set_yticks(range(len(shown)), [e.name for e, _ in shown])
    ax.set_ylim(len(shown) - 0.4, -0.6)
    ax.set_xlabel("value / typical value")
    legend_below(ax, 4, -0.12)
    return ax


def profile(fit: FitRecord, quantity: str, ax: Axes | None = None) -> Axes:
    """Increase of the squared residual with the value of one quantity, its threshold, and the parabola of Wald.

    Raises `InputError` for an unknown quantity.
    """
    if quantity not in {e.name for e in fit.estimates}:
        raise InputError(f"quantity: expected one of {', '.join(e.name for e in fit.estimates)}, got {quantity!r}")
    ax, e = axes(ax), fit[quantity]
    x, rise = e.profile.value, e.profile.rise
    threshold = _threshold(e)
    ax.plot(x, rise, "o", color=PROFILE, markersize=3.5, label="profile")
    ax.axhline(threshold, color=OTHER, linestyle=DASHES[2], linewidth=1.0, label=f"threshold {threshold:.2f}")
    ax.axvspan(e.low, e.high, color=PROFILE, alpha=0.1, linewidth=0)
    se = (e.wald_high - e.wald_low) / 2 / ndtri(0.5 + fit.level / 2)
    span = max(e.high - e.low, 1e-12 + abs(e.estimate) * 1e-6)
    if np.isfinite(se) and se > 0:
        at = np.linspace(
            max(e.estimate - 3 * se, e.low - 0.3 * span), min(e.estimate + 3 * se, e.high + 0.3 * span), 80
        )
        parabola = ((at - e.estimate) / se) ** 2
        near = parabola <= 1.6 * threshold
        ax.plot(at[near], parabola[near], color=WALD, linestyle=DASHES[1], label="Wald")
    ax.plot(e.estimate, 0, "D", color=COLOURS["ink"], markersize=5, label="estimate")
    ax.set_xlim(e.low - 0.08 * span, e.high + 0.08 * span)
    ax.set_ylim(-0.05 * threshold, 1.5 * threshold)
    ax.set_xlabel(f"{quantity} ({with_units(e.unit)})" if e.unit else quantity)
    ax.set_ylabel("squared residual above lowest")
    ax.set_title(f"{quantity}: {e.verdict}")
    return ax


def correlations(fit: FitRecord, ax: Axes | None = None) -> Axes:
    """Correlations of the errors near the estimate: discs positive, hollow squares negative."""
    ax = axes(ax, (4.3, 4.3))
    free = np.isfinite(np.diag(fit.correlation))
    names = [n for n, f in zip(fit.model.names, free, strict=True) if f]
    draw_correlations(ax, names, fit.correlation[np.ix_(free, free)])
    return ax


def waterfall(fit: FitRecord, ax: Axes | None = None) -> Axes:
    """Squared residuals of all random starts above the lowest minimum, ascending."""
    ax = axes(ax)
    m = fit.minima
    rise = np.maximum(m.waterfall[np.isfinite(m.waterfall)] - m.chi2[0], LEAST_RISE)
    ax.plot(np.arange(1, rise.size + 1), rise, "o", color=PROFILE, markersize=3, label="starts")
    ax.axhline(
        max(_threshold(e) for e in fit.estimates), color=OTHER, linestyle=DASHES[2], label="threshold of intervals"
    )
    log_axis(ax.yaxis)
    ax.set_xlabel("random start, best first")
    ax.set_ylabel("squared residual above lowest")
    legend_below(ax, 2)
    return ax


def coverage(fit: FitRecord, ax: Axes | None = None) -> Axes:
    """Percent of simulated intervals of every quantity that hold the truth: all bodies, and worst to best body.

    Raises `InputError` where no similar recordings were simulated.
    """
    c = fit.coverage
    if c is None:
        raise InputError(f"{fit.name}: expected a kind of recording whose intervals were simulated (fit.coverage)")
    ax = axes(ax, (6.4, 4.6))
    ax.axvspan(LEAST, MOST, color=OTHER, alpha=0.15, linewidth=0, label=f"goal, {LEAST:g} to {MOST:g} %")
    for y, covered in enumerate(c.quantities.values()):
        ends = covered.lowest, covered.highest
        ax.plot(ends, [y, y], color=PROFILE, linewidth=2.2, label=_once(ax, "worst to best body"))
        ax.plot(covered.percent, y, "D", color=COLOURS["ink"], markersize=4.5, label=_once(ax, "all bodies"))
    ax.set_yticks(range(len(c.quantities)), list(c.quantities))
    ax.set_ylim(len(c.quantities) - 0.4, -0.6)
    ax.set_xlim(min(90.0, *(covered.lowest - 1 for covered in c.quantities.values())), 100.2)
    ax.set_xlabel(f"simulated {100 * fit.level:g} % intervals that hold the truth (%)")
    legend_below(ax, 3, -0.12)
    return ax


def information(fit: FitRecord, ax: Axes | None = None) -> Axes:
    """Share of the information on every quantity that each band of frequencies carries."""
    ax, names = axes(ax, (6.4, 4.6)), band_names(fit)
    share = np.nan_to_num(np.array([e.information[: len(names)] for e in fit.estimates]))
    left = np.zeros(len(share))
    for b, name in enumerate(names):
        ax.barh(range(len(share)), 100 * share[:, b], 0.72, left=left, color=SERIES[b], alpha=0.75, label=name,
                hatch=HATCHES[b], edgecolor=COLOURS["panel"])  # fmt: skip
        left += 100 * share[:, b]
    ax.set_yticks(range(len(share)), [e.name for e in fit.estimates])
    ax.set_ylim(len(share) - 0.4, -0.6)
    ax.set_xlim(0, 100)
    ax.set_xlabel("share of the information (%)")
    ax.grid(axis="y", visible=False)
    legend_below(ax, 4, -0.12)
    return ax


def sway(fit: FitRecord, ax: Axes | None = None) -> Axes:
    """Predicted sway of both angles with its range over the intervals, and the measured one with two standard errors.

    Raises `InputError` for a fit without recorded sway.
    """
    if fit.sway is None:
        raise InputError(f"{fit.name}: expected a fit of time series, because sway needs them")
    ax = axes(ax, (4.3, 2.9))
    names: list[str] = []
    for a in fit.sway.angles:
        _sway_row(ax, len(names), (a.stimulus, a.stimulus_low, a.stimulus_high), a.measured, 2 * a.measured_se)
        names.append(f"{_greek(a.angle)}, stimulus")
        if a.noise is not None and a.noise_low is not None and a.noise_high is not None:
            _sway_row(ax, len(names), (a.noise, a.noise_low, a.noise_high), a.noise_measured, 0.0)
            names.append(f"{_greek(a.angle)}, noise")
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.set_xlim(left=0)
    ax.set_xlabel("sway (° RMS)")
    legend_below(ax, 2, -0.2)
    return ax


def _sway_row(ax: Axes, y: int, predicted: tuple[float, float, float], measured: float | None, error: float) -> None:
    at, low, high = predicted
    ax.plot([low, high], [y - 0.12] * 2, color=PROFILE, linewidth=2.2)
    ax.plot(at, y - 0.12, "D", color=PROFILE, markersize=5, label=_once(ax, "predicted, range over the intervals"))
    if measured is not None:
        ax.errorbar(measured, y + 0.15, xerr=error, fmt="o", color=COLOURS["ink"], capsize=3, markersize=4,
                    markerfacecolor="none", label=_once(ax, "measured ± 2 SE"))  # fmt: skip


def _once(ax: Axes, label: str) -> str | None:
    return None if label in ax.get_legend_handles_labels()[1] else label


def _greek(angle: str) -> str:
    return angle.replace("theta", "θ")


def _known(e: Estimate, typical: dict[str, float]) -> bool:
    terms = e.name.split(" + ")
    return set(terms) <= set(typical) and sum(typical[t] for t in terms) != 0


def _threshold(e: Estimate) -> float:
    """Increase at which the interval ends; the largest on the profile where no end is set by the data."""
    return float(e.profile.rise.max())
