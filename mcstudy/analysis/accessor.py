"""``dataset.mc``: the analysis as methods of a cube, for use in a notebook.

    tree = mcstudy.open_results("cube.zarr")
    tree["accuracy"].mc.bias()              # value, mcse, n, left_out
    tree["accuracy"].mc.combined().mc.cv()  # active and passive stiffness summed

Every method works on a cube (it takes the best start first) and on cells (`best` or a derivative of it); those that
need all starts say so. Cubes larger than memory are reduced chunk by chunk. A result of moderate size (`MOST_BYTES`)
is computed at once; a larger one, and every result of ``dataset.mc.lazy``, stays lazy if the cube is lazy.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from inspect import Parameter, getdoc, signature
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
import xarray as xr

from mcstudy.analysis import accuracy, context, efficiency, neural, order_statistics, selection
from mcstudy.analysis import compare as comparing
from mcstudy.analysis import correlation as correlations
from mcstudy.analysis import derived as quantities
from mcstudy.analysis import performance as performances
from mcstudy.analysis import sensitivity as sensitivities
from mcstudy.analysis.labels import PERCENT, labelled
from mcstudy.analysis.search import atlas as atlases
from mcstudy.analysis.search import basins as minima
from mcstudy.analysis.search import by_starts as first_starts
from mcstudy.analysis.search import convergence, minimum_curve, stable_starts
from mcstudy.analysis.statistics import CELL_STATISTICS
from mcstudy.analysis.view import GroupView
from mcstudy.errors import InputError
from mcstudy.fitting.standard_errors import overlap_of
from mcstudy.stance.feedback import Model
from mcstudy.study.cube.conversion import readable

MOST_BYTES = 64 * 2**20
"""Largest result that is computed at once: tables, and the best fits of some hundred thousand cells."""

_OF_A_GROUP = ("estimate", "cost", "status", "truth", "initial")
"""Variables by which a group of a cube is recognized."""

T = TypeVar("T", xr.Dataset, xr.DataArray)
P = ParamSpec("P")


def _of_cells(function: Callable[Concatenate[xr.Dataset, P], T]) -> Callable[Concatenate[MonteCarlo, P], T]:
    """The method that applies ``function`` to the best fits."""
    return _method(function, lambda group: group._cells)


def _of_cube(function: Callable[Concatenate[xr.Dataset, P], T]) -> Callable[Concatenate[MonteCarlo, P], T]:
    """The method that applies ``function`` to all starts."""
    return _method(function, lambda group: group._cube)


def _method(function: Callable[..., T], data: Callable[[MonteCarlo], xr.Dataset]) -> Callable[..., T]:
    """A method that says of itself what ``function`` does; its first argument is ``data`` of a group."""

    def method(self: MonteCarlo, *args: Any, **settings: Any) -> T:
        return self._result(function(data(self), *args, **settings))

    declared = signature(function)
    _, *others = declared.parameters.values()
    its = Parameter("self", Parameter.POSITIONAL_OR_KEYWORD)
    method.__name__, method.__doc__ = function.__name__, function.__doc__
    method.__qualname__ = f"MonteCarlo.{function.__name__}"
    setattr(method, "__signature__", declared.replace(parameters=[its, *others]))  # noqa: B010 - read by inspect
    return method


class MonteCarlo:
    """Statistics of one group of a cube, each with its Monte Carlo standard error.

    Unless a method says otherwise, it returns a Dataset with dims (amplitude, fmax, parameter): ``value``; ``mcse``,
    its Monte Carlo standard error; ``n`` and ``left_out``, the numbers of realizations used and not used. Values are in
    the unit of each parameter (coordinate ``parameter_unit``). Statistics are those of the best fits; methods that need
    all starts say so and raise `InputError` without them.
    """

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
        """The model that was fitted, a `mcstudy.stance.feedback.Model`."""
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
        """Lowest-cost usable fit per cell (amplitude, fmax, realization). Needs all starts.

        Parameters
        ----------
        allowed
            Which starts may win, bool (amplitude, fmax, realization, start); all by default.

        Returns
        -------
        xarray.Dataset
            The group without ``start``: ``estimate`` (amplitude, fmax, realization, parameter), ``cost``, ``status``,
            ``at_bound``, ``growth_rate``, ``iterations``; also ``best_start`` (-1 where no start was usable; numbers
            are then NaN), ``usable_starts``, and ``missed``: the chance that as many new starts miss the lowest cost of
            the cell, and so that these missed a lower one (right in the mean over realizations).
        """
        cells = selection.best(self._cube, allowed)
        return self._result(cells.assign(missed=convergence.missed_minimum(self._cube)))

    def compare(self, other: xr.Dataset | xr.DataTree) -> xr.Dataset:
        """Another group, of any cube, minus this one: bias, spread and more by Fmax. Needs all starts of both.

        Averaged over parameters and common amplitudes. Paired by realization where both have the same seed, and thus
        the same noise.

        Parameters
        ----------
        other
            A group of this or another cube.

        Returns
        -------
        xarray.Dataset
            ``value``, ``mcse`` and ``n`` with dims (measure, fmax), in percent; coordinate ``meaning`` describes each
            measure. NaN where a measure does not exist.

        Raises
        ------
        InputError
            The groups have nothing in common, or ``other`` is not a group.
        """
        if not isinstance(other, xr.Dataset | xr.DataTree):
            raise InputError(f"compare: expected a group of a cube, got {type(other).__name__}")
        theirs = getattr(other, "mc")._cube  # noqa: B009 - registered, which types do not show
        return comparing.difference(GroupView("this", self._cube), GroupView("the other", theirs)).dataset()

    only = _of_cells(selection.only)
    stable = _of_cells(selection.stable)
    inside_bounds = _of_cells(selection.inside_bounds)
    combined = _of_cells(quantities.combined)
    derived = _of_cells(quantities.derived)
    outcomes = _of_cube(selection.outcomes)
    realizations = _of_cube(selection.realizations)
    bias = _of_cells(accuracy.bias)
    absolute_bias_percent = _of_cells(accuracy.absolute_bias_percent)
    mean_absolute_bias_percent = _of_cells(accuracy.mean_absolute_bias_percent)
    mean_spread_percent = _of_cells(accuracy.mean_spread_percent)
    sd = _of_cells(accuracy.sd)
    cv = _of_cells(accuracy.cv)
    rmse = _of_cells(accuracy.rmse)
    median_bias = _of_cells(order_statistics.median_bias)
    mad = _of_cells(order_statistics.mad)
    quantiles = _of_cells(order_statistics.estimate_quantiles)

    def performance(self, level: float = 0.95) -> xr.Dataset:
        """Bias, empirical SE and MSE with the formulas of Morris et al. (2019), and how true the standard errors are.

        The latter for a cube that holds standard errors (``store.standard_errors`` of a study file): their root mean
        square, its error relative to the empirical SE, and the fraction of intervals that hold the truth, or the mean
        estimate (bias-eliminated). Fits with the parameter on a bound have no standard error and count in ``left_out``.

        Parameters
        ----------
        level
            Of the normal intervals whose coverage is counted.

        Returns
        -------
        xarray.Dataset
            Dims (measure, amplitude, fmax, parameter); coordinates ``meaning`` and ``measure_unit``; ``lower`` and
            ``upper`` for coverages. Estimates made elsewhere: `mcstudy.performance`.
        """
        cells = self._cells
        error = cells.get(selection.ERROR)
        return self._result(performances.performance(cells["estimate"], cells["truth"], error, level))

    def relative_precision(self, other: xr.Dataset | xr.DataTree) -> xr.Dataset:
        """Variance of another group's estimates over that of this one, less one, in percent; paired by realization.

        Parameters
        ----------
        other
            The reference: a group of this or another cube, with the same seed for its pairs to mean anything.

        Raises
        ------
        InputError
            The groups have no parameter, amplitude or Fmax in common, or ``other`` is not a group.
        """
        if not isinstance(other, xr.Dataset | xr.DataTree):
            raise InputError(f"relative_precision: expected a group of a cube, got {type(other).__name__}")
        theirs = getattr(other, "mc")._cells  # noqa: B009 - registered, which types do not show
        mine, reference = xr.align(self._cells["estimate"], theirs["estimate"], join="inner")
        if 0 in mine.shape:
            raise InputError("relative_precision: expected groups with parameters, amplitudes and Fmax in common")
        gain = performances.relative_precision(mine, reference).drop_vars(["lower", "upper"])
        return self._result(labelled(gain, self._data, performances.PRECISION.meaning, PERCENT))

    correlation = _of_cells(correlations.correlation)
    at_bound = _of_cells(accuracy.at_bound)
    unstable = _of_cells(accuracy.unstable)

    def j_nc(self) -> xr.DataArray:
        """Error of the neural controllers of every fit held (all starts, or the best), at all frequencies.

        J_NC is the sum of ``|true - fit|^2 / |true|^2`` over n frequencies and four controllers, over 4 n; dims
        (amplitude, fmax, realization, start). Source: Goodworth & Peterka 2018, Methods.
        """
        return self._result(neural.j_nc(self._data, self.model))

    def j_nc_within(self) -> xr.DataArray:
        """`j_nc` at the fitted frequencies only, those up to each Fmax."""
        return self._result(neural.j_nc_within(self._data, self.model))

    def sensitivity(self) -> xr.Dataset:
        """Change of the FRFs when each parameter of the truth changes by 10 %, in three frequency ranges.

        Returns
        -------
        xarray.Dataset
            ``value`` (range, direction, parameter): the cost J between the two FRFs; ``share`` (range, parameter): mean
            of both directions as a fraction of the range's total, the slices of the paper's pies (Goodworth & Peterka
            2018, Fig. 7C). Exact: no Monte Carlo error.
        """
        truth, f = self._data["truth"].values, self._data["frequency"].values
        return self._result(sensitivities.sensitivity(self.model, truth, f))

    def efficiency(self, covariance: xr.DataArray | None = None) -> xr.Dataset:
        """Cramér-Rao variance over observed variance, 1 at best; NaN where more than one best fit in ten is on a bound.

        Parameters
        ----------
        covariance
            Covariance of the FRF errors, dims (amplitude, frequency, angle, angle_2); that of the study's noise by
            default.

        Returns
        -------
        xarray.Dataset
            Also ``applies`` (amplitude, fmax): whether the bound applies there, which it does not where bounds of the
            parameters are active; ``box`` and ``box_mcse``, the bound of van Trees over the observed mean squared
            error, which knows the box of allowed values and so holds there too; ``cramer_rao_sd``, ``paper_cost_sd``
            and ``box_rmse``, the smallest possible standard deviations of an unbiased estimator and of the paper's
            cost, and the smallest possible largest root mean squared error of any estimator in the box; ``held``,
            parameters that their bounds fix; ``why_not``, why there is no Cramér-Rao bound.
        """
        cells, model = self._cells, context.fitted_model(self._data)
        covariance = context.covariance_of(cells) if covariance is None else covariance
        overlap = overlap_of(context.points_of(cells), len(model.stimulus_names))
        bounds = efficiency.bounds_on_sd(cells, model, covariance, overlap)
        return self._result(efficiency.efficiency(cells, bounds))

    starts_needed = _of_cube(convergence.starts_needed)

    def starts_needed_quantiles(self, q: tuple[float, ...] = (0.5, 0.9)) -> xr.Dataset:
        """Quantiles over realizations of the new starts needed, median and 90th percentile. Needs all starts.

        Parameters
        ----------
        q
            The quantiles, 0 to 1.

        Returns
        -------
        xarray.Dataset
            Dims (amplitude, fmax, quantile), with a 95 % interval (``lower``, ``upper``).
        """
        return self._result(convergence.starts_needed_quantiles(convergence.starts_needed(self._cube), q))

    def minimum_curve(self, drawn: np.ndarray | None = None) -> xr.Dataset:
        """The paper's Fig. 3B: expected lowest cost of x starts, averaged over realizations. Needs all starts.

        Parameters
        ----------
        drawn
            Numbers of starts x; 1 to 500, or to the number there is, by default.

        Returns
        -------
        xarray.Dataset
            Dims (amplitude, fmax, drawn): ``value``, mean lowest cost; ``sd``, mean over realizations of its standard
            deviation over draws, the paper's bars.
        """
        return self._result(minimum_curve.average_curve(minimum_curve.minimum_curve(self._cube, drawn)))

    def asymptote(self, tolerance: float = 0.01) -> xr.Dataset:
        """Number of starts at which Fig. 3B flattens: dims (amplitude, fmax). Needs all starts.

        Parameters
        ----------
        tolerance
            The curve is flat where it exceeds the lowest cost of all starts by no more than this, relative.

        Returns
        -------
        xarray.Dataset
            With a 95 % interval (``lower``, ``upper``) from a bootstrap over realizations; NaN where the curve does not
            get there.
        """
        return self._result(minimum_curve.asymptote(minimum_curve.minimum_curve(self._cube), tolerance))

    basins = _of_cube(minima.basins)

    def atlas(self, amplitude: float | None = None, fmax: float | None = None, most: int = 10) -> xr.Dataset:
        """Local minima of all realizations in clusters, most often reached first. Needs all starts.

        Parameters
        ----------
        amplitude, fmax
            Where; the last of each by default.
        most
            Number of minima taken from each realization.

        Returns
        -------
        xarray.Dataset
            Dim ``cluster``: ``value``, probability that a start ends there, with ``mcse``; ``realizations``, in how
            many it occurs; ``lowest``, in how many it is the lowest minimum; ``stable``, fraction of its fits with a
            stable loop; ``excess``, median cost over the realization's lowest; ``position`` (cluster, parameter), mean
            place between the bounds, 0 the lower, 1 the upper.

        Raises
        ------
        InputError
            The cube does not hold this amplitude or Fmax.
        """
        cube = self._cube
        for name, value in (("amplitude", amplitude), ("fmax", fmax)):
            cube = cube.sel({name: self._held(name, value)})
        return self._result(atlases.atlas_of_starts(cube, most))

    def _held(self, name: str, value: float | None) -> float:
        held = [float(x) for x in self._data[name].values]
        if value is None:
            return held[-1]
        nearest = context.nearest(self._data[name].values, value)
        if nearest is None:
            raise InputError(f"{name}: expected one of {', '.join(f'{x:g}' for x in held)}, got {value:g}")
        return nearest

    by_starts = _of_cube(first_starts.by_starts)

    def hit_rate_by_start(self) -> xr.Dataset:
        """Fraction of starts that reach the lowest cost, for stable and unstable loops at the start. Needs all starts.

        Dims (amplitude, fmax, loop): ``value`` and ``mcse`` over realizations; ``worst``, the smallest of a
        realization; ``starts``, their number. Reads all starts at once.
        """
        needed = self._cube[["initial", "cost", "status"]].compute()
        return self._result(stable_starts.hit_rate_by_start(needed, self.model))


for _declared in CELL_STATISTICS:
    if not hasattr(MonteCarlo, _declared.key):
        setattr(MonteCarlo, _declared.key, _of_cells(_declared.load()))


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
