"""The schema of a results cube, from the layout of its arrays (`mcstudy.study.cube.layout`)."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

from mcstudy.fitting.status import Status
from mcstudy.study.cube.metadata import describe
from mcstudy.study.cube.store import Cube
from mcstudy.study.study_file import parse_study

STUDY = """
[study]
name = "layout"
seed = 0

[model]
joints = ["joint"]
stimulus = [{ name = "torque" }, { name = "force", unit = "N" }]
term = [
  { order = 2 }, { gain = "B", order = 1, noisy = true }, { sense = "torque" }, { sense = "force", coefficient = 0.3 },
]
parameter = [{ name = "B", value = 1.0 }]
output = [{ name = "output", value = "2*joint" }]

[group.all_arrays]
realizations = 1
starts = "until certain"
fmax = [1.2]
amplitude = [5.0]
store.standard_errors = true
"""
"""A study whose group has every array."""

OPTIONAL = ("noise_covariance", "standard_error", "angle_unit", "stimulus")
"""Arrays that some groups lack: without noise, unless asked for, without declared outputs, with one stimulus."""

BY_GROUP = {
    "amplitude": {"units": {"type": "string"}, "convention": {"enum": ["peak", "peak_to_peak"]}},
    "truth": {"provenance": {"type": "string"}},
    **{name: {"units": {"type": "string"}} for name in ("true_frf", "frf", "noise_covariance")},
}
"""Attributes whose values follow from the group: of the other attributes all but ``long_name`` are fixed."""

DIGEST = {"type": "string", "pattern": "^[0-9a-f]{64}$"}
TEXT = {"type": "string"}
TEXTS = {"type": "object", "additionalProperties": TEXT}
THREADS = ("MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def schema() -> dict[str, Any]:
    """The schema of the metadata documents of a cube as one JSON value."""
    with tempfile.TemporaryDirectory() as folder:
        made = describe(Cube.create(Path(folder) / "layout.zarr", parse_study(STUDY)).path)
    (group,) = made["groups"].values()
    arrays = group["arrays"]
    codecs = {"number_codecs": arrays["cost"]["codecs"], "byte_codecs": arrays["status"]["codecs"]}
    codecs["text_codecs"] = arrays["parameter"]["codecs"]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "mcstudy:study_cube:1.0.0",
        "title": "Results cube of a Monte Carlo study",
        "description": "The Zarr v3 metadata documents of a cube as one value: attributes of the root, and per group "
        "its attributes and the zarr.json of each array. See ../README.md for the meaning of every array.",
        **_record({"attributes": _root(), "groups": _groups()}),
        "$defs": {
            "environment": _environment(),
            "group": _record({"attributes": _attributes(), "arrays": _arrays(arrays)}),
            **{name: {"const": value} for name, value in codecs.items()},
            **{name: _array(name, found, codecs) for name, found in arrays.items()},
        },
    }


def _record(properties: dict[str, Any], optional: tuple[str, ...] = ()) -> dict[str, Any]:
    required = [name for name in properties if name not in optional]
    return {"type": "object", "required": required, "additionalProperties": False, "properties": properties}


def _described(kind: dict[str, Any], description: str) -> dict[str, Any]:
    return {**kind, "description": description}


def _root() -> dict[str, Any]:
    environment = {"$ref": "#/$defs/environment"}
    properties = {
        "schema": {"const": "mcstudy:study_cube:1.0.0"},
        "title": TEXT,
        "study": _described(
            {**TEXT, "maxLength": 1000000}, "canonical study file (TOML) with all defaults written out"
        ),
        "fingerprint": _described(DIGEST, "SHA-256 of the canonical JSON of the study without its description"),
        "seed": {"type": "integer", "minimum": 0},
        "environment": _described(
            environment,
            "in which the cube was created, and every chunk was computed whose checksum file names no other",
        ),
        "environments": {
            "type": "object",
            "description": "other environments that the checksum files of chunks name, by their label: the first 16 "
            "digits of the SHA-256 of their canonical JSON; absent where there are none",
            "propertyNames": {"pattern": "^[0-9a-f]{16}$"},
            "additionalProperties": environment,
        },
    }
    return _record(properties, ("environments",))


def _groups() -> dict[str, Any]:
    return {
        "type": "object",
        "minProperties": 1,
        "propertyNames": {"pattern": "^[A-Za-z][A-Za-z0-9_-]{0,63}$"},
        "additionalProperties": {"$ref": "#/$defs/group"},
    }


def _environment() -> dict[str, Any]:
    threads = _record(dict.fromkeys(THREADS, TEXT), THREADS)
    threads.pop("required")
    properties = {
        "source": _described(DIGEST, "SHA-256 of the source files that compute the numbers"),
        "versions": TEXTS,
        "machine": TEXT,
        "cpu": TEXT,
        "cpu_features": {"type": "array", "items": TEXT},
        "threads": _described(
            threads, "environment variables that set numbers of threads: those that were set; absent in older cubes"
        ),
        "settings": _described(
            TEXTS,
            "environment variables that choose which instructions a library uses: those that were set; absent in older "
            "cubes, as all that follows",
        ),
        "simd": {"type": "array", "description": "instruction sets that NumPy used", "items": TEXT},
        "blas": _described(
            TEXTS,
            "linear algebra: what NumPy and SciPy were built with, and the loaded libraries with the kernels that they "
            "chose and their number of threads",
        ),
        "libc": _described(TEXT, "name and version of the C library"),
        "svml": {"type": "boolean", "description": "whether compiled code used Intel's elementary functions"},
    }
    return _record(properties, ("threads", "settings", "simd", "blas", "libc", "svml"))


def _attributes() -> dict[str, Any]:
    copy = "copy of the root's; absent in older cubes"
    properties = {
        "fingerprint": _described(DIGEST, copy),
        "environment": _described({"$ref": "#/$defs/environment"}, copy),
        "design": {"type": "object", "description": "the resolved sections of the group"},
        "model": TEXT,
        "truth_provenance": TEXT,
        "stimulus_unit": TEXT,
        "realizations_a_chunk": {"type": "integer", "minimum": 1},
    }
    return _record(properties, ("fingerprint", "environment"))


def _arrays(arrays: dict[str, Any]) -> dict[str, Any]:
    return _record({name: {"$ref": f"#/$defs/{name}"} for name in arrays}, OPTIONAL)


def _array(name: str, found: dict[str, Any], codecs: dict[str, Any]) -> dict[str, Any]:
    """The schema of the ``zarr.json`` of an array, from one that was written."""
    dims = len(found["dimension_names"])
    size = {"type": "integer", "minimum": 1, "maximum": 1000000000}
    same = next(key for key, value in codecs.items() if value == found["codecs"])
    properties = {
        "data_type": {"const": found["data_type"]},
        "fill_value": {"const": found["fill_value"]},
        "dimension_names": {"const": found["dimension_names"]},
        "shape": {"type": "array", "minItems": dims, "maxItems": dims, "items": size},
        "codecs": {"$ref": f"#/$defs/{same}"},
        "chunk_key_encoding": {"const": found["chunk_key_encoding"]},
        "attributes": _array_attributes(name, found["attributes"]),
        "zarr_format": {"const": 3},
        "node_type": {"const": "array"},
    }
    required = [key for key in properties if key != "chunk_key_encoding"]
    return {"type": "object", "required": required, "properties": properties}


def _array_attributes(name: str, found: dict[str, Any]) -> dict[str, Any]:
    known = {"long_name": TEXT, **BY_GROUP.get(name, {})}
    if name == "status":  # only where starts are drawn until certain, or loops must be stable, are some left out
        optional = (Status.NOT_NEEDED, Status.UNSTABLE)
        states = [[s for s in Status if s not in gone] for gone in (optional, *((s,) for s in optional), ())]
        known["flag_values"] = {"enum": [[int(s) for s in all_] for all_ in states]}
        known["flag_meanings"] = {"enum": [" ".join(s.name.lower() for s in all_) for all_ in states]}
    properties = {key: known.get(key, {"const": value}) for key, value in found.items()}
    return {"type": "object", "required": list(properties), "properties": json.loads(json.dumps(properties))}
