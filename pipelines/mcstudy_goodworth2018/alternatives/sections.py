"""Sections on the alternatives the paper discusses, each with what the paper says of it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from mcstudy.report.document import Section
from mcstudy.report.figure import Figure, Missing, Panel, figures
from mcstudy.report.html import html, joined
from mcstudy.report.numbers import short
from mcstudy.report.study.context import Context
from mcstudy.report.study.search import one_start
from mcstudy.text_tables import Table, with_error
from mcstudy_goodworth2018.alternatives import figures as drawn
from mcstudy_goodworth2018.alternatives.files import PopulationResult, TwoStimuliResult, read_alternative

DISCUSSION = "Goodworth & Peterka 2018, Discussion"


def alternatives(beside: Sequence[tuple[Path, Context | None]]) -> Section:
    """The section of a study's page: its key, its title and its content.

    ``beside``: files that are shown too, each with the study of its cube or None for a result of `files`.
    """
    items = [_companion(file, study, f"beside-{i}") for i, (file, study) in enumerate(beside)]
    shown = joined(figures([item], how) for item, how in items)
    more = html(
        "<p>To show identification from two stimuli and fits to a population's mean here, use <code>mcstudy report OUT "
        "--beside FILE</code>; the scripts in <code>pipelines/examples</code> make the files.</p>"
    )
    return "alternatives", "Alternatives the paper discusses", shown if beside else more


def _companion(file: Path, study: Context | None, key: str) -> tuple[Figure | Missing, str]:
    """The figure of a file beside the study, and the command that made it."""
    if study is not None:
        how = f"mcstudy report OUT --beside {study.name}.zarr, after mcstudy run {study.name}.toml"
        return one_start(study, key), how
    result = read_alternative(file)
    return two_stimuli(result, key) if isinstance(result, TwoStimuliResult) else population(result, key), result.command


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
