"""One task of a run: fill some chunks of the cube.

A task is a pure function of the design and of coordinates; its result does not depend on where and when it runs.
Chunks that a stopped run left incomplete are completed fit by fit, because fits are independent of each other.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from mcstudy.fitting.certainty import looks
from mcstudy.fitting.problem import Fits
from mcstudy.fitting.solvers import fit_queue, solvers
from mcstudy.fitting.status import NOT_RUN, USABLE, Status
from mcstudy.stance.stability import growth_rate
from mcstudy.study.cube.checksums import OWN, UNKNOWN
from mcstudy.study.cube.layout import Chunk, ChunkData, Layout
from mcstudy.study.cube.store import GroupStore
from mcstudy.study.design import Group, Study
from mcstudy.study.experiment import Experiment

CHECKPOINT_S = 20.0
"""Longest time between two writes of a slow chunk, seconds; a kill loses at most this work and the current fit."""

STOP: dict[str, threading.Event] = {}
"""Stop requests by run, for tasks that run in the process that may be interrupted."""


@dataclass(frozen=True)
class Task:
    """Input of a worker: the cube, the study (as JSON), a group and its chunks, and the realizations per chunk.

    ``here``: label of the environment that the worker runs in, `OWN` where the cube was created in it.
    """

    run: str
    path: str
    study: str
    group: str
    depth: int
    chunks: tuple[Chunk, ...]
    here: str = OWN


@dataclass(frozen=True)
class TaskReport:
    """Result of a task: fits run or left out by status, whether its chunks are complete, and the seconds it took."""

    counts: Counter[int] = field(default_factory=Counter)
    complete: bool = True
    seconds: float = 0.0

    @property
    def fits(self) -> int:
        """Number of fits run or left out."""
        return sum(self.counts.values())


@lru_cache(maxsize=16)
def open_group(path: str, study: str, group: str, depth: int) -> GroupStore:
    """The group of a cube with its experiment prepared; kept by the worker for its next task."""
    resolved = Study.from_json(study)
    return GroupStore(
        Path(path), group, Experiment(resolved.groups[group], resolved.study.seed), depth, resolved.fingerprint
    )


def run_task(task: Task) -> TaskReport:
    """Fill the chunks of a task and write each when it is complete; a slow chunk is also written in between."""
    begun = time.perf_counter()
    store = open_group(task.path, task.study, task.group, task.depth)
    stop = STOP.get(task.run, threading.Event())
    counts: Counter[int] = Counter()
    complete = True
    for chunk in task.chunks:
        if stop.is_set():
            complete = False
            break
        data, environments = _taken_up(store, chunk, task)
        before = data.pending
        fill(store.experiment, store.layout, chunk, data, _pause(store, chunk, data, environments, stop))
        counts.update(data["status"][0][before & ~data.pending].tolist())
        complete = complete and not data.pending.any()
        store.write(chunk, data, environments)
    return TaskReport(counts, complete, time.perf_counter() - begun)


def _taken_up(store: GroupStore, chunk: Chunk, task: Task) -> tuple[ChunkData, tuple[str, ...]]:
    """The arrays of a chunk, and the environments that it names when this one has completed it."""
    there, named = store.annotated(chunk), store.environments(chunk)
    data = store.taken_up(chunk)
    made: set[str] = {task.here}
    if not data.pending.all():
        made |= set(named or [OWN if there or task.here == OWN else UNKNOWN])
    return data, () if made == {OWN} else tuple(sorted(made))


def _pause(
    store: GroupStore,
    chunk: Chunk,
    data: ChunkData,
    environments: tuple[str, ...],
    stop: threading.Event,
) -> Callable[[], bool]:
    """Between calls of the solver, check for a stop request and write a slow chunk as far as it is done."""
    written = time.monotonic()

    def stopped() -> bool:
        nonlocal written
        if time.monotonic() > written + CHECKPOINT_S:
            store.write(chunk, data, environments)
            written = time.monotonic()
        return stop.is_set()

    return stopped


def fill(
    experiment: Experiment, layout: Layout, chunk: Chunk, data: ChunkData, stopped: Callable[[], bool] = lambda: False
) -> None:
    """Run every pending fit of a chunk, in place in ``data``, until done or ``stopped()``."""
    group = experiment.group
    amplitude, realizations = group.amplitude[chunk.amplitude], layout.realizations(chunk)
    options, step = group.fit.options(), solvers()[group.fit.solver].starts_a_call
    unfinished = data.unfinished
    measured = {
        r: experiment.measure(amplitude, realizations[r]) for r in np.flatnonzero(unfinished.any(axis=0)).tolist()
    }
    for r, measurement in measured.items():
        data["frf"][0, r] = measurement.frf
        if measurement.covariance is not None:
            data["noise_covariance"][0, r] = measurement.covariance
    for k, fmax in enumerate(group.fmax):
        rows = np.flatnonzero(unfinished[k])
        problems = [experiment.problem(measured[r], fmax) for r in rows.tolist()]
        if stopped():
            return
        for last in looks(group.starts) if group.until_certain else [group.starts]:
            going = np.flatnonzero(data.pending[k, rows].any(axis=1))
            if going.size:
                drawn = experiment.starts([problems[i] for i in going], [realizations[rows[i]] for i in going], last)
                data["initial"][0, k, rows[going], :last] = drawn
            row, start = np.nonzero(data.pending[k, rows, :last])
            for begin in range(0, row.size, step):
                if stopped():
                    return
                part, at = row[begin : begin + step], start[begin : begin + step]
                initial = data["initial"][0, k, rows[part], at]
                fits = fit_queue(problems, part, initial, group.fit.solver, options)
                data.put(k, rows[part], at, fits, _growth(experiment, fits))
            if group.until_certain:
                data.leave_out(k, last)
        if "standard_error" in data:
            for i, problem in zip(rows.tolist(), problems, strict=True):
                error, best = data["standard_error"][0, k, i], data.best(k, i)
                estimate = None if best is None else data["estimate"][0, k, i, best]
                error[:] = np.nan if estimate is None else experiment.standard_errors(problem, estimate, measured[i])


def _growth(experiment: Experiment, fits: Fits) -> np.ndarray:
    """Growth rate of each fit's closed loop; NaN for a fit without an estimate."""
    usable, growth = np.isin(fits.status, USABLE), np.full(len(fits.cost), np.nan)
    if usable.any():
        growth[usable] = growth_rate(experiment.model, fits.estimate[usable])
    return growth


