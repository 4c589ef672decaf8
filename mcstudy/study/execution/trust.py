"""Whether another machine agrees bit for bit: a sample of fits that a worker repeats before its first block of a group.

A worker with the environment of this process is trusted. One that runs other source code is not. Of any other one
(another CPU, Python or library) the bits of a sample are compared, for each group, because groups differ in noise, cost
and solver. Equal samples do not prove that all fits are equal: the chunks of such a worker name its environment.
"""

from __future__ import annotations

from functools import lru_cache
from hashlib import sha256
from typing import Any

import numpy as np

from mcstudy.fitting.solvers import fit_queue, solvers
from mcstudy.stance.stability import growth_rate
from mcstudy.study.experiment import Experiment
from mcstudy.study.group import Group

STARTS = 4
"""Fits in the sample at each Fmax, for each of its data."""

REALIZATIONS = 2
"""Realizations in the sample, at the smallest and at the largest amplitude."""


def same_source(environment: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two environments run the same code of this package."""
    return bool(environment["source"] == other["source"])


def cells(group: Group) -> tuple[list[tuple[float, int]], int]:
    """Data of the sample of a group (amplitude, realization), and the number of starts of each at every Fmax."""
    if not solvers()[group.fit.solver].parts:  # slow: that many fits of a compiled one take less than a second
        return [(group.amplitude[0], 0)], 1
    amplitudes = dict.fromkeys((group.amplitude[0], group.amplitude[-1]))
    realizations = range(min(REALIZATIONS, group.realizations))
    return [(a, r) for a in amplitudes for r in realizations], min(STARTS, group.starts)


def fits(group: Group) -> int:
    """Number of fits in the sample of a group."""
    data, starts = cells(group)
    return len(data) * len(group.fmax) * starts


@lru_cache(maxsize=16)
def sample(experiment: Experiment) -> str:
    """Digest of all that a few fits of a group give: data, noise, starts, estimates, costs, growth rates, errors."""
    group, digest = experiment.group, sha256()
    data, n = cells(group)

    def add(*arrays: np.ndarray) -> None:
        for array in arrays:
            digest.update(np.ascontiguousarray(array).tobytes())

    for amplitude, realization in data:
        measured = experiment.measure(amplitude, realization)
        add(measured.frf, *(() if measured.covariance is None else (measured.covariance,)))
        for fmax in group.fmax:
            problem = experiment.problem(measured, fmax)
            starts = np.ascontiguousarray(experiment.starts([problem], [realization], n)[0])
            fits_of_sample = fit_queue([problem], np.zeros(n, dtype=int), starts, group.fit.solver, group.fit.options())
            add(starts, fits_of_sample.estimate, fits_of_sample.cost, fits_of_sample.iterations, fits_of_sample.status)
            add(growth_rate(experiment.model, fits_of_sample.estimate))
            if group.store.standard_errors and np.isfinite(fits_of_sample.cost).all():
                add(
                    experiment.standard_errors(
                        problem, fits_of_sample.estimate[int(fits_of_sample.cost.argmin())], measured
                    )
                )
    return digest.hexdigest()
