"""All figures of a study, by what they are about."""

from __future__ import annotations

from collections.abc import Iterator

from mcstudy.analysis.view import GroupView
from mcstudy.report.figure import Figure, Missing
from mcstudy.report.study.context import Context
from mcstudy.report.study.estimates import (
    determined_figure,
    efficiency_figure,
    estimate_figures,
    estimates,
    statistic_figures,
)
from mcstudy.report.study.pairs import pairs_figure
from mcstudy.report.study.search import minima_figures, search_figures
from mcstudy.report.study.signals import signal_figures
from mcstudy.report.study.standard_errors import zipper_figures


def main_figures(context: Context) -> list[Figure | Missing]:
    """Signals, starts, estimates and minima of the study."""
    main = context.accuracy
    items = [determined_figure(context), *signal_figures(context), *search_figures(context), *estimate_figures(context)]
    items += [pairs_figure(context), *minima_figures(context)]
    if main is not None:
        items += [efficiency_figure(main), *zipper_figures(main), *statistic_figures(main)]
    return items


def group_figures(context: Context) -> Iterator[tuple[GroupView, list[Figure | Missing]]]:
    """Estimates of every other group."""
    for i, view in enumerate(context.others):
        items = [*estimates(context, view, f"-{i}"), efficiency_figure(view, f"-{i}"), *zipper_figures(view, f"-{i}")]
        yield view, [*items, *statistic_figures(view, f"-{i}")]
