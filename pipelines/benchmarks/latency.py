"""What a reader waits for: whole processes of every verb that shows something, and the imports that are their floor."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mcstudy.analysis import cache
from pipelines.benchmarks.large_cubes import write_cube
from pipelines.benchmarks.measure import Usage, mcstudy, run_command
from pipelines.benchmarks.report import Result, Sizes
from pipelines.benchmarks.studies import PIPELINES

HELP = ("argparse",)
READ = ("numpy", "pydantic", "jsonschema", "numcodecs.zstd")
KEPT = ("jsonschema", "llvmlite.binding")
RUN = (*READ, "numba", "distributed", "zarr")
DIAGNOSIS = ("numpy", "scipy.special", "scipy.fft", "numba", "h5netcdf")
STATISTICS = (*READ, "xarray", "zarr", "dask.array", "numba")
PAGE = ("matplotlib.figure", "matplotlib.backends.backend_svg")

LONGEST_S = 900
"""Wall-clock seconds after which one process is stopped: it is then left out of the table."""


@dataclass(frozen=True)
class Look:
    """One process to measure.

    Attributes
    ----------
    command: its words. floor: libraries that it needs; importing them alone is its floor.
    goal: most CPU seconds; None: no goal. before: what is done before each time, unmeasured.
    """

    command: tuple[str, ...]
    floor: tuple[str, ...]
    goal: float | None = None
    before: Callable[[], object] = lambda: None


def run(sizes: Sizes) -> Result:
    """CPU seconds and peak memory of every look and of its floor; the lowest of the repeats, in turn.

    Every look is measured once before any is measured again, and no round begins after ``sizes.seconds``, so that a
    busy machine gives fewer repeats, not an endless benchmark. Each number is told on stderr as soon as it is known.
    """
    result = Result("latency")
    with tempfile.TemporaryDirectory() as name:
        looks = _looks(sizes, Path(name))
        used: dict[str, list[tuple[Usage, Usage]]] = {verb: [] for verb in looks}
        ends = time.monotonic() + sizes.seconds
        for repeat in range(sizes.repeats):
            if repeat and time.monotonic() > ends:
                result.notes.append(f"{repeat} of {sizes.repeats} repeats: the machine is busy.")
                break
            for verb, look in looks.items():
                try:
                    look.before()
                    taken = run_command(*look.command, longest_s=LONGEST_S)
                    floor = run_command(sys.executable, "-c", f"import {', '.join(look.floor)}", longest_s=LONGEST_S)
                except (subprocess.TimeoutExpired, RuntimeError) as error:
                    result.notes.append(f"{verb}: {error}")
                    continue
                used[verb].append((taken, floor))
                told = f"{verb} {taken.cpu:.2f} s, floor {floor.cpu:.2f} s, peak {taken.peak / 1e6:.0f} MB"
                print(f"latency {repeat + 1}: {told}", file=sys.stderr)
    for verb, all_used in used.items():
        if all_used:
            _tell(result, verb, looks[verb].goal, all_used)
    result.notes.append("CPU seconds of whole processes; floor: the imports of the libraries that the verb needs.")
    result.notes.append("Seconds depend on the machine and on what else it does, ratios to the floor much less.")
    result.notes.append("A first run from a wheel and from source: --only wheel.")
    return result


def _tell(result: Result, verb: str, goal: float | None, used: list[tuple[Usage, Usage]]) -> None:
    cpu, floor = min(u.cpu for u, _ in used), min(f.cpu for _, f in used)
    peak = max(u.peak for u, _ in used) / 1e6
    row = {"what": verb, "CPU s": cpu, "goal": "-" if goal is None else goal, "floor": floor, "over floor": cpu / floor}
    result.table.append(row | {"peak MB": peak, "repeats": len(used)})
    key = verb.replace(", ", "_").replace(" ", "_").replace("--", "")
    result.keys[f"latency.{key}_cpu_s"] = cpu
    result.keys[f"latency.{key}_over_floor"] = cpu / floor
    result.keys[f"latency.{key}_peak_bytes"] = peak * 1e6


def _looks(sizes: Sizes, folder: Path) -> dict[str, Look]:
    """The looks in their order; makes what they look at."""
    study, cube, page = PIPELINES / f"{sizes.study}.toml", folder / "cube.zarr", folder / "page.html"
    recording, left, new = folder / "ankle.nc", folder / "left", folder / "new.zarr"
    run_command(*mcstudy("run", study, "-o", cube))
    run_command(*mcstudy("simulate", "-o", recording, "--effect", "passive_damping_ankle=40", "--seed", "4"))
    if cache.folder(cube).exists():  # a short study leaves none
        shutil.copytree(cache.folder(cube), left)

    def nothing() -> None:
        shutil.rmtree(cache.folder(cube), ignore_errors=True)

    def as_left_by_the_run() -> None:
        nothing()
        if left.exists():
            shutil.copytree(left, cache.folder(cube))

    def no_cube() -> None:
        shutil.rmtree(new, ignore_errors=True)
        shutil.rmtree(new.with_name("new.zarr.log"), ignore_errors=True)

    show, report = mcstudy("show", cube), mcstudy("report", cube, "-o", page)
    diagnose = mcstudy("gap", "diagnose", recording, "--fast")
    write = mcstudy("gap", "report", recording, "--fast", "-o", page)
    looks = {
        "--version": Look(mcstudy("--version"), ("importlib.metadata",)),
        "run --help": Look(mcstudy("run", "--help"), HELP),
        "studies": Look(mcstudy("studies"), HELP),
        "run quick, warm": Look(mcstudy("run", PIPELINES / "quick.toml", "-o", new), RUN, 6.0, no_cube),
        "status": Look(mcstudy("status", cube), READ, 0.5),
        "show, nothing kept": Look(show, STATISTICS, 1.5, nothing),
        "show, first after run": Look(show, KEPT, 1.5, as_left_by_the_run),
        "show, later": Look(show, KEPT, 1.5),
        "show --json, later": Look(mcstudy("show", cube, "--json"), KEPT, 1.5),
        "report, nothing kept": Look(report, (*STATISTICS, *PAGE), None, nothing),
        "report, first after run": Look(report, (*STATISTICS, *PAGE), 6.0, as_left_by_the_run),
        "report, later": Look(report, KEPT, 6.0),
        "plan": Look(mcstudy("plan", study), (*READ, "scipy.special", "numba", "distributed")),
        "verify": Look(mcstudy("verify", cube), (*READ, "scipy.special", "numba", "zarr")),
        "gap effects": Look(mcstudy("gap", "effects"), ("numpy",)),
        "gap diagnose --fast": Look(diagnose, DIAGNOSIS, 2.0),
        "gap report --fast": Look(write, (*DIAGNOSIS, *PAGE), 4.0),
    }
    for fits in sizes.report_fits:
        large = folder / f"{fits}.zarr"
        write_cube(large, fits)

        def forget(large: Path = large) -> None:
            shutil.rmtree(cache.folder(large), ignore_errors=True)

        goal = 20.0 if fits >= 1_000_000 else None
        looks[f"report of {fits} fits"] = Look(mcstudy("report", large, "-o", page), (*STATISTICS, *PAGE), goal, forget)
    return looks
