"""Environment on which numbers may depend: program, libraries, CPU, settings. No host names, paths or times are stored.

`platform` needs no slow import and says what is installed and set; `environment` also asks the loaded libraries what
they chose: OpenBLAS its kernels by the processor, NumPy its loops.
"""

from __future__ import annotations

import json
import os
import platform as machine
from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from typing import Any

from mcstudy import program
from mcstudy.fitting.attached import attached_sources

PACKAGES = ("mcstudy", "numpy", "scipy", "numba", "llvmlite", "zarr", "numcodecs", "dask", "distributed")

THREADS = ("MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Variables that set the number of threads of a library; sums that are split differently differ in the last digits."""

SETTINGS = (
    "BLIS_ARCH_TYPE",
    "GLIBC_TUNABLES",
    "MKL_CBWR",
    "MKL_DEBUG_CPU_TYPE",
    "MKL_ENABLE_INSTRUCTIONS",
    "NPY_DISABLE_CPU_FEATURES",
    "NPY_ENABLE_CPU_FEATURES",
    "NUMBA_CPU_FEATURES",
    "NUMBA_CPU_NAME",
    "NUMBA_DISABLE_INTEL_SVML",
    "NUMBA_DISABLE_JIT",
    "NUMBA_ENABLE_AVX",
    "NUMBA_LOOP_VECTORIZE",
    "NUMBA_OPT",
    "NUMBA_SLP_VECTORIZE",
    "OPENBLAS_CORETYPE",
    "VECLIB_MAXIMUM_THREADS",
)
"""Other variables that choose which instructions a library uses, and with them the last digits."""

LAYERS = (
    "compiling",
    "effect_library",
    "expressions.py",
    "files",
    "fitting",
    "models",
    "recordings",
    "spectra",
    "stance",
    "streams.py",
    "study",
)
"""Folders and files of this package that affect numbers; so do the solvers of others."""

DIGITS = 12
"""Digits of a source's digest that a message prints."""

FIELDS: dict[str, tuple[str, ...]] = {
    "versions": PACKAGES,
    "source": (),
    "machine": (),
    "cpu": (),
    "cpu_features": (),
    "simd": (),
    "blas": (),
    "libc": (),
    "svml": (),
    "threads": THREADS,
    "settings": SETTINGS,
}
"""Fields of an environment in the order of a message, and names within them that come first."""


def source() -> str:
    """SHA-256 of the source that computes numbers; that of no other process if files have changed since it started."""
    return program.source((*LAYERS, *attached_sources())) or program.MIXED


def platform(packages: tuple[str, ...] = PACKAGES) -> dict[str, Any]:
    """Versions, source, CPU and settings."""
    return {
        "versions": {"python": machine.python_version(), **program.versions(packages)},
        "source": source(),
        **_processor(),
        "threads": _set(THREADS),
        "settings": _set(SETTINGS),
    }


def environment() -> dict[str, Any]:
    """The environment of this process, as stored in a cube's attributes."""
    chosen = _chosen()  # loads libraries: their versions are those of what was loaded
    return {**platform(), **json.loads(chosen)}


def _set(names: tuple[str, ...]) -> dict[str, str]:
    return {name: os.environ[name] for name in names if name in os.environ}


@cache
def _processor() -> dict[str, Any]:
    from llvmlite import binding  # not needed to open a cube

    features = sorted(name for name, on in binding.get_host_cpu_features().items() if on)
    return {"machine": machine.machine(), "cpu": binding.get_host_cpu_name(), "cpu_features": features}


@cache
def _chosen() -> str:
    """What the libraries of this process are and chose, as JSON; cached, because every block reports it."""
    import numpy as np
    import scipy.linalg  # its linear algebra is another library than NumPy's
    from numba import config
    from threadpoolctl import threadpool_info

    loaded = [
        " ".join(str(library.get(key) or "") for key in ("internal_api", "version", "threading_layer", "architecture"))
        + f", {library['num_threads']} threads"
        for library in threadpool_info()
        if library["user_api"] == "blas" and _of_ours(library["filepath"])
    ]
    built = {module.__name__: module.show_config(mode="dicts") for module in (np, scipy)}
    chosen = {
        "simd": [name for kind in ("baseline", "found") for name in built["numpy"]["SIMD Extensions"].get(kind, ())],
        "blas": {
            **{name: _built(config["Build Dependencies"].get("blas", {})) for name, config in built.items()},
            "loaded": "; ".join(sorted(" ".join(text.split()) for text in loaded)),
        },
        "libc": _libc(),
        "svml": bool(getattr(config, "USING_SVML", False)),
    }
    return json.dumps(chosen)


def _of_ours(path: str) -> bool:
    """Whether a loaded library is that of NumPy or SciPy, and not one that another package has brought."""
    _, packages, inside = path.replace(os.sep, "/").rpartition("/site-packages/")
    return not packages or inside.startswith(("numpy", "scipy"))


def _built(blas: dict[str, Any]) -> str:
    return f"{blas.get('name', '')} {blas.get('version', '')}".strip()


def _libc() -> str:
    """Name and version of the C library, whose elementary functions numbers depend on."""
    try:
        version = os.confstr("CS_GNU_LIBC_VERSION")
    except (AttributeError, OSError, ValueError):
        version = None
    return version or " ".join(filter(None, machine.libc_ver())) or f"{machine.system()} {machine.mac_ver()[0]}".strip()


def label(environment: dict[str, Any]) -> str:
    """A short name of an environment; equal for equal ones."""
    return sha256(json.dumps(environment, sort_keys=True).encode()).hexdigest()[:16]


def differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Differences between two environments, as ``field: old -> new`` lines."""
    lines: list[str] = []
    for field, first in FIELDS.items():
        if field in old and field in new:
            lines += _different(field, old[field], new[field], first)
    if absent := [field for field in FIELDS if field in new and field not in old]:
        lines.append(f"not stored: {', '.join(absent)}")
    return lines


def _different(field: str, old: Any, new: Any, first: tuple[str, ...]) -> Iterator[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        for name in dict.fromkeys((*first, *sorted({*old, *new}))):
            if old.get(name) != new.get(name):
                yield f"{field}.{name}: {old.get(name, 'unset')} -> {new.get(name, 'unset')}"
    elif isinstance(old, list) and isinstance(new, list):
        gone, come = sorted(set(old) - set(new)), sorted(set(new) - set(old))
        if gone or come:
            yield f"{field}: " + " ".join([*("-" + f for f in gone), *("+" + f for f in come)])
    elif old != new:
        most = DIGITS if field == "source" else None
        yield f"{field}: {str(old)[:most]} -> {str(new)[:most]}"
