"""``dataset.mc``: the analysis as methods of a cube, for use in a notebook.

    tree = mcstudy.open_results("cube.zarr")
    tree["accuracy"].mc.bias()              # value, mcse, n, left_out
    tree["accuracy"].mc.combined().mc.cv()  # active and passive stiffness summed

Every method works on a cube (it takes the best start first) and on cells (`best` or a derivative of it); those that
need all starts say so. Cubes larger than memory are reduced chunk by chunk. A result of moderate size (`MOST_BYTES`)
is computed at once; a larger one, and every result of ``dataset.mc.lazy``, stays lazy if the cube is lazy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from inspect import getdoc
from typing import TypeVar

import numpy as np
import xarray as xr

import mcstudy.analysis.accessors  # noqa: F401 - registers it
from mcstudy.analysis import (
    accuracy,
    basins,
    by_starts,
    context,
    convergence,
    correlation,
    efficiency,
    minimum_curve,
    neural,
    selection,
    stable_starts,
)
from mcstudy.analysis import atlas as atlases
from mcstudy.analysis import compare as comparing
from mcstudy.analysis import sensitivity as sensitivities
from mcstudy.analysis.view import GroupView
from mcstudy.errors import InputError
from mcstudy.stance.feedback import Model
from mcstudy.study.readable import readable

MOST_BYTES = 64 * 2**20
"""Largest result that is computed at once: tables, and the best fits of some hundred thousand cells."""

_OF_A_GROUP = ("estimate", "cost", "status", "truth", "initial")
"""Variables by which a group of a cube is recognized."""

T = TypeVar("T", xr.Dataset, xr.DataArray)


class MonteCarlo:
    """Statistics of one group of a cube, each with its Monte Carlo standard error."""

    def __init__(self, data: xr.Dataset, compute: bool = True) -> None:
        self._given, self._compute = data, compute

    def __repr__(self) -> str:
        names = [n for n in dir(type(self)) if not n.startswith("_")]
        width = max(map(len, names)) + 2
        lines = [f"  {n:{width}}{(getdoc(getattr(type(self), n)) or '').splitlines()[0]}" for n in names]
        return "\n".join([f"{(getdoc(MonteCarlo) or '').splitlines()[0]} See help(dataset.mc.bias).", *lines])

    @cached_property
    def _data(self) -> xr.Dataset:
        if not any(name in self._given for name in _OF_A_GROUP):
            held = ", ".join(map(str, self._given.data_vars)) or "nothing"
            raise InputError(f"mc: expected a group of a cube or its best fits, got a Dataset with {held}")
        return readable(self._given)

    def _result(self, result: T) -> T:
        return result.compute() if self._compute and result.nbytes <= MOST_BYTES else result

    @property
    def lazy(self) -> MonteCarlo:
        """The same methods with lazy results, to be computed together or written piece by piece."""
        return MonteCarlo(self._data, compute=False)

    @cached_property
    def model(self) -> Model:
        """The model that was fitted."""
        return context.model_of(self._data)

    @property
    def _cells(self) -> xr.Dataset:
        return selection.best(self._data) if "start" in self._data.dims else self._data

    @property
    def _cube(self) -> xr.Dataset:
        if "start" not in self._data.dims:
            raise InputError("start: expected a cube with all its starts, got best fits only")
        return self._data

    def best(self, allowed: xr.DataArray | None = None) -> xr.Dataset:
        """Lowest-cost usable fit per cell; see `mcstudy.analysis.selection.best`. Needs all starts."""
        return self._result(selection.best(self._cube, allowed))

    def compare(self, other: xr.Dataset | xr.DataTree) -> xr.Dataset:
        """Another group, of any cube, minus this one: bias, spread and more by Fmax. Needs all starts of both.

        Paired by realization where both have the same seed. See `mcstudy.analysis.compare`. Raises `InputError` for
        groups with nothing in common.
        """
        if not isinstance(other, xr.Dataset | xr.DataTree):
            raise InputError(f"compare: expected a group of a cube, got {type(other).__name__}")
        theirs = getattr(other, "mc")._cube  # noqa: B009 - registered, which types do not show
        return comparing.difference(GroupView("this", self._cube), GroupView("the other", theirs)).dataset()

    def only(self, mask: xr.DataArray) -> xr.Dataset:
        """Best fits where ``mask`` (e.g. ``cells.mc.stable()``) holds, the rest left out: conditional statistics."""
        return self._result(selection.only(self._cells, mask))

    def stable(self) -> xr.DataArray:
        """Mask of cells whose best fit is a stable loop."""
        return self._result(selection.stable(self._cells))

    def inside_bounds(self) -> xr.DataArray:
        """Mask of cells whose best fit touches no bound."""
        return self._result(selection.inside_bounds(self._cells))

    def combined(self) -> xr.Dataset:
        """Best fits with active and passive stiffness summed: the paper's 10 numbers."""
        return self._result(selection.combined(self._cells))

    def outcomes(self) -> xr.DataArray:
        """Counts of fits by status. Needs all starts."""
        return self._result(selection.outcomes(self._cube))

    def realizations(self) -> xr.Dataset:
        """Counts of realizations used, not run, with data not finite, diverged, failed. Needs all starts."""
        return self._result(selection.realizations(self._cube))

    def bias(self) -> xr.Dataset:
        """Mean estimate minus truth, in units."""
        return self._result(accuracy.bias(self._cells))

    def absolute_bias_percent(self) -> xr.Dataset:
        """The paper's bias, with its noise floor."""
        return self._result(accuracy.absolute_bias_percent(self._cells))

    def mean_absolute_bias_percent(self) -> xr.Dataset:
        """The paper's bias averaged over parameters, with its noise floor."""
        return self._result(accuracy.mean_absolute_bias_percent(self._cells))

    def mean_spread_percent(self) -> xr.Dataset:
        """Standard deviation in percent of the truth, averaged over parameters: the paper's variability."""
        return self._result(accuracy.mean_spread_percent(self._cells))

    def sd(self) -> xr.Dataset:
        """Standard deviation over realizations, in units."""
        return self._result(accuracy.sd(self._cells))

    def cv(self) -> xr.Dataset:
        """Coefficient of variation."""
        return self._result(accuracy.cv(self._cells))

    def rmse(self) -> xr.Dataset:
        """Root mean squared error, in units."""
        return self._result(accuracy.rmse(self._cells))

    def correlation(self) -> xr.Dataset:
        """Correlation of every pair of estimates over realizations. Reads the best fits at once."""
        return self._result(correlation.correlation(self._cells))

    def at_bound(self) -> xr.Dataset:
        """Fraction of best fits on a bound, by side."""
        return self._result(accuracy.at_bound(self._cells))

    def unstable(self) -> xr.Dataset:
        """Fraction of best fits that are unstable."""
        return self._result(accuracy.unstable(self._cells))

    def j_nc(self) -> xr.DataArray:
        """Error of the neural controllers of every fit held (all starts, or the best), at all frequencies."""
        return self._result(neural.j_nc(self._data, self.model))

    def j_nc_within(self) -> xr.DataArray:
        """The same at the fitted frequencies only."""
        return self._result(neural.j_nc_within(self._data, self.model))

    def sensitivity(self) -> xr.Dataset:
        """J_true when each parameter of the truth changes by 10 %, in three frequency ranges."""
        truth, f = self._data["truth"].values, self._data["frequency"].values
        return self._result(sensitivities.sensitivity(self.model, truth, f))

    def efficiency(self, covariance: xr.DataArray | None = None) -> xr.Dataset:
        """Cramér-Rao variance over observed variance; NaN where many fits are on bounds, because it does not apply.

        ``covariance`` (amplitude, frequency, angle, angle_2) of the FRF errors; `context.covariance_of` by default. Of
        combined stiffnesses too. See `mcstudy.analysis.efficiency.efficiency`.
        """
        cells, model = self._cells, context.fitted_model(self._data)
        covariance = context.covariance_of(cells) if covariance is None else covariance
        overlap = efficiency.overlap_of(context.points_of(cells))
        bounds = efficiency.bounds_on_sd(cells, model, covariance, overlap)
        return self._result(efficiency.efficiency(cells, bounds))

    def starts_needed(self, confidence: float = 0.95) -> xr.Dataset:
        """Starts that find the pool's minimum, per realization. Needs all starts."""
        return self._result(convergence.starts_needed(self._cube, confidence))

    def starts_needed_quantiles(self, q: tuple[float, ...] = (0.5, 0.9)) -> xr.Dataset:
        """Quantiles of `starts_needed` over realizations. Needs all starts."""
        return self._result(convergence.starts_needed_quantiles(convergence.starts_needed(self._cube), q))

    def minimum_curve(self, drawn: np.ndarray | None = None) -> xr.Dataset:
        """The paper's Fig. 3B, averaged over realizations. Needs all starts."""
        return self._result(minimum_curve.average_curve(minimum_curve.minimum_curve(self._cube, drawn)))

    def asymptote(self, tolerance: float = 0.01) -> xr.Dataset:
        """Number of starts at which Fig. 3B flattens. Needs all starts."""
        return self._result(minimum_curve.asymptote(minimum_curve.minimum_curve(self._cube), tolerance))

    def basins(self, most: int = 10) -> xr.Dataset:
        """The lowest local minima of every cell, and how often they are reached. Needs all starts."""
        return self._result(basins.basins(self._cube, most))

    def atlas(self, amplitude: float | None = None, fmax: float | None = None, most: int = 10) -> xr.Dataset:
        """Local minima of all realizations in clusters, at the last amplitude and Fmax by default. Needs all starts.

        See `mcstudy.analysis.atlas.atlas`. Raises `InputError` for values the cube does not hold.
        """
        cube = self._cube
        for name, value in (("amplitude", amplitude), ("fmax", fmax)):
            cube = cube.sel({name: [self._held(name, value)]})
        found = basins.basins(cube, most).isel(amplitude=0, fmax=0).compute()
        return self._result(atlases.atlas(found, self._data["lower"], self._data["upper"]))

    def _held(self, name: str, value: float | None) -> float:
        held = [float(x) for x in self._data[name].values]
        if value is None:
            return held[-1]
        found = context.nearest(self._data[name].values, value)
        if found is None:
            raise InputError(f"{name}: expected one of {', '.join(f'{x:g}' for x in held)}, got {value:g}")
        return found

    def by_starts(
        self,
        statistic: Callable[[xr.Dataset], xr.Dataset] = by_starts.mean_cv,
        counts: Iterable[int] = by_starts.COUNTS,
    ) -> xr.Dataset:
        """A statistic of cells as a function of the number of starts (dim ``drawn``). Needs all starts."""
        return self._result(by_starts.by_starts(self._cube, statistic, counts))

    def hit_rate_by_start(self) -> xr.Dataset:
        """Fraction of successful starts, for stable and unstable loops at the start. Needs all starts.

        Reads all starts at once; see `mcstudy.analysis.stable_starts.hit_rate_by_start`.
        """
        needed = self._cube[["initial", "cost", "status"]].compute()
        return self._result(stable_starts.hit_rate_by_start(needed, self.model))


class MonteCarloOfNode(MonteCarlo):
    """The same on a node of the tree: ``tree["accuracy"].mc.bias()``."""

    def __init__(self, node: xr.DataTree) -> None:
        super().__init__(node.to_dataset())
        self._groups = list(map(str, node.children))

    @cached_property
    def _data(self) -> xr.Dataset:
        if self._groups and not self._given.data_vars:
            first, *_ = self._groups
            raise InputError(
                f'mc: choose a group: {", ".join(self._groups)} (e.g. tree["{first}"].mc), got all of them'
            )
        return super()._data
