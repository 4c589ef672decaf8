"""Recordings as labelled datasets: NetCDF (through h5netcdf) and Zarr, written and read by xarray.

Dimensions ``trial, time, angle``; variables ``stimulus (trial, time)``, ``theta (trial, time, angle)``, ``amplitude
(trial)`` and ``samples (trial)``, the length of every trial (shorter ones are padded with nan). Files
without ``trial`` can also be read. `results_schema/1.0.0/recording.json` states the attributes.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from mcstudy.errors import ModelError, RecordingError
from mcstudy.files import schema
from mcstudy.files.durable import partial_name, replace_tree
from mcstudy.files.unfinished import unfinished
from mcstudy.recordings.checks import rate_of
from mcstudy.recordings.columns import NUMBER
from mcstudy.recordings.guards import LARGEST, check_hdf5, check_zarr
from mcstudy.recordings.recording import Recording, Trial, refuse_size
from mcstudy.recordings.units import factor
from mcstudy.stance.body import STIMULI, Body
from mcstudy.stance.feedback import ANGLES

BODY = ("J1", "J2", "C1", "C2", "A1", "A2", "g")

SHEET = "recording.toml"
"""Description of the CSV files in a folder."""


def to_dataset(recording: Recording) -> xr.Dataset:
    """The recording as a dataset, angles in rad."""
    n = max(t.samples for t in recording.trials)
    stimulus = np.full((len(recording.trials), n), np.nan)
    theta = np.full((len(recording.trials), n, 2), np.nan)
    for k, trial in enumerate(recording.trials):
        stimulus[k, : trial.samples] = trial.stimulus
        theta[k, : trial.samples] = trial.theta
    stated = [np.nan if t.amplitude is None else t.amplitude for t in recording.trials]
    unit = recording.stimulus_unit
    attrs: dict[str, Any] = {
        "schema": schema.identifier("recording"),
        "name": recording.name,
        "provenance": recording.provenance,
        "rate_hz": recording.rate_hz,
        "stimulus_kind": recording.stimulus,
        "convention": recording.convention,
        "body": json.dumps(asdict(recording.body)),
    }
    if recording.period_s is not None:
        attrs["period_s"] = recording.period_s
    dataset = xr.Dataset(
        {
            "stimulus": (("trial", "time"), stimulus, {"units": unit, "long_name": recording.stimulus}),
            "theta": (("trial", "time", "angle"), theta, {"units": "rad", "long_name": "joint angles"}),
            "amplitude": ("trial", np.array(stated), {"units": unit, "long_name": "stated stimulus amplitude"}),
            "samples": ("trial", np.array([t.samples for t in recording.trials]), {"long_name": "length of the trial"}),
        },
        coords={
            "trial": np.arange(1, len(recording.trials) + 1),
            "time": ("time", np.arange(n) / recording.rate_hz, {"units": "s", "long_name": "time"}),
            "angle": list(ANGLES),
        },
        attrs=attrs,
    )
    schema.validate("recording", header(dataset), recording.name)
    return dataset


def header(dataset: xr.Dataset) -> dict[str, Any]:
    """The part of a dataset that the schema describes: sizes, variables (dims, dtype, units), attributes."""
    return {
        "sizes": {str(k): int(v) for k, v in dataset.sizes.items()},
        "variables": {
            str(name): {
                "dims": list(map(str, v.dims)),
                "dtype": str(v.dtype),
                **({"units": v.attrs["units"]} if "units" in v.attrs else {}),
            }
            for name, v in dataset.data_vars.items()
        },
        "attrs": dict(dataset.attrs),
    }


def write_netcdf(recording: Recording, path: str | Path) -> None:
    """Write a NetCDF-4 file; an existing one is replaced."""
    path = Path(path)
    partial = partial_name(path)
    with unfinished(partial, partial.touch):
        to_dataset(recording).to_netcdf(partial, engine="h5netcdf")
        partial.replace(path)


def write_zarr(recording: Recording, path: str | Path) -> None:
    """Write a Zarr v3 store of fixed-length types; an existing one is replaced."""
    path, dataset = Path(path), to_dataset(recording)
    # Strings have no Zarr v3 specification yet: the names of the angles go into an attribute.
    dataset = dataset.drop_vars("angle").assign_attrs(angles=list(ANGLES))
    partial = partial_name(path)
    with unfinished(partial, partial.mkdir):
        dataset.to_zarr(partial, mode="w", zarr_format=3, consolidated=False)
        if path.exists():
            replace_tree(path, partial)
        else:
            partial.rename(path)


def write_csv(recording: Recording, folder: str | Path) -> Path:
    """Write ``recording.toml`` and one CSV per trial into a folder; returns the path of the TOML file."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    body = ", ".join(f"{n} = {getattr(recording.body, n)!r}" for n in BODY)
    lines = [
        f"name = {json.dumps(recording.name)}",
        f"provenance = {json.dumps(recording.provenance)}",
        f"rate_hz = {recording.rate_hz!r}",
        *([f"period_s = {recording.period_s!r}"] if recording.period_s is not None else []),
        f'stimulus = "{recording.stimulus}"',
        f'convention = "{recording.convention}"',
        f'units = {{time = "s", stimulus = "{recording.stimulus_unit}", angle = "deg"}}',
        f"body = {{{body}}}",
    ]
    for k, trial in enumerate(recording.trials, start=1):
        name = f"trial{k}.csv"
        lines += ["", "[[trials]]", f'file = "{name}"']
        lines += [f"amplitude = {trial.amplitude!r}"] if trial.amplitude is not None else []
        time = np.arange(trial.samples) / recording.rate_hz
        table = np.column_stack([time, trial.stimulus, np.rad2deg(trial.theta)])
        header = "time,stimulus,theta1,theta2"
        np.savetxt(folder / name, table, fmt="%.12g", delimiter=",", header=header, comments="")
    path = folder / SHEET
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def read_dataset(path: str | Path) -> Recording:
    """Read a NetCDF file or a Zarr store (by its name's ending); structure and units, `RecordingError` otherwise."""
    path = Path(path)
    # No indexes, because building one would read a coordinate before its size is checked.
    options: dict[str, Any] = {
        "decode_times": False,
        "decode_timedelta": False,
        "create_default_indexes": False,
    }
    try:
        if path.suffix == ".zarr" or path.is_dir():
            from mcstudy.files.guarded_store import GuardedStore  # imports Zarr, which NetCDF does not need

            check_zarr(path)
            store: Any = GuardedStore(path, read_only=True)
            dataset = xr.open_zarr(store, consolidated=False, zarr_format=3, chunks=None, **options)
        else:
            check_hdf5(path)
            dataset = xr.open_dataset(path, engine="h5netcdf", **options)
        with dataset:
            return from_dataset(dataset, str(path))
    except RecordingError:
        raise
    except Exception as error:  # the libraries raise different errors for files that are not recordings
        reason = (str(error).splitlines() or [type(error).__name__])[0][:300]
        raise RecordingError(f"{path}: expected NetCDF or Zarr: {reason}") from error


