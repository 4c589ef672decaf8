"""Statistics of the best fits of each amplitude and Fmax, declared once.

Each declaration is a method of ``.mc``, a number in the JSON of ``mcstudy show``, a column of its table of a group and
of the page, and a figure of the page where it has a title for one. Functions are named here and loaded when they are
called, so that tables of numbers that are known are printed without loading a library of numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, kw_only=True)
class CellStatistic:
    """One statistic of the best fits.

    Attributes
    ----------
    key: its name in JSON, and as a method of ``.mc`` if that has no other of this name.
    function: ``module:name`` of a function from best fits to a Dataset ``value``, ``mcse`` and, where they exist,
        ``floor``, ``lower``, ``upper``, with dims (amplitude, fmax) and labels (`mcstudy.analysis.labels`).
    summed: whether it is also given for the combined stiffnesses, as ``<key>_combined``.
    head, page: header of its column in the terminal and on the page; no column where empty.
    factor: by which columns and figure multiply it, 100 for a fraction in percent.
    floor: whether a column with its floor follows. error: whether the terminal prints its Monte Carlo error.
    meaning: what the column and the figure show; empty where the legend of the table says it.
    figure: title of its figure on the page; no figure where empty.
    """

    key: str
    function: str
    summed: bool = False
    head: str = ""
    page: str = ""
    factor: float = 1.0
    floor: bool = False
    error: bool = True
    meaning: str = ""
    figure: str = ""

    def load(self) -> Callable[[xr.Dataset], xr.Dataset]:
        """The function."""
        function: Callable[[xr.Dataset], xr.Dataset] = resolve_name(self.function)
        return function


CELL_STATISTICS = (
    CellStatistic(
        key="mean_absolute_bias_percent",
        function="mcstudy.analysis.accuracy:mean_absolute_bias_percent",
        summed=True,
        head="|bias| %",
        page="mean |bias| (%)",
        floor=True,
    ),
    CellStatistic(
        key="mean_spread_percent",
        function="mcstudy.analysis.accuracy:mean_spread_percent",
        summed=True,
        head="SD %",
        page="mean SD (%)",
    ),
    CellStatistic(
        key="unstable",
        function="mcstudy.analysis.accuracy:unstable",
        head="unstable %",
        page="unstable (%)",
        factor=100.0,
    ),
    CellStatistic(
        key="inside_bounds",
        function="mcstudy.analysis.accuracy:share_inside_bounds",
        head="off bounds %",
        page="on no bound (%)",
        factor=100.0,
    ),
    CellStatistic(
        key="median_cost", function="mcstudy.analysis.order_statistics:median_cost", head="cost", error=False
    ),
    CellStatistic(key="median_j_nc", function="mcstudy.analysis.neural:median_j_nc", head="J_NC", error=False),
)
"""In the order of the columns."""


def cell_statistic(key: str) -> CellStatistic:
    """The statistic called ``key``; raises `KeyError`."""
    return {s.key: s for s in CELL_STATISTICS}[key]
