"""Success of fits that start from a stable or an unstable loop.

An FRF is infinite when a characteristic root crosses the imaginary axis, so a fit that decreases the cost can hardly
move a root from one side to the other. The number of unstable roots therefore usually stays that of the start (derived;
confirmed by the counts of this module). A measured body is stable, so a stable start is on the correct side.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from mcstudy.analysis.labels import ONE, label, labelled
from mcstudy.analysis.selection import attempted, usable
from mcstudy.fitting.certainty import COST_FLOOR, HIT_TOLERANCE
from mcstudy.stance.feedback import Model
from mcstudy.stance.stability import growth_rate

LOOPS = ("stable", "unstable")


def stable_starts(cube: xr.Dataset, model: Model) -> xr.DataArray:
    """Whether the loop is stable at each fit's start, bool, dims of ``status``; False where there is no start."""
    initial = cube["initial"].transpose(*cube["status"].dims, "parameter")
    values = initial.values.reshape(-1, initial.sizes["parameter"])
    # Streams give all amplitudes and Fmax of a realization the same starts: each is looked at once.
    distinct, where = np.unique(values, axis=0, return_inverse=True)
    growth = np.full(len(distinct), np.nan)
    known = np.isfinite(distinct).all(axis=1)
    if known.any():
        growth[known] = growth_rate(model, distinct[known])
    stable = xr.DataArray((growth < 0)[where].reshape(cube["status"].shape), dims=cube["status"].dims)
    return label(stable, "whether the loop at the start of the fit is stable")


def hit_rate_by_start(
    cube: xr.Dataset, model: Model, tolerance: float = HIT_TOLERANCE, floor: float = COST_FLOOR
) -> xr.Dataset:
    """Fraction of starts that reach the pool's minimum, for starts with a stable and with an unstable loop.

    Parameters
    ----------
    cube: a group with all its starts.
    model: what was fitted (``dataset.mc.model``, or the one given to `mcstudy.own_model.run_model`).
    tolerance, floor: what counts as the minimum; see `mcstudy.analysis.search.convergence`.

    Returns
    -------
    Dataset with dims (amplitude, fmax, loop): ``value``, mean over realizations of the fraction within each; ``mcse``
    over realizations; ``worst``, smallest fraction of a realization; ``starts``, number of starts. NaN without starts.
    """
    cost = cube["cost"].where(usable(cube))
    hit = cost <= cost.min("start") * (1 + tolerance) + floor
    stable = stable_starts(cube, model)
    ran = attempted(cube)
    loop = xr.concat([stable & ran, ~stable & ran], dim=xr.DataArray(list(LOOPS), dims="loop", name="loop"))
    n = loop.sum("start")
    share = (hit & loop).sum("start") / n.where(n > 0)
    used = share.notnull().sum("realization")
    out = xr.Dataset(
        {
            "value": share.mean("realization"),
            "mcse": share.std("realization", ddof=1).where(used > 1) / used.where(used > 1) ** 0.5,
            "worst": share.min("realization"),
            "starts": n.sum("realization"),
        }
    ).transpose("amplitude", "fmax", "loop")
    return labelled(
        out,
        cube,
        "fraction of starts that reached the lowest cost of the pool, mean over realizations",
        worst=("fraction of starts that reached the lowest cost of the pool, in the worst realization", ONE),
        starts=("starts from such a loop", ONE),
    )