def from_dataset(dataset: xr.Dataset, where: str = "dataset") -> Recording:
    """A recording from a dataset, opened lazily or in memory; `RecordingError` names what is missing or wrong."""
    stimulus = _variable(dataset, "stimulus", ("time",), where)
    theta = _variable(dataset, "theta", ("time", "angle"), where)
    for dim, size in {"trial": stimulus.sizes["trial"], "time": stimulus.sizes["time"], "angle": 2}.items():
        if theta.sizes[dim] != size:
            raise RecordingError(f"{where}: theta: expected {size} along {dim}, got {theta.sizes[dim]}")
    named = tuple(map(str, theta["angle"].values)) if "angle" in theta.coords else ANGLES
    if named != ANGLES:
        raise RecordingError(f"{where}: angle: expected {', '.join(ANGLES)}, got {', '.join(named)}")
    attrs = dataset.attrs
    kind = str(_attribute(attrs, "stimulus_kind", where))
    if kind not in STIMULI:
        raise RecordingError(f"{where}: stimulus_kind: expected one of {', '.join(STIMULI)}, got {kind!r}")
    count, length = stimulus.sizes["trial"], stimulus.sizes["time"]
    refuse_size(count, 0, where)
    samples = _per_trial(dataset, "samples", count, float(length), where)
    for k, n in enumerate(samples, start=1):
        if not (1 <= n <= length and n == round(n)):
            raise RecordingError(f"{where}: samples: trial {k} states {n:g} of {length}")
    refuse_size(count, int(samples.sum()), where)
    u = _values(stimulus, where) * factor(
        str(stimulus.attrs.get("units", "missing")), STIMULI[kind], f"{where}: stimulus"
    )
    y = _values(theta, where) * factor(str(theta.attrs.get("units", "missing")), "rad", f"{where}: theta")
    stated = _per_trial(dataset, "amplitude", count, np.nan, where)
    trials = [
        Trial(u[k, :n], y[k, :n], None if np.isnan(stated[k]) else float(stated[k]))
        for k, n in enumerate(samples.astype(int))
    ]
    period = attrs.get("period_s")
    try:
        return Recording(
            tuple(trials),
            _rate(dataset, attrs, where),
            None if period is None else _number(period, "period_s", where),
            kind,
            _body(attrs, where),
            str(attrs.get("convention", "peak")),
            str(attrs.get("name", Path(where).stem)),
            str(attrs.get("provenance", "")),
        )
    except RecordingError as error:
        raise RecordingError(str(error) if str(error).startswith(where) else f"{where}: {error}") from error


