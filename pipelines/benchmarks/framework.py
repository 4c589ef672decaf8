"""Overhead of scheduling and storing fits: the study's runner compared with xyzpy and joblib, with the same solver.

Each framework maps one function over realizations and stores the results. The function's own time, measured in a plain
loop, is subtracted; the remainder per fit is the overhead of the framework.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mcstudy.fitting.solvers import fit
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.stance.stability import growth_rate
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study
from pipelines.benchmarks.cases import AMPLITUDE, FMAX, experiment, study_text
from pipelines.benchmarks.report import Result, Sizes

STARTS = 50


def cell(realization: int) -> tuple[np.ndarray, ...]:
    """All fits of one realization, as in a task of a study; the unit of work of the frameworks."""
    paper = experiment(STARTS)
    data = paper.measure(AMPLITUDE, realization)
    out = []
    for fmax in FMAX:
        problem = paper.problem(data, fmax)
        starts = paper.starts([problem], [realization])[0]
        fits = fit(problem, starts)
        growth = growth_rate(problem.model, fits.estimate)
        out.append((starts, fits.estimate, fits.cost, fits.iterations, fits.at_bound, growth, fits.status))
    return (data.frf, data.covariance, *(np.stack(part) for part in zip(*out, strict=True)))


NAMES = ("frf", "covariance", "initial", "estimate", "cost", "iterations", "at_bound", "growth", "status")


def _loop(_: Path, n: int) -> None:
    for r in range(n):
        cell(r)


def _joblib(folder: Path, n: int) -> None:
    import joblib

    rows = joblib.Parallel(n_jobs=1, backend="threading")(joblib.delayed(cell)(r) for r in range(n))
    joblib.dump({name: np.stack(part) for name, part in zip(NAMES, zip(*rows, strict=True), strict=True)}, folder / "x")


def _xyzpy(folder: Path, n: int) -> None:
    import xyzpy

    angles, fits, by_parameter = ["frequency", "angle"], ["fmax", "start"], ["fmax", "start", "parameter"]
    dims = (angles, [*angles, "angle_2"], by_parameter, by_parameter, fits, fits, by_parameter, fits, fits)
    runner = xyzpy.Runner(cell, list(NAMES), var_dims=dict(zip(NAMES, dims, strict=True)))
    harvester = xyzpy.Harvester(runner, data_name=str(folder / "x.h5"), engine="h5netcdf")
    harvester.harvest_combos({"realization": list(range(n))}, verbosity=0)


def _mcstudy(folder: Path, n: int) -> None:
    study = parse_study(study_text(n, STARTS))
    run_study(study, folder / "x.zarr", ClusterOptions(workers=1))


CARRIERS: dict[str, Callable[[Path, int], None]] = {
    "loop": _loop,
    "mcstudy": _mcstudy,
    "xyzpy": _xyzpy,
    "joblib": _joblib,
}


def run(sizes: Sizes) -> Result:
    """Overhead per fit, CPU of the whole process and wall, of all carriers in turn."""
    result = Result("framework")
    n = sizes.framework_cells
    fits = n * len(FMAX) * STARTS
    cpu: dict[str, list[float]] = {}
    wall: dict[str, list[float]] = {}
    for attempt in range(sizes.repeats + 1):
        for name, carry in CARRIERS.items():
            with tempfile.TemporaryDirectory() as folder:
                begun, before = time.perf_counter(), time.process_time()
                try:
                    carry(Path(folder), 1 if attempt == 0 else n)
                except ImportError as error:
                    if attempt == 0:
                        result.notes.append(f"{name}: package not installed, left out ({error})")
                    continue
                if attempt:
                    wall.setdefault(name, []).append(time.perf_counter() - begun)
                    cpu.setdefault(name, []).append(time.process_time() - before)
    plain_cpu, plain_wall = np.array(cpu["loop"]), np.array(wall["loop"])
    for name in cpu:
        more = float(np.median(np.array(cpu[name]) - plain_cpu)) / fits * 1e6
        longer = float(np.median(np.array(wall[name]) - plain_wall)) / fits * 1e6
        row = {"carrier": name, "CPU us a fit": float(np.median(cpu[name])) / fits * 1e6, "overhead CPU us": more}
        result.table.append({**row, "overhead wall us": longer})
        if name != "loop":
            result.keys[f"overhead.{name}"] = more
            result.keys[f"overhead_wall.{name}"] = longer
    durable = (
        "mcstudy stores durably, resumable and chunk by chunk; joblib one pickle, xyzpy one file rewritten at the end"
    )
    result.notes.append(f"{fits} fits in {n} cells, one worker; {durable}")
    return result
