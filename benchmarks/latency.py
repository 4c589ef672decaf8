"""What a reader waits for: verbs that read a finished cube or one recording, as whole processes, and their floor."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.measure import mcstudy, run_command
from benchmarks.report import Result, Sizes
from benchmarks.studies import PIPELINES

READ = ("numpy", "pydantic", "jsonschema", "numcodecs.zstd")
STATISTICS = (*READ, "scipy.special", "numba", "zarr", "xarray", "dask.array")
DIAGNOSIS = (*READ, "scipy.special", "scipy.sparse.csgraph", "scipy.fft", "scipy.stats", "numba", "h5netcdf", "xarray")
PAGE = ("matplotlib.figure", "matplotlib.backends.backend_svg")

FLOOR: dict[str, tuple[str, ...]] = {
    "status": READ,
    "show": STATISTICS,
    "report": (*STATISTICS, *PAGE),
    "gap_diagnose": (*DIAGNOSIS, "dask.array"),
    "gap_report": (*DIAGNOSIS, "zarr", "dask.array", *PAGE),
}
"""Libraries that a verb needs; importing them alone is its floor."""


def run(sizes: Sizes) -> Result:
    """CPU seconds of every verb and of its floor, in turn; the lowest of the repeats, so that caches are warm."""
    result = Result("latency")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cube, recording, page = folder / "cube.zarr", folder / "ankle.nc", folder / "page.html"
        run_command(*mcstudy("run", PIPELINES / f"{sizes.study}.toml", "-o", cube))
        effect = ("--effect", "passive_damping_ankle=40", "--seed", "4")
        run_command(*mcstudy("simulate", "-o", recording, *effect))
        verbs = {
            "status": mcstudy("status", cube),
            "show": mcstudy("show", cube),
            "report": mcstudy("report", cube, "-o", page),
            "gap_diagnose": mcstudy("gap", "diagnose", recording, "--fast"),
            "gap_report": mcstudy("gap", "report", recording, "--fast", "-o", page),
        }
        for verb, command in verbs.items():
            floor = (sys.executable, "-c", f"import {', '.join(FLOOR[verb])}")
            cpu, least = _lowest(sizes.repeats, lambda c=command: _cpu(c), lambda f=floor: _cpu(f))
            result.keys[f"latency.{verb}_cpu_s"] = cpu
            result.keys[f"latency.{verb}_over_floor"] = cpu / least
            result.table.append({"verb": verb, "CPU s": cpu, "floor s": least, "ratio": cpu / least})
    result.notes.append("floor: the imports of the libraries alone; seconds depend on the machine, ratios much less")
    return result


def _cpu(command: tuple[str, ...]) -> float:
    return run_command(*command).cpu


def _lowest(repeats: int, *measures: Callable[[], float]) -> list[float]:
    """The lowest of each, in turn, so that a busy minute hits all of them."""
    found = [[measure() for measure in measures] for _ in range(repeats)]
    return [min(values) for values in zip(*found, strict=True)]
