"""How good the estimates are: responses, estimates, bias, variability, influence, efficiency."""

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
from mcstudy.report.labels import cell_label, unit, with_units
from mcstudy.report.numbers import finite, short
from mcstudy.report.study.context import Context, conditions, largest_amplitude, stat, value_of
from mcstudy.report.study.search import relative_errors
from mcstudy.report.style import HATCHES
from mcstudy.text_tables import Table, with_error

NO_NOISE_GROUP = "no group with noise has more than one realization"


def determined_figure(context: Context) -> Figure | Missing:
    """What the experiment tells of every parameter."""
    view, title = context.accuracy, "What this experiment tells"
    if view is None:
        return Missing(title, NO_NOISE_GROUP, "determined")
    amplitude = largest_amplitude(view)
    fmaxes = [f for a, f in conditions(view) if a == amplitude]
    return Figure(
        "determined",
        title,
        [
            "Mean ± SD of the best fits about the true value. Determined: the coefficient of variation (CV) is below "
            "20 % and hardly any estimate is on a bound of the fit; not: half of the estimates are on a bound, or the "
            "CV is 50 % or more.",
        ],
        [
            Panel(cell_label(view, amplitude, f), partial(figures.determined_dots, view, f, amplitude), (4.3, 4.2), "x")
            for f in fmaxes
        ],
        python=f'figures.determined_dots(tree["{view.name}"], fmax={fmaxes[-1]:g}, amplitude={amplitude:g})',
    )


def estimate_figures(context: Context) -> list[Figure | Missing]:
    """Fitted responses, estimates, their bias and variability, and the influence of the parameters."""
    view = context.accuracy
    out: list[Figure | Missing] = [_responses(context)]
    if view is None:
        titles = {"estimates": "Estimates", "combined": "Combined stiffness", "bias": "Bias, variability, influence"}
        return out + [Missing(title, NO_NOISE_GROUP, key) for key, title in titles.items()]
    return [*out, _responses_with_noise(view), *estimates(context, view), _influence(view)]


def estimates(context: Context, view: GroupView, suffix: str = "") -> list[Figure | Missing]:
    """Estimates, bias and variability of one group; ``suffix`` makes their ids unique."""
    single, summed = _estimates(context, view, suffix), _combined(context, view, suffix)
    return [single, summed, _bias(view, suffix), _variability(view, suffix)]


def statistic_figures(view: GroupView, suffix: str = "") -> list[Figure]:
    """Declared statistics that have a title for a figure."""
    return [
        Figure(
            f"{s.key}{suffix}",
            s.figure,
            [f"{s.page or s.head}: {s.meaning}. By Fmax and amplitude, ± MCSE."],
            [Panel(s.figure, partial(figures.statistic_by_fmax, view, s.key))],
            python=f'figures.statistic_by_fmax(tree["{view.name}"], "{s.key}")',
        )
        for s in CELL_STATISTICS
        if s.figure
    ]


def _responses(context: Context) -> Figure | Missing:
    title = "Fits without noise"
    view = context.theory
    if view is None:
        return Missing(title, "the study has no group without noise (simulator = 'none')", "responses")
    a, f = conditions(view)[-1]
    return Figure(
        "responses",
        title,
        [
            "Responses of the angles to the stimulus, and the neural controllers. Lines: the truth. Markers: the best "
            "fit of all starts. They coincide: without noise, one stimulus identifies all parameters.",
        ],
        [
            Panel("gain of the angles", partial(figures.frf_gain, view, a, f)),
            Panel("phase of the angles", partial(figures.frf_phase, view, a, f)),
            Panel("gain of the neural controllers", partial(figures.controller_gain, view, a, f)),
            Panel("phase of the neural controllers", partial(figures.controller_phase, view, a, f)),
        ],
        [Table("Best fit without noise", ["parameter", "truth", "estimate", "error (%)"], relative_errors(view))],
        f'figures.controller_gain(tree["{view.name}"], fmax={f:g})',
    )


def _responses_with_noise(view: GroupView) -> Figure | Missing:
    a = largest_amplitude(view)
    fmaxes = [f for amplitude, f in conditions(view) if amplitude == a]
    panels = [
        Panel(f"gain of the {subject}, Fmax {f:g} Hz", partial(draw, view, a, f), share="xy")
        for subject, draw in (("angles", figures.frf_gain), ("neural controllers", figures.controller_gain))
        for f in fmaxes
    ]
    panels += [
        Panel(f"phase of the {subject}, Fmax {f:g} Hz", partial(draw, view, a, f), share="xy")
        for subject, draw in (("angles", figures.frf_phase), ("neural controllers", figures.controller_phase))
        for f in fmaxes
    ]
    return Figure(
        "responses_with_noise",
        "Fitted responses with noise",
        [
            "Lines: truth. Bands: 10th to 90th percentile of the best fits over realizations, at each frequency. "
            "Dashed: Fmax. Beyond Fmax a fit extrapolates: a low Fmax does not determine the dynamics above it. "
            "The phase is that of stable fits only: an unstable loop has no response to be measured."
            + of_all(view, MOST_FITS),
        ],
        panels,
        (),
        f'figures.controller_gain(tree["{view.name}"], amplitude={a:g}, fmax={view.cube["fmax"].values[0]:g})',
    )


