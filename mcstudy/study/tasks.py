"""One task of a run: fill some chunks of the cube.

A task is a pure function of the design and of coordinates; where and when it runs leaves no trace in the result.
Chunks that a stopped run left half done are completed fit by fit, since no fit depends on its neighbours.
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

from mcstudy.fit.problem import Fits
from mcstudy.fit.solvers import Options, fit_queue
from mcstudy.fit.status import USABLE, Status
from mcstudy.stance.stability import growth_rate
from mcstudy.study.design import Study
from mcstudy.study.experiment import Experiment
from mcstudy.study.layout import Chunk
from mcstudy.study.store import GroupStore

STARTS_A_CALL = {"lm": 1024}
"""Starts handed to a solver at once; SciPy's are slow, and a stop request is looked at only between calls."""

OTHERS_A_CALL = 1

CHECKPOINT_S = 20.0
"""Longest time between writes of a chunk that takes long: what a kill can cost, besides the fit in progress."""

STOP: dict[str, threading.Event] = {}
"""Stop requests by run, for tasks that run in the process that may be interrupted."""


@dataclass(frozen=True)
class Task:
    """What a worker needs to know: the cube, the study (as JSON), which chunks of which group, and their depth."""

    run: str
    path: str
    study: str
    group: str
    depth: int
    chunks: tuple[Chunk, ...]


@dataclass(frozen=True)
class Report:
    """What a task did: fits run now by status, whether it filled its chunks, seconds it took."""

    counts: Counter[int] = field(default_factory=Counter)
    complete: bool = True
    seconds: float = 0.0

    @property
    def fits(self) -> int:
        """Number of fits run now."""
        return sum(self.counts.values())


@lru_cache(maxsize=16)
def open_group(path: str, study: str, group: str, depth: int) -> GroupStore:
    """The group of a cube with its experiment prepared; kept by the worker for its next task."""
    resolved = Study.from_json(study)
    return GroupStore(
        Path(path), group, Experiment(resolved.group[group], resolved.study.seed), depth, resolved.fingerprint
    )


def run_task(task: Task) -> Report:
    """Fill the chunks of a task and write each as soon as it is complete; now and then before, if that takes long."""
    begun = time.perf_counter()
    store = open_group(task.path, task.study, task.group, task.depth)
    stop = STOP.get(task.run, threading.Event())
    counts: Counter[int] = Counter()
    complete = True
    for chunk in task.chunks:
        if stop.is_set():
            complete = False
            break
        data = store.taken_up(chunk)
        before = data["status"] != Status.PENDING
        fill(store, chunk, data, _pause(store, chunk, data, stop))
        new = data["status"][~before]
        counts.update(new[new != Status.PENDING].tolist())
        complete = complete and bool((data["status"] != Status.PENDING).all())
        store.write(chunk, data)
    return Report(counts, complete, time.perf_counter() - begun)


def _pause(store: GroupStore, chunk: Chunk, data: dict[str, np.ndarray], stop: threading.Event) -> Callable[[], bool]:
    """What happens between calls of the solver: a stop request is seen, and a slow chunk is written as far as it is."""
    written = time.monotonic()

    def stopped() -> bool:
        nonlocal written
        if time.monotonic() > written + CHECKPOINT_S:
            store.write(chunk, data)
            written = time.monotonic()
        return stop.is_set()

    return stopped


def fill(store: GroupStore, chunk: Chunk, data: dict[str, np.ndarray], stopped: Callable[[], bool]) -> None:
    """Run every pending fit of a chunk, in place in ``data``, until done or ``stopped()``."""
    experiment, group = store.experiment, store.experiment.group
    amplitude, realizations = group.amplitude[chunk.amplitude], store.layout.realizations(chunk)
    options = Options(group.fit.tolerance, group.fit.max_iterations)
    step = STARTS_A_CALL.get(group.fit.solver, OTHERS_A_CALL)
    wanted = np.flatnonzero((data["status"][0] == Status.PENDING).any(axis=(0, 2)))
    measured = {r: experiment.measure(amplitude, realizations[r]) for r in wanted}
    for r, measurement in measured.items():
        data["frf"][0, r] = measurement.frf
        if measurement.covariance is not None:
            data["noise_covariance"][0, r] = measurement.covariance
    for k, fmax in enumerate(group.fmax):
        rows = np.flatnonzero((data["status"][0, k] == Status.PENDING).any(axis=1))
        problems = [experiment.problem(measured[r], fmax) for r in rows]
        if stopped():
            return
        if rows.size:
            data["initial"][0, k, rows] = experiment.starts(problems, [realizations[r] for r in rows])
        row, start = np.nonzero(data["status"][0, k, rows] == Status.PENDING)
        for first in range(0, row.size, step):
            if stopped():
                return
            which, at = row[first : first + step], start[first : first + step]
            place = (0, k, rows[which], at)
            _put(data, place, fit_queue(problems, which, data["initial"][place], group.fit.solver, options), experiment)


def _put(
    data: dict[str, np.ndarray], place: tuple[int, int, np.ndarray, np.ndarray], fits: Fits, experiment: Experiment
) -> None:
    usable = np.isin(fits.status, USABLE)
    growth = np.full(len(fits.cost), np.nan)
    if usable.any():
        growth[usable] = growth_rate(experiment.model, fits.estimate[usable])
    data["growth_rate"][place] = growth
    for name in ("estimate", "cost", "iterations", "at_bound", "status"):
        data[name][place] = getattr(fits, name)
