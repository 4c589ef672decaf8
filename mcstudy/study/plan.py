"""What a study will cost and how precise it will be, from a small pilot.

The pilot fits a few starts to time them, and 16 noise realizations from the truth itself: the spread of the minima
next to the truth is the spread the study will find where the data determine the parameters, and it costs one fit a
realization instead of all starts.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from mcstudy.fit.solvers import Options, fit, fit_queue
from mcstudy.stance.stability import growth_rate
from mcstudy.study.design import Study
from mcstudy.study.experiment import Experiment
from mcstudy.study.layout import layout, realizations_a_chunk

PILOT_REALIZATIONS = 16

PILOT_STARTS = {"lm": 64}
"""Starts timed per Fmax; SciPy's solvers are timed on two."""

PILOT_CELLS = {"lm": 8}
"""Realizations timed together (the compiled solver fits several in one queue); one with SciPy's."""


@dataclass(frozen=True)
class Precision:
    """Expected Monte Carlo standard error of a bias, in percent of the true value, at one (amplitude, fmax)."""

    amplitude: float
    fmax: float
    mean: float
    largest: float
    parameter: str


@dataclass(frozen=True)
class GroupPlan:
    """One group: fits, chunks, bytes before compression, CPU seconds, and precision (none without noise)."""

    name: str
    fits: int
    chunks: int
    bytes: int
    seconds: float
    precision: tuple[Precision, ...]


def plan(study: Study) -> list[GroupPlan]:
    """Plan every group of a study."""
    plans = []
    for name, group in study.group.items():
        experiment = Experiment(group, study.study.seed)
        arrays = layout(
            group,
            experiment.model,
            experiment.f,
            experiment.n_frequencies,
            experiment.true_frf,
            realizations_a_chunk(group),
        )
        size = sum(
            math.prod(a.shape) * np.dtype(a.dtype).itemsize for a in arrays.arrays.values() if a.dtype != "string"
        )
        cells = group.realizations * len(group.amplitude)
        seconds = _seconds_a_cell(experiment) * cells
        plans.append(GroupPlan(name, group.fits, len(arrays.chunks), size, seconds, _precision(experiment)))
    return plans


def _seconds_a_cell(experiment: Experiment) -> float:
    """CPU seconds of one (amplitude, realization): its data, and all starts at every Fmax."""
    group = experiment.group
    pilot = range(min(group.realizations, PILOT_CELLS.get(group.fit.solver, 1)))
    n = min(group.starts, PILOT_STARTS.get(group.fit.solver, 2))
    options = Options(group.fit.tolerance, group.fit.max_iterations)
    experiment.measure(group.amplitude[0], 0)
    begun = time.process_time()
    data = [experiment.measure(group.amplitude[0], r) for r in pilot]
    total = time.process_time() - begun
    for fmax in group.fmax:
        problems = [experiment.problem(one, fmax) for one in data]
        experiment.starts(problems[:1], pilot[:1])  # compiles
        begun = time.process_time()
        starts = experiment.starts(problems, pilot)
        total += time.process_time() - begun
        which, x0 = np.repeat(np.arange(len(problems)), n), starts[:, :n].reshape(-1, starts.shape[-1])
        growth_rate(experiment.model, fit(problems[0], x0[:1], group.fit.solver, options).estimate)  # compiles
        begun = time.process_time()
        growth_rate(experiment.model, fit_queue(problems, which, x0, group.fit.solver, options).estimate)
        total += (time.process_time() - begun) / n * group.starts
    return total / len(pilot)


def _precision(experiment: Experiment) -> tuple[Precision, ...]:
    group, model = experiment.group, experiment.model
    if group.simulator == "none":
        return ()
    found = []
    for amplitude in group.amplitude:
        pilot = [experiment.measure(amplitude, r) for r in range(PILOT_REALIZATIONS)]
        for fmax in group.fmax:
            fits = [fit(experiment.problem(data, fmax), model.truth[None]) for data in pilot]
            spread = np.nanstd([f.estimate[0] for f in fits], axis=0, ddof=1)
            error = 100 * spread / np.abs(model.truth) / math.sqrt(group.realizations)
            worst = int(np.argmax(error))
            found.append(Precision(amplitude, fmax, float(error.mean()), float(error[worst]), model.names[worst]))
    return tuple(found)
