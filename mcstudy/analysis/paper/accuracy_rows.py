"""The paper's statements about estimates, as functions of the best fits of a study: Table II, Fig. 5-7B.

Every function takes `Moments` with the dims amplitude, fmax and parameter (12 parameters and the two sums of
stiffnesses, any further dims pass through) and averages over the paper's amplitudes, as the paper does. Percent means
percent of the true value, or of the number compared with.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import xarray as xr
from scipy.stats import rankdata

from mcstudy.analysis import accuracy
from mcstudy.analysis.montecarlo import Moments, Statistic
from mcstudy.analysis.paper import published
from mcstudy.analysis.paper.published import FMAX_HZ

LOW, MID, HIGH = FMAX_HZ
TWO = published.COMBINED_STIFFNESS
TWELVE = (*published.BETTER_AT_8HZ, *published.WORSE_AT_8HZ)
TEN = (*TWO, *(n for n in TWELVE if n not in ("K11", "Kpas1", "K22", "Kpas2")))
PASSIVE, DAMPINGS = ("Kpas1", "Kpas2"), ("B11", "B12", "B21", "B22")
STIFFNESSES = published.LOW_CV_STIFFNESSES

Measure = Callable[[Moments], xr.DataArray]
"""A measure of every parameter, e.g. its |bias| in percent."""


def mean(of: Measure, names: Iterable[str], fmax: float) -> Statistic:
    """Mean over both amplitudes and the parameters ``names`` at an Fmax."""
    return lambda m: of(m).sel(fmax=fmax, parameter=list(names)).mean(["amplitude", "parameter"])


def each(of: Measure, names: Iterable[str], fmax: float) -> Statistic:
    """Mean over both amplitudes of each of the parameters ``names`` at an Fmax."""
    return lambda m: of(m).sel(fmax=fmax, parameter=list(names)).mean("amplitude")


def reduction(before: Statistic, after: Statistic) -> Statistic:
    """By how much the second is smaller than the first, percent of the first."""
    return lambda m: 100 * (1 - after(m) / before(m))


def excess(larger: Statistic, smaller: Statistic) -> Statistic:
    """By how much the first is larger than the second, percent of the second."""
    return lambda m: 100 * (larger(m) / smaller(m) - 1)


def least(*statistics: Statistic) -> Statistic:
    """The smallest of several numbers."""
    return lambda m: _stacked(m, statistics).min("_")


def most(*statistics: Statistic) -> Statistic:
    """The largest of several numbers."""
    return lambda m: _stacked(m, statistics).max("_")


def _stacked(m: Moments, statistics: Iterable[Statistic]) -> xr.DataArray:
    parts = [s(m).reset_coords(drop=True) for s in statistics]
    return xr.concat(parts, dim="_", coords="minimal", compat="override")


def least_parameter(of: Statistic) -> Statistic:
    """The smallest over parameters."""
    return lambda m: of(m).min("parameter")


def lead(x: xr.DataArray, first: tuple[str, ...], largest: bool) -> xr.DataArray:
    """Margin in percent by which the worst of ``first`` ranks ahead of the best other parameter (larger or smaller)."""
    chosen = x["parameter"].isin(list(first))
    inside, outside = x.sel(parameter=chosen), x.sel(parameter=~chosen)
    if largest:
        return 100 * (inside.min("parameter") / outside.max("parameter") - 1)
    return 100 * (outside.min("parameter") / inside.max("parameter") - 1)


def at_one(of: Measure, amplitude: float, fmax: float, names: Iterable[str] = TWELVE) -> Statistic:
    """Mean over parameters at one amplitude and Fmax."""
    return lambda m: of(m).sel(fmax=fmax, amplitude=amplitude, parameter=list(names), drop=True).mean("parameter")


bias, sd, cv = accuracy.absolute_bias_of, accuracy.relative_sd_of, accuracy.cv_of
WEAK, STRONG = published.AMPLITUDES_NM


def _difference_of_bias(m: Moments) -> xr.DataArray:
    b = bias(m).sel(parameter=list(TWELVE)).mean(["fmax", "parameter"])
    return b.sel(amplitude=WEAK, drop=True) - b.sel(amplitude=STRONG, drop=True)


def _ratio_of_cv(m: Moments) -> xr.DataArray:
    together = each(cv, TWO, MID)(m)
    single = each(cv, ("K11", "K22"), MID)(m).assign_coords(parameter=together["parameter"].values)
    return (together / single).mean("parameter")


def _ranked(of: Measure, first: tuple[str, ...], largest: bool) -> Statistic:
    return lambda m: lead(each(of, TWELVE, MID)(m), first, largest)


def _of_passive(of: Measure) -> Statistic:
    """Smallest excess, over the Fmax, of the passive stiffnesses over the other parameters (means)."""
    others = tuple(n for n in TWELVE if n not in PASSIVE)
    return least(*(excess(mean(of, PASSIVE, f), mean(of, others, f)) for f in FMAX_HZ))


SMOOTH: dict[str, tuple[tuple[float, ...], Statistic]] = {
    **{f"bias_12_{f:g}": ((f,), mean(bias, TWELVE, f)) for f in FMAX_HZ},
    **{f"bias_10_{f:g}": ((f,), mean(bias, TEN, f)) for f in FMAX_HZ},
    **{f"bias_2_{f:g}": ((f,), mean(bias, TWO, f)) for f in (LOW, MID)},
    "bias_amplitude": (FMAX_HZ, _difference_of_bias),
    "bias_8_largest": (FMAX_HZ, excess(mean(bias, TWELVE, HIGH), most(*(mean(bias, TWELVE, f) for f in (LOW, MID))))),
    "bias_passive": (FMAX_HZ, _of_passive(bias)),
    "largest_bias": ((MID,), _ranked(bias, published.LARGEST_BIAS, largest=True)),
    "spread_fmax": ((LOW, MID), reduction(mean(sd, TWELVE, LOW), mean(sd, TWELVE, MID))),
    "spread_fmax_cv": ((LOW, MID), reduction(mean(cv, TWELVE, LOW), mean(cv, TWELVE, MID))),
    "spread_fmax_10": ((LOW, MID), reduction(mean(sd, TEN, LOW), mean(sd, TEN, MID))),
    "spread_fmax_2": ((LOW, MID), reduction(mean(sd, TWO, LOW), mean(sd, TWO, MID))),
    "spread_8_larger": ((MID, HIGH), excess(mean(sd, TWELVE, HIGH), mean(sd, TWELVE, MID))),
    "spread_8hz_better": (
        (MID, HIGH),
        reduction(mean(sd, published.BETTER_AT_8HZ, MID), mean(sd, published.BETTER_AT_8HZ, HIGH)),
    ),
    "spread_8hz_better_each": (
        (MID, HIGH),
        least_parameter(reduction(each(sd, published.BETTER_AT_8HZ, MID), each(sd, published.BETTER_AT_8HZ, HIGH))),
    ),
    "spread_8hz_worse": (
        (MID, HIGH),
        reduction(mean(sd, published.WORSE_AT_8HZ, HIGH), mean(sd, published.WORSE_AT_8HZ, MID)),
    ),
    "spread_8hz_worse_each": (
        (MID, HIGH),
        least_parameter(reduction(each(sd, published.WORSE_AT_8HZ, HIGH), each(sd, published.WORSE_AT_8HZ, MID))),
    ),
    "spread_passive": (FMAX_HZ, _of_passive(sd)),
    "spread_sums": (FMAX_HZ, least(*(excess(mean(sd, TWELVE, f), mean(sd, TWO, f)) for f in FMAX_HZ))),
    **{f"spread_amplitude_{f:g}": ((f,), reduction(at_one(sd, WEAK, f), at_one(sd, STRONG, f))) for f in FMAX_HZ},
    **{f"spread_amplitude_cv_{f:g}": ((f,), reduction(at_one(cv, WEAK, f), at_one(cv, STRONG, f))) for f in FMAX_HZ},
    "lowest_cv": ((MID,), _ranked(cv, published.LOWEST_CV, largest=False)),
    "highest_cv": ((MID,), _ranked(cv, published.HIGHEST_CV, largest=True)),
    "low_cv": ((MID,), lambda m: each(cv, STIFFNESSES, MID)(m).max("parameter")),
    "cv_stiffness_damping": ((MID,), excess(mean(cv, DAMPINGS, MID), mean(cv, STIFFNESSES, MID))),
    "cv_stiffness_damping_each": (
        (MID,),
        lambda m: lead(each(cv, (*STIFFNESSES, *DAMPINGS), MID)(m), STIFFNESSES, largest=False),
    ),
    "combined_cv_lowest": ((MID,), lambda m: lead(each(cv, (*TWO, *TWELVE), MID)(m), TWO, largest=False)),
    "combined_cv_ratio": ((MID,), _ratio_of_cv),
}
"""Smooth statistics of the moments: (the Fmax they need, the function)."""

RANKINGS: dict[str, tuple[Measure, tuple[str, ...], int, bool]] = {
    "largest_bias": (bias, TWELVE, 4, True),
    "lowest_cv": (cv, TWELVE, 4, False),
    "highest_cv": (cv, TWELVE, 4, True),
    "low_cv": (cv, STIFFNESSES, 4, True),
    "combined_cv_lowest": (cv, (*TWO, *TWELVE), 3, False),
}
"""Rows that print the parameters behind a ranking at 1.2 Hz: measure, parameters, how many, largest first."""


def leaders(x: xr.DataArray, n: int, largest: bool) -> str:
    """The first ``n`` of a ranking as text."""
    ranked = x.sortby(x, ascending=not largest).isel(parameter=slice(n))
    return ", ".join(f"{p} {v:.3g}" for p, v in zip(ranked["parameter"].values, ranked.values, strict=True))


def ranks(x: xr.DataArray) -> xr.DataArray:
    """Ranks along ``parameter``, from 1 for the smallest."""
    x = x.transpose(..., "parameter")
    return x.copy(data=rankdata(x.values, axis=-1))


def small_bias(names: Iterable[str], fmax: float) -> Statistic:
    """Percent of the parameters whose |bias| is below 5 %."""
    return lambda m: 100 * (each(bias, names, fmax)(m) < published.SMALL_BIAS_PERCENT).mean("parameter")


def counted(influence: xr.DataArray, mostly_high: xr.DataArray) -> dict[str, Statistic]:
    """Counts and ranks at 1.2 Hz that need the sensitivity: ``influence`` and whether it is largest at high frequency.

    Both have the dim parameter (the 12). The three least influential parameters count as of small influence.
    """
    influence, mostly_high = (x.sel(parameter=list(TWELVE)) for x in (influence, mostly_high))
    rank = ranks(influence)

    def explained(m: Moments) -> xr.DataArray:
        large = each(bias, TWELVE, MID)(m) > published.SMALL_BIAS_PERCENT
        either = (rank <= len(published.LEAST_INFLUENTIAL)) | mostly_high
        return (100 * (large & either).sum("parameter") / large.sum("parameter")).where(large.any("parameter"), 100.0)

    def influential(m: Moments) -> xr.DataArray:
        precise = each(cv, TWELVE, MID)(m) < published.LOW_CV
        upper = rank > len(TWELVE) / 2
        return (100 * (precise & upper).sum("parameter") / precise.sum("parameter")).where(precise.any("parameter"))

    def follows(of: Measure) -> Statistic:
        return lambda m: -xr.corr(ranks(each(of, TWELVE, MID)(m)), rank, dim="parameter")

    return {
        "bias_over_5": explained,
        "low_cv_influential": influential,
        "influence_cv": follows(cv),
        "influence_bias": follows(bias),
    }


COUNTED: dict[str, tuple[tuple[float, ...], Statistic]] = {
    f"bias_below_5_{len(names)}_{f:g}": ((f,), small_bias(names, f)) for names in (TWELVE, TEN) for f in (LOW, MID)
}
"""Counts that need the best fits only."""


def together(pair: tuple[str, str]) -> Callable[[xr.Dataset], xr.DataArray]:
    """Correlation over realizations of the estimates of two parameters, mean over amplitudes and Fmax."""
    a, b = pair

    def of(data: xr.Dataset) -> xr.DataArray:
        x = data["estimate"]
        r = xr.corr(x.sel(parameter=a, drop=True), x.sel(parameter=b, drop=True), dim="realization")
        return r.mean(["amplitude", "fmax"])

    return of


def relation(data: xr.Dataset) -> xr.DataArray:
    """Correlation over realizations of the logarithms of ``cost`` and ``j_nc``, dims (amplitude, fmax)."""
    logarithm = data[["cost", "j_nc"]].map(np.log)
    return xr.corr(logarithm["cost"], logarithm["j_nc"], dim="realization")


def weaker_with_noise(r: xr.DataArray) -> xr.DataArray:
    """By how much a correlation is smaller at the small amplitude, mean over 1.2 and 8 Hz."""
    r = r.sel(fmax=[MID, HIGH]).mean("fmax")
    return r.sel(amplitude=STRONG, drop=True) - r.sel(amplitude=WEAK, drop=True)


def weaker_at_8hz(r: xr.DataArray) -> xr.DataArray:
    """By how much a correlation is smaller at 8 than at 1.2 Hz, mean over amplitudes."""
    r = r.mean("amplitude")
    return r.sel(fmax=MID, drop=True) - r.sel(fmax=HIGH, drop=True)
