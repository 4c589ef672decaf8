"""Recordings as labelled datasets: NetCDF (through h5netcdf) and Zarr, written by xarray.

xarray also reads Zarr and packed NetCDF. A NetCDF file whose numbers are stored as they are, which is how recordings
are written here, is read by h5netcdf alone: importing xarray takes as long as a third of a fast diagnosis. NetCDF is
opened in a process of its own only (`mcstudy.files.reading_process`).

Dimensions ``trial, time, angle``; variables ``stimulus (trial, time)``, ``theta (trial, time, angle)``, ``amplitude
(trial)`` and ``samples (trial)``, the length of every trial (shorter ones are padded with nan). Files
without ``trial`` can also be read. `results_schema/1.0.0/recording.json` states the attributes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial as bound
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mcstudy.errors import ModelError, RecordingError
from mcstudy.files import schema
from mcstudy.files.delimited import NUMBER
from mcstudy.files.durable import partial_name, replace_tree
from mcstudy.files.json_files import write_text
from mcstudy.files.output import write_file
from mcstudy.files.reading_process import answer
from mcstudy.files.unfinished import unfinished
from mcstudy.recordings.clock import rate_of
from mcstudy.recordings.columns import Columns, ModelLike, model_of
from mcstudy.recordings.guards import LARGEST, check_zarr
from mcstudy.recordings.recording import Recording, Trial, refuse_size
from mcstudy.recordings.refusals import UNREAD, first_line, refused, require_known
from mcstudy.recordings.units import factor
from mcstudy.stance.body import STIMULI, Body
from mcstudy.stance.feedback import ANGLES, Model

if TYPE_CHECKING:
    import xarray as xr

BODY = ("J1", "J2", "C1", "C2", "A1", "A2", "g")

TEXTS = ("convention", "name", "provenance", "person", "condition")
"""Attributes that are text."""

SHEET, MODEL = "recording.toml", "model.toml"
"""Description of the CSV files in a folder, and the declared model whose outputs they hold."""


def to_dataset(recording: Recording) -> xr.Dataset:
    """The recording as a dataset, angles of a standing body in rad."""
    import xarray as xr

    n = max(t.samples for t in recording.trials)
    stimulus = np.full((len(recording.trials), n), np.nan)
    columns = recording.columns
    theta = np.full((len(recording.trials), n, len(columns.outputs)), np.nan)
    for k, trial in enumerate(recording.trials):
        stimulus[k, : trial.samples] = trial.stimulus
        theta[k, : trial.samples] = trial.theta
    stated = np.array([np.nan if t.amplitude is None else t.amplitude for t in recording.trials], dtype=float)
    unit, model = columns.stimulus_unit, recording.model
    attrs: dict[str, Any] = {
        "schema": schema.identifier("recording"),
        "name": recording.name,
        "provenance": recording.provenance,
        "rate_hz": recording.rate_hz,
        "stimulus_kind": recording.stimulus,
        "convention": recording.convention,
        **({"body": json.dumps(asdict(recording.body))} if model is None else {"model": json.dumps(_table(model))}),
        **({"constants": json.dumps(dict(recording.constants))} if recording.constants else {}),
        **_stated(recording),
    }
    measured = "joint angles" if model is None else f"outputs of {model.name}"
    dataset = xr.Dataset(
        {
            "stimulus": (("trial", "time"), stimulus, {"units": unit, "long_name": recording.stimulus}),
            "theta": (("trial", "time", "angle"), theta, {"units": columns.unit, "long_name": measured}),
            "amplitude": ("trial", stated, {"units": unit, "long_name": "stated stimulus amplitude"}),
            "samples": ("trial", np.array([t.samples for t in recording.trials]), {"long_name": "length of the trial"}),
        },
        coords={
            "trial": np.arange(1, len(recording.trials) + 1),
            "time": ("time", np.arange(n) / recording.rate_hz, {"units": "s", "long_name": "time"}),
            "angle": list(columns.outputs),
        },
        attrs=attrs,
    )
    schema.validate("recording", header(dataset), recording.name)
    return dataset


def _table(model: Model) -> dict[str, Any]:
    """The table of a model as a file holds it."""
    from mcstudy.models.record import table_of  # pydantic, which recordings of standing bodies do without

    return table_of(model)


def _stated(recording: Recording) -> dict[str, Any]:
    """What need not be stated of a recording, where it is."""
    optional = {n: getattr(recording, n) for n in ("period_s", "person", "condition")}
    return {n: value for n, value in optional.items() if value not in (None, "")}


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
    """Write a NetCDF-4 file; an existing one is replaced. Raises `StoreError` where it cannot be written."""
    write_file(path, lambda: netcdf_bytes(to_dataset(recording)))


def netcdf_bytes(dataset: xr.Dataset, encoding: dict[str, Any] | None = None) -> bytes:
    """A dataset as a NetCDF-4 file, made in memory: where a disk is full, HDF5 ends the process that writes to it."""
    return bytes(dataset.to_netcdf(engine="h5netcdf", encoding=encoding))


def write_zarr(recording: Recording, path: str | Path) -> None:
    """Write a Zarr v3 store of fixed-length types; an existing one is replaced."""
    path, dataset = Path(path), to_dataset(recording)
    # Strings have no Zarr v3 specification yet: the names of the angles go into an attribute.
    dataset = dataset.drop_vars("angle").assign_attrs(angles=list(recording.columns.outputs))
    partial = partial_name(path)
    with unfinished(partial, partial.mkdir):
        dataset.to_zarr(partial, mode="w", zarr_format=3, consolidated=False)
        if path.exists():
            replace_tree(path, partial)
        else:
            partial.rename(path)


def write_csv(recording: Recording, folder: str | Path) -> Path:
    """Write ``recording.toml`` and one CSV per trial into a folder; returns the path of the TOML file.

    A declared model is written beside them.
    """
    folder, columns, model = Path(folder), recording.columns, recording.model
    if model is None:
        body = ", ".join(f"{n} = {getattr(recording.body, n)!r}" for n in BODY)
        subject, unit = [f'stimulus = "{recording.stimulus}"', f"body = {{{body}}}"], "deg"
    else:
        from mcstudy.models.catalogue import written
        from mcstudy.models.record import ModelTable

        table = ModelTable.of(model).model_copy(update={"constants": dict(recording.constants)})
        write_text(folder / MODEL, written(table))
        constants = ", ".join(f"{n} = {x!r}" for n, x in recording.constants.items())
        subject, unit = (
            [f'model = "{MODEL}"', *([f"constants = {{{constants}}}"] if constants else [])],
            columns.units[0],
        )
    angle = factor("rad", unit, "angle") if model is None else 1.0
    units = f', angle = "{unit}"' if len(set(columns.units)) == 1 else ""
    lines = [
        f"name = {json.dumps(recording.name)}",
        f"provenance = {json.dumps(recording.provenance)}",
        *(f"{n} = {json.dumps(value)}" for n, value in _stated(recording).items()),
        f"rate_hz = {recording.rate_hz!r}",
        *subject,
        f'convention = "{recording.convention}"',
        f'units = {{time = "s", stimulus = {json.dumps(columns.stimulus_unit)}{units}}}',
    ]
    for k, trial in enumerate(recording.trials, start=1):
        name = f"trial{k}.csv"
        lines += ["", "[[trials]]", f'file = "{name}"']
        lines += [f"amplitude = {trial.amplitude!r}"] if trial.amplitude is not None else []
        values = np.column_stack([np.arange(trial.samples) / recording.rate_hz, trial.stimulus, trial.theta * angle])
        rows = [",".join(f"{x:.12g}" for x in row) for row in values.tolist()]
        write_text(folder / name, "\n".join([",".join(("time", "stimulus", *columns.outputs)), *rows]))
    path = folder / SHEET
    write_text(path, "\n".join(lines))
    return path


@dataclass(frozen=True)
class Variable:
    """A variable of a file. Its dims, shape, dtype and attributes are known, its values are read on demand.

    ``chunk``: shape of the pieces it is stored in, empty if it is stored in one.
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype
    attrs: Mapping[str, Any]
    chunk: tuple[int, ...]
    read: Callable[[], np.ndarray]

    @property
    def sizes(self) -> dict[str, int]:
        """Length along every dimension; one trial where the file has no trials."""
        return {"trial": 1, **dict(zip(self.dims, self.shape, strict=True))}

    def along(self, *dims: str) -> np.ndarray:
        """The values with these dims, among which are all of its own; one trial where the file has no trials."""
        values, stored_dims = np.asarray(self.read()), self.dims
        if "trial" not in stored_dims:
            values, stored_dims = values[None], ("trial", *stored_dims)
        return values.transpose([stored_dims.index(d) for d in dims])


