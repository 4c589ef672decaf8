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
DIAGNOSIS = (*READ, "scipy.special", "scipy.sparse.csgraph", "scipy.fft", "numba", "h5netcdf")
PAGE = ("matplotlib.figure", "matplotlib.backends.backend_svg")


@dataclass(frozen=True)
class Look:
    """One command.

    Attributes
    ----------
    command: its words. floor: libraries that a later look needs; importing them alone is its floor.
    goal: most CPU seconds of a later look. first_goal: of the first look. None: no goal.
    """

    command: tuple[str, ...]
    floor: tuple[str, ...]
    goal: float | None = None
    first_goal: float | None = None


def run(sizes: Sizes) -> Result:
    """CPU seconds of every verb, at a new cube and again, and of its floor; the lowest of the repeats, in turn.

    A cube is new as ``mcstudy run`` leaves it, with the statistics that it computed at its end; the first look at a
    cube without any is measured too.
    """
    result = Result("latency")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study, cube, recording = PIPELINES / f"{sizes.study}.toml", folder / "cube.zarr", folder / "ankle.nc"
        run_command(*mcstudy("run", study, "-o", cube))
        effect = ("--effect", "passive_damping_ankle=40", "--seed", "4")
        run_command(*mcstudy("simulate", "-o", recording, *effect))
        left = folder / "statistics"
        if kept.folder(cube).exists():  # a short study leaves none
            shutil.copytree(kept.folder(cube), left)
        for verb, look in _looks(study, cube, recording, folder / "page.html").items():
            nothing, first, again, floor = _lowest(
                sizes.repeats,
                lambda c=look.command: _new(cube, c, None),
                lambda c=look.command: _new(cube, c, left),
                lambda c=look.command: run_command(*c).cpu,
                lambda f=look.floor: run_command(sys.executable, "-c", f"import {', '.join(f)}").cpu,
            )
            result.keys[f"latency.{verb}_nothing_kept_cpu_s"] = nothing
            result.keys[f"latency.{verb}_first_cpu_s"] = first
            result.keys[f"latency.{verb}_cpu_s"] = again
            result.keys[f"latency.{verb}_over_floor"] = again / floor
            result.table.append(
                {
                    "verb": verb,
                    "nothing kept": nothing,
                    "first": first,
                    "goal first": _goal(look.first_goal),
                    "again": again,
                    "goal again": _goal(look.goal),
                    "floor": floor,
                    "again / floor": again / floor,
                }
            )
    result.notes.append(
        "CPU seconds. first: of a cube as mcstudy run leaves it, which keeps the statistics of show; nothing kept: "
        "without these; again: every later look. floor: the imports of the libraries that a later look needs."
    )
    result.notes.append("Seconds depend on the machine and on what else it does, ratios to the floor much less.")
    return result


def _looks(study: Path, cube: Path, recording: Path, page: Path) -> dict[str, Look]:
    diagnose, write = ("gap", "diagnose", recording, "--fast"), ("gap", "report", recording, "--fast", "-o", page)
    return {
        "help": Look(mcstudy("run", "--help"), HELP),
        "version": Look(mcstudy("--version"), ("importlib.metadata",)),
        "status": Look(mcstudy("status", cube), READ, 0.5, 0.5),
        "show": Look(mcstudy("show", cube), KEPT, 1.5, 1.5),
        "show_json": Look(mcstudy("show", cube, "--json"), KEPT, 1.5, 1.5),
        "report": Look(mcstudy("report", cube, "-o", page), KEPT, 6.0, 6.0),
        "plan": Look(mcstudy("plan", study), (*READ, "scipy.special", "numba", "distributed")),
        "verify": Look(mcstudy("verify", cube), (*READ, "scipy.special", "numba", "zarr")),
        "gap_effects": Look(mcstudy("gap", "effects"), ("numpy",)),
        "gap_diagnose": Look(mcstudy(*diagnose), DIAGNOSIS, 2.0, 2.0),
        "gap_report": Look(mcstudy(*write), (*DIAGNOSIS, *PAGE), 4.0, 4.0),
    }


def _goal(seconds: float | None) -> float | str:
    return "-" if seconds is None else seconds


def _new(cube: Path, command: tuple[str, ...], statistics: Path | None) -> float:
    """CPU seconds of a command when these statistics of the cube are kept, or none."""
    shutil.rmtree(kept.folder(cube), ignore_errors=True)
    if statistics is not None and statistics.exists():
        shutil.copytree(statistics, kept.folder(cube))
    return run_command(*command).cpu


def _lowest(repeats: int, *measures: Callable[[], float]) -> list[float]:
    """The lowest of each, in turn, so that a busy minute hits all of them."""
    found = [[measure() for measure in measures] for _ in range(repeats)]
    return [min(values) for values in zip(*found, strict=True)]
