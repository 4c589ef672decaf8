"""What the starts found: costs and controllers, starts needed, waterfall, atlas of minima, accuracy by starts."""

from __future__ import annotations

from functools import partial

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from mcstudy.analysis.accuracy import mean_absolute_bias_percent
from mcstudy.analysis.montecarlo import REALIZATION
from mcstudy.analysis.search.by_starts import mean_cv, missed_by
from mcstudy.analysis.search.convergence import starts_needed
from mcstudy.analysis.search.stable_starts import hit_rate_by_start
from mcstudy.analysis.show.missed_minimum import missed_percent, missed_words
from mcstudy.analysis.view import GroupView
from mcstudy.fitting.certainty import MISSED
from mcstudy.report import figures
from mcstudy.report.figure import Figure, Missing, Panel
from mcstudy.report.figures.common import MOST_POINTS, of_all, sampled
from mcstudy.report.figures.optimiser import MOST_CLUSTERS, atlas_of, by_starts_of
from mcstudy.report.figures.search import MOST_CURVES, curve_of, pools_of_points, printed_starts
from mcstudy.report.labels import amplitude_label, cell_label, fmax_label
from mcstudy.report.numbers import finite, short
from mcstudy.report.study.context import Context, conditions, largest_amplitude, stat, value_of, with_ends
from mcstudy.text_tables import Table, with_error

CURVE_TITLE = "Starts needed"

MOST_LOOPS = 40_000
"""Starts of a group whose loops are looked at: one takes some 20 µs."""

ONE_START = "Does one start suffice?"


def search_figures(context: Context) -> list[Figure | Missing]:
    """Costs and controllers, and the number of starts that is needed."""
    return [_controller_error(context), _starts(context), _controller_error_with_noise(context)]


def minima_figures(context: Context) -> list[Figure | Missing]:
    """Waterfall, atlas, accuracy by starts, success by the loop at the start."""
    return [_waterfall(context), _atlas(context), _by_starts(context), one_start(context)]


def _controller_error(context: Context) -> Figure | Missing:
    title = "Without noise, a low cost means correct controllers"
    view = context.theory
    if view is None:
        return Missing(title, "the study has no group without noise (simulator = 'none')", "controller_error")
    f = float(view.cube["fmax"].values[-1])
    cell = next(c for c in context.cells(view) if c["fmax"] == f)
    return Figure(
        "controller_error",
        title,
        [
            f"Every start of group {view.name} without noise: cost J of its fit to the two FRFs against the error J_NC "
            "of the four neural controllers. Bottom left: the true parameters were found. Points gather at the truth "
            f"(to rounding) and at the local minima.{of_all(view, pools_of_points(view))}",
        ],
        [Panel("cost and controller error", lambda ax: figures.controller_error(view, fmax=f, ax=ax))],
        [
            Table(
                "Noise-free fits",
                ["quantity", "ours"],
                [
                    ["lowest cost J", short(cell["median_cost"]["value"])],
                    ["J_NC of that fit", short(cell["median_j_nc"]["value"])],
                    ["starts that reach it (%)", short(100 * (cell["hit_rate"] or 0.0))],
                ],
            )
        ],
        f'figures.controller_error(tree["{view.name}"], fmax={f:g})',
    )


def _starts(context: Context) -> Figure | Missing:
    noisy, free = context.pools, context.free_pools
    views = [v for v in (noisy, *context.other_solvers, free) if v is not None and v.group.starts > 1]
    if not views:
        return Missing(CURVE_TITLE, "no group has more than one start", "starts")
    shown = [(v, f) for v in views for f in v.cube["fmax"].values.tolist()]
    return Figure(
        "starts",
        CURVE_TITLE,
        [
            "Expected lowest cost after x random starts: mean over realizations ± standard error, one curve per "
            "condition. Where a curve is flat, more starts do not help. Computed from exact order "
            "statistics of the whole pool, not by resampling. Dots: the starts needed, with which nine of ten "
            "realizations are 95 % sure of their lowest minimum. The mean hides those that need more starts: "
            f"see the median and the 90th percentile in the table.{of_all(views[0], sampled(views[0]))}",
        ],
        [
            Panel(f"group {v.name}, solver {v.group.fit.solver}, Fmax {f:g} Hz", partial(figures.starts_curve, v, f))
            for v, f in shown
        ],
        [_starts_table(context, v) for v in views] + [_curve_table(v) for v in views],
        f'figures.starts_curve(tree["{views[0].name}"])',
    )


