"""Reading and writing recordings; the file name extension determines the format."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path

from mcstudy.errors import RecordingError, StoreError
from mcstudy.files.json_files import own_folder
from mcstudy.files.local_path import local_path
from mcstudy.files.untrusted import json_document, real_bytes
from mcstudy.recordings.checks import check
from mcstudy.recordings.columns import ModelLike
from mcstudy.recordings.formats.netcdf_zarr import SHEET, read_dataset, write_csv, write_netcdf, write_zarr
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.guards import regular
from mcstudy.recordings.recording import EXPECTED, Recording
from mcstudy.recordings.refusals import refused

NETCDF = (".nc", ".nc4", ".h5")

NAMELESS = ("recording", "frf", "simulated")
"""Names that stand for none; such a recording has the name of its file."""


def read_recording(
    path: str | Path, data: str | Path | None = None, model: ModelLike | None = None
) -> Recording | FrfRecording:
    """Read a recording and check it.

    Parameters
    ----------
    path
        NetCDF (``.nc``, ``.nc4``, ``.h5``), Zarr (``.zarr``), or a description (``.toml``) of text files with columns;
        a ``.csv`` is read with the ``.toml`` of the same name.
    data
        Folder of the files that a ``.toml`` names; its own folder when None.
    model
        The declared model whose outputs the columns are, by name: a `mcstudy.Model`, its name, or its file, which then
        has the constants of the person recorded. None for a standing body, and for a recording that names its model.

    Returns
    -------
    Recording or FrfRecording
        Warnings about data quality are in its ``suspicions``; without a name it has that of its file. Whether
        channels are mislabelled is checked by `mcstudy.diagnose`, which estimates the responses.

    Raises
    ------
    RecordingError
        The recording cannot be used; one line that names file and field.
    """
    path = local_path(path)
    recording = _structure(path, None if data is None else Path(data), model)
    if recording.name in NAMELESS:
        recording = replace(recording, name=path.resolve().parent.name if path.name == SHEET else path.stem)
    if isinstance(recording, FrfRecording):
        return recording
    with refused(RecordingError, where=path):
        return replace(recording, suspicions=check(recording))


def _structure(path: Path, data: Path | None, model: ModelLike | None) -> Recording | FrfRecording:
    if not path.exists():
        raise RecordingError(f"{path}: no such file")
    regular(path)
    if path.suffix in (".csv", ".toml"):
        from mcstudy.recordings.assembly import read_sheet  # its parser takes longer to import than a file to read

        sheet = path.with_suffix(".toml")
        if not sheet.exists():
            raise RecordingError(
                f"{path}: expected {sheet.name} in the same folder, with rate, units, stimulus and body"
            )
        return read_sheet(sheet, data, model)
    if _holds(path, "study_cube"):
        raise RecordingError(f"{path}: this is a results cube (for mcstudy show and mcstudy report); {EXPECTED}")
    if path.is_dir() and path.suffix != ".zarr":
        raise RecordingError(f"{path}: this is a folder{_within(path)}; {EXPECTED}")
    if path.suffix in NETCDF or path.suffix == ".zarr":
        return read_dataset(path, model)
    raise RecordingError(f"{path}: expected a name ending in {', '.join(NETCDF)}, .zarr, .toml or .csv; {EXPECTED}")


def _within(folder: Path) -> str:
    """The recordings that a folder seems to hold, as a hint."""
    held = sorted(p.name for p in folder.iterdir() if p.suffix in (*NETCDF, ".zarr", ".toml"))
    return f" with {', '.join(held[:3])}{' ...' if len(held) > 3 else ''}" if held else ""


def _holds(path: Path, kind: str) -> bool:
    """Whether a Zarr store says of itself that it holds a "recording", or a "study_cube"."""
    with contextlib.suppress(OSError, StoreError, ValueError, LookupError, TypeError):
        schema = json_document(real_bytes(path / "zarr.json"))["attributes"]["schema"]
        return str(schema).startswith(f"mcstudy:{kind}:")
    return False


def write_recording(recording: Recording, path: str | Path) -> Path:
    """Write a recording.

    Parameters
    ----------
    recording
        With time series; an `FrfRecording` cannot be written.
    path
        NetCDF (``.nc``, ``.nc4``, ``.h5``), Zarr (``.zarr``) or, for a name without ending, a folder of CSV files with
        ``recording.toml``.

    Returns
    -------
    pathlib.Path
        What `mcstudy.read_recording` reads back.

    Raises
    ------
    RecordingError
        The ending is another one, or the path cannot be written.
    """
    path = local_path(path)
    if not path.parent.is_dir():
        raise RecordingError(f"{path}: cannot be written: {path.parent} is not a folder")
    try:
        if path.suffix in NETCDF:
            with refused(StoreError):
                write_netcdf(recording, path)
        elif path.suffix == ".zarr":
            if path.exists() and not _holds(path, "recording"):
                raise RecordingError(f"{path}: expected a new name or that of a recording, found something else")
            write_zarr(recording, path)
        elif path.suffix == "":
            own_folder(path, SHEET, "a recording of CSV files")
            return write_csv(recording, path)
        else:
            raise RecordingError(f"{path}: expected a name ending in {', '.join(NETCDF)}, .zarr or none (CSV folder)")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from error
    return path
