"""Whether another machine computes the same bits: a sample of fits that a worker repeats before its first block.

A worker with the environment of this process is trusted. One that runs other source code is not. Of any other one
(another CPU, Python or library) the bits of a sample of each group's fits are compared.
"""

from __future__ import annotations

import json
from functools import lru_cache
from hashlib import sha256
from typing import Any

import numpy as np

from mcstudy.fitting.arguments import Options
from mcstudy.fitting.solvers import fit_queue
from mcstudy.stance.stability import growth_rate
from mcstudy.study.experiment import Experiment

STARTS = 2
"""Fits in the sample at each Fmax."""


def label(environment: dict[str, Any]) -> str:
    """A short name of an environment; equal for equal ones."""
    return sha256(json.dumps(environment, sort_keys=True).encode()).hexdigest()[:16]


def same_source(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two environments run the same code of this package."""
    return bool(one["source"] == other["source"])


@lru_cache(maxsize=16)
def sample(experiment: Experiment) -> str:
    """Digest of everything that a few fits of a group give: data, starts, estimates, costs and growth rates."""
    group, digest = experiment.group, sha256()
    measured = experiment.measure(group.amplitude[0], 0)
    digest.update(np.ascontiguousarray(measured.frf).tobytes())
    options = Options(group.fit.tolerance, group.fit.max_iterations)
    for fmax in group.fmax:
        problem = experiment.problem(measured, fmax)
        starts = np.ascontiguousarray(experiment.starts([problem], [0])[0][:STARTS])
        fits = fit_queue([problem], np.zeros(len(starts), dtype=int), starts, group.fit.solver, options)
        growth = growth_rate(experiment.model, fits.estimate)
        for array in (starts, fits.estimate, fits.cost, fits.iterations, fits.status, growth):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
