"""Figures of the alternatives: two stimuli without a model, and fits to a population's mean."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from mcstudy.report.axes import axes, frequency_axis, legend_below, log_axis
from mcstudy.report.style import COLOURS, DASHES, MARKERS, SERIES
from mcstudy_goodworth2018.alternatives.files import PopulationResult, TwoStimuliResult

SHOWN_PERCENT = 100.0
"""Errors of a population's parameters that the axis shows; larger ones are arrows at its ends."""


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
