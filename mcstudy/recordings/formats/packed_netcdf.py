"""NetCDF files whose values need decoding (scales, offsets, fill values), which xarray does in a process of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from mcstudy.files.reading_process import Answer
from mcstudy.recordings.formats.hdf5 import plain


def netcdf(path: Path) -> Answer:
    """As `mcstudy.recordings.formats.hdf5.netcdf`."""
    with _opened(path) as dataset:
        variables = []
        for name, v in dataset.variables.items():
            kind = v.dtype.str if v.dtype.kind in "fiub" else "O"
            chunk = v.encoding.get("chunksizes") or ()
            variables.append([str(name), list(map(str, v.dims)), v.shape, kind, chunk, plain(v.attrs)])
        return [variables, plain(dataset.attrs)], []


def values(path: Path, name: str) -> Answer:
    """As `mcstudy.recordings.formats.hdf5.values`."""
    with _opened(path) as dataset:
        array = np.asarray(dataset.variables[name].values)
        return (None, [array]) if array.dtype.kind in "fiub" else (array.astype(str).tolist(), [])


def _opened(path: Path) -> xr.Dataset:
    # No indexes, because building one would read a coordinate before its size is checked.
    return xr.open_dataset(
        path, engine="h5netcdf", decode_times=False, decode_timedelta=False, create_default_indexes=False
    )