def _amplitude_keys(view: GroupView) -> list[tuple[str, str]]:
    """In the order of the bars: the largest amplitude comes first."""
    palette = ("blue", "orange", "green", "purple", "ochre", "sky")
    labels = [f"{a:g} {unit(view)}" for a in view.cube["amplitude"].values]
    keys = [
        (palette[i % len(palette)] + (" hatched" if HATCHES[i % len(HATCHES)] else ""), label)
        for i, label in enumerate(labels)
    ]
    return [("muted", "true value"), *reversed(keys)]


def _estimates(context: Context, view: GroupView, suffix: str) -> Figure | Missing:
    names = view.model.names
    return Figure(
        f"estimates{suffix}",
        "Estimates of every parameter",
        [
            "True value, then mean ± SD over realizations of the best fits, by Fmax (Hz, below the bars) and amplitude "
            "of the stimulus. Dashed: the true value. A parameter that the data do not determine scatters between its "
            "bounds and, if these are centred on the truth, still averages to the truth. So check the SD and the "
            "number of fits on a bound before trusting a small bias.",
        ],
        [Panel(n, partial(figures.parameter_bars, view, n), (2.1, 1.9)) for n in names],
        _estimate_tables(context, view, set(names)),
        f'figures.parameter_bars(tree["{view.name}"], "{names[0]}")',
        small=True,
        legend=_amplitude_keys(view),
    )


_OF_SUMS = (
    "The sum of the active and the passive stiffness of a joint is well determined where the two alone are not, "
    "because they differ only by the delay. "
)


def _combined(context: Context, view: GroupView, suffix: str) -> Figure | Missing:
    declared = view.group.model.declared
    title = "Derived quantities" if declared else "Active and passive stiffness combined"
    if view.derived is None:
        return Missing(title, "the model derives no quantity from its parameters", f"combined{suffix}")
    names = [str(n) for n in view.derived["parameter"].values]
    return Figure(
        f"combined{suffix}",
        title,
        [
            ("" if declared else _OF_SUMS) + "Mean ± SD over realizations.",
        ],
        [Panel(n, partial(figures.parameter_bars, view, n), (2.4, 2.0)) for n in names],
        _estimate_tables(context, view, set(names)),
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


def _bias(view: GroupView, suffix: str) -> Figure | Missing:
    f = chosen_fmax(view)
    result = bias_at(view, f)
    rows = [
        [str(n), value_of(result.sel(parameter=n)), short(result["floor"].sel(parameter=n), 2)]
        for n in result["parameter"].values
    ]
    return Figure(
        f"bias{suffix}",
        "Bias",
        [
            f"|mean estimate − truth| at Fmax {f:g} Hz, averaged over amplitudes, ± MCSE; least variable first. The "
            "tick with pale edges is the |bias| expected by chance alone, for unbiased estimates from this many "
            "realizations.",
        ],
        [Panel("|bias| by parameter", partial(figures.bias_bars, view, f), (4.3, 4.2))],
        [Table(f"Fmax {f:g} Hz", ["parameter", "|bias| (%) ± MCSE", "expected from chance (%)"], rows)],
        f'figures.bias_bars(tree["{view.name}"], fmax={f:g})',
    )


def _variability(view: GroupView, suffix: str) -> Figure | Missing:
    f = chosen_fmax(view)
    result = cv_at(view, f)
    result = result.sortby("value")
    rows = [[str(n), value_of(result.sel(parameter=n))] for n in result["parameter"].values]
    return Figure(
        f"variability{suffix}",
        "Variability",
        [f"Coefficient of variation over realizations at Fmax {f:g} Hz, averaged over amplitudes, ± MCSE."],
        [Panel("CV by parameter", partial(figures.cv_bars, view, f), (4.3, 4.2))],
        [Table(f"Fmax {f:g} Hz", ["parameter", "CV ± MCSE"], rows)],
        f'figures.cv_bars(tree["{view.name}"], fmax={f:g})',
    )


def _influence(view: GroupView) -> Figure | Missing:
    f = view.cube["frequency"].values
    held = {name: r for name, r in RANGES.items() if ((f >= 0.99 * r[0]) & (f <= 1.01 * r[1])).any()}
    if not held:
        return Missing("Influence", "the group has no frequency in the ranges", "influence")
    result = figures.influence_shares(view)
    rows = [
        [name, *(short(100 * result["share"].sel(range=r, parameter=name), 2) for r in held)]
        for name in view.model.names
    ]
    return Figure(
        "influence",
        "Influence of every parameter",
        [
            "Change of the two FRFs when a parameter changes by ±10 %, as a share of the sum over parameters, at low, "
            "mid and high frequencies. The values are exact.",
        ],
        [
            Panel(f"{r}: {lo:g} to {hi:g} Hz", partial(figures.sensitivity_bars, view, r), (4.3, 3.6), "x")
            for r, (lo, hi) in held.items()
        ],
        [Table("Share of influence (%)", ["parameter", *held], rows)],
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
        return Missing(title, f"group {view.name} has no noise covariance", f"efficiency{suffix}")
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
        why_not = "".join([*missing, reason and f" {reason}"]).strip()
        return Missing(f"{title}, group {view.name}", why_not, f"efficiency{suffix}")
    ticks = "" if view.group.fit.cost == "ml" else " Vertical ticks: that of the weights of this cost, to first order."
    return Figure(
        f"efficiency{suffix}",
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
        f'figures.efficiency_dots(tree["{view.name}"], amplitude={amplitudes[-1]:g})',
    )