def _starts_table(context: Context, view: GroupView) -> Table:
    rows = [
        [
            cell_label(view, c["amplitude"], c["fmax"]),
            short(100 * (c["hit_rate"] or 0.0)),
            missed_words(c, error=True),
            *(with_ends(c[f"starts_needed_{q}"]) for q in ("median", "90th")),
        ]
        for c in context.cells(view)
    ]
    header = [
        "condition",
        "starts that reach the minimum (%)",
        f"{MISSED} (%)",
        "needed, median [95 % interval]",
        "needed, 90th percentile [95 % interval]",
    ]
    return Table(f"Group {view.name}: new starts for 95 % certainty of the lowest minimum", header, rows)


def _curve_table(view: GroupView) -> Table:
    curve = curve_of(view).sel(drawn=printed_starts(view))
    return _against_starts(f"Group {view.name}: lowest cost expected, ± MCSE", view, curve)


def _against_starts(caption: str, view: GroupView, result: xr.Dataset) -> Table:
    """One row per number of starts and one column per condition: there are more numbers than conditions."""
    cells = [(a, f) for f in result["fmax"].values.tolist() for a in result["amplitude"].values.tolist()]
    rows = [
        [f"{x}", *(value_of(result.sel(amplitude=a, fmax=f, drawn=x)) for a, f in cells)]
        for x in result["drawn"].values.tolist()
    ]
    return Table(caption, ["starts", *(cell_label(view, a, f) for a, f in cells)], rows)


def _controller_error_with_noise(context: Context) -> Figure | Missing:
    title = "With noise, a low cost no longer guarantees correct controllers"
    view = context.accuracy
    if view is None:
        return Missing(title, "no group with noise has more than one realization", "controller_error_with_noise")
    header = ["condition", "median cost J", "median J_NC", "unstable best fits (%)"]
    rows = [
        [
            cell_label(view, c["amplitude"], c["fmax"]),
            stat(c["median_cost"]),
            stat(c["median_j_nc"]),
            stat(c["unstable"], 100.0),
        ]
        for c in context.cells(view)
    ]
    return Figure(
        "controller_error_with_noise",
        title,
        [
            "Best fit of every realization: cost against error of the neural controllers (over all frequencies, also "
            "those not fitted). Hollow: the fitted loop is unstable. Small dots: the local minima of the first "
            f"realizations.{of_all(view, MOST_POINTS)}",
        ],
        [
            Panel(f"Fmax {f:g} Hz", partial(figures.controller_error_by_noise, view, f), share="xy")
            for f in sorted({f for _, f in conditions(view)})
        ],
        [Table("Best fits, ± MCSE", header, rows)],
        f'figures.controller_error_by_noise(tree["{view.name}"], fmax={view.cube["fmax"].values[-1]:g})',
    )


def _waterfall(context: Context) -> Figure | Missing:
    title = "Waterfall of costs"
    views = [v for v in dict.fromkeys((context.pools, context.accuracy, context.theory)) if v is not None]
    views = [v for v in views if v.group.starts > 1]
    if not views:
        return Missing(title, "no group has more than one start", "waterfall")
    return Figure(
        "waterfall",
        title,
        [
            "Costs of all starts of a realization, sorted, divided by the realization's lowest; one line per "
            "realization. The flat beginning is the fraction of starts that found the lowest minimum; every step is "
            f"another minimum.{of_all(views[0], MOST_CURVES)}",
        ],
        [
            Panel(
                f"group {v.name}, {cell_label(v, a, f)}",
                partial(_named_waterfall, v, a, f),
                (4.3, 2.9),
                "xy" if v.noisy else "x",
            )
            for v in views
            for a, f in conditions(v, ends_only=True)
        ],
        [_hits_table(v) for v in views],
        f'figures.waterfall(tree["{views[0].name}"])',
    )


def _named_waterfall(view: GroupView, amplitude: float, fmax: float, ax: Axes) -> None:
    figures.waterfall(view, amplitude, fmax, ax).set_title(f"{view.name}, {cell_label(view, amplitude, fmax)}")


