"""Layout of the cube of a group: arrays, dimensions, units, fill values and chunks.

The chunks follow from the design alone, not from workers or tasks, so that every way of running a study writes the same
files. A chunk holds one amplitude x all Fmax x a few realizations x all starts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mcstudy.fitting.certainty import certain
from mcstudy.fitting.problem import Fits
from mcstudy.fitting.solvers import solvers
from mcstudy.fitting.status import USABLE, Status
from mcstudy.stance.feedback import ANGLES, Model
from mcstudy.study.group import Group

CHUNKS_A_GROUP = 400
"""Number of chunks of a large group: enough to distribute, few enough for a file system."""

NAN = float("nan")
COMPLEX_NAN = complex(NAN, NAN)


@dataclass(frozen=True)
class ArraySpec:
    """One array of a group. ``chunks`` has one entry per dimension; coordinates and constants have ``values``."""

    name: str
    dims: tuple[str, ...]
    dtype: str
    fill: Any
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    attributes: dict[str, Any]
    values: np.ndarray | None = field(default=None, compare=False)


@dataclass(frozen=True, order=True)
class Chunk:
    """One chunk: position on the amplitude axis, and the number of the realization chunk."""

    amplitude: int
    block: int


class ChunkData(dict[str, np.ndarray]):
    """Results of a chunk by array, each (1, ...): the axis of amplitudes has one entry.

    Fits of a chunk are counted by position: ``k`` of Fmax, ``rows`` of realizations, starts.
    """

    @property
    def pending(self) -> np.ndarray:
        """Fits that have not been run, (fmax, realization, start) bool."""
        return np.asarray(self["status"][0] == Status.PENDING)

    @property
    def unfinished(self) -> np.ndarray:
        """Cells with pending fits, or without the standard errors that they should have, (fmax, realization) bool."""
        unfinished = self.pending.any(axis=2)
        if "standard_error" in self:  # a stop may have come before them
            usable = np.isin(self["status"][0], USABLE).any(axis=2)
            unfinished = unfinished | np.isnan(self["standard_error"][0]).all(axis=2) & usable
        return np.asarray(unfinished)

    def best(self, k: int, row: int) -> int | None:
        """The start of lowest cost of a cell, of equal costs the first (as in the analysis); None without a fit."""
        cost, status = self["cost"][0, k, row], self["status"][0, k, row]
        usable = np.isin(status, USABLE) & np.isfinite(cost)
        return int(np.where(usable, cost, np.inf).argmin()) if usable.any() else None

    def put(self, k: int, rows: np.ndarray, starts: np.ndarray, fits: Fits, growth: np.ndarray) -> None:
        """Results of fits at (M,) ``rows`` and ``starts``, with the growth rates (M,) of their estimates."""
        place = (0, k, rows, starts)
        self["growth_rate"][place] = growth
        for name in ("estimate", "cost", "iterations", "at_bound", "status"):
            self[name][place] = getattr(fits, name)

    def leave_out(self, k: int, first: int) -> None:
        """Mark pending starts as not needed where the ``first`` starts of a realization suffice."""
        status, cost = self["status"][0, k], self["cost"][0, k]
        pending = status == Status.PENDING
        rows = np.flatnonzero(pending.any(axis=1) & ~pending[:, :first].any(axis=1))
        enough = rows[certain(np.where(np.isin(status[rows, :first], USABLE), cost[rows, :first], np.inf))]
        status[enough] = np.where(pending[enough], Status.NOT_NEEDED, status[enough])

    def copy(self) -> ChunkData:
        """With arrays of its own."""
        return ChunkData({name: values.copy() for name, values in self.items()})


@dataclass(frozen=True)
class Layout:
    """All arrays of one group.

    ``arrays`` holds constants (coordinates, truth ...) and results; ``results`` names those written chunk by chunk,
    in the order of writing, ``status`` last.
    """

    group: Group
    realizations_a_chunk: int
    arrays: dict[str, ArraySpec]
    results: tuple[str, ...]

    @property
    def chunks(self) -> list[Chunk]:
        """Every chunk, in the order in which a run visits them: all amplitudes of a realization together."""
        n = -(-self.group.realizations // self.realizations_a_chunk)
        return [Chunk(a, b) for b in range(n) for a in range(len(self.group.amplitude))]

    def realizations(self, chunk: Chunk) -> range:
        """Realizations (coordinate values) of a chunk."""
        first = chunk.block * self.realizations_a_chunk
        return range(first, min(first + self.realizations_a_chunk, self.group.realizations))

    def fits(self, chunk: Chunk) -> int:
        """Number of fits of a chunk."""
        return len(self.group.fmax) * self.group.starts * len(self.realizations(chunk))

    def empty(self, chunk: Chunk) -> ChunkData:
        """Results of a chunk before any fit: every array at its fill value."""
        out = ChunkData()
        for name in self.results:
            spec = self.arrays[name]
            size = {"amplitude": 1, "realization": len(self.realizations(chunk))}
            shape = tuple(size.get(dim, n) for dim, n in zip(spec.dims, spec.shape, strict=True))
            out[name] = np.full(shape, spec.fill, dtype=spec.dtype)
        return out

    def key(self, name: str, chunk: Chunk) -> str:
        """Name of the chunk's file inside the array's folder."""
        place = {"amplitude": chunk.amplitude, "realization": chunk.block}
        return ".".join(["c", *(str(place.get(dim, 0)) for dim in self.arrays[name].dims)])

    def place(self, name: str, key: str) -> Chunk | None:
        """The chunk whose file in the folder of array ``name`` is called ``key``; None when there is none."""
        if name not in self.results:
            return None
        dims, parts = self.arrays[name].dims, key.split(".")[1:]
        if len(parts) != len(dims) or not all(part.isdecimal() for part in parts):
            return None
        chunk = Chunk(int(parts[dims.index("amplitude")]), int(parts[dims.index("realization")]))
        blocks = -(-self.group.realizations // self.realizations_a_chunk)
        there = chunk.amplitude < len(self.group.amplitude) and chunk.block < blocks
        return chunk if there and self.key(name, chunk) == key else None

    def note(self, chunk: Chunk) -> str:
        """Path of a chunk's checksum file relative to the group's folder (`mcstudy.study.cube.checksums`)."""
        status = self.results[-1]
        return f"{status}/{self.key(status, chunk)}.checksums"


def realizations_a_chunk(group: Group) -> int:
    """Realizations that share a chunk."""
    low, high = solvers()[group.fit.solver].fits_a_chunk
    target = min(max(group.fits // CHUNKS_A_GROUP, low), high)
    return max(1, min(group.realizations, round(target / (len(group.fmax) * group.starts))))


def layout(
    group: Group, model: Model, f: np.ndarray, n_frequencies: tuple[int, ...], true_frf: np.ndarray, depth: int
) -> Layout:
    """The arrays of a group whose FRFs have frequencies ``f`` (N,) Hz and are ``true_frf`` (N, Y) without noise.

    ``depth``: realizations per chunk; from `realizations_a_chunk` for a new cube, as stored for an existing one.
    """
    sizes = {
        "amplitude": len(group.amplitude),
        "fmax": len(group.fmax),
        "realization": group.realizations,
        "start": group.starts,
        "parameter": len(model.parameters),
        "angle": model.n_outputs,
        "angle_2": model.n_outputs,
        "frequency": f.size,
    }
    chunk = {**sizes, "amplitude": 1, "realization": depth}
    arrays: dict[str, ArraySpec] = {}

    def add(
        name: str, dims: str, dtype: str, fill: Any, units: str, long_name: str, values: Any = None, **extra: Any
    ) -> None:
        axes = tuple(dims.split())
        shape = tuple(sizes[d] for d in axes)
        per_chunk = shape if values is not None else tuple(chunk[d] for d in axes)
        attributes = {"long_name": long_name, **({"units": units} if units else {}), **extra}
        stored = None if values is None else np.asarray(values, dtype=object if dtype == "string" else dtype)
        arrays[name] = ArraySpec(name, axes, dtype, fill, shape, per_chunk, attributes, stored)

    u, per_parameter, per_unit = model.stimulus_unit, "see parameter_unit", _response_unit(model)
    what = "start pool" if group.simulator == "none" else "noise realization"
    convention = group.stimulus.convention
    add("amplitude", "amplitude", "<f8", 0.0, u, "stimulus amplitude", group.amplitude, convention=convention)
    add("fmax", "fmax", "<f8", 0.0, "Hz", "highest frequency of the fit", group.fmax)
    add("realization", "realization", "<i8", 0, "1", what, np.arange(group.realizations))
    add("start", "start", "<i8", 0, "1", "start of the fit", np.arange(group.starts))
    add("parameter", "parameter", "string", "", "", "model parameter", model.names)
    what = "output" if model.outputs else "joint angle"
    add("angle", "angle", "string", "", "", what, model.output_names)
    add("angle_2", "angle_2", "string", "", "", what, model.output_names)
    if model.outputs:
        add("angle_unit", "angle", "string", "", "", "unit of the output", model.output_units)
    add("frequency", "frequency", "<f8", 0.0, "Hz", "frequency of the FRF point", f)
    if model.blocks:
        in_turn = model.stimulus_names * (f.size // len(model.blocks))
        add("stimulus", "frequency", "string", "", "", "stimulus of the FRF point", in_turn)
    add("parameter_unit", "parameter", "string", "", "", "unit of the parameter", model.units)
    meanings = [p.meaning for p in model.parameters]
    add("parameter_meaning", "parameter", "string", "", "", "meaning of the parameter", meanings)
    origin = model.provenance
    add("truth", "parameter", "<f8", NAN, per_parameter, "true value", model.truth, provenance=origin)
    add("lower", "parameter", "<f8", NAN, per_parameter, "lower bound", model.lower)
    add("upper", "parameter", "<f8", NAN, per_parameter, "upper bound", model.upper)
    add("n_frequencies", "fmax", "<i8", 0, "1", "number of FRF points up to fmax", n_frequencies)
    add("true_frf", "frequency angle", "<c16", COMPLEX_NAN, per_unit, "FRF of the true model", true_frf)
    _add_results(add, group, model)
    results = tuple(name for name, spec in arrays.items() if spec.values is None)
    return Layout(group, depth, arrays, results)


def with_empty_angle(given: Layout) -> Layout:
    """The arrays of a model of one joint as earlier versions stored them: with a second angle, without response."""
    arrays, empty = {}, "none" if given.group.model.declared else ANGLES[1]
    for name, spec in given.arrays.items():
        more = tuple(int(dim in ("angle", "angle_2")) for dim in spec.dims)
        shape, chunks = (tuple(np.add(size, more).tolist()) for size in (spec.shape, spec.chunks))
        values = spec.values
        if values is not None and any(more):
            nothing = empty if spec.dtype == "string" else 0.0
            values = np.pad(values, [(0, n) for n in more], constant_values=nothing)
        arrays[name] = replace(spec, shape=shape, chunks=chunks, values=values)
    return replace(given, arrays=arrays)


def _response_unit(model: Model) -> str:
    """Unit of responses; where outputs have several, the array that says them."""
    (unit, *others) = dict.fromkeys(model.output_units)
    return "see angle_unit" if others else f"{unit}/({model.stimulus_unit})"


def _add_results(add: Callable[..., None], group: Group, model: Model) -> None:
    """Declare what the runs of a study write, in the order of writing."""
    per_parameter, per_unit = "see parameter_unit", _response_unit(model)
    data, cell = "amplitude realization frequency angle", "amplitude fmax realization start"
    by_parameter = cell + " parameter"
    add("frf", data, "<c16", COMPLEX_NAN, per_unit, "FRF that was fitted")
    if group.simulator != "none":
        origin = "the true one" if group.spectra.covariance == "true" else "estimated from the record"
        covariance = f"covariance E[r r^H] of the FRF's errors, {origin}"
        add("noise_covariance", data + " angle_2", "<c16", COMPLEX_NAN, f"({per_unit})2", covariance)
    add("initial", by_parameter, "<f8", NAN, per_parameter, "parameters the fit started from")
    add("estimate", by_parameter, "<f8", NAN, per_parameter, "parameters the fit ended at")
    add("cost", cell, "<f8", NAN, "1", f"cost at the estimate ({group.fit.cost})")
    add("iterations", cell, "<i4", 0, "1", "evaluations of the model with its derivatives")
    bounds = {"flag_values": [-1, 0, 1], "flag_meanings": "lower none upper"}
    add("at_bound", by_parameter, "|i1", 0, "1", "bound the estimate lies on", **bounds)
    unstable = "real part of the rightmost characteristic root; positive is unstable"
    add("growth_rate", cell, "<f8", NAN, "1/s", unstable)
    if group.store.standard_errors:
        error = "standard error of the best fit's estimate; NaN on a bound"
        add("standard_error", "amplitude fmax realization parameter", "<f8", NAN, per_parameter, error)
    held = group.fit.stability_margin is not None
    optional = {Status.NOT_NEEDED: group.until_certain, Status.UNSTABLE: held}
    states = [s for s in Status if optional.get(s, True)]
    flags = {"flag_values": [int(s) for s in states], "flag_meanings": " ".join(s.name.lower() for s in states)}
    add("status", cell, "|u1", 0, "1", "how the fit ended; pending is a fit that has not been run", **flags)