@dataclass(frozen=True)
class Labelled:
    """The variables and attributes of a file."""

    variables: Mapping[str, Variable]
    attrs: Mapping[str, Any]

    def coordinate(self, name: str) -> Variable | None:
        """The coordinate of a dimension; None where there is none."""
        variable = self.variables.get(name)
        return variable if variable is not None and variable.dims == (name,) else None


def read_dataset(path: str | Path, model: ModelLike | None = None) -> Recording:
    """Read a NetCDF file or a Zarr store (by its name's ending); structure and units, `RecordingError` otherwise.

    ``model``: the declared one of which these are outputs, in place of the one in the file.
    """
    path = Path(path)
    try:
        if path.suffix == ".zarr" or path.is_dir():
            check_zarr(path)
            return _by_xarray(path, model)
        return _recording(_of_netcdf(path), str(path), model)
    except RecordingError:
        raise
    except Exception as error:  # the libraries raise different errors for files that are not recordings
        raise RecordingError(f"{path}: expected NetCDF or Zarr: {first_line(error)}") from error


def _of_netcdf(path: Path) -> Labelled:
    reader = "mcstudy.recordings.formats.hdf5"
    listing, _ = answer(f"{reader}:netcdf", path)
    if listing is None:
        reader = "mcstudy.recordings.formats.packed_netcdf"
        listing, _ = answer(f"{reader}:netcdf", path)
    variables, attrs = listing

    def values(name: str, size: int) -> np.ndarray:
        texts, arrays = answer(f"{reader}:values", path, name, expected=8 * size)
        return arrays[0] if arrays else np.asarray(texts)

    by_name = {}
    for name, dims, shape, kind, chunk, stated in variables:
        read = bound(values, name, math.prod(shape))
        by_name[name] = Variable(name, tuple(dims), tuple(shape), np.dtype(kind), stated, tuple(chunk), read)
    return Labelled(by_name, attrs)


