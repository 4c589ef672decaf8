"""How true the standard errors of the fits are."""

from __future__ import annotations

from functools import partial

from mcstudy.analysis.selection import ERROR
from mcstudy.analysis.show.text import share_with_ends
from mcstudy.analysis.view import GroupView
from mcstudy.report import figures
from mcstudy.report.figure import Figure, Panel
from mcstudy.report.figures.common import MOST_POINTS, chosen_fmax
from mcstudy.report.figures.zipper import performance_of
from mcstudy.report.labels import cell_label
from mcstudy.report.numbers import finite
from mcstudy.report.study.context import largest_amplitude
from mcstudy.text_tables import Table, with_error

COVERAGES = ("coverage", "bias_eliminated_coverage")


def zipper_figures(view: GroupView, suffix: str = "") -> list[Figure]:
    """Zipper plots and coverages of one condition; none for a group without standard errors."""
    if ERROR not in view.cells:
        return []
    a, f = largest_amplitude(view), chosen_fmax(view)
    performance = performance_of(view).sel(amplitude=a, fmax=f)
    rows = []
    for name in view.model.names:
        measures = performance.sel(parameter=name)
        off = with_error(*(finite(measures.sel(measure="relative_error")[k]) for k in ("value", "mcse")))
        shares = [{k: finite(measures.sel(measure=m)[k]) for k in ("value", "lower", "upper")} for m in COVERAGES]
        rows.append([name, off, *map(share_with_ends, shares), str(int(measures["n"].sel(measure="coverage")))])
    return [
        Figure(
            f"zipper{suffix}",
            f"Intervals from the standard errors, group {view.name}",
            [
                f"95 % intervals (estimate ± 1.96 standard errors) of {cell_label(view, a, f)}, one line per "
                f"realization (at most the first {MOST_POINTS}), by their distance from the truth in standard errors. "
                "Orange: the interval misses the truth. Of honest intervals those above the dashed line do; the dotted "
                "lines are the 95 % interval of the fraction that holds it. With the parameter on a bound there "
                "is no interval.",
            ],
            [Panel(n, partial(figures.zipper, view, n, a, f), (3.2, 3.4)) for n in view.model.names],
            [
                Table(
                    f"Standard errors, {cell_label(view, a, f)}",
                    [
                        "parameter",
                        "SE against SD, % ± MCSE",
                        "holds truth, % [95 % interval]",
                        "holds mean, % [95 % interval]",
                        "realizations",
                    ],
                    rows,
                )
            ],
            f'figures.zipper(tree["{view.name}"], "{view.model.names[0]}", amplitude={a:g}, fmax={f:g})',
        )
    ]
