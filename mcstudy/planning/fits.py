"""The fits of a design: cheap ones as controls, and those that the study would make.

A design differs from the group of the study file in cycles, amplitude and Fmax. Realizations are those of the study:
the same noise at every amplitude and Fmax, the same starts everywhere. Everything that was fitted is kept, so to look
at a design again, or at more of its realizations, costs only what is new.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from mcstudy.errors import DesignError
from mcstudy.fitting.linearised import linearised_many
from mcstudy.fitting.problem import Problem
from mcstudy.fitting.solvers import fit_queue
from mcstudy.fitting.status import USABLE
from mcstudy.stance.feedback import Model
from mcstudy.streams import stream
from mcstudy.study.checks import check_group
from mcstudy.study.experiment import Experiment
from mcstudy.study.group import Group
from mcstudy.study.measure import KEPT_REALIZATIONS

TRUTH, LINEARISED, FULL = "truth", "linearised", "full"
"""Kinds of fits: one start at the true values; one start from the data; all starts of the study."""

AT_ONCE = 32
"""Realizations that a thread measures and fits at a time."""


@dataclass(frozen=True, order=True)
class Design:
    """What is chosen: recorded cycles, amplitude in units of the stimulus, highest frequency of the fits in Hz."""

    cycles: int
    amplitude: float
    fmax: float


@dataclass
class Spent:
    """Fits that were made, as ``fits`` (starts) and as ``evaluations`` of the model with its derivatives."""

    fits: int = 0
    evaluations: int = 0

    def add(self, other: Spent) -> None:
        """Count more."""
        self.fits, self.evaluations = self.fits + other.fits, self.evaluations + other.evaluations


class Fitter:
    """Estimates at designs of one group, each realization and kind of fit once.

    Parameters
    ----------
    group: of the study. seed: of the study. fmax: every Fmax that may be asked for, Hz. threads: that fit.
    """

    def __init__(self, group: Group, seed: int, fmax: Iterable[float], threads: int = 1) -> None:
        self._group = group.model_copy(update={"fmax": tuple(sorted(fmax)), "realizations": KEPT_REALIZATIONS})
        self._seed, self._threads = seed, threads
        self._experiments: dict[tuple[int, int], Experiment] = {}
        self._kept: dict[tuple[Design, str], np.ndarray] = {}
        self._evaluations: dict[str, Spent] = {kind: Spent() for kind in (TRUTH, LINEARISED, FULL)}
        self.model: Model = self.experiment(group.stimulus.cycles).model

    @property
    def spent(self) -> Spent:
        """All fits so far."""
        total = Spent()
        for part in self._evaluations.values():
            total.add(part)
        return total

    def cost(self, kind: str) -> float:
        """Evaluations of the model for one realization, from all fits of that kind so far; NaN before the first."""
        made = sum(len(v) for (_, k), v in self._kept.items() if k == kind)
        return self._evaluations[kind].evaluations / made if made else np.nan

    def experiment(self, cycles: int, realization: int = 0) -> Experiment:
        """The experiment with so many cycles; each keeps the noise of `KEPT_REALIZATIONS` realizations."""
        key = (cycles, realization // KEPT_REALIZATIONS)
        if key not in self._experiments:
            stimulus = self._group.stimulus.model_copy(update={"cycles": cycles})
            group = self._group.model_copy(update={"stimulus": stimulus})
            if not self._experiments:
                _check(group)
            self._experiments[key] = Experiment(group, self._seed)
        return self._experiments[key]

    def estimates(self, design: Design, kind: str, n: int) -> np.ndarray:
        """Estimates (n, P) of the first ``n`` realizations; NaN where no start gave a usable fit."""
        key = (design, kind)
        kept = self._kept.get(key, np.empty((0, len(self.model.parameters))))
        if len(kept) < n:
            for first in range(0, n, KEPT_REALIZATIONS):  # made here, not by two threads at once
                self.experiment(design.cycles, first)
            blocks = list(_blocks(len(kept), n))
            with ThreadPoolExecutor(self._threads) as pool:
                parts = list(pool.map(lambda block: self._fitted(design, kind, block), blocks))
            for _, spent in parts:
                self._evaluations[kind].add(spent)
            self._kept[key] = kept = np.concatenate([kept, *(x for x, _ in parts)])
        return kept[:n]

    def _fitted(self, design: Design, kind: str, block: range) -> tuple[np.ndarray, Spent]:
        experiment = self.experiment(design.cycles, block[0])
        problems = [experiment.problem(experiment.measure(design.amplitude, r), design.fmax) for r in block]
        starts, before = STARTS[kind](experiment, problems, block)
        R, S, P = starts.shape
        group = self._group.fit
        fits = fit_queue(problems, np.repeat(np.arange(R), S), starts.reshape(R * S, P), group.solver, group.options())
        usable = np.isin(fits.status, USABLE) & np.isfinite(fits.cost)
        cost = np.where(usable, fits.cost, np.inf).reshape(R, S)
        best = cost.argmin(axis=1)
        estimate = fits.estimate.reshape(R, S, P)[np.arange(R), best]
        failed = np.isinf(cost[np.arange(R), best])
        # a control may be anything that is the same on both levels
        estimate[failed] = np.nan if kind == FULL else self.model.truth
        return estimate, Spent(R * S, int(fits.iterations.sum()) + before)


def _blocks(first: int, last: int) -> Iterator[range]:
    """Ranges of realizations from ``first`` to before ``last``, none over the edge of an experiment."""
    while first < last:
        end = min(first + AT_ONCE, last, (first // KEPT_REALIZATIONS + 1) * KEPT_REALIZATIONS)
        yield range(first, end)
        first = end


def _check(group: Group) -> None:
    try:
        check_group(group)
    except DesignError as error:
        raise DesignError(f"{error}") from None


Starts = Callable[[Experiment, list[Problem], range], tuple[np.ndarray, int]]
"""Starts (R, S, P) of problems of realizations, and the evaluations of the model that they took."""

RACE_EVALUATIONS = 450
"""Evaluations of the model with its derivatives behind one linearised start (`mcstudy.fitting.linearised`)."""


def _at_truth(experiment: Experiment, problems: list[Problem], block: range) -> tuple[np.ndarray, int]:
    del block
    return np.repeat(experiment.model.truth[None, None], len(problems), axis=0), 0


def _linearised(experiment: Experiment, problems: list[Problem], block: range) -> tuple[np.ndarray, int]:
    streams = [stream(experiment.seed, "control", r) for r in block]
    return linearised_many(problems, streams, 1), RACE_EVALUATIONS * len(problems)


def _all(experiment: Experiment, problems: list[Problem], block: range) -> tuple[np.ndarray, int]:
    group = experiment.group
    race = RACE_EVALUATIONS * group.starts * len(problems) if group.fit.starts == "linearised" else 0
    return experiment.starts(problems, list(block)), race


STARTS: dict[str, Starts] = {TRUTH: _at_truth, LINEARISED: _linearised, FULL: _all}
