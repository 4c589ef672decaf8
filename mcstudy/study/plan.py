"""Predict the run time, size and precision of a study from a small pilot.

The pilot runs a few realizations of every group into a temporary cube. It times data, fits and writing separately,
because they scale differently, and measures the size of the files. The predicted wall-clock time is the CPU time
divided by the number of threads, multiplied by the ratio of wall-clock to CPU time in the pilot: a machine that is busy
now is assumed to stay busy.

Precision is predicted from more realizations with fewer starts. Each is fitted from the truth and from some random
starts; the spread of the best fits is the expected spread of the study.
"""

from __future__ import annotations

import math
import resource
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mcstudy.files.unfinished import scratch_folder
from mcstudy.fitting.solvers import fit_many, solvers
from mcstudy.fitting.starts import uniform
from mcstudy.fitting.status import Status
from mcstudy.scheduler.activity import doing
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.scheduler.progress import duration
from mcstudy.stance.stability import growth_rate
from mcstudy.streams import start_stream
from mcstudy.study.cube.layout import realizations_a_chunk
from mcstudy.study.cube.store import Cube, GroupStore
from mcstudy.study.design import Group, Study
from mcstudy.study.execution.tasks import fill
from mcstudy.study.experiment import Experiment
from mcstudy.study.extent import Extent, extent
from mcstudy.study.instability import refuse_unstable, warnings_of
from mcstudy.text_tables import table

PILOT_UNTIL_CERTAIN = 4
"""Realizations that tell how many starts it takes to be certain."""

PILOT_REALIZATIONS = {"spectral": 48, "time_domain": 12}
"""Number of realizations for the expected precision, which determine the spread to 10 % (time domain: 20 %)."""

PILOT_STARTS = 24
"""Number of random starts for each of them, in addition to the truth."""

Spreads = dict[str, np.ndarray]
"""Standard deviations of the best fits (P,), percent, by settings; groups often differ in nothing but their size."""

LOADING_S = 1.0
"""Upper limit for the time to load the compiled solvers; if they are compiled now, a later run need not compile."""


@dataclass(frozen=True)
class Precision:
    """Expected Monte Carlo standard error of the bias, in percent of the true value, at one (amplitude, fmax)."""

    amplitude: float
    fmax: float
    mean: float
    largest: float
    parameter: str


@dataclass(frozen=True)
class GroupPlan:
    """Prediction for one group: fits, chunks, bytes on disk, CPU seconds, seconds of disk waits, and precision.

    ``precision`` is empty without noise. Where starts are drawn until certain, ``fits`` and ``starts``, the mean number
    of starts of a fit problem, are estimates.
    """

    name: str
    fits: int
    starts: float
    chunks: int
    bytes: int
    seconds: float
    waiting: float
    precision: tuple[Precision, ...]


