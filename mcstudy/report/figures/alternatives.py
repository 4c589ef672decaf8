"""The alternatives that the paper discusses: one segment, two stimuli without a model, fits to a population's mean."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from mcstudy.report.alternatives import PopulationResult, TwoStimuliResult
from mcstudy.report.axes import axes, frequency_axis, legend_below, log_axis
from mcstudy.report.style import COLOURS, DASHES, MARKERS, SERIES

SHOWN_PERCENT = 100.0
"""Errors of a population's parameters that the axis shows; larger ones are arrows at its ends."""


def hit_rate_bars(rate: xr.Dataset, title: str = "", ax: Axes | None = None) -> Axes:
    """Fraction of starts that reach the lowest minimum by Fmax, for stable and unstable loops at the start, ± MCSE.

    ``rate``: `mcstudy.analysis.stable_starts.hit_rate_by_start` at one amplitude.
    """
    ax = axes(ax)
    fmax = rate["fmax"].values
    for i, loop in enumerate(("stable", "unstable")):
        here = rate.sel(loop=loop)
        x = np.arange(len(fmax)) + (i - 0.5) * 0.38
        value, error = 100 * here["value"].values, 100 * here["mcse"].fillna(0.0).values
        hatch = "" if i == 0 else "///"
        ax.bar(x, value, 0.36, yerr=error, color=SERIES[i], alpha=0.8, hatch=hatch, label=f"{loop} start", capsize=3)
        for k, v in enumerate(value):
            text = "none" if not np.isfinite(v) else f"{v:.0f}"
            at = 0.0 if not np.isfinite(v) else min(v + error[k], 108.0)
            ax.annotate(text, (x[k], at), (0, 3), textcoords="offset points", ha="center", fontsize=9)
    ax.set_xticks(range(len(fmax)), [f"{f:g} Hz" for f in fmax])
    ax.set_ylim(0, 119)
    ax.set_yticks([0, 25, 50, 75, 100])
    ax.set_ylabel("starts reaching the minimum (%)")
    ax.set_title(title)
    ax.grid(axis="x", visible=False)
    legend_below(ax, 2, -0.1)
    return ax


def controller_off(result: TwoStimuliResult, controller: str, ax: Axes | None = None) -> Axes:
    """Error of the mean estimate of one neural controller by frequency, for every estimator.

    The dotted line is the error expected from chance alone if the first estimator is unbiased.
    """
    ax = axes(ax)
    for i, (name, (_, controllers)) in enumerate(result.estimators.items()):
        ax.plot(
            result.f,
            controllers[controller]["off"],
            color=SERIES[i % len(SERIES)],
            marker=MARKERS[i % len(MARKERS)],
            markersize=3.2,
            linewidth=1.1,
            label=name,
        )
    first = next(iter(result.estimators.values()))[1]
    ax.plot(
        result.f, first[controller]["chance"], color=COLOURS["ink"], linestyle=DASHES[2], label="chance (first one)"
    )
    frequency_axis(ax, result.f)
    log_axis(ax.yaxis)
    ax.set_ylabel("error of the mean (% of magnitude)")
    ax.set_title(controller)
    legend_below(ax, 1, -0.18)
    return ax


def population_bias(result: PopulationResult, ax: Axes | None = None) -> Axes:
    """Bias ± MCSE of both routes by parameter; the thin line is ± one standard deviation over populations."""
    ax = axes(ax, (4.3, 5.2))
    names = [r["name"] for r in result.rows]
    for i, (key, label) in enumerate((("mean_of_fits", "mean of fits"), ("fit_to_mean", "fit to the mean"))):
        y = np.arange(len(names)) + (i - 0.5) * 0.36
        bias, mcse, sd = (np.array([r[key][k] for r in result.rows]) for k in ("bias", "mcse", "sd"))
        inside = np.abs(bias) <= SHOWN_PERCENT
        for low, high, width in ((bias - sd, bias + sd, 0.7), (bias - mcse, bias + mcse, 2.6)):
            low, high = np.clip(low, -SHOWN_PERCENT, SHOWN_PERCENT), np.clip(high, -SHOWN_PERCENT, SHOWN_PERCENT)
            ax.hlines(y, low, high, color=SERIES[i], linewidth=width)
        ax.plot(bias[inside], y[inside], MARKERS[i], color=SERIES[i], label=label)
        for side, arrow in ((1, ">"), (-1, "<")):
            out = side * bias > SHOWN_PERCENT
            ax.plot(np.full(int(out.sum()), side * SHOWN_PERCENT), y[out], arrow, color=SERIES[i])
    ax.axvline(0, color=COLOURS["ink"], linewidth=0.9, linestyle=DASHES[1])
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("bias (% of the truth)")
    legend_below(ax, 2, -0.1)
    return ax
