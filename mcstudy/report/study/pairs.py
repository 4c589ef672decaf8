"""Which parameters the data tell apart only together: correlations of the estimates."""

from __future__ import annotations

from functools import partial

import numpy as np

from mcstudy.analysis.view import GroupView
from mcstudy.models.quantities import sums
from mcstudy.report import figures
from mcstudy.report.figure import Figure, Missing, Panel
from mcstudy.report.figures.common import MOST_POINTS, chosen_fmax
from mcstudy.report.figures.pairs import WRITTEN, correlations_of
from mcstudy.report.labels import cell_label
from mcstudy.report.study.context import Context, conditions, largest_amplitude, value_of
from mcstudy.text_tables import Table

MOST_ROWS = 12
"""Pairs in the table: stiffnesses that add up, then those of largest correlation."""


def pairs_figure(context: Context) -> Figure | Missing:
    """Map of correlations, and the scatter of stiffnesses that add up."""
    title = "Correlation of the estimates"
    view = context.accuracy
    if view is None:
        return Missing(title, "no group with noise has more than one realization", "pairs")
    a, f = largest_amplitude(view), chosen_fmax(view)
    added = [(m[0], m[1]) for m in sums(view.model).values() if len(m) == 2]
    return Figure(
        "pairs",
        title,
        [
            "Left: correlation of every pair of estimates over realizations. Its area is |r|; blue discs are positive, "
            f"orange squares negative; the upper half gives 100 r where |r| is at least {WRITTEN:g}. Right: best fits "
            f"of active and passive stiffness, one point per realization (at most the first {MOST_POINTS}). On the "
            "dashed line their sum is the true one. The data determine this sum but not its parts: points move "
            "along the line, up to the bounds.",
        ],
        [
            Panel("correlations", partial(figures.correlation_map, view, a, f), (4.3, 4.3)),
            *(Panel(f"{p} and {q}", partial(figures.estimate_scatter, view, p, q, a), (4.3, 4.3)) for p, q in added),
        ],
        [_table(view, added)],
        python=f'figures.correlation_map(tree["{view.name}"], amplitude={a:g}, fmax={f:g})',
    )


def _table(view: GroupView, first: list[tuple[str, str]]) -> Table:
    correlations = {cell_label(view, a, f): correlations_of(view, a, f) for a, f in conditions(view)}
    names = view.model.names
    row, column = np.tril_indices(len(names), -1)
    size = np.nanmax([np.abs(np.nan_to_num(r["value"].values[row, column])) for r in correlations.values()], axis=0)
    pairs = list(dict.fromkeys([*first, *((names[column[k]], names[row[k]]) for k in np.argsort(-size))]))[:MOST_ROWS]
    rows = [
        [f"{p}, {q}", *(value_of(r.sel(parameter=p, parameter_2=q)) for r in correlations.values())] for p, q in pairs
    ]
    return Table("Correlation ± MCSE, largest pairs", ["pair", *correlations], rows)
