"""``.mc`` of a sweep: every statistic of a group, for each cell of the sweep or of a part of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import xarray as xr

from mcstudy.analysis.accessor import MonteCarlo
from mcstudy.analysis.sweeps import CELL, cells_of, joined
from mcstudy.errors import InputError


class MonteCarloOfSweep:
    """Every method of `MonteCarlo`, of each cell of a sweep; results have the axes of the sweep as dimensions."""

    def __init__(self, data: xr.Dataset, compute: bool = True) -> None:
        self._given, self._compute = data, compute

    @property
    def lazy(self) -> MonteCarloOfSweep:
        """The same methods with lazy results."""
        return MonteCarloOfSweep(self._given, compute=False)

    def __dir__(self) -> list[str]:
        return dir(MonteCarlo)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("_") or not callable(getattr(MonteCarlo, name)):
            raise AttributeError(f"{name}: choose one cell of the sweep, e.g. data.sel(...).mc.{name}")

        def of_each(*args: Any, **settings: Any) -> Any:
            cells = cells_of(self._given) or {}
            if not cells:
                raise InputError("mc: expected cells of a sweep, got a combination that was left out")
            results = {n: getattr(MonteCarlo(c, self._compute), name)(*args, **settings) for n, c in cells.items()}
            said = {cell: data.attrs for cell, data in cells.items()}
            return joined(results, self._given[CELL], said)

        of_each.__name__, of_each.__doc__ = name, getattr(MonteCarlo, name).__doc__
        return of_each