def _hits_table(view: GroupView) -> Table:
    rate, missed = 100 * view.needed["hit_rate"], view.needed["missed"].mean(REALIZATION)
    upper = view.needed["missed_upper"].mean(REALIZATION)
    alone = view.needed.sizes[REALIZATION] == 1
    rows = [
        [
            cell_label(view, a, f),
            *(short(rate.sel(amplitude=a, fmax=f).dropna(REALIZATION).quantile(q), 2) for q in (0.0, 0.1, 0.5, 0.9)),
            missed_percent(
                float(missed.sel(amplitude=a, fmax=f)), upper=float(upper.sel(amplitude=a, fmax=f)) if alone else None
            ),
        ]
        for a, f in conditions(view)
    ]
    header = ["condition", "worst realization", "10th percentile", "median", "90th percentile", f"{MISSED} (%, mean)"]
    return Table(f"Group {view.name}: starts that reach the lowest minimum (%)", header, rows)


def _atlas(context: Context) -> Figure | Missing:
    title = "Atlas of local minima"
    view = context.accuracy or context.theory
    if view is None or view.group.starts < 2:
        return Missing(title, "no group has more than one start", "atlas")
    amplitude = largest_amplitude(view)
    fmaxes = [f for a, f in conditions(view) if a == amplitude]
    return Figure(
        "atlas",
        title,
        [
            "Local minima of all realizations, clustered by their position between the bounds (no parameter further "
            "than half the distance between its bounds from the cluster's leader). A bar goes from the middle of the "
            "bounds, which is the truth where bounds are centred, to the cluster's mean; thin lines are the bounds. At "
            "the right: fraction of all starts that end there, and in how many realizations the cluster holds the "
            "lowest minimum. Green and solid: mostly stable loops; orange and pale: mostly unstable.",
        ],
        [Panel(f"Fmax {f:g} Hz", partial(figures.basin_atlas, view, amplitude, f), (4.3, 4.4)) for f in fmaxes],
        [_atlas_table(view, amplitude, f) for f in fmaxes],
        f'figures.basin_atlas(tree["{view.name}"], amplitude={amplitude:g}, fmax={fmaxes[-1]:g})',
    )


def _atlas_table(view: GroupView, amplitude: float, fmax: float) -> Table:
    table = atlas_of(view, amplitude, fmax).isel(cluster=slice(0, MOST_CLUSTERS))
    rows = []
    for c in range(table.sizes["cluster"]):
        cluster = table.isel(cluster=c)
        percent = xr.Dataset({k: 100 * cluster[k] for k in ("value", "mcse")})
        rows.append(
            [
                str(c + 1),
                value_of(percent),
                str(int(cluster["realizations"])),
                str(int(cluster["lowest"])),
                short(100 * cluster["stable"], 2),
                short(cluster["excess"]),
            ]
        )
    header = ["cluster", "starts (% ± MCSE)", "in realizations", "lowest in", "stable (%)", "median cost / lowest"]
    return Table(f"{cell_label(view, amplitude, fmax)}, {table.attrs['realizations']} realizations", header, rows)


def _by_starts(context: Context) -> Figure | Missing:
    title = "Bias and CV against the number of starts"
    view = context.accuracy
    if view is None or view.group.starts < 2:
        return Missing(title, "no group with noise has more than one realization and more than one start", "bystarts")
    return Figure(
        "bystarts",
        title,
        [
            "Mean |bias| and coefficient of variation over parameters when only the first x starts of every "
            "realization are used. What still decreases with x is due to the optimiser; the remainder is due to the "
            f"estimator.{of_all(view, sampled(view))}",
        ],
        [
            Panel("mean |bias|", partial(figures.bias_by_starts, view), (4.3, 4.0)),
            Panel("mean coefficient of variation", partial(figures.cv_by_starts, view), (4.3, 4.0)),
        ],
        [
            _against_starts("Mean |bias| (% ± MCSE)", view, by_starts_of(view, mean_absolute_bias_percent)),
            _against_starts("Mean coefficient of variation (± MCSE)", view, by_starts_of(view, mean_cv)),
            _missed_table(view),
        ],
        f'figures.bias_by_starts(tree["{view.name}"])',
    )


