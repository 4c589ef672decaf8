"""Sections on the alternatives the paper discusses, each with what the paper says of it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from mcstudy.analysis.search.convergence import starts_needed
from mcstudy.analysis.search.stable_starts import hit_rate_by_start
from mcstudy.report.figure import Figure, Missing, Panel, figure, missing
from mcstudy.report.figures.stable_starts import hit_rate_bars
from mcstudy.report.html import Table
from mcstudy.report.labels import amplitude_label, fmax_label
from mcstudy.report.numbers import finite, short
from mcstudy.report.study.context import Context, largest_amplitude
from mcstudy.text_tables import with_error
from mcstudy_goodworth2018.alternatives import figures as drawn
from mcstudy_goodworth2018.alternatives.files import PopulationResult, TwoStimuliResult, read_alternative

MOST_STARTS = 40_000
"""Starts of a group whose loops are looked at: one takes some 20 µs."""

ONE_START = "Does one start suffice?"

DISCUSSION = "Goodworth & Peterka 2018, Discussion"


def alternatives(context: Context, beside: Sequence[tuple[Path, Context | None]]) -> tuple[str, str, str]:
    """The section of a study's page: its key, its title and its content.

    ``beside``: files that are shown too, each with the study of its cube or None for a result of `files`.
    """
    items = [(one_start(context), f"mcstudy report OUT, after mcstudy run {context.name}.toml -o OUT")]
    items += [_companion(file, study, f"beside-{i}") for i, (file, study) in enumerate(beside)]
    shown = "".join(figure(item, "", how) if isinstance(item, Figure) else missing([item]) for item, how in items)
    more = (
        ""
        if beside
        else (
            "<p>To show identification from two stimuli and fits to a population's mean here, use <code>mcstudy report "
            "OUT --beside FILE</code>; the scripts in <code>pipelines/examples</code> make the files.</p>"
        )
    )
    return "alternatives", "Alternatives the paper discusses", shown + more


def _companion(file: Path, study: Context | None, key: str) -> tuple[Figure | Missing, str]:
    """The figure of a file beside the study, and the command that made it."""
    if study is not None:
        how = f"mcstudy report OUT --beside {study.name}.zarr, after mcstudy run {study.name}.toml"
        return one_start(study, key), how
    result = read_alternative(file)
    return two_stimuli(result, key) if isinstance(result, TwoStimuliResult) else population(result, key), result.command


def one_start(context: Context, key: str = "onestart") -> Figure | Missing:
    """Success rate of starts, by whether the loop is stable at the start, for every group with several starts."""
    title = f"{ONE_START} (study {context.name})"
    views = [v for v in context.held if v.group.starts > 1]
    if not views:
        return Missing("", title, "no group has more than one start")
    rates = {}
    for view in views:
        a = largest_amplitude(view)
        cube = view.cube[["initial", "cost", "status"]].sel(amplitude=[a])
        a_realization = cube.sizes["fmax"] * cube.sizes["start"]
        some = cube.isel(realization=slice(0, max(1, MOST_STARTS // a_realization))).load()
        done = some["cost"].notnull().any(("amplitude", "fmax", "start"))
        held = some.isel(realization=np.flatnonzero(done.values))
        hits = starts_needed(held)["hit_rate"].mean("realization").isel(amplitude=0)
        rates[view.name] = view, a, hits, hit_rate_by_start(held, view.model).isel(amplitude=0)
    titles = {name: f"{name}, {amplitude_label(v, a)}" for name, (v, a, _, _) in rates.items()}
    return Figure(
        key,
        "",
        title,
        [
            "Fraction of all starts that reach the lowest minimum of their realization, ± MCSE, by whether the loop of "
            "the model is stable at the start. A fit that starts unstable usually stays unstable. Where every stable "
            "start succeeds, one reasonable guess is enough; the fraction of stable starts is in the table.",
            f"{DISCUSSION}: with a single-link pendulum the fit “typically converges to what is likely to be a global "
            "minimum value with a single set of reasonable initial guesses”, with two segments it frequently does not.",
            "Ours, at the lowest and the highest Fmax: "
            + "; ".join(
                f"{name} {_of_stable(r, 0)} and {_of_stable(r, -1)} of stable starts succeed"
                for name, (_, _, _, r) in rates.items()
            )
            + ".",
        ],
        [Panel(titles[name], partial(hit_rate_bars, r, titles[name])) for name, (_, _, _, r) in rates.items()],
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
    here = rate.sel(fmax=fmax, loop=loop)
    value, mcse = finite(here["value"]), finite(here["mcse"])
    return with_error(None if value is None else 100 * value, None if mcse is None else 100 * mcse)


def two_stimuli(result: TwoStimuliResult, key: str) -> Figure:
    """Non-parametric identification with two stimuli and with one."""
    names = list(next(iter(result.estimators.values()))[1])
    estimators = result.estimators.items()
    rows = [
        [f"{name}: {c}", str(stimuli), *(short(values[c][k].mean(), 2) for k in ("off", "chance", "single"))]
        for name, (stimuli, values) in result.estimators.items()
        for c in names
    ]
    return Figure(
        key,
        "",
        "Two stimuli without a model of the controllers",
        [
            "Distance of the mean estimate of each neural controller from the truth, for the cross-spectral estimate "
            "with two independent torques, two estimates from one torque, and the paper's fit of 12 parameters to one "
            "torque. Dotted: distance expected of the first from chance alone, if it is unbiased.",
            f"{DISCUSSION}: with one stimulus total torque at the ankle “cannot distinguish between T11 and T21”, so "
            "“it is not possible to accurately calculate the neural controller FRFs by relating total torque to joint "
            "angle motion with a single stimulus”, while a parametric fit can (after Boonstra et al. 2013 and "
            "Engelhart et al. 2015).",
            f"Ours, mean over frequencies and controllers: {'; '.join(_off(n, v) for n, (_, v) in estimators)}.",
        ],
        [Panel(c, partial(drawn.controller_off, result, c), (4.3, 4.0)) for c in names],
        [
            Table(
                f"Mean over {result.f.size} frequencies up to {result.f[-1]:.2g} Hz, percent of the true magnitude",
                ["estimator: controller", "stimuli", "mean error", "chance alone", "one experiment"],
                rows,
            ),
            _settings(result.settings),
        ],
        python="figures.controller_off(read_alternative(FILE), 'T11')",
    )


def _off(name: str, controllers: dict[str, dict[str, np.ndarray]]) -> str:
    off, chance = (np.mean([v[k].mean() for v in controllers.values()]) for k in ("off", "chance"))
    return f"{name}: off by {short(off, 3)} % (chance alone {short(chance, 2)} %)"


def population(result: PopulationResult, key: str) -> Figure:
    """Fit to a population's mean against the mean of individual fits."""
    apart = [
        f"{r['name']} ({r['difference']['value']:+.1f} ± {r['difference']['mcse']:.1f} %)"
        for r in result.rows
        if abs(r["difference"]["value"]) > 3 * r["difference"]["mcse"]
    ]
    alike = [r["name"] for r in result.rows if abs(r["difference"]["value"]) <= 3 * r["difference"]["mcse"]]
    rows = [
        [
            r["name"],
            *(
                text
                for route in ("mean_of_fits", "fit_to_mean")
                for text in (with_error(r[route]["bias"], r[route]["mcse"]), short(r[route]["sd"], 2))
            ),
            with_error(r["difference"]["value"], r["difference"]["mcse"]),
        ]
        for r in result.rows
    ]
    return Figure(
        key,
        "",
        "Mean of fits, fit to the mean",
        [
            "Bias ± MCSE (thick) and SD over populations (thin) of the population's mean parameters, by fitting every "
            "subject and averaging, and by averaging FRFs and fitting once.",
            f"{DISCUSSION}: “mean parameter estimates based on fits to individual subjects were similar to the "
            "parameter estimates based on mean experimental data […] in a homogeneous population (Goodworth & Peterka "
            "2009, 2012)”.",
            f"Ours: the routes differ by no more than 3 standard errors on {', '.join(alike) or 'nothing'}, by more on "
            f"{', '.join(apart) or 'nothing'}.",
        ],
        [Panel("bias by route", partial(drawn.population_bias, result), (4.3, 5.2))],
        [
            Table(
                "Percent of the truth",
                ["parameter", "mean of fits: bias ± MCSE", "SD", "fit to mean: bias ± MCSE", "SD", "difference ± MCSE"],
                rows,
            ),
            _settings(result.settings),
        ],
        python="figures.population_bias(read_alternative(FILE))",
    )


def _settings(settings: dict[str, object]) -> Table:
    return Table("Settings", ["", ""], [[k, f"{v:g}" if isinstance(v, float) else str(v)] for k, v in settings.items()])
