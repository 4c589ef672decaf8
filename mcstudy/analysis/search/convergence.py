"""Number of starts that a fit needs: exact, per realization (expected cost: `mcstudy.analysis.search.minimum_curve`).

A *pool* is the set of fits of one cell. A fit is a success (*hit*) if its cost is within `HIT_TOLERANCE` of the pool's
minimum. The pool's minimum represents the global one; `mcstudy.fitting.certainty` estimates the chance that it is not.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.special import gammaln

from mcstudy.analysis.labels import ONE, label, labelled
from mcstudy.analysis.montecarlo import quantiles, wilson
from mcstudy.analysis.selection import attempted, usable
from mcstudy.fitting.certainty import COST_FLOOR, HIT_TOLERANCE, MISSED, missed

HITS = ("starts that reached the lowest cost of the pool", ONE)

STARTS = ("starts attempted", ONE)

_EQUAL = 1 + 1e-9  # a probability that equals its limit up to rounding has reached it


def hits(cube: xr.Dataset, tolerance: float = HIT_TOLERANCE, floor: float = COST_FLOOR) -> xr.Dataset:
    """Per pool: ``hits`` among ``starts`` attempted, the pool's ``minimum``; dims (amplitude, fmax, realization).

    A failed fit counts as a start without success; one that is pending or was not needed does not count.
    """
    cost = cube["cost"].where(usable(cube))
    minimum = cost.min("start")
    out = xr.Dataset(
        {
            "hits": (cost <= minimum * (1 + tolerance) + floor).sum("start"),
            "starts": attempted(cube).sum("start"),
            "minimum": minimum,
        }
    )
    return labelled(out, cube, hits=HITS, starts=STARTS, minimum=("lowest cost of the pool", ONE))


def missed_minimum(cube: xr.Dataset, tolerance: float = HIT_TOLERANCE, floor: float = COST_FLOOR) -> xr.DataArray:
    """``missed`` of `starts_needed` alone, dims (amplitude, fmax, realization)."""
    pool = hits(cube, tolerance, floor)
    return label(_missed(pool, pool["hits"] / pool["starts"].where(pool["starts"] > 0)), MISSED)


def _missed(pool: xr.Dataset, rate: xr.DataArray) -> xr.DataArray:
    return missed(rate, pool["starts"]).where(pool["hits"] > 0)


def miss_probability(hits: np.ndarray, starts: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """Probability that ``drawn`` of ``starts`` fits, taken without replacement, hold none of the ``hits``.

    C(n - k, s) / C(n, s), hypergeometric; zero once s exceeds n - k. Integer arrays, broadcast.
    """
    k, n, s = np.broadcast_arrays(hits, starts, drawn)
    possible = s <= n - k
    s = np.where(possible, s, 0)
    log = gammaln(n - k + 1) - gammaln(n - k - s + 1) - gammaln(n + 1) + gammaln(n - s + 1)
    return np.where(possible, np.exp(log), 0.0)


def fewest_starts(hits: np.ndarray, starts: np.ndarray, confidence: float) -> np.ndarray:
    """Fewest starts, drawn from the pool without replacement, with a success at this confidence; NaN if none."""
    out = np.full(np.shape(hits), np.nan)
    pairs, inverse = np.unique(np.stack([np.ravel(hits), np.ravel(starts)]), axis=1, return_inverse=True)
    needed = np.full(pairs.shape[1], np.nan)
    for j, (k, n) in enumerate(pairs.T):
        if k > 0:
            without = miss_probability(k, n, np.arange(1, n - k + 2))
            needed[j] = 1 + np.argmax(without <= (1 - confidence) * _EQUAL)
    out[...] = needed[inverse].reshape(out.shape)
    return out


def fewest_independent_starts(p: np.ndarray, confidence: float) -> np.ndarray:
    """The same for an infinite pool with success probability ``p``: ln(1 - confidence) / ln(1 - p), rounded up."""
    p = np.asarray(p, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = np.log1p(-confidence) / np.log1p(-p)
    return np.where(p >= 1, 1.0, np.where(p > 0, np.maximum(np.ceil(exact / _EQUAL), 1.0), np.nan))


def starts_needed(
    cube: xr.Dataset, confidence: float = 0.95, tolerance: float = HIT_TOLERANCE, floor: float = COST_FLOOR
) -> xr.Dataset:
    """New starts that find the lowest cost of their cell, per realization. Needs all starts.

    Parameters
    ----------
    confidence
        Probability with which one of them finds it.
    tolerance, floor
        A start finds the lowest cost if its own is above it by at most this, relative and absolute.

    Returns
    -------
    xarray.Dataset
        Dims (amplitude, fmax, realization): ``value``, for new starts, with ``mcse`` (delta method), ``lower``,
        ``upper`` (Wilson); ``from_pool``, exact, for starts drawn from those of the cell, which cannot exceed them;
        ``missed``, the chance that as many new starts miss that cost, and so that these missed a lower one (right in
        the mean over realizations); ``missed_upper``, the same from the lower end of the interval of the hit rate, the
        criterion of ``starts = "until certain"``; ``hit_rate``, ``hits``, ``starts``.
    """
    pool = hits(cube, tolerance, floor)
    rate = wilson(pool["hits"], pool["starts"])

    def independent(p: xr.DataArray) -> xr.DataArray:
        return xr.apply_ufunc(
            fewest_independent_starts,
            p,
            kwargs={"confidence": confidence},
            dask="parallelized",
            output_dtypes=[float],
        ).where(pool["hits"] > 0)

    from_pool = xr.apply_ufunc(
        fewest_starts,
        pool["hits"],
        pool["starts"],
        kwargs={"confidence": confidence},
        dask="parallelized",
        output_dtypes=[float],
    )
    p = rate["value"].where((pool["hits"] > 0) & (rate["value"] < 1))
    slope = abs(np.log1p(-confidence)) / ((1 - p) * np.log1p(-p) ** 2)
    error = slope * (p * (1 - p) / pool["starts"]) ** 0.5
    out = xr.Dataset(
        {
            "value": independent(rate["value"]),
            "mcse": error.where(rate["value"] < 1, 0.0).where(pool["hits"] > 0),
            "lower": independent(rate["upper"]),
            "upper": independent(rate["lower"]),
            "from_pool": from_pool,
            "missed": _missed(pool, rate["value"]),
            "missed_upper": missed(rate["lower"], pool["starts"]).where(pool["hits"] > 0),
            "hit_rate": rate["value"],
            "hits": pool["hits"],
            "starts": pool["starts"],
        }
    )
    target = f"for {100 * confidence:g} % certainty"
    return labelled(
        out,
        cube,
        f"new starts needed {target}",
        from_pool=(f"starts needed {target}, drawn from the pool without replacement", ONE),
        missed=(MISSED, ONE),
        missed_upper=(f"upper end of the 95 % interval of the {MISSED}", ONE),
        hit_rate=("fraction of starts that reached the lowest cost of the pool", ONE),
        hits=HITS,
        starts=STARTS,
    )


def starts_needed_quantiles(needed: xr.Dataset, q: tuple[float, ...] = (0.5, 0.9)) -> xr.Dataset:
    """Quantiles of `starts_needed` over realizations, with standard error and interval."""
    name = str(needed["value"].attrs.get("long_name", "new starts needed"))
    return labelled(quantiles(needed["value"], q), needed, f"quantile over realizations of the {name}")
