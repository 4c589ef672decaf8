"""Fig. 4-7 and the efficiency: how good the estimates are."""

from __future__ import annotations

from functools import partial
from typing import Any

import xarray as xr

from mcstudy.analysis.sensitivity import RANGES
from mcstudy.analysis.statistics import CELL_STATISTICS
from mcstudy.analysis.view import GroupView
from mcstudy.report import figures
from mcstudy.report.figure import Figure, Missing, Panel
from mcstudy.report.figures.accuracy import bias_at, cv_at
from mcstudy.report.figures.common import chosen_fmax, of_all
from mcstudy.report.figures.efficiency import efficiency_of
from mcstudy.report.figures.responses import MOST_FITS
from mcstudy.report.html import Table
from mcstudy.report.labels import cell_label, unit, with_units
from mcstudy.report.numbers import finite, short
from mcstudy.report.study.context import Context, conditions, largest_amplitude, stat, value_of
from mcstudy.report.study.search import relative_errors
from mcstudy.report.style import HATCHES
from mcstudy.text_tables import with_error

NO_NOISE_GROUP = "no group with noise has more than one realization"


def paper_estimate_figures(context: Context) -> list[Figure | Missing]:
    """Fig. 4-7."""
    view = context.accuracy
    out: list[Figure | Missing] = [_fig_4(context)]
    if view is None:
        titles = {"Fig. 5": "Estimates", "Fig. 6": "Combined stiffness", "Fig. 7": "Bias, variability, influence"}
        return out + [Missing(n, t, NO_NOISE_GROUP) for n, t in titles.items()]
    return [*out, _fig_4_noise(view), *estimates(context, view, ""), _fig_7c(view)]


def estimates(context: Context, view: GroupView, suffix: str) -> list[Figure | Missing]:
    """Fig. 5, 6, 7A and 7B of one group; ``suffix`` makes their ids unique."""
    return [_fig_5(context, view, suffix), _fig_6(context, view, suffix), _fig_7a(view, suffix), _fig_7b(view, suffix)]


def statistic_figures(view: GroupView, suffix: str = "") -> list[Figure]:
    """Declared statistics that have a title for a figure."""
    return [
        Figure(
            f"{s.key}{suffix}",
            "",
            s.figure,
            [f"{s.page or s.head}: {s.meaning}. By Fmax and amplitude, ± MCSE."],
            [Panel(s.figure, partial(figures.statistic_by_fmax, view, s.key))],
            python=f'figures.statistic_by_fmax(tree["{view.name}"], "{s.key}")',
        )
        for s in CELL_STATISTICS
        if s.figure
    ]


def _fig_4(context: Context) -> Figure | Missing:
    title = "Fits without noise"
    view = context.theory
    if view is None:
        return Missing("Fig. 4", title, "the study has no group without noise (simulator = 'none')")
    a, f = conditions(view)[-1]
    return Figure(
        "fig4",
        "Fig. 4",
        title,
        [
            "A: responses of the angles to the stimulus, B: the neural controllers. Lines are the truth, markers the "
            "best fit of all starts. They coincide: without noise, one stimulus identifies all parameters.",
        ],
        [
            Panel("A, gain of the angles", partial(figures.frf_gain, view, a, f), letter="A"),
            Panel("A, phase of the angles", partial(figures.frf_phase, view, a, f), letter="A"),
            Panel("B, gain of the neural controllers", partial(figures.controller_gain, view, a, f), letter="B"),
            Panel("B, phase of the neural controllers", partial(figures.controller_phase, view, a, f), letter="B"),
        ],
        [Table("Best fit without noise", ["parameter", "truth", "estimate", "error (%)"], relative_errors(view))],
        ("theory_mean_error", "theory_max_error"),
        f'figures.controller_gain(tree["{view.name}"], fmax={f:g})',
    )