def _by_xarray(path: Path, model: ModelLike | None) -> Recording:
    import xarray as xr

    from mcstudy.files.guarded_store import GuardedStore  # imports Zarr, which NetCDF does not need

    # No indexes, because building one would read a coordinate before its size is checked.
    options: dict[str, Any] = {"decode_times": False, "decode_timedelta": False, "create_default_indexes": False}
    store: Any = GuardedStore(path, read_only=True)
    with xr.open_zarr(store, consolidated=False, zarr_format=3, chunks=None, **options) as dataset:
        return _recording(_of_xarray(dataset), str(path), model)


def _of_xarray(dataset: xr.Dataset) -> Labelled:
    def values(variable: xr.Variable) -> np.ndarray:
        return np.asarray(variable.values)

    def lazy(name: str, v: xr.Variable) -> Variable:
        chunk = v.encoding.get("chunks") or ()
        return Variable(name, tuple(map(str, v.dims)), v.shape, v.dtype, v.attrs, tuple(chunk), bound(values, v))

    return Labelled({str(name): lazy(str(name), v) for name, v in dataset.variables.items()}, dict(dataset.attrs))


def _recording(file: Labelled, where: str, given: ModelLike | None) -> Recording:
    """The recording in a file; `RecordingError` names what is missing or wrong."""
    attrs = file.attrs
    constants = _constants(attrs, where)
    model = model_of(given, constants=constants) or _model(attrs, where)
    kind = "" if model is not None else str(_attribute(attrs, "stimulus_kind", where))
    if model is None:
        require_known(kind, STIMULI, f"{where}: stimulus_kind")
    columns = Columns.of(model, kind)
    stimulus = _variable(file, "stimulus", ("time",), where)
    theta = _variable(file, "theta", ("time", "angle"), where)
    count, length = stimulus.sizes["trial"], stimulus.sizes["time"]
    angle = file.coordinate("angle")
    named = tuple(map(str, attrs.get("angles", columns.outputs) if angle is None else angle.read()))
    for dim, size in {"trial": count, "time": length, "angle": len(named)}.items():
        if theta.sizes[dim] != size:
            raise RecordingError(f"{where}: theta: expected {size} along {dim}, got {theta.sizes[dim]}")
    if model is None and named != ANGLES:
        raise RecordingError(f"{where}: angle: expected {', '.join(ANGLES)}, got {', '.join(named)}")
    at = list(range(len(named))) if model is None else columns.places(named, where, model)
    refuse_size(count, count * length, where)
    samples = _per_trial(file, "samples", count, float(length), where)
    for k, n in enumerate(samples, start=1):
        if not (1 <= n <= length and n == round(n)):
            raise RecordingError(f"{where}: samples: trial {k} states {n:g} of {length}")
    refuse_size(count, int(samples.sum()), where)
    u = _values(stimulus, ("trial", "time"), where) * factor(
        str(stimulus.attrs.get("units", "missing")), columns.stimulus_unit, f"{where}: stimulus"
    )
    y = _values(theta, ("trial", "time", "angle"), where)[..., at]
    stated_units = str(theta.attrs.get("units", "missing"))
    if stated_units != columns.unit or len(set(columns.units)) == 1:  # units that differ are stated as one text
        y = y * np.array([factor(stated_units, unit, f"{where}: theta") for unit in columns.units])
    stated = _per_trial(file, "amplitude", count, np.nan, where)
    trials = [
        Trial(u[k, :n], y[k, :n], None if np.isnan(stated[k]) else float(stated[k]))
        for k, n in enumerate(samples.astype(int))
    ]
    period = attrs.get("period_s")
    texts: dict[str, Any] = {"name": Path(where).stem} | {n: str(attrs[n]) for n in TEXTS if n in attrs}
    with refused(RecordingError, where=where):
        return Recording(
            tuple(trials),
            _rate(file, where),
            None if period is None else _number(period, "period_s", where),
            kind,
            Body() if model is not None else _body(attrs, where),
            **texts,
            model=model,
            constants=constants,
        )


