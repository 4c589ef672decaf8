"""Whole studies from the command line: time, share of the kernel, memory, cost per fit, workers, planner."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy import open_results
from mcstudy.study.study_file import read_study
from pipelines.benchmarks.cases import study_text
from pipelines.benchmarks.measure import Usage, mcstudy, run_command
from pipelines.benchmarks.report import Result, Sizes

PIPELINES = Path(__file__).parents[1]
LIBRARIES = "import numpy, numba, distributed, zarr, pydantic"
"""Libraries that every program of this kind must load first."""

LARGE = {"fmax": (0.41, 1.2, 8.0), "starts": 50}


def _run(study: Path, folder: Path, *options: str) -> Usage:
    """One run into a new cube, from a cold process."""
    out = folder / f"{time.monotonic_ns()}.zarr"
    return run_command(*mcstudy("run", study, "-o", out, *options))


def _sized(folder: Path, fits: int) -> tuple[Path, int]:
    """A study file of about ``fits`` fits (one amplitude, three Fmax, 50 starts), and their exact number."""
    cells = max(1, round(fits / (len(LARGE["fmax"]) * LARGE["starts"])))
    path = folder / f"study_{fits}.toml"
    path.write_text(study_text(cells, LARGE["starts"], LARGE["fmax"]))
    return path, cells * len(LARGE["fmax"]) * LARGE["starts"]


def whole_study(sizes: Sizes) -> Result:
    """The paper's study from a cold process with one and two workers, and where the time goes."""
    result = Result("study")
    study = PIPELINES / f"{sizes.study}.toml"
    fits = read_study(study).fits
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _run(PIPELINES / "quick.toml", folder)  # warms caches
        wall: dict[int, list[float]] = {1: [], 2: []}
        cpu: dict[int, list[float]] = {1: [], 2: []}
        parts: list[dict[str, float]] = []
        for k in range(sizes.repeats):
            for workers in (1, 2):
                used = _run(study, folder, "--workers", str(workers))
                wall[workers].append(used.wall)
                cpu[workers].append(used.cpu)
            trace = folder / f"trace_{k}.json"
            out = folder / f"traced_{k}.zarr"
            command = ("benchmarks.traced", str(trace), "run", str(study), "-o", str(out), "--workers", "2")
            run_command(sys.executable, "-m", *command)
            parts.append(json.loads(trace.read_text()))
        size = sum(f.stat().st_size for f in out.rglob("*") if f.is_file())
    for workers in (1, 2):
        result.keys[f"study.wall_s.{workers}_workers"] = float(np.median(wall[workers]))
        result.keys[f"study.cpu_s.{workers}_workers"] = float(np.median(cpu[workers]))
    middle = sorted(parts, key=lambda p: p["cpu"])[len(parts) // 2]
    named = dict(middle["seconds"])
    named["scheduler, progress, all else"] = middle["cpu"] - sum(named.values())
    for part, seconds in sorted(named.items(), key=lambda item: -item[1]):
        row = {"part": part, "CPU s": seconds, "share": seconds / middle["cpu"], "us a fit": seconds / fits * 1e6}
        result.table.append(row)
    floor = [run_command(sys.executable, "-c", LIBRARIES).cpu for _ in range(sizes.repeats)]
    result.keys["study.libraries_cpu_s"] = float(np.median(floor))
    kernel = named["kernel"]
    result.keys["study.kernel_cpu_s"] = kernel
    result.keys["study.outside_kernel.cpu"] = 1 - kernel / middle["cpu"]
    result.keys["study.outside_kernel.wall"] = 1 - kernel / (2 * middle["wall"])
    result.keys["study.peak_bytes"] = middle["peak"]
    result.keys["study.bytes_per_fit"] = size / fits
    result.notes.append(f"{sizes.study}: {fits} fits; parts of the median of {len(parts)} traced runs with two workers")
    return result


def growth(sizes: Sizes) -> Result:
    """Cost per fit and peak memory against the number of fits."""
    result = Result("growth")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        small, _ = _sized(folder, 1)
        _run(small, folder)
        fixed = float(np.median([_run(small, folder, "--workers", "2").cpu for _ in range(sizes.repeats)]))
        for wanted in sizes.fits:
            study, fits = _sized(folder, wanted)
            repeats = sizes.repeats if wanted <= 10_000 else 1
            used = [_run(study, folder, "--workers", "2") for _ in range(repeats)]
            middle = sorted(used, key=lambda u: u.cpu)[len(used) // 2]
            row = {
                "fits": fits,
                "wall s": middle.wall,
                "CPU s": middle.cpu,
                "CPU us a fit": middle.cpu / fits * 1e6,
                "without start-up": (middle.cpu - fixed) / fits * 1e6,
                "peak MB": middle.peak / 1e6,
            }
            result.table.append(row)
            result.keys[f"growth.us_per_fit.{wanted}"] = row["CPU us a fit"]
            result.keys[f"growth.us_per_fit_without_startup.{wanted}"] = row["without start-up"]
            result.keys[f"growth.peak_bytes.{wanted}"] = middle.peak
    result.keys["growth.startup_cpu_s"] = fixed
    reference = next((row for row in result.table if 5_000 < row["fits"] < 20_000), result.table[0])
    last = result.table[-1]
    result.keys["growth.largest_over_1e4"] = last["CPU us a fit"] / reference["CPU us a fit"]
    result.keys["growth.largest_over_1e4_without_startup"] = last["without start-up"] / reference["without start-up"]
    return result


@contextmanager
def cluster(workers: int) -> Iterator[str]:
    """A scheduler and single-threaded workers, each its own process, over TCP on the loopback; yields the address."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scheduler.json"
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
        dask = (sys.executable, "-m", "dask")
        options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
        processes = [subprocess.Popen([*dask, "scheduler", *options], **quiet)]
        try:
            for _ in range(300):
                if file.exists() and file.stat().st_size:
                    break
                time.sleep(0.1)
            address = json.loads(file.read_text())["address"]
            command = [*dask, "worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
            processes += [subprocess.Popen(command, **quiet) for _ in range(workers)]
            from distributed import Client

            with Client(address, set_as_default=False) as client:
                client.wait_for_workers(workers, timeout=60)
                # imports, and the kernel's compiled code from its cache, as in a cluster that has run before
                client.run(lambda: __import__("mcstudy.study.execution.tasks"))
            yield address
        finally:
            for process in reversed(processes):  # a scheduler that is asked to end may wait for clients that are gone
                process.kill()
                process.wait()


def workers(sizes: Sizes) -> Result:
    """Two workers compared with one: threads of one process, and processes of a cluster; wall time minus start-up."""
    result = Result("workers")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study, fits = _sized(folder, sizes.fits[-1] // 2)
        small, _ = _sized(folder, 1)
        wall: dict[str, list[float]] = {}
        with cluster(1) as one, cluster(2) as two:
            ways = {
                "1 thread": ("--workers", "1"),
                "2 threads": ("--workers", "2"),
                "1 process": ("--scheduler", one),
                "2 processes": ("--scheduler", two),
            }
            for way in ways.values():
                _run(small, folder, *way)
            repeats = min(2, sizes.repeats)
            for _ in range(repeats):
                for way, options in ways.items():
                    wall.setdefault(way, []).append(_run(study, folder, *options).wall)
                    wall.setdefault(f"{way}, start-up", []).append(_run(small, folder, *options).wall)
    for way in ways:
        whole, fixed = np.array(wall[way]), np.array(wall[f"{way}, start-up"])
        result.table.append(
            {
                "workers": way,
                "wall s": float(np.mean(whole)),
                "start-up s": float(np.mean(fixed)),
                "fits/s": fits / float(np.mean(whole - fixed)),
            }
        )
    rate = {row["workers"]: row for row in result.table}
    for kind, single, double in (("threads", "1 thread", "2 threads"), ("processes", "1 process", "2 processes")):
        result.keys[f"scaling.two_{kind}"] = rate[single]["wall s"] / rate[double]["wall s"]
        result.keys[f"scaling.two_{kind}_without_startup"] = rate[double]["fits/s"] / rate[single]["fits/s"]
    result.notes.append(f"{fits} fits; means of {repeats}, all ways in turn")
    return result


def planner(sizes: Sizes) -> Result:
    """Predictions of `mcstudy plan` compared with `mcstudy run`: seconds, bytes, Monte Carlo errors."""
    result = Result("plan")
    over: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sized, _ = _sized(folder, sizes.fits[min(2, len(sizes.fits) - 1)])
        for study in (PIPELINES / f"{sizes.study}.toml", sized):
            for k in range(sizes.repeats):
                planned = _planned(study)  # just before the run, which finds the machine as busy
                out = folder / f"{study.stem}_{k}.zarr"
                used = run_command(*mcstudy("run", study, "-o", out, "--workers", "2"))
                written = sum(f.stat().st_size for f in out.rglob("*") if f.is_file())
                row = {
                    "study": study.stem if study != sized else "generated",
                    "predicted CPU s": planned["cpu"],
                    "CPU s": used.cpu,
                    "predicted wall s": planned["wall"],
                    "wall s": used.wall,
                    "predicted MB": planned["bytes"] / 1e6,
                    "written MB": written / 1e6,
                }
                result.table.append(row)
                over.setdefault("cpu_s", []).append(planned["cpu"] / used.cpu)
                over.setdefault("wall_s", []).append(planned["wall"] / used.wall)
                over.setdefault("bytes", []).append(planned["bytes"] / written)
            for group, expected, found in _errors(planned["precision"], out):
                over.setdefault("mcse", []).append(expected / found)
                what = f"{group}: MCSE predicted {expected:.3g} %, found {found:.3g} %"
                result.notes.append(what)
    for what, ratios in over.items():
        result.keys[f"plan.{what}_predicted_over_found"] = float(np.median(ratios))
        result.keys[f"plan.{what}_worst"] = float(max(ratios, key=lambda r: abs(np.log(r))))
    result.notes.append("two workers; process time, start-up included; MCSE: mean over parameters, of each cell's bias")
    return result


PLAN = """
import json, sys, time
import mcstudy.study.run
from mcstudy.study.plan import plan_study
from mcstudy.study.study_file import read_study
from pathlib import Path
p = plan_study(read_study(Path(sys.argv[1])), time.process_time())
each = [(g.name, q.amplitude, q.fmax, q.mean) for g in p.groups for q in g.precision]
print(json.dumps({"cpu": p.cpu, "wall": p.wall(2), "bytes": p.bytes, "precision": each}))
"""


def _planned(study: Path) -> dict[str, Any]:
    """The plan as a new process makes it, as the command line does."""
    return json.loads(run_command(sys.executable, "-c", PLAN, str(study)).output.splitlines()[-1])


def _errors(precision: list[tuple[str, float, float, float]], out: Path) -> Iterator[tuple[str, float, float]]:
    """Standard errors of the bias in percent, mean over parameters: as expected, and as found."""
    cube = open_results(out)
    for name, amplitude, fmax, expected in precision:
        group = cube[name].to_dataset()
        error = 100 * group.mc.bias()["mcse"] / abs(group["truth"])
        found = float(error.sel(amplitude=amplitude, fmax=fmax).mean("parameter"))
        yield f"{name}, {amplitude:g} N m, {fmax:g} Hz", expected, found