def _fig_4_noise(view: GroupView) -> Figure | Missing:
    a = largest_amplitude(view)
    fmaxes = [f for amplitude, f in conditions(view) if amplitude == a]
    panels = [
        Panel(f"gain of the {what}, Fmax {f:g} Hz", partial(draw, view, a, f), share="xy")
        for what, draw in (("angles", figures.frf_gain), ("neural controllers", figures.controller_gain))
        for f in fmaxes
    ]
    panels += [
        Panel(f"phase of the {what}, Fmax {f:g} Hz", partial(draw, view, a, f), share="xy")
        for what, draw in (("angles", figures.frf_phase), ("neural controllers", figures.controller_phase))
        for f in fmaxes
    ]
    return Figure(
        "fig4noise",
        "",
        "Fitted responses with noise",
        [
            "Lines: truth. Bands: 10th to 90th percentile of the best fits over realizations, at each frequency. "
            "Dashed: Fmax. Beyond Fmax a fit extrapolates: a low Fmax does not determine the dynamics above it, as in "
            "the paper. The phase is that of stable fits only: an unstable loop has no response to be measured."
            + of_all(view, MOST_FITS),
        ],
        panels,
        (),
        (),
        f'figures.controller_gain(tree["{view.name}"], amplitude={a:g}, fmax={view.cube["fmax"].values[0]:g})',
    )


def _amplitude_keys(view: GroupView) -> list[tuple[str, str]]:
    """In the order of the bars: as in the paper's Fig. 5, the largest amplitude comes first."""
    palette = ("blue", "orange", "green", "purple", "ochre", "sky")
    labels = [f"{a:g} {unit(view)}" for a in view.cube["amplitude"].values]
    keys = [
        (palette[i % len(palette)] + (" hatched" if HATCHES[i % len(HATCHES)] else ""), label)
        for i, label in enumerate(labels)
    ]
    return [("muted", "true value"), *reversed(keys)]


def _fig_5(context: Context, view: GroupView, suffix: str) -> Figure | Missing:
    held_hz = [f"{f:g}" for f in context.publication.fmax]
    spread = ("spread_fmax", *(f"spread_amplitude_{f}" for f in held_hz))
    trade = ("together_1", "together_2")
    names = view.model.names
    return Figure(
        f"fig5{suffix}",
        "Fig. 5",
        "Estimates of every parameter",
        [
            "True value, then mean ± SD over realizations of the best fits, by Fmax (Hz, below the bars) and amplitude "
            "of the stimulus. Dashed: the true value. A parameter that the data do not determine scatters between its "
            "bounds and, if these are centred on the truth, still averages to the truth. So check the SD and the "
            "number of fits on a bound before trusting a small bias.",
        ],
        [Panel(n, partial(figures.parameter_bars, view, n), (2.1, 1.9)) for n in names],
        _estimate_tables(context, view, set(names)),
        (
            *spread,
            *(f"bias_12_{f}" for f in held_hz),
            "spread_8_larger",
            "spread_8hz_better",
            "spread_8hz_worse",
            *trade,
        ),
        f'figures.parameter_bars(tree["{view.name}"], "{names[0]}")',
        small=True,
        legend=_amplitude_keys(view),
    )


_OF_SUMS = (
    "The sum of the active and the passive stiffness of a joint is well determined where the two alone are not, "
    "because they differ only by the delay. "
)


def _fig_6(context: Context, view: GroupView, suffix: str) -> Figure | Missing:
    declared = view.group.model.declared
    title = "Derived quantities" if declared else "Active and passive stiffness combined"
    if view.derived is None:
        return Missing("Fig. 6", title, "the model derives no quantity from its parameters")
    names = [str(n) for n in view.derived["parameter"].values]
    return Figure(
        f"fig6{suffix}",
        "Fig. 6",
        title,
        [
            ("" if declared else _OF_SUMS) + "Mean ± SD over realizations, as in Fig. 5.",
        ],
        [Panel(n, partial(figures.parameter_bars, view, n), (2.4, 2.0)) for n in names],
        _estimate_tables(context, view, set(names)),
        ("bias_10_0.41", "bias_10_1.2", "bias_10_8", "bias_2_0.41", "bias_2_1.2", "spread_fmax_10", "spread_fmax_2"),
        f'figures.parameter_bars(tree["{view.name}"], "{names[0]}")',
        small=True,
        legend=_amplitude_keys(view),
    )