@dataclass(frozen=True)
class StudyPlan:
    """All groups; printed, what `mcstudy plan` prints.

    Attributes
    ----------
    study: what was planned. groups: in the order of the study file. extent: its chunks, files and tasks.
    start_up: CPU seconds before the first fit, on one thread.
    slowdown: wall-clock seconds per CPU second during the pilot; 1 on an idle machine.
    metadata: bytes of the empty cube. threads: assumed for what is printed. libraries: bytes of memory without data.
    """

    study: Study
    groups: tuple[GroupPlan, ...]
    start_up: float
    slowdown: float
    metadata: int
    threads: int
    extent: Extent
    libraries: int

    def __repr__(self) -> str:
        lines = [f"study {self.study.study.name}, seed {self.study.study.seed}"]
        lines += [f"warning: {line}" for line in warnings_of(self.study)]
        sizes = [[g.name, str(g.fits), str(g.chunks), f"{g.bytes / 1e6:.1f}", duration(g.seconds)] for g in self.groups]
        lines.append(table(["group", "fits", "chunks", "MB", "CPU"], sizes))
        busy = f" ({self.slowdown:.1f} times slower than idle)" if self.slowdown > 1.1 else ""
        for g in self.groups:
            if self.study.groups[g.name].until_certain:
                most = self.study.groups[g.name].starts
                source = "from a few realizations" if g.starts < most else "the largest number, which it may not need"
                lines.append(f"{g.name}: about {g.starts:.0f} starts of at most {most}, {source}")
        lines.append(
            f"total: {self.fits} fits, {self.bytes / 1e6:.1f} MB, {duration(self.cpu)} of CPU time; about "
            f"{duration(self.wall(self.threads))} on {self.threads} threads under the present load{busy}"
        )
        memory = f"{self.memory / 1e6:.0f} MB"
        whole = self.extent
        lines.append(f"{whole.tasks} tasks, {whole.files} files, about {memory} of memory at any time of the run")
        lines += [
            f"{g.name} has no noise, so its bias has no Monte Carlo error" for g in self.groups if not g.precision
        ]
        errors = [
            [g.name, f"{p.amplitude:g}", f"{p.fmax:g}", f"{p.mean:.2g}", f"{p.largest:.2g} ({p.parameter})"]
            for g in self.groups
            for p in g.precision
        ]
        if errors:
            lines.append("expected Monte Carlo standard error of the bias, % of the true value:")
            lines.append(table(["group", "amplitude", "Fmax (Hz)", "mean", "largest"], errors))
        return "\n".join(lines)

    @property
    def fits(self) -> int:
        """Fits of the whole run."""
        return sum(g.fits for g in self.groups)

    @property
    def cpu(self) -> float:
        """CPU seconds of the whole run."""
        return self.start_up + sum(g.seconds for g in self.groups)

    @property
    def bytes(self) -> int:
        """Bytes of the finished cube."""
        return self.metadata + sum(g.bytes for g in self.groups)

    @property
    def memory(self) -> int:
        """Resident bytes of the run on ``threads`` threads, whatever the number of fits."""
        return self.libraries + self.extent.memory(self.threads)

    def wall(self, threads: int) -> float:
        """Wall-clock seconds with this many threads, on a machine as busy as during the pilot."""
        shared = sum(g.seconds * self.slowdown + g.waiting for g in self.groups)
        return self.start_up * self.slowdown + shared / threads


def plan_study(
    study: Study, imports: float = 0.0, *, workers: int | None = None, allow_unstable: bool = False
) -> StudyPlan:
    """Plan every group of a study.

    Parameters
    ----------
    study: a resolved study. imports: CPU seconds that a run spends before it reads the study file.
    workers: threads assumed, one per core when None.
    allow_unstable: whether the closed loop of the true parameters may be unstable.

    Raises `DesignError` for an unstable closed loop unless ``allow_unstable`` is true.
    """
    refuse_unstable(study, allow_unstable)
    threads, libraries = ClusterOptions(workers=workers).threads, _resident()
    pilots = {name: _pilot(group) for name, group in study.groups.items()}
    small = study.model_copy(update={"groups": pilots})
    with scratch_folder("mcstudy-plan-") as folder:
        watch = _Watch()
        cube = Cube.create(folder / "pilot.zarr", small, depths={n: g.realizations for n, g in pilots.items()})
        loading = 0.0
        for store in cube.groups.values():
            loading += _load(store)
        start_up = imports + min(loading, LOADING_S) + (watch.cpu() - loading)
        metadata = _size(cube.path)
        watch = _Watch()
        spreads: Spreads = {}
        plans = tuple(_plan_group(name, study, cube.groups[name], spreads) for name in study.groups)
        at_disk = sum(g.waiting / g.chunks for g in plans)
        slowdown = max(1.0, (watch.wall() - at_disk) / watch.cpu())
    return StudyPlan(study, plans, start_up, slowdown, metadata, threads, extent(study, threads), libraries)


def _resident() -> int:
    """Largest number of bytes in memory that this process has had so far."""
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024


class _Watch:
    """Wall-clock and CPU time since it was created."""

    def __init__(self) -> None:
        self._cpu, self._wall = time.process_time(), time.perf_counter()

    def cpu(self) -> float:
        return time.process_time() - self._cpu

    def wall(self) -> float:
        return time.perf_counter() - self._wall


