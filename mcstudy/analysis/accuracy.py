"""Accuracy of the estimates: bias, spread, fits on bounds and stability of the best fits, with Monte Carlo errors.

All functions take *cells* (`mcstudy.analysis.selection.best` of a cube, possibly `combined` or restricted with
`only`) and return a Dataset ``value``, ``mcse``, ``n``, ``left_out`` with dims (amplitude, fmax, parameter) unless
said otherwise, in the parameters' own units unless the name says percent. Lazy where the cells are.

Definitions of bias and variability: Goodworth & Peterka 2018, note to Table II and Results.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from mcstudy.analysis.labels import ONE, PERCENT, labelled, units_of
from mcstudy.analysis.montecarlo import A, Moments, PlainStatistic, Statistic, fraction, jackknife, jackknives, moments
from mcstudy.analysis.selection import inside_bounds


def statistic_of(cells: xr.Dataset, statistic: Statistic, name: str = "statistic", units: str = ONE) -> xr.Dataset:
    """Any function of the cells' moments, with its Monte Carlo standard error; ``name`` and ``units`` are its own."""
    return labelled(jackknife(cells["estimate"], cells["truth"], statistic), cells, name, units)


def _plain(
    cells: xr.Dataset, statistic: PlainStatistic, name: str, units: str = ONE, **more: xr.DataArray
) -> xr.Dataset:
    """`statistic_of` for a statistic that needs no coordinates; ``more``: variables of the result."""
    (out,) = jackknives(cells["estimate"], cells["truth"], [statistic])
    return labelled(out.assign(more), cells, name, units)


def bias(cells: xr.Dataset) -> xr.Dataset:
    """Mean estimate minus truth, in the unit of the parameter."""
    return _plain(cells, bias_of, "bias (mean estimate minus truth)", units_of(cells))


def sd(cells: xr.Dataset) -> xr.Dataset:
    """Standard deviation over realizations (divisor n - 1), in the unit of the parameter."""
    return _plain(cells, sd_of, "standard deviation over realizations", units_of(cells))


def cv(cells: xr.Dataset) -> xr.Dataset:
    """Coefficient of variation: standard deviation over absolute mean estimate, dimensionless."""
    return _plain(cells, cv_of, "coefficient of variation")


def rmse(cells: xr.Dataset) -> xr.Dataset:
    """Root mean squared error about the truth, in the unit of the parameter."""
    return _plain(cells, rmse_of, "root mean squared error", units_of(cells))


def absolute_bias_percent(cells: xr.Dataset) -> xr.Dataset:
    """The paper's bias, ``100 |mean estimate - truth| / |truth|``, in percent, with ``floor``.

    An absolute value does not average to zero: ``floor`` = sqrt(2/pi) SD / sqrt(n), in percent of the truth, is its
    expectation for an unbiased estimator. Compare every value with its floor. NaN where the truth is zero. Source:
    Goodworth & Peterka 2018, note to Table II.
    """
    name = "absolute bias, in percent of the truth"
    return _plain(cells, absolute_bias_of, name, PERCENT, floor=floor_percent(cells))


def mean_absolute_bias_percent(cells: xr.Dataset, over: Sequence[str] = ("parameter",)) -> xr.Dataset:
    """The paper's bias averaged over parameters, in percent: dims (amplitude, fmax), with ``floor``.

    ``floor`` is the expectation when every parameter is unbiased. The standard error accounts for the correlation
    of the parameters of a realization; it is too large where the true biases are far below their errors, because an
    absolute value varies less than its argument.

    Parameters
    ----------
    over
        The dims averaged over: ``parameter``, and ``amplitude`` if wanted.
    """
    name, floor = f"absolute bias, in percent of the truth, {_mean_over(over)}", floor_percent(cells).mean(list(over))
    return _plain(cells, lambda m: absolute_bias_of(m).mean(list(over)), name, PERCENT, floor=floor)


def mean_spread_percent(cells: xr.Dataset, over: Sequence[str] = ("parameter",)) -> xr.Dataset:
    """Standard deviation in percent of the truth, averaged over parameters: the paper's variability.

    Dims (amplitude, fmax). Source: Goodworth & Peterka 2018, Results.

    Parameters
    ----------
    over
        The dims averaged over: ``parameter``, and ``amplitude`` if wanted.
    """
    name = f"standard deviation, in percent of the truth, {_mean_over(over)}"
    return _plain(cells, lambda m: relative_sd_of(m).mean(list(over)), name, PERCENT)


def _mean_over(dims: Sequence[str]) -> str:
    return f"mean over every {' and '.join(dims)}"


def bias_of(m: Moments[A]) -> A:
    """Mean estimate minus truth."""
    return m.mean - m.truth


def sd_of(m: Moments[A]) -> A:
    """Standard deviation."""
    return m.sd


def rmse_of(m: Moments[A]) -> A:
    """Root mean squared error."""
    return m.mse**0.5


def absolute_bias_of(m: Moments[A]) -> A:
    """Absolute bias in percent of the truth; NaN where the truth is zero."""
    return 100 * abs(m.mean - m.truth) / abs(m.truth.where(m.truth != 0))


def relative_sd_of(m: Moments[A]) -> A:
    """Standard deviation in percent of the truth; NaN where the truth is zero."""
    return 100 * m.sd / abs(m.truth.where(m.truth != 0))


def cv_of(m: Moments[A]) -> A:
    """Coefficient of variation; NaN where the mean estimate is zero."""
    return m.sd / abs(m.mean.where(m.mean != 0))


def floor_percent(cells: xr.Dataset) -> xr.DataArray:
    """Expected absolute bias of an unbiased estimator, in percent of the truth: sqrt(2/pi) SD / sqrt(n)."""
    m = moments(cells["estimate"], cells["truth"])
    return np.sqrt(2 / np.pi) * relative_sd_of(m) / np.sqrt(m.n.where(m.n > 0))


def at_bound(cells: xr.Dataset) -> xr.Dataset:
    """Fraction of best fits with a parameter on a bound, by ``side``.

    Dims (amplitude, fmax, parameter, side), with a 95 % Wilson interval (``lower``, ``upper``). If it is large, the
    bias of that parameter has little meaning: bounds centred on the truth hide bias.
    """
    used = cells["estimate"].notnull()
    sides = xr.DataArray(["lower", "upper"], dims="side", name="side")
    parts = [fraction(cells["at_bound"] == side, used) for side in (-1, 1)]  # one at a time: half of the memory
    out = xr.concat(parts, sides).transpose(..., "side")
    return labelled(out, cells, "fraction of best fits with the parameter on that bound")


def unstable(cells: xr.Dataset) -> xr.Dataset:
    """Fraction of best fits whose loop is unstable: dims (amplitude, fmax).

    With a 95 % Wilson interval (``lower``, ``upper``). Unstable: the rightmost characteristic root has a positive
    real part. A fit without a growth rate counts as left out.
    """
    out = fraction(cells["growth_rate"] > 0, cells["growth_rate"].notnull())
    return labelled(out, cells, "fraction of best fits that are unstable")


def share_inside_bounds(cells: xr.Dataset) -> xr.Dataset:
    """Fraction of best fits that touch no bound: dims (amplitude, fmax), with a 95 % Wilson interval."""
    out = fraction(inside_bounds(cells), cells["cost"].notnull())
    return labelled(out, cells, "fraction of best fits that touch no bound")