def left_out(group: Group, status: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Status (1, fmax, realization, start) of finished fits with those starts marked as not needed that should be."""
    out = ChunkData(status=np.where(status == Status.NOT_NEEDED, Status.PENDING, status), cost=cost)
    for last in looks(group.starts) if group.until_certain else ():
        for k in range(status.shape[1]):
            out.leave_out(k, last)
    return out["status"]


def again(store: GroupStore, chunk: Chunk, stored: ChunkData, chosen: np.ndarray) -> ChunkData:
    """The arrays of a chunk with the ``chosen`` finished fits run again; whatever has not been run stays as stored.

    ``chosen``: of the shape of ``stored["status"]``, bool.
    """
    data = stored.copy()
    waiting = np.isin(stored["status"], NOT_RUN)
    data["status"][waiting] = Status.SOLVER_ERROR  # `fill` must skip them
    data["status"][chosen] = Status.PENDING
    fill(store.experiment, store.layout, chunk, data)
    for name in store.layout.results:
        dims = store.layout.arrays[name].dims
        if "start" in dims:  # one value or row per fit
            data[name][waiting] = stored[name][waiting]
        elif "fmax" in dims:  # of the best of all starts
            data[name][waiting.any(axis=3)] = stored[name][waiting.any(axis=3)]
    return data
