"""Every compiled function called once, on the smallest problem there is, so that nobody has to wait for it later.

A function is compiled for the types that it is called with, so the calls are those that studies and diagnoses make:
through the functions around the compiled code, not by lists of types that would have to be kept up.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import NamedTuple

import numpy as np

from mcstudy.fitting.arguments import Prior, pack
from mcstudy.fitting.linearised import POOL, LinearModel
from mcstudy.fitting.lm import lm, normal_equations
from mcstudy.fitting.problem import Problem, paper_cost
from mcstudy.stance.body import two_segment
from mcstudy.stance.compiled import KEPT
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_time import simulate
from mcstudy.stance.stability import growth_rate

EVERY_S = 0.01
"""Time between the samples of the record that is simulated."""


class Warmed(NamedTuple):
    """Compiled functions by where they came from: compiled now, or found on disk."""

    compiled: int
    found: int


def warm(parts: Iterable[str] = ()) -> Warmed:
    """Compile what is not compiled yet, or load it; all ``parts`` (`PARTS`) unless some are named."""
    before = _counts()
    for part in parts or PARTS:
        PARTS[part]()
    after = _counts()
    return Warmed(after.compiled - before.compiled, after.found - before.found)


def _counts() -> Warmed:
    statistics = [function.stats for function in KEPT]
    return Warmed(sum(sum(s.cache_misses.values()) for s in statistics), sum(len(s.cache_hits) for s in statistics))


@cache
def _problem() -> Problem:
    """A fit of the data of the true parameters."""
    model, f = two_segment(), np.array([0.1, 0.3, 1.0, 3.0])
    return paper_cost(model, f, frf(model, model.truth, f))


def _stability() -> None:
    model = _problem().model
    growth_rate(model, model.truth)


def _simulation() -> None:
    model = _problem().model
    simulate(model, model.truth, np.zeros((64, 3)), 1 / EVERY_S)


def _lm() -> None:
    problem = _problem()
    lm(problem, problem.model.truth[None], 1e-12, 1)


def _gram() -> None:
    problem = _problem()
    normal_equations(problem, problem.model.truth[None])


def _starts() -> None:
    problem = _problem()
    LinearModel.of(problem.model, problem.f).steps(problem, problem.model.truth[None], POOL[-1:])


def _diagnosis() -> None:
    # Imported here: studies need none of them, and the statistics behind the first take a second to import.
    from mcstudy.fitting.penalised import Fitter
    from mcstudy.fitting.small_linear import gaussian_factor, orthonormal

    problem = _problem()
    model = problem.model
    fitter = Fitter(model, Prior(model.truth, model.upper - model.lower), problem.f)
    for count in (1, 2):  # a single start has bounds that cannot be written to, which is another type
        fitter.fits(pack(problem.data, problem.weight), np.tile(model.truth, (count, 1)))
    gaussian_factor(np.eye(2), np.ones((2, 1)), 1.0)
    orthonormal(np.eye(2, 4), np.ones((1, 4)), 1e-6)


PARTS = {
    "stability": _stability,
    "time_domain": _simulation,
    "lm": _lm,
    "linearised": _starts,
    "gram": _gram,
    "diagnosis": _diagnosis,
}
"""What needs which functions, by the name of the simulator, solver or kind of starts in a study file, or our own."""