def _missed_table(view: GroupView) -> Table:
    """Chance that the best of x starts is not the lowest minimum."""
    drawn = by_starts_of(view, mean_cv)["drawn"]
    missed = missed_by(view.needed["hit_rate"], drawn)
    rows = [
        [cell_label(view, a, f), *(missed_percent(float(x)) for x in missed.sel(amplitude=a, fmax=f).values)]
        for f in view.cube["fmax"].values.tolist()
        for a in view.cube["amplitude"].values.tolist()
    ]
    return Table(f"{MISSED[0].upper()}{MISSED[1:]} (%, mean)", ["condition", *(f"{x}" for x in drawn.values)], rows)


def relative_errors(view: GroupView) -> list[list[str]]:
    """Rows parameter, truth, best fit, error in percent, for a group without noise."""
    cells = view.cells.isel(amplitude=0, fmax=-1)
    first = cells.isel(realization=0)
    rows = []
    for name in view.model.names:
        truth, estimate = (float(first[k].sel(parameter=name)) for k in ("truth", "estimate"))
        error = 100 * abs(estimate / truth - 1) if truth and np.isfinite(estimate) else None
        rows.append(
            [name, short(truth, 4), short(estimate, 4), "-" if finite(error or 0.0) is None else short(error or 0.0, 2)]
        )
    return rows


def one_start(context: Context, key: str = "onestart") -> Figure | Missing:
    """Success rate of starts, by whether the loop is stable at the start, for every group with several starts."""
    title = f"{ONE_START} (study {context.name})"
    views = [v for v in context.held if v.group.starts > 1]
    if not views:
        return Missing(title, "no group has more than one start", key)
    rates = {}
    for view in views:
        a = largest_amplitude(view)
        cube = view.cube[["initial", "cost", "status"]].sel(amplitude=[a])
        a_realization = cube.sizes["fmax"] * cube.sizes["start"]
        some = cube.isel(realization=slice(0, max(1, MOST_LOOPS // a_realization))).load()
        done = some["cost"].notnull().any(("amplitude", "fmax", "start"))
        held = some.isel(realization=np.flatnonzero(done.values))
        hits = starts_needed(held)["hit_rate"].mean("realization").isel(amplitude=0)
        rates[view.name] = view, a, hits, hit_rate_by_start(held, view.model).isel(amplitude=0)
    titles = {name: f"{name}, {amplitude_label(v, a)}" for name, (v, a, _, _) in rates.items()}
    return Figure(
        key,
        title,
        [
            "Fraction of all starts that reach the lowest minimum of their realization, ± MCSE, by whether the loop of "
            "the model is stable at the start. A fit that starts unstable usually stays unstable. Where every stable "
            "start succeeds, one reasonable guess is enough; the fraction of stable starts is in the table.",
            "Ours, at the lowest and the highest Fmax: "
            + "; ".join(
                f"{name} {_of_stable(r, 0)} and {_of_stable(r, -1)} of stable starts succeed"
                for name, (_, _, _, r) in rates.items()
            )
            + ".",
        ],
        [Panel(titles[name], partial(figures.hit_rate_bars, r, titles[name])) for name, (_, _, _, r) in rates.items()],
        [
            Table(
                f"Group {name} ({v.group.model.title.replace('_', ' ')}), {amplitude_label(v, a)}: starts that reach "
                "the minimum (% ± MCSE)",
                ["Fmax", "all", "stable start", "worst realization", "unstable start", "stable among starts"],
                [
                    [
                        fmax_label(float(f)),
                        short(100 * hits.sel(fmax=f), 3),
                        _percent(r, f, "stable"),
                        short(100 * r["worst"].sel(fmax=f, loop="stable"), 3),
                        _percent(r, f, "unstable"),
                        short(100 * r["starts"].sel(fmax=f, loop="stable") / r["starts"].sel(fmax=f).sum(), 2),
                    ]
                    for f in r["fmax"].values
                ],
            )
            for name, (v, a, hits, r) in rates.items()
        ],
        python="figures.hit_rate_bars(tree[GROUP].mc.hit_rate_by_start().isel(amplitude=-1))",
    )


def _of_stable(rate: xr.Dataset, fmax: int) -> str:
    value = finite(rate["value"].isel(fmax=fmax).sel(loop="stable"))
    return "none" if value is None else f"{100 * value:.0f} %"


def _percent(rate: xr.Dataset, fmax: float, loop: str) -> str:
    cell = rate.sel(fmax=fmax, loop=loop)
    value, mcse = finite(cell["value"]), finite(cell["mcse"])
    return with_error(None if value is None else 100 * value, None if mcse is None else 100 * mcse)
