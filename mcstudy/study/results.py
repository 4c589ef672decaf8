"""Opening a results cube."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import mcstudy.accessors  # noqa: F401 - results open with their .mc methods
from mcstudy.errors import StoreError
from mcstudy.study.checksums import CheckedStore
from mcstudy.study.readable import readable, text_attributes
from mcstudy.study.store import Cube, GroupStore

FITS_A_PIECE = 200_000
"""Fits in one Dask chunk: about 20 MB of estimates, a few tens of pieces for millions of fits."""


FITS_IN_MEMORY = 1_000_000
"""Fits that are read whole when nothing is said: about 250 MB, and several times as fast as lazily."""


def open_results(path: str | Path, lazy: bool | None = True) -> xr.DataTree:
    """A results cube as an `xarray.DataTree`, one node a group of the study, ``.mc`` its statistics.

    Coordinates and constants (truth, bounds) are read at once; results stay on disk until they are asked for, so a
    cube may be larger than memory. Attributes that are objects (``design``, ``environment``) are JSON text, so that all
    of it can be written as NetCDF.

    Parameters
    ----------
    path: the cube (``OUT`` of ``mcstudy run``).
    lazy: whether results are Dask arrays, in pieces of whole stored chunks; else they are read now. None: lazy from
        `FITS_IN_MEMORY` fits on.

    Raises
    ------
    StoreError: not a cube, or one of another schema version.
    """
    path = Path(path)
    cube = Cube.open(path)
    if lazy is None:
        lazy = cube.study.fits > FITS_IN_MEMORY
    # The store refuses links, chunks that claim to be larger than any study's, and chunks that are missing or another
    # one's; other formats are not looked for.
    layouts = {name: store.layout for name, store in cube.groups.items()}
    guarded: Any = CheckedStore(path, layouts, cube.study.fingerprint)
    root = xr.open_datatree(guarded, engine="zarr", consolidated=False, zarr_format=3, chunks=None)
    groups = {}
    for name, store in cube.groups.items():
        group, depth = store.layout.group, store.layout.realizations_a_chunk
        per_chunk = len(group.fmax) * group.starts * depth
        piece = depth * max(1, FITS_A_PIECE // per_chunk)
        data = root[name].to_dataset()
        if lazy:
            results = {k: data[k].chunk(amplitude=1, realization=piece) for k in store.layout.results}
            data = data.drop_vars(list(results)).load().assign(results)
        else:
            # Status first: a run may be writing, and what it says was done is then in the other arrays.
            data.variables["status"].load()
            data = data.load()
        _check_constants(store, data)
        # the seed too, which the root alone holds: it says which groups of other cubes had the same noise
        groups[name] = readable(data[list(root[name].data_vars)]).assign_attrs(seed=cube.study.study.seed)
    tree = xr.DataTree.from_dict(groups)
    tree.attrs.update(text_attributes(root.attrs))
    return tree


def _check_constants(store: GroupStore, data: xr.Dataset) -> None:
    """Raise `StoreError` when a coordinate or constant is not the study's: no checksum tells a file in another's place.

    Another machine may have rounded the last digits in another way.
    """
    for name, spec in store.layout.arrays.items():
        if spec.values is None:
            continue
        found, expected = data[name].values, np.asarray(spec.values)
        if expected.dtype.kind in "fc":
            same = np.allclose(found, expected, rtol=1e-9, atol=0.0, equal_nan=True)
        else:
            same = bool((found == expected).all())
        if not same:
            raise StoreError(f"{store.path / name}: expected the values of the study, found others")
