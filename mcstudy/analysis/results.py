"""Opening a results cube."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import mcstudy.analysis.registration  # noqa: F401 - results open with their .mc methods
from mcstudy.analysis.sweeps import together
from mcstudy.errors import StoreError
from mcstudy.files.local_path import local_path
from mcstudy.files.plain_errors import short
from mcstudy.study.cube.checked_store import CheckedStore
from mcstudy.study.cube.conversion import readable, text_attributes
from mcstudy.study.cube.replacement import settled
from mcstudy.study.cube.store import Cube, GroupStore

FITS_A_PIECE = 50_000
"""Fits per Dask chunk: about 5 MB of estimates, several times that while the best of them are found."""


FITS_IN_MEMORY = 1_000_000
"""Up to this number of fits, results are read at once by default: about 250 MB, several times faster than lazily."""


FITS_OF_TABLES = 200_000
"""The same for tables and pages, which read a larger cube in slabs: at 10^6 fits less than half of the memory."""


def open_for_tables(path: str | Path) -> xr.DataTree:
    """`open_results` for who reads all of a cube once: in memory only up to `FITS_OF_TABLES` fits."""
    return open_results(path, lazy=Cube.open(path).study.fits > FITS_OF_TABLES)


def open_results(path: str | Path, lazy: bool | None = True) -> xr.DataTree:
    """Open a results cube: one node per group, with its statistics as ``.mc``.

    Coordinates and constants (truth, bounds) are read at once. Results stay on disk until they are needed, so a cube
    may be larger than memory. Attributes that are objects (``design``, ``environment``) become JSON text, so that the
    tree can be written as NetCDF.

    Parameters
    ----------
    path
        The cube (``OUT`` of ``mcstudy run``).
    lazy
        True for Dask arrays, whose chunks are multiples of stored chunks; False to read results now; None for lazy
        above a million fits.

    Returns
    -------
    xarray.DataTree
        The arrays of each group (``results_schema/README.md``): ``estimate``, ``cost``, ``status``, …, with dims
        (amplitude, fmax, realization, start, …).

    Raises
    ------
    StoreError
        Not a cube, a cube of another schema version, or a damaged one.
    """
    path = local_path(path)
    return settled([path], lambda: _open(path, lazy))


def _open(path: Path, lazy: bool | None) -> xr.DataTree:
    cube = Cube.open(path)
    if lazy is None:
        lazy = cube.study.fits > FITS_IN_MEMORY
    # The store refuses links, chunks that declare an impossible size, and missing or swapped chunks. Other formats are
    # not considered.
    layouts = {name: store.stored for name, store in cube.groups.items()}
    guarded: Any = CheckedStore(path, layouts, cube.study.fingerprint)
    try:
        root = xr.open_datatree(guarded, engine="zarr", consolidated=False, zarr_format=3, chunks=None)
    except (AttributeError, KeyError, TypeError, ValueError) as error:  # Zarr's, about the copies in group metadata
        raise StoreError(f"{path}: damaged metadata ({short(str(error))}); mcstudy verify names the file") from None
    groups = {}
    for name, store in cube.groups.items():
        group, depth = store.layout.group, store.layout.realizations_a_chunk
        per_chunk = len(group.fmax) * group.starts * depth
        piece = depth * max(1, FITS_A_PIECE // per_chunk)
        data = root[name].to_dataset()
        if store.older:  # its second angle is none
            data = data.isel(angle=slice(1), angle_2=slice(1))
        if lazy:
            results = {k: data[k].chunk(amplitude=1, realization=piece) for k in store.layout.results}
            data = data.drop_vars(list(results)).load().assign(results)
        else:
            # Status first: if a run is writing, the fits that status reports as done are then in the other arrays.
            data.variables["status"].load()
            data = data.load()
        _check_constants(store, data)
        # the seed too, which only the root holds: it tells which groups of other cubes have the same noise
        groups[name] = readable(data[list(root[name].data_vars)]).assign_attrs(seed=cube.study.study.seed)
    tree = xr.DataTree.from_dict(together(groups))
    tree.attrs.update(text_attributes(root.attrs))
    return tree


def _check_constants(store: GroupStore, data: xr.Dataset) -> None:
    """Raise `StoreError` when a coordinate or constant differs from the study's; checksums do not detect swapped files.

    The last digits may differ, because another machine may round differently.
    """
    for name, spec in store.layout.arrays.items():
        if spec.values is None:
            continue
        stored, expected = data[name].values, np.asarray(spec.values)
        if expected.dtype.kind in "fc":
            same = np.allclose(stored, expected, rtol=1e-9, atol=0.0, equal_nan=True)
        else:
            same = bool((stored == expected).all())
        if not same:
            raise StoreError(f"{store.path / name}: expected the values of the study, found others")
