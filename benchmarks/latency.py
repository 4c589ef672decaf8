"""What a reader waits for: verbs that look at a finished cube or one recording, as whole processes, and their floor."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.measure import mcstudy, run_command
from benchmarks.report import Result, Sizes
from benchmarks.studies import PIPELINES
from mcstudy.analysis import kept

HELP = ("argparse",)
READ = ("numpy", "pydantic", "jsonschema", "numcodecs.zstd")
KEPT = ("jsonschema", "llvmlite.binding")
STATISTICS = (*READ, "scipy.special", "numba", "zarr", "xarray", "dask.array")
DIAGNOSIS = (*READ, "scipy.special", "scipy.sparse.csgraph", "scipy.fft", "numba", "h5netcdf")
PAGE = ("matplotlib.figure", "matplotlib.backends.backend_svg")


@dataclass(frozen=True)
class Look:
    """One command. ``floor``: libraries that it needs; importing them alone is its floor."""

    command: tuple[str, ...]
    floor: tuple[str, ...]


def run(sizes: Sizes) -> Result:
    """CPU seconds of every verb, at a new cube and again, and of its floor; the lowest of the repeats, in turn."""
    result = Result("latency")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study, cube, recording = PIPELINES / f"{sizes.study}.toml", folder / "cube.zarr", folder / "ankle.nc"
        run_command(*mcstudy("run", study, "-o", cube))
        effect = ("--effect", "passive_damping_ankle=40", "--seed", "4")
        run_command(*mcstudy("simulate", "-o", recording, *effect))
        for verb, look in _looks(study, cube, recording, folder / "page.html").items():
            first, again, floor = _lowest(
                sizes.repeats,
                lambda c=look.command: _new(cube, c),
                lambda c=look.command: run_command(*c).cpu,
                lambda f=look.floor: run_command(sys.executable, "-c", f"import {', '.join(f)}").cpu,
            )
            result.keys[f"latency.{verb}_first_cpu_s"] = first
            result.keys[f"latency.{verb}_cpu_s"] = again
            result.keys[f"latency.{verb}_over_floor"] = again / floor
            row = {"verb": verb, "first CPU s": first, "again CPU s": again, "floor s": floor, "ratio": again / floor}
            result.table.append(row)
    result.notes.append(
        "first: no statistics are kept yet. floor: the imports of the libraries that a later look needs."
    )
    result.notes.append("Seconds depend on the machine and on what else it does, ratios to the floor much less.")
    return result


def _looks(study: Path, cube: Path, recording: Path, page: Path) -> dict[str, Look]:
    return {
        "help": Look(mcstudy("run", "--help"), HELP),
        "version": Look(mcstudy("--version"), ("importlib.metadata",)),
        "status": Look(mcstudy("status", cube), READ),
        "show": Look(mcstudy("show", cube), KEPT),
        "show_json": Look(mcstudy("show", cube, "--json"), KEPT),
        "report": Look(mcstudy("report", cube, "-o", page), (*STATISTICS, *PAGE)),
        "plan": Look(mcstudy("plan", study), (*READ, "scipy.special", "numba", "distributed")),
        "verify": Look(mcstudy("verify", cube), (*READ, "scipy.special", "numba", "zarr")),
        "gap_effects": Look(mcstudy("gap", "effects"), ("numpy",)),
        "gap_diagnose": Look(mcstudy("gap", "diagnose", recording, "--fast"), DIAGNOSIS),
        "gap_report": Look(mcstudy("gap", "report", recording, "--fast", "-o", page), (*DIAGNOSIS, *PAGE)),
    }


def _new(cube: Path, command: tuple[str, ...]) -> float:
    """CPU seconds of a command when no statistics of the cube are kept."""
    shutil.rmtree(kept.folder(cube), ignore_errors=True)
    return run_command(*command).cpu


def _lowest(repeats: int, *measures: Callable[[], float]) -> list[float]:
    """The lowest of each, in turn, so that a busy minute hits all of them."""
    found = [[measure() for measure in measures] for _ in range(repeats)]
    return [min(values) for values in zip(*found, strict=True)]