def _estimate_tables(context: Context, view: GroupView, names: set[str]) -> list[Table]:
    return [_estimate_table(view, cell, names) for cell in context.cells(view)]


def _estimate_table(view: GroupView, cell: dict[str, Any], names: set[str]) -> Table:
    rows = []
    for p in cell["parameters"]:
        if p["name"] not in names:
            continue
        scale = 100 / abs(p["truth"]) if p["truth"] else None
        bias = "-" if scale is None else stat(p["bias"], scale)
        mean = None if p["bias"]["value"] is None else p["truth"] + p["bias"]["value"]
        on = [100 * p[k]["value"] for k in ("at_lower_bound", "at_upper_bound") if k in p and p[k]["value"] is not None]
        rows.append(
            [
                f"{p['name']} ({with_units(p['unit'])})",
                short(p["truth"], 4),
                with_error(mean, p["bias"]["mcse"]),
                stat(p["sd"]),
                bias,
                stat(p["cv"]),
                short(sum(on), 2) if on else "-",
            ]
        )
    header = ["parameter", "truth", "mean ± MCSE", "SD ± MCSE", "bias (%) ± MCSE", "CV ± MCSE", "on a bound (%)"]
    return Table(cell_label(view, cell["amplitude"], cell["fmax"]), header, rows)


def _fig_7a(view: GroupView, suffix: str) -> Figure | Missing:
    f = chosen_fmax(view)
    result = bias_at(view, f)
    rows = [
        [str(n), value_of(result.sel(parameter=n)), short(result["floor"].sel(parameter=n), 2)]
        for n in result["parameter"].values
    ]
    return Figure(
        f"fig7a{suffix}",
        "Fig. 7A",
        "Bias",
        [
            f"|mean estimate − truth| at Fmax {f:g} Hz, averaged over amplitudes, ± MCSE; in the order of Fig. 7B. The "
            "tick with pale edges is the |bias| expected by chance alone, for unbiased estimates from this many "
            "realizations.",
        ],
        [Panel("|bias| by parameter", partial(figures.bias_bars, view, f), (4.3, 4.2))],
        [Table(f"Fmax {f:g} Hz", ["parameter", "|bias| (%) ± MCSE", "expected from chance (%)"], rows)],
        ("bias_12_1.2", "bias_10_1.2", "bias_amplitude", "largest_bias", "bias_below_5_12_1.2", "bias_over_5"),
        f'figures.bias_bars(tree["{view.name}"], fmax={f:g})',
    )


def _fig_7b(view: GroupView, suffix: str) -> Figure | Missing:
    f = chosen_fmax(view)
    result = cv_at(view, f)
    result = result.sortby("value")
    rows = [[str(n), value_of(result.sel(parameter=n))] for n in result["parameter"].values]
    return Figure(
        f"fig7b{suffix}",
        "Fig. 7B",
        "Variability",
        [f"Coefficient of variation over realizations at Fmax {f:g} Hz, averaged over amplitudes, ± MCSE."],
        [Panel("CV by parameter", partial(figures.cv_bars, view, f), (4.3, 4.2))],
        [Table(f"Fmax {f:g} Hz", ["parameter", "CV ± MCSE"], rows)],
        ("lowest_cv", "highest_cv", "combined_cv_lowest", "combined_cv_ratio", "low_cv", "cv_stiffness_damping"),
        f'figures.cv_bars(tree["{view.name}"], fmax={f:g})',
    )


