"""Reading and writing recordings; the file name extension determines the format."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mcstudy.errors import RecordingError
from mcstudy.recordings.checks import check
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.guards import regular
from mcstudy.recordings.netcdf_zarr import read_dataset, write_csv, write_netcdf, write_zarr
from mcstudy.recordings.recording import Recording
from mcstudy.recordings.sheet import read_sheet

NETCDF = (".nc", ".nc4", ".h5")


def read_recording(path: str | Path, data: str | Path | None = None) -> Recording | FrfRecording:
    """A checked recording from NetCDF (.nc), Zarr (.zarr), or a TOML file (.toml, or a .csv with one in the same
    folder).

    Parameters
    ----------
    data: folder of the files a TOML file names; its own folder when None.

    Data quality warnings are in ``suspicions``. The diagnosis, which estimates the responses, checks whether channels
    are mislabelled. Raises `RecordingError`, one line that names file and field.
    """
    path = Path(path)
    recording = _structure(path, None if data is None else Path(data))
    if isinstance(recording, FrfRecording):
        return recording
    try:
        return replace(recording, suspicions=check(recording))
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


def _structure(path: Path, data: Path | None) -> Recording | FrfRecording:
    if not path.exists():
        raise RecordingError(f"{path}: no such file")
    regular(path)
    if path.suffix == ".csv":
        sheet = path.with_suffix(".toml")
        if not sheet.exists():
            raise RecordingError(
                f"{path}: expected {sheet.name} in the same folder, with rate, units, stimulus and body"
            )
        return read_sheet(sheet, data)
    if path.suffix == ".toml":
        return read_sheet(path, data)
    if path.suffix in NETCDF or path.suffix == ".zarr":
        return read_dataset(path)
    raise RecordingError(f"{path}: expected a name ending in {', '.join(NETCDF)}, .zarr, .toml or .csv")


def write_recording(recording: Recording, path: str | Path) -> Path:
    """Write NetCDF (.nc), Zarr (.zarr) or, for a name without ending, a folder of CSV with ``recording.toml``.

    Returns the path to read it back from. Raises `RecordingError` for another ending or an unwritable path.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise RecordingError(f"{path}: cannot be written: {path.parent} is not a folder")
    try:
        if path.suffix in NETCDF:
            write_netcdf(recording, path)
        elif path.suffix == ".zarr":
            write_zarr(recording, path)
        elif path.suffix == "":
            return write_csv(recording, path)
        else:
            raise RecordingError(f"{path}: expected a name ending in {', '.join(NETCDF)}, .zarr or none (CSV folder)")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from error
    return path
