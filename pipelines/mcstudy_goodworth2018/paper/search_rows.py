"""The paper's statements about the search for the minimum: fits without noise (Fig. 3A) and starts needed (Fig. 3B)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from mcstudy.analysis.neural import j_nc, j_nc_within
from mcstudy.analysis.publications.sampling import Value, correlation, means, pooled
from mcstudy.analysis.search.minimum_curve import asymptote
from mcstudy.analysis.selection import best, usable
from mcstudy.fitting.certainty import HIT_TOLERANCE
from mcstudy.stance.feedback import Model
from mcstudy_goodworth2018.paper import published

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
"""Relative excess of the mean lowest cost at which the curve may be said to have flattened; the paper gives none."""

FLOORS = (1e-4, 1e-6, 1e-8, 1e-11)
"""The same without noise, where the minimum is zero: excess of J itself, down to the order of the paper's minimum."""

ADEQUATE = 1e-10
"""Largest J of a fit without noise that has found the minimum: ten times the order of the paper's."""

ROUNDING_PERCENT = 1e-6
"""Errors below this are rounding, and have no ranking."""

MOST = 500
"""Realizations of which every start is looked at: ten studies of the paper's size."""


def theory_values(cube: xr.Dataset, model: Model) -> dict[str, Value]:
    """Rows about fits without noise, from a cube at one amplitude and Fmax (dims realization, start, parameter).

    The sample are blocks of 50 starts, of which the best counts, as in the paper.
    """
    size = published.STARTS
    blocks = cube.coarsen(start=size, boundary="trim").construct(start=("pool", "start"))
    cells = best(blocks).stack(sample=("pool", "realization"))
    error = 100 * abs(cells["estimate"] / cells["truth"] - 1)
    worst = error.sel(parameter="Kpas2", drop=True) / error.drop_sel(parameter="Kpas2").max("parameter")
    if float(error.max()) < ROUNDING_PERCENT:
        worst = worst.where(False)
    of_pools = {
        "theory_mean_error": error.mean("parameter"),
        "theory_max_error": error.max("parameter"),
        "theory_worst": 100 * (worst - 1),
        "theory_cost": cells["cost"],
    }
    out = {key: _of_sample(x.values) for key, x in of_pools.items()}
    ok = usable(blocks)
    missed = xr.where(ok & (blocks["cost"] <= ADEQUATE), 0.0, 100.0).mean("start")
    out["theory_misses"] = _of_sample(missed.values)
    cost, error_of_controllers = blocks["cost"].where(ok), j_nc(blocks, model).where(ok)
    with np.errstate(divide="ignore"):
        x, y = (np.log(z.transpose(..., "start").values) for z in (cost, error_of_controllers))
    return out | {"theory_relation": _of_sample(correlation(x, y, -1))}


def _of_sample(x: np.ndarray) -> Value:
    x = x[np.isfinite(x)]
    error = x.std(ddof=1) if x.size > 1 else float("nan")
    return Value(float(x.mean()), float(error / np.sqrt(x.size)), float(error), int(x.size)) if x.size else _NOTHING


_NOTHING = Value(float("nan"), float("nan"), float("nan"), 0)


def starts_value(curve: xr.Dataset, noisy: bool, hit_rate: float, size: int) -> Value:
    """Number of starts at which Fig. 3B flattens, over the tolerances that the paper leaves open.

    ``curve``: `minimum_curve` at one amplitude and Fmax. ``hit_rate``: fraction of single starts that reach the
    minimum. ``size``: pools behind the paper's number.
    """
    found = [asymptote(curve, tolerance=t) for t in TOLERANCES]
    if not noisy:
        found = [asymptote(curve, tolerance=0.0, floor=f) for f in FLOORS]
    found = [f.squeeze() for f in found]
    at = [float(f["value"]) for f in found]
    errors = [float(f["mcse"]) for f in found]
    shown = TOLERANCES if noisy else FLOORS
    what = "excess" if noisy else "J"
    numbers = ", ".join(
        f"{x:.0f}" + (f" ± {e:.1f}" if np.isfinite(e) else "") + f" at {t:.0e}".replace("e-0", "e-")
        for x, e, t in zip(at, errors, shown, strict=True)
    )
    n = int(found[0]["n"])
    first = pooled(np.array(at[:1]), np.array(errors[:1]), n, size)
    largest = max((e for e in errors if np.isfinite(e)), default=float("nan"))
    detail = f"{numbers} {what}; {100 * hit_rate:.3g} % of single starts reach the minimum"
    return replace(
        first, detail=detail, low=min(at), high=max(at), mcse=largest, study_error=largest * float(np.sqrt(n / size))
    )


def misses_value(hit_rate: xr.DataArray, size: int) -> Value:
    """Percent of single starts that miss the minimum; ``hit_rate`` (realization, ...) is averaged over other dims."""
    missed = 100 * (1 - hit_rate.mean([d for d in hit_rate.dims if d != "realization"]).values)
    whole = means(missed[None, :])[0]
    return pooled(whole.mean, whole.sd / np.sqrt(whole.n), missed.size, size)


def cost_order_value(weak: xr.DataArray, strong: xr.DataArray, size: int) -> Value:
    """By how much the lowest cost of the pools (realization,) is larger at the smaller amplitude, percent (paired)."""
    ratio = 100 * (weak.values / strong.values - 1)
    whole = means(ratio[None, :])[0]
    return pooled(whole.mean, whole.sd / np.sqrt(whole.n), ratio.size, size)


def relation_of_starts(cube: xr.Dataset, model: Model) -> xr.DataArray:
    """Fig. 3C: correlation over starts of log J and log J_NC within a realization (amplitude, fmax, realization).

    J_NC is that of the fitted frequencies, as in the paper's Methods. NaN where all starts end in the same minimum, so
    that both numbers vary by rounding only. Of the first `MOST` realizations.
    """
    axes = ("amplitude", "fmax", "realization", "start")
    cube = cube.isel(realization=slice(0, MOST))
    kept = cube[["estimate", "cost", "status", "truth", "n_frequencies"]].compute()
    kept = kept.assign_coords(frequency=cube["frequency"])
    ok = usable(kept)
    cost, error = kept["cost"].where(ok), j_nc_within(kept, model).where(ok)
    x, y = (np.log(z.transpose(*axes).values) for z in (cost, error))
    r = correlation(x, y, -1)
    several = (cost.max("start") > cost.min("start") * (1 + HIT_TOLERANCE)).transpose(*axes[:-1])
    return xr.DataArray(np.where(several, r, np.nan), {d: kept[d].values for d in axes[:2]}, axes[:-1])