def _variable(dataset: xr.Dataset, name: str, dims: tuple[str, ...], where: str) -> xr.DataArray:
    if name not in dataset:
        raise RecordingError(f"{where}: {name}: missing; found {', '.join(map(str, dataset.data_vars)) or 'nothing'}")
    array = dataset[name]
    if array.dtype.kind not in "fiu":
        raise RecordingError(f"{where}: {name}: expected numbers, got {array.dtype}")
    if "trial" not in array.dims:
        array = array.expand_dims("trial")
    if set(array.dims) != {"trial", *dims}:
        raise RecordingError(f"{where}: {name}: expected dimensions trial, {', '.join(dims)}, got {array.dims}")
    chunks = array.encoding.get("chunks") or array.encoding.get("chunksizes") or ()
    declared = 8 * max(array.size, math.prod(int(c) for c in chunks))
    if declared > LARGEST:
        raise RecordingError(f"{where}: {name}: declares {declared} bytes; expected less than {LARGEST}")
    if array.size == 0:
        raise RecordingError(f"{where}: {name}: empty")
    return array.transpose("trial", *dims)


def _values(array: xr.DataArray, where: str) -> np.ndarray:
    try:
        return np.asarray(array.values, dtype=float)
    except (OSError, ValueError, RuntimeError, KeyError, MemoryError) as error:
        raise RecordingError(f"{where}: {array.name}: cannot be read: {str(error).splitlines()[0]}") from error


def _per_trial(dataset: xr.Dataset, name: str, n: int, default: float, where: str) -> np.ndarray:
    if name not in dataset:
        return np.full(n, default)
    array = dataset[name]
    if array.dtype.kind not in "fiu" or array.size != n:
        raise RecordingError(f"{where}: {name}: expected one number per trial ({n})")
    return np.asarray(array.values, dtype=float).ravel()


def _attribute(attrs: dict[Any, Any], name: str, where: str) -> Any:
    if name not in attrs:
        raise RecordingError(f"{where}: attribute {name!r} is missing; found {', '.join(map(str, attrs)) or 'none'}")
    return attrs[name]


def _number(value: Any, name: str, where: str) -> float:
    try:
        if isinstance(value, str) and not NUMBER.fullmatch(value.strip()):
            raise ValueError
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise RecordingError(f"{where}: {name}: expected a number, got {value!r}"[:300]) from None


def _rate(dataset: xr.Dataset, attrs: dict[Any, Any], where: str) -> float:
    stated = None if "rate_hz" not in attrs else _number(attrs["rate_hz"], "rate_hz", where)
    if "time" not in dataset.coords or dataset["time"].dtype.kind != "f":
        if stated is None:
            raise RecordingError(f"{where}: rate_hz: expected an attribute or a time coordinate in s")
        return stated
    time = np.asarray(dataset["time"].values, dtype=float)
    unit = str(dataset["time"].attrs.get("units", "s"))
    return rate_of(time * factor(unit, "s", f"{where}: time"), stated, where)


def _body(attrs: dict[Any, Any], where: str) -> Body:
    text = _attribute(attrs, "body", where)
    try:
        given = json.loads(text) if isinstance(text, str) else dict(text)
        named = {n: given[n] for n in BODY if n in given or n != "g"}
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{where}: body: expected JSON with {', '.join(BODY)}: {error!r}") from error
    try:
        return Body(**{n: _number(v, f"body.{n}", where) for n, v in named.items()})
    except ModelError as error:
        raise RecordingError(f"{where}: {error}") from error
