"""The local minima of a whole study: clusters of the basins of all realizations, and how often each is reached.

The noise shifts every minimum, so basins of different realizations are never equal. Two belong to the same cluster if
no parameter differs by more than `TOLERANCE` of the distance between its bounds. The basin whose neighbourhood was
reached by most starts becomes the leader of the first cluster, which takes its neighbourhood; this is repeated with the
remaining basins. Derived; the paper has no such figure.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from mcstudy.analysis.labels import ONE, labelled
from mcstudy.analysis.montecarlo import REALIZATION
from mcstudy.analysis.search.basins import basins

TOLERANCE = 0.5
"""Largest difference of a parameter from its cluster's leader, as a fraction of its bounds' distance."""

MOST_BASINS = 4000
"""Largest number of basins in one atlas; which of all pairs are near is in memory at once."""

_ROWS = 256
"""Basins that are compared with all others at once: about 8 MB of distances."""

_DIGITS = 9
"""Decimals to which probabilities are compared; of equal ones, the basin of the first realization leads."""


def atlas_of_starts(cube: xr.Dataset, most: int, tolerance: float = TOLERANCE) -> xr.Dataset:
    """`atlas` of the ``most`` lowest minima of every realization, at one amplitude and Fmax of a cube with all starts.

    Only realizations that the atlas holds are read, so the time does not grow with their number.
    """
    held = cube.isel({REALIZATION: slice(0, _realizations(most))})
    return atlas(basins(held, most).compute(), cube["lower"], cube["upper"], tolerance)


def _realizations(most: int) -> int:
    return max(1, MOST_BASINS // most)


def atlas(basins: xr.Dataset, lower: xr.DataArray, upper: xr.DataArray, tolerance: float = TOLERANCE) -> xr.Dataset:
    """Clusters of the local minima of one (amplitude, Fmax), most often reached first.

    Parameters
    ----------
    basins: from `mcstudy.analysis.search.basins.basins`, at one amplitude and Fmax: dims (realization, basin).
    lower, upper: bounds (parameter,).

    Returns
    -------
    Dataset with dim ``cluster``: ``value`` (probability that a start ends there, mean over realizations) with ``mcse``,
    ``realizations`` (in how many it occurs), ``lowest`` (in how many it holds the lowest minimum), ``stable`` (fraction
    of its starts whose fit is a stable loop), ``excess`` (median cost over the realization's lowest) and ``position``
    (cluster, parameter): mean place between the bounds, 0 the lower, 1 the upper. Attribute ``realizations``: how many
    were gathered (the first ones, at most `MOST_BASINS` basins).
    """
    basins = basins.transpose(REALIZATION, "basin", ...)
    basins = basins.isel({REALIZATION: slice(0, _realizations(basins.sizes["basin"]))})
    realizations = basins.sizes[REALIZATION]
    reach = basins["value"].values
    place = ((basins["estimate"] - lower) / (upper - lower)).transpose(REALIZATION, "basin", "parameter").values
    r, b = np.nonzero(np.isfinite(reach))
    label = _clusters(place[r, b], reach[r, b], tolerance)
    excess = basins["cost"].values / basins["cost"].values[:, :1]
    stable = basins["stable"].values
    rows = []
    for c in range(label.max(initial=-1) + 1):
        mine = label == c
        weight, who = reach[r, b][mine], r[mine]
        per_realization = np.bincount(who, weight, minlength=realizations)
        mcse = per_realization.std(ddof=1) / np.sqrt(realizations) if realizations > 1 else np.nan
        known = np.isfinite(stable[r, b][mine])
        rows.append(
            (
                per_realization.mean(),
                mcse,
                np.unique(who).size,
                np.unique(who[b[mine] == 0]).size,
                np.average(stable[r, b][mine][known], weights=weight[known]) if known.any() else np.nan,
                np.median(excess[r, b][mine]),
                np.average(place[r, b][mine], axis=0, weights=weight),
            )
        )
    rows.sort(key=lambda row: -row[0])
    names = ("value", "mcse", "realizations", "lowest", "stable", "excess")
    columns = {n: ("cluster", np.array([row[i] for row in rows])) for i, n in enumerate(names)}
    position = np.array([row[-1] for row in rows]).reshape(len(rows), place.shape[-1])
    out = xr.Dataset(
        {**columns, "position": (("cluster", "parameter"), position)},
        coords={"cluster": np.arange(len(rows)), **lower["parameter"].coords},
    )
    return labelled(
        out,
        basins,
        "probability that a start ends in the cluster",
        realizations=("realizations in which the cluster occurs", ONE),
        lowest=("realizations in which the cluster holds the lowest minimum", ONE),
        stable=("fraction of the cluster's starts whose fit is a stable loop", ONE),
        excess=("median cost over the lowest cost of the realization", ONE),
        position=("mean place between the bounds, 0 the lower and 1 the upper", ONE),
    ).assign_attrs(realizations=realizations)


def _clusters(place: np.ndarray, reach: np.ndarray, tolerance: float) -> np.ndarray:
    """Cluster of every basin (B,), from positions (B, P) between the bounds and probabilities (B,)."""
    near = np.ones((len(place), len(place)), dtype=bool)
    around = np.empty(len(place))
    """Probability of reaching a basin that is near and not yet taken."""
    for rows in _blocks(len(place)):
        for column in place.T:  # one parameter at a time: no (B, B, P) array
            near[rows] &= np.abs(column[rows, None] - column) <= tolerance
        around[rows] = near[rows] @ reach
    label, left, c = np.full(len(place), -1), np.ones(len(place), dtype=bool), 0
    while left.any():
        leader = int(np.argmax(np.where(left, around.round(_DIGITS), -np.inf)))
        taken = np.flatnonzero(near[leader] & left)
        label[taken], c = c, c + 1
        left[taken] = False
        for rows in _blocks(taken.size):
            around -= reach[taken[rows]] @ near[taken[rows]]
    return label


def _blocks(n: int) -> list[slice]:
    return [slice(i, i + _ROWS) for i in range(0, n, _ROWS)]