def _pilot(group: Group) -> Group:
    """The group with few realizations and starts, all of them one chunk."""
    timed = solvers()[group.fit.solver].pilot_fits
    if not timed:
        return group.model_copy(update={"realizations": 1, "starts": min(group.starts, 2), "most_starts": None})
    if group.until_certain:  # whose number of starts is to be found out
        return group.model_copy(update={"realizations": min(group.realizations, PILOT_UNTIL_CERTAIN)})
    most = timed // len(group.fmax)
    starts = max(1, min(group.starts, most // min(2, group.realizations)))
    depth = min(max(1, most // starts), realizations_a_chunk(group))
    return group.model_copy(update={"realizations": depth, "starts": starts})


def _load(store: GroupStore) -> float:
    """Load the compiled solvers by running one fit; returns CPU seconds."""
    watch, experiment = _Watch(), store.experiment
    single_start = Experiment(experiment.group.model_copy(update={"starts": 1, "most_starts": None}), experiment.seed)
    problem = single_start.problem(single_start.measure(single_start.group.amplitude[0], 0), single_start.group.fmax[0])
    (fits,) = fit_many([problem], single_start.starts([problem], [0]), single_start.group.fit.solver)
    growth_rate(single_start.model, fits.estimate)
    return watch.cpu()


def _plan_group(name: str, study: Study, store: GroupStore, spreads: Spreads) -> GroupPlan:
    """Measure time and size of the pilot of one group, and scale them to the whole group."""
    doing(f"timing a few fits of group {name}")
    group, pilot, experiment = study.groups[name], store.experiment.group, store.experiment
    chunk, n = store.layout.chunks[0], pilot.realizations
    first, again = _time_data(experiment, n)
    data = store.layout.empty(chunk)
    watch = _Watch()
    fill(experiment, store.layout, chunk, data)
    fits_cpu = max(watch.cpu() - again * n, 0.0)
    watch = _Watch()
    store.write(chunk, data)
    write_cpu, write_wall = watch.cpu(), watch.wall()
    chunks = -(-group.realizations // realizations_a_chunk(group)) * len(group.amplitude)
    cells = group.realizations * len(group.amplitude)
    starts, share = float(group.starts), cells / n * group.starts / pilot.starts
    if pilot.until_certain:
        starts, share = float((data["status"] != Status.NOT_NEEDED).sum() / data["status"][..., 0].size), cells / n
    size = 0.0
    for array in store.layout.results:
        by_fit = "start" in store.layout.arrays[array].dims
        size += store.chunk_file(array, chunk).stat().st_size * (share if by_fit else cells / n)
    seconds = group.realizations * (first + again * (len(group.amplitude) - 1)) + fits_cpu * share + chunks * write_cpu
    waiting = chunks * max(write_wall - write_cpu, 0.0)
    doing(f"predicting the precision of group {name}")
    fits = round(group.fits * starts / group.starts)
    return GroupPlan(name, fits, starts, chunks, round(size), seconds, waiting, _precision(group, experiment, spreads))


def _time_data(experiment: Experiment, n: int) -> tuple[float, float]:
    """CPU seconds for the data of a realization at the first amplitude, and at a further one (with the same noise)."""
    amplitude, begun = experiment.group.amplitude[0], time.process_time()
    for realization in range(n):
        experiment.measure(amplitude, realization)
    between = time.process_time()
    for realization in range(n):
        experiment.measure(amplitude, realization)
    return (between - begun) / n, (time.process_time() - between) / n


def _size(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def _precision(group: Group, pilot: Experiment, spreads: Spreads) -> tuple[Precision, ...]:
    """Expected precision of ``group``, from more realizations of its pilot's data; adds to ``spreads``."""
    if group.simulator == "none":
        return ()
    precisions, model, number = [], pilot.model, min(group.starts, PILOT_STARTS)
    for amplitude in group.amplitude:
        for fmax in group.fmax:
            alike = {"amplitude": (amplitude,), "fmax": (fmax,), "realizations": 1, "starts": number}
            key = group.model_copy(update={**alike, "most_starts": None}).model_dump_json()
            if key not in spreads:
                spreads[key] = _spread(pilot, amplitude, fmax, number)
            error = spreads[key] / math.sqrt(group.realizations)
            worst = int(np.argmax(error))
            precisions.append(Precision(amplitude, fmax, float(error.mean()), float(error[worst]), model.names[worst]))
    return tuple(precisions)


def _spread(experiment: Experiment, amplitude: float, fmax: float, number: int) -> np.ndarray:
    """Standard deviation of the best fits (P,), in percent of the true values; ``number`` of random starts."""
    model, realizations = experiment.model, range(PILOT_REALIZATIONS[experiment.group.simulator])
    random = [uniform(model, start_stream(experiment.seed, r), number) for r in realizations]
    starts = np.stack([np.vstack([model.truth[None], random_starts]) for random_starts in random])
    problems = [experiment.problem(experiment.measure(amplitude, r), fmax) for r in realizations]
    best = [f.estimate[f.best] for f in fit_many(problems, starts) if np.isfinite(f.cost).any()]
    size = np.where(model.truth != 0, np.abs(model.truth), model.upper - model.lower)  # an effect may be absent
    return 100 * np.std(best, axis=0, ddof=1) / size