def _fig_7c(view: GroupView) -> Figure | Missing:
    f = view.cube["frequency"].values
    held = {name: r for name, r in RANGES.items() if ((f >= 0.99 * r[0]) & (f <= 1.01 * r[1])).any()}
    if not held:
        return Missing("Fig. 7C", "Influence", "the group has no frequency in the paper's ranges")
    result = figures.influence_shares(view)
    rows = [
        [name, *(short(100 * result["share"].sel(range=r, parameter=name), 2) for r in held)]
        for name in view.model.names
    ]
    return Figure(
        "fig7c",
        "Fig. 7C",
        "Influence of every parameter",
        [
            "Change of the two FRFs when a parameter changes by ±10 %, as a share of the sum over parameters, in the "
            "paper's low, mid and high frequency ranges (the paper's pie charts, drawn as bars). The values are exact.",
        ],
        [
            Panel(f"{r}: {lo:g} to {hi:g} Hz", partial(figures.sensitivity_bars, view, r), (4.3, 3.6), "x")
            for r, (lo, hi) in held.items()
        ],
        [Table("Share of influence (%)", ["parameter", *held], rows)],
        ("least_influential", "delays_low", "delays_high", "stiffness_low", "damping_high", "influence_cv"),
        f'figures.sensitivity_bars(tree["{view.name}"], "mid")',
    )


def _efficiency(result: xr.Dataset) -> str:
    if bool(result["held"]):
        return "fixed by its bounds"
    if bool(result["applies"]) and not str(result["why_not"].item()):
        return value_of(result)
    if finite(result["box"]) is None:
        return "–"
    return f"{value_of(result.assign(value=result['box'], mcse=result['box_mcse']))} (box)"


def efficiency_figure(view: GroupView, suffix: str = "") -> Figure | Missing:
    """Efficiency against the Cramér-Rao bound."""
    title = "Efficiency against the Cramér–Rao bound"
    if view.bounds_on_sd is None:
        return Missing("", title, f"group {view.name} has no noise covariance")
    result = efficiency_of(view)
    amplitudes = view.cube["amplitude"].values.tolist()
    missing = [
        f" None at {a:g} {unit(view)} up to {f:g} Hz: {why}."
        for a in amplitudes
        for f in result["fmax"].values.tolist()
        if (why := str(result["why_not"].sel(amplitude=a, fmax=f).item()))
    ]
    if not bool(result["applies"].any()):
        every = "every" if not missing else "every other"
        reason = f"in {every} condition more than 10 % of the fits end on a bound, where it does not apply."
        if len(missing) == len(amplitudes) * result["fmax"].size:
            reason = ""
        return Missing("", f"{title}, group {view.name}", "".join([*missing, reason and f" {reason}"]).strip())
    ticks = (
        " Vertical ticks: efficiency of the paper's weights, to first order." if view.group.fit.cost == "paper" else ""
    )
    return Figure(
        f"efficiency{suffix}",
        "",
        title,
        [
            f"Group {view.name} (cost {view.group.fit.cost}): smallest possible variance of an unbiased estimator, "
            "divided by the observed variance, ± MCSE; 1 is the optimum. Hollow, and (box) in the tables: more than "
            "one fit in ten ends on a bound, so the Cramér-Rao bound does not apply; instead, the bound of van Trees, "
            "which knows the box of allowed values, divided by the mean squared error."
            f"{ticks} Arrows: beyond the scale.{''.join(missing)}",
        ],
        [Panel(f"{a:g} {unit(view)}", partial(figures.efficiency_dots, view, a), (4.3, 4.6), "x") for a in amplitudes],
        [
            Table(
                f"Efficiency ± MCSE, {a:g} {unit(view)}",
                ["parameter", *(f"{f:g} Hz" for f in result["fmax"].values)],
                [
                    [n, *(_efficiency(result.sel(amplitude=a, fmax=f, parameter=n)) for f in result["fmax"].values)]
                    for n in view.model.names
                ],
            )
            for a in amplitudes
        ],
        (),
        f'figures.efficiency_dots(tree["{view.name}"], amplitude={amplitudes[-1]:g})',
    )
