"""Opening a results cube."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import xarray as xr

from mcstudy.study.store import Cube


def open_results(path: str | Path, chunks: Any = "auto") -> xr.DataTree:
    """A results cube as an `xarray.DataTree`, one node a group of the study.

    Nothing is read but coordinates until values are asked for, so a cube may be larger than memory.

    Parameters
    ----------
    path: the cube (``OUT`` of ``mcstudy run``).
    chunks: passed to xarray; "auto" gives Dask arrays of whole stored chunks, None plain lazy arrays.

    Raises
    ------
    StoreError: not a cube, or one of another schema version.
    """
    path = Path(path)
    Cube.open(path)
    return xr.open_datatree(path, engine="zarr", consolidated=False, chunks=chunks)
