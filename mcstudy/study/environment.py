"""Environment on which numbers may depend: versions, CPU, thread settings. No host names, paths or times are stored."""

from __future__ import annotations

import copy
import os
import platform
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

PACKAGES = ("mcstudy", "numpy", "scipy", "numba", "llvmlite", "zarr", "numcodecs", "dask", "distributed")

THREADS = ("MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Variables that set the number of threads of a library; sums that are split differently differ in the last digits."""

LAYERS = ("compiling", "stance", "files", "recordings", "spectra", "fitting", "study", "streams.py")
"""Folders and files of this package that affect numbers."""

DIGITS = 12
"""Digits of a source's digest that a message prints."""


@cache
def source(layers: tuple[str, ...] = LAYERS) -> str:
    """SHA-256 of the source that computes the numbers; unlike a version number, it detects an edited copy."""
    package, digest = Path(__file__).resolve().parent.parent, sha256()
    for layer in layers:
        at = package / layer
        for file in [at] if at.is_file() else sorted(at.rglob("*.py")):
            digest.update(file.relative_to(package).as_posix().encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()


def environment() -> dict[str, Any]:
    """Versions, CPU, and the thread settings that are set, as stored in a cube's attributes."""
    threads = {name: os.environ[name] for name in THREADS if name in os.environ}
    return {**copy.deepcopy(_lasting(PACKAGES)), "threads": threads}


@cache
def _lasting(packages: tuple[str, ...]) -> dict[str, Any]:
    """The part that is constant in a process; cached, because it takes milliseconds and every block reports it."""
    from llvmlite import binding  # not needed to open a cube

    features = sorted(name for name, on in binding.get_host_cpu_features().items() if on)
    return {
        "versions": {"python": platform.python_version(), **{name: version(name) for name in packages}},
        "source": source(),
        "machine": platform.machine(),
        "cpu": binding.get_host_cpu_name(),
        "cpu_features": features,
    }


def differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Differences between two environments, as ``field: old -> new`` lines."""
    lines = []
    for name in sorted({*old.get("versions", {}), *new["versions"]}):
        a, b = old.get("versions", {}).get(name), new["versions"].get(name)
        if a != b:
            lines.append(f"versions.{name}: {a} -> {b}")
    for k, most in (("source", DIGITS), ("machine", None), ("cpu", None)):
        if old.get(k) != new[k]:
            lines.append(f"{k}: {str(old.get(k))[:most]} -> {str(new[k])[:most]}")
    gone = sorted(set(old.get("cpu_features", [])) - set(new["cpu_features"]))
    come = sorted(set(new["cpu_features"]) - set(old.get("cpu_features", [])))
    if gone or come:
        lines.append("cpu_features: " + " ".join([*("-" + f for f in gone), *("+" + f for f in come)]))
    before, now = old.get("threads"), new["threads"]
    if before is None:  # an old cube, which does not store them
        lines.append(
            "threads: not stored -> " + (" ".join(f"{name}={value}" for name, value in now.items()) or "unset")
        )
        return lines
    for name in THREADS:
        if before.get(name) != now.get(name):
            lines.append(f"threads.{name}: {before.get(name, 'unset')} -> {now.get(name, 'unset')}")
    return lines
