"""Results of every cell of a lazy cube, a slab of realizations at a time: memory for the results and for one slab.

Dask would hold the pieces of a result and their concatenation together, and several pieces of the cube per thread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import xarray as xr

from mcstudy.analysis.montecarlo import REALIZATION

FITS_A_SLAB = 500_000
"""Fits that are read at once: about 100 MB."""


def in_slabs(cube: xr.Dataset, statistic: Callable[[xr.Dataset], xr.Dataset]) -> xr.Dataset:
    """``statistic(cube)`` in memory, for a function of each realization alone; a cube in memory is one slab.

    Every variable of ``cube`` is read, so it should have no others than ``statistic`` needs. They are read before it is
    called: a lazy one takes many small steps for each of Dask's chunks.
    """
    parts = list(_slabs(cube))
    first = statistic(cube.isel({REALIZATION: parts[0]}).compute())
    if len(parts) == 1:
        return first
    total = cube.sizes[REALIZATION]
    filled = {name: _room(v, total) for name, v in first.variables.items() if REALIZATION in v.dims}
    for part in parts:
        computed = first if part == parts[0] else statistic(cube.isel({REALIZATION: part}).compute())
        for name, (dims, values, _) in filled.items():
            values[(*(slice(None),) * dims.index(REALIZATION), part)] = computed.variables[name].values
    variables = {name: filled.get(name, v) for name, v in first.variables.items()}
    data = {name: variables[name] for name in first.data_vars}
    return xr.Dataset(data, {name: variables[name] for name in first.coords}, first.attrs)


def summed(cube: xr.Dataset, statistic: Callable[[xr.Dataset], xr.Dataset]) -> xr.Dataset:
    """``statistic(cube)`` in memory, for counts over the realizations: the sum over all slabs. See `in_slabs`."""
    total: xr.Dataset | None = None
    with xr.set_options(keep_attrs=True):
        for part in _slabs(cube):
            computed = statistic(cube.isel({REALIZATION: part}).compute())
            total = computed if total is None else total + computed
    assert total is not None  # there is one slab at least
    return total


def _slabs(cube: xr.Dataset) -> Iterator[slice]:
    """Slices at the borders of Dask's chunks; everything when there are none."""
    total, lazy = cube.sizes[REALIZATION], REALIZATION in cube.chunksizes
    chunk = cube.chunksizes[REALIZATION][0] if lazy else total
    fits = cube.sizes["amplitude"] * cube.sizes["fmax"] * cube.sizes["start"]
    depth = chunk * max(1, int(FITS_A_SLAB / max(fits, 1)) // max(chunk, 1)) if lazy else total
    for first in range(0, max(total, 1), max(depth, 1)):
        yield slice(first, min(first + depth, total))


def _room(v: xr.Variable, total: int) -> tuple[tuple[str, ...], np.ndarray, dict[str, object]]:
    shape = tuple(total if dim == REALIZATION else n for dim, n in zip(v.dims, v.shape, strict=True))
    return tuple(map(str, v.dims)), np.empty(shape, dtype=v.dtype), v.attrs