def _constants(attrs: Mapping[str, Any], where: str) -> dict[str, float]:
    """Numbers of the person that the declared model took."""
    try:
        return {str(n): float(x) for n, x in json.loads(str(attrs.get("constants", "{}"))).items()}
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise RecordingError(f"{where}: constants: expected JSON with numbers: {first_line(error)}") from None


def _model(attrs: Mapping[str, Any], where: str) -> Model | None:
    """The declared model in a file, None for a standing body."""
    if "model" not in attrs:
        return None
    from mcstudy.models.catalogue import checked_table

    try:
        table = json.loads(str(attrs["model"]))
        if not isinstance(table, dict):
            raise ValueError("not a table")
        return checked_table(table).model()
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"{where}: model: {first_line(error)}") from None


def _variable(file: Labelled, name: str, dims: tuple[str, ...], where: str) -> Variable:
    if name not in file.variables:
        others = ", ".join(n for n in file.variables if file.coordinate(n) is None)
        raise RecordingError(f"{where}: {name}: missing; found {others or 'nothing'}")
    variable = file.variables[name]
    if variable.dtype.kind not in "fiu":
        raise RecordingError(f"{where}: {name}: expected numbers, got {variable.dtype}")
    if {"trial", *variable.dims} != {"trial", *dims} or len(set(variable.dims)) < len(variable.dims):
        raise RecordingError(f"{where}: {name}: expected dimensions trial, {', '.join(dims)}, got {variable.dims}")
    declared = 8 * max(math.prod(variable.shape), math.prod(int(c) for c in variable.chunk))
    if declared > LARGEST:
        raise RecordingError(f"{where}: {name}: declares {declared} bytes; expected less than {LARGEST}")
    if 0 in variable.shape:
        raise RecordingError(f"{where}: {name}: empty")
    return variable


def _values(variable: Variable, dims: tuple[str, ...], where: str) -> np.ndarray:
    try:
        return np.asarray(variable.along(*dims), dtype=float)
    except UNREAD as error:
        raise RecordingError(f"{where}: {variable.name}: cannot be read: {first_line(error)}") from error


def _per_trial(file: Labelled, name: str, n: int, default: float, where: str) -> np.ndarray:
    variable = file.variables.get(name)
    if variable is None:
        return np.full(n, default)
    if variable.dtype.kind not in "fiu" or math.prod(variable.shape) != n:
        raise RecordingError(f"{where}: {name}: expected one number per trial ({n})")
    return np.asarray(variable.read(), dtype=float).ravel()


def _attribute(attrs: Mapping[str, Any], name: str, where: str) -> Any:
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


def _rate(file: Labelled, where: str) -> float:
    stated = None if "rate_hz" not in file.attrs else _number(file.attrs["rate_hz"], "rate_hz", where)
    time = file.coordinate("time")
    if time is None or time.dtype.kind != "f":
        if stated is None:
            raise RecordingError(f"{where}: rate_hz: expected an attribute or a time coordinate in s")
        return stated
    unit = str(time.attrs.get("units", "s"))
    return rate_of(np.asarray(time.read(), dtype=float) * factor(unit, "s", f"{where}: time"), stated, where)


def _body(attrs: Mapping[str, Any], where: str) -> Body:
    text = _attribute(attrs, "body", where)
    try:
        given = json.loads(text) if isinstance(text, str) else dict(text)
        named = {n: given[n] for n in BODY if n in given or n != "g"}
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{where}: body: expected JSON with {', '.join(BODY)}: {error!r}") from error
    with refused(ModelError, where=where):
        return Body(**{n: _number(v, f"body.{n}", where) for n, v in named.items()})
