"""Sweeps of a study on its page: the bias of every parameter in every cell."""

from __future__ import annotations

from functools import partial
from typing import Any

from mcstudy.analysis.show.sweeps import sweep_tables, sweeps_of
from mcstudy.report.figure import Figure, Panel
from mcstudy.report.figures.sweep import bias_map, size_of_map
from mcstudy.report.study.context import Context

WORDS = {"sd": "bias in standard deviations of the estimates", "percent": "bias in % of the truth"}


def sweep_figures(context: Context) -> list[Figure]:
    """A figure for each sweep, with its numbers."""
    return [_figure(name, cells) for name, cells in sweeps_of(context.data["groups"]).items()]


def _figure(name: str, cells: list[dict[str, Any]]) -> Figure:
    d = cells[0]["design"]
    where = f"{d['fmax'][-1]:g} Hz and {d['amplitude'][-1]:g} {d['amplitude_unit']}"
    return Figure(
        f"sweep-{name}",
        f"Sweep {name}: bias of every parameter in every cell",
        [
            f"At {where}. Orange: estimates too large, violet: too small, full at 3 standard deviations or 100 %. In "
            "brackets: within two Monte Carlo errors of none. All cells share the noise of a realization.",
        ],
        [Panel(words, partial(bias_map, cells, -1, unit), size_of_map(cells)) for unit, words in WORDS.items()],  # type: ignore[arg-type]
        sweep_tables(cells),
        f'mcstudy.open_results("OUT")["{name}"].mc.bias()',
    )
