"""Performance of an estimator and of its standard errors, each with its Monte Carlo standard error.

The measures and the closed formulas of their errors are those of Morris, White & Crowther 2019 (Statistics in Medicine
38:2074-2102, Table 6), where estimates are normally distributed. `mcstudy.analysis.accuracy` has the jackknife errors
of bias and spread, which do not assume it. The interval of a coverage is Wilson's, so that it stays between 0 and 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from mcstudy.analysis.labels import ONE, labelled
from mcstudy.analysis.montecarlo import REALIZATION, wilson
from mcstudy.fitting.certainty import normal_quantile

LEVEL = 0.95
"""Level of the intervals whose coverage is counted."""


EQUAL = 4 * float(np.finfo(float).eps)
"""Relative difference that is rounding."""


@dataclass(frozen=True)
class Measure:
    """One measure: its key, its unit and its meaning."""

    key: str
    unit: str
    meaning: str


_OWN = "unit of the parameter"
WITHOUT_ERRORS = (
    Measure("bias", _OWN, "mean estimate minus truth"),
    Measure("empirical_se", _OWN, "standard deviation of the estimates"),
    Measure("mse", "square of the unit of the parameter", "mean squared error"),
)
WITH_ERRORS = (
    Measure("model_se", _OWN, "root mean square of the standard errors"),
    Measure("relative_error", "%", "model_se over empirical_se, less one"),
    Measure("coverage", ONE, "fraction of the intervals that hold the truth"),
    Measure("bias_eliminated_coverage", ONE, "fraction of the intervals that hold the mean estimate"),
)
PRECISION = Measure("relative_precision", "%", "precision gained over the reference: variance ratio, less one")
MEASURES = {m.key: m for m in (*WITHOUT_ERRORS, *WITH_ERRORS, PRECISION)}


def performance(
    estimate: xr.DataArray, truth: xr.DataArray, error: xr.DataArray | None = None, level: float = LEVEL
) -> xr.Dataset:
    """All measures over realizations, with the dim ``measure``.

    Parameters
    ----------
    estimate: any dims with ``realization``; NaN is left out. truth: broadcastable. error: standard errors, like
        ``estimate``; without them there are only the measures `WITHOUT_ERRORS`.
    level: of the normal intervals, estimate ± quantile times standard error, whose coverage is counted.

    Returns
    -------
    Dataset ``value``, ``mcse``, ``n``, ``left_out``, and ``lower``, ``upper`` for the coverages (NaN for the others).
    The measures of standard errors are over the realizations that have one. ``mcse`` is NaN for fewer than two.
    """
    parts = _of_estimates(estimate, truth)
    if error is not None:
        parts |= _of_errors(estimate, truth, error, level)
    size = estimate.sizes[REALIZATION]
    rows = [part.assign(left_out=size - part["n"]) for part in parts.values()]
    return described(xr.concat(rows, dim=xr.Variable("measure", list(parts)), data_vars="all", coords="minimal"))


def described(result: xr.Dataset) -> xr.Dataset:
    """``result`` with the coordinates ``meaning`` and ``measure_unit`` of its dim ``measure``, and labels."""
    keys = [str(k) for k in result["measure"].values]
    coords = {
        "meaning": ("measure", [MEASURES[k].meaning for k in keys], {"long_name": "meaning of the measure"}),
        "measure_unit": ("measure", [MEASURES[k].unit for k in keys], {"long_name": "unit of the measure"}),
    }
    return labelled(result.assign_coords(coords), None, "performance of the estimator", "see measure_unit")


def _of_estimates(x: xr.DataArray, truth: xr.DataArray) -> dict[str, xr.Dataset]:
    n = x.notnull().sum(REALIZATION)
    several = n.where(n > 1)
    sd = empirical_se(x)
    squared = (x - truth) ** 2
    mse = squared.mean(REALIZATION)
    mse_error = (((squared - mse) ** 2).sum(REALIZATION) / (several * (several - 1))) ** 0.5
    return {
        "bias": _row((x - truth).mean(REALIZATION), sd / several**0.5, n),
        "empirical_se": _row(sd, sd / (2 * (several - 1)) ** 0.5, n),
        "mse": _row(mse, mse_error, n),
    }


def _of_errors(x: xr.DataArray, truth: xr.DataArray, error: xr.DataArray, level: float) -> dict[str, xr.Dataset]:
    used = x.notnull() & error.notnull()
    x, error = x.where(used), error.where(used)
    n = used.sum(REALIZATION)
    several = n.where(n > 1)
    sd, square = empirical_se(x), error**2
    model = square.mean(REALIZATION) ** 0.5
    # variance of the mean square, relative to its own square: four times that of its root
    relative = empirical_se(square) ** 2 / (4 * several * model**4)
    ratio = 100 * model / sd.where(sd > 0)
    reach = normal_quantile(level) * error
    centre = x.mean(REALIZATION)
    return {
        "model_se": _row(model, model * relative**0.5, n),
        "relative_error": _row(ratio - 100, ratio * (relative + 1 / (2 * (several - 1))) ** 0.5, n),
        "coverage": _fraction(_holds(x, reach, truth), n),
        "bias_eliminated_coverage": _fraction(_holds(x, reach, centre), n),
    }


def empirical_se(x: xr.DataArray) -> xr.DataArray:
    """Standard deviation over realizations (divisor n - 1); NaN for fewer than two.

    Exactly 0 for estimates that differ by no more than rounding, such as those on a bound.
    """
    n = x.notnull().sum(REALIZATION)
    sd = (((x - x.mean(REALIZATION)) ** 2).sum(REALIZATION) / (n - 1).where(n > 1)) ** 0.5
    spread = x.max(REALIZATION) - x.min(REALIZATION)
    return sd.where((spread > EQUAL * abs(x).max(REALIZATION)) | (n < 2), 0.0)


def _holds(x: xr.DataArray, reach: xr.DataArray, value: xr.DataArray) -> xr.DataArray:
    return (value >= x - reach) & (value <= x + reach)


def _row(value: xr.DataArray, mcse: xr.DataArray, n: xr.DataArray) -> xr.Dataset:
    none = xr.full_like(value, np.nan, dtype=float)
    return xr.Dataset({"value": value, "mcse": mcse, "n": n, "lower": none, "upper": none})


def _fraction(event: xr.DataArray, n: xr.DataArray) -> xr.Dataset:
    interval = wilson(event.sum(REALIZATION), n)
    p = interval["value"]
    return interval.assign(mcse=(p * (1 - p) / n.where(n > 0)) ** 0.5)


def relative_precision(estimate: xr.DataArray, reference: xr.DataArray) -> xr.Dataset:
    """How much more precise an estimator is than a reference, in percent: 100 ((reference SD / SD)^2 - 1).

    The two are paired by realization, and only those that have both are used. Dataset ``value``, ``mcse``, ``n``,
    ``left_out``; the error accounts for the correlation of the two (Morris et al. 2019, Table 6).
    """
    estimate, reference = xr.align(estimate, reference, join="outer", exclude=_others(estimate, reference))
    used = estimate.notnull() & reference.notnull()
    x, y = estimate.where(used), reference.where(used)
    n, sd, other = used.sum(REALIZATION), empirical_se(x), empirical_se(y)
    shared = ((x - x.mean(REALIZATION)) * (y - y.mean(REALIZATION))).sum(REALIZATION) / (n - 1).where(n > 1)
    r2 = (shared / (sd * other).where(sd * other > 0)) ** 2
    gain = (other / sd.where(sd > 0)) ** 2
    mcse = 200 * gain * ((1 - r2).clip(min=0.0) / (n - 1).where(n > 1)) ** 0.5
    return _row(100 * (gain - 1), mcse, n).assign(left_out=used.sizes[REALIZATION] - n)


def _others(a: xr.DataArray, b: xr.DataArray) -> list[str]:
    return [str(d) for d in {*a.dims, *b.dims} if d != REALIZATION]


def intervals(estimate: xr.DataArray, truth: xr.DataArray, error: xr.DataArray, level: float = LEVEL) -> xr.Dataset:
    """Intervals of every realization, for a zipper plot (Morris et al. 2019, Figure 5).

    Dataset ``lower``, ``upper``, ``holds`` (whether the truth is inside) and ``centile``, the share of realizations
    whose estimate is at most as many standard errors from the truth: of valid intervals, those above the level miss it.
    """
    from scipy.stats import rankdata  # slow to import, and few studies keep standard errors

    reach = normal_quantile(level) * error
    away = abs(estimate - truth) / error
    holds = _holds(estimate, reach, truth)
    rank = xr.apply_ufunc(
        rankdata,
        away,
        input_core_dims=[[REALIZATION]],
        output_core_dims=[[REALIZATION]],
        kwargs={"axis": -1, "nan_policy": "omit"},
    )
    centile = (rank / away.notnull().sum(REALIZATION)).transpose(*away.dims)
    out = xr.Dataset({"lower": estimate - reach, "upper": estimate + reach, "holds": holds, "centile": centile})
    return labelled(
        out,
        None,
        lower=("lower end of the interval", _OWN),
        upper=("upper end of the interval", _OWN),
        holds=("whether the interval holds the truth", ONE),
        centile=("rank of the distance from the truth in standard errors, as a share", ONE),
    )
