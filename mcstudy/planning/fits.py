"""The fits of a design: those that the study would make, and cheap ones as controls.

A design differs from the group of the study file in cycles, amplitude and Fmax. The realizations are those of the
study: the same noise at every amplitude and Fmax, the same starts everywhere. To simulate one costs as much as to fit
it, so the controls are drawn from the exact distribution of the FRFs (`mcstudy.spectra.frf_law`), from the same random
numbers at every design. Everything that was fitted is kept: to look at a design again, or at more draws of it, costs
only what is new.

A control sees the FRFs alone. With maximum likelihood it weights them with the expected covariance, because the
estimated one cannot be drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from mcstudy.fitting.linearised import linear, linearised_many
from mcstudy.fitting.problem import Problem, ml_cost, paper_cost
from mcstudy.fitting.solvers import fit_queue
from mcstudy.fitting.status import USABLE
from mcstudy.spectra.frf_law import FrfLaw, frf_law
from mcstudy.stance.feedback import Model
from mcstudy.streams import stream
from mcstudy.study.experiment import Experiment
from mcstudy.study.group import Group
from mcstudy.study.measure import KEPT_REALIZATIONS, stimulus

FULL, TRUTH, LINEARISED = "full", "truth", "linearised"
"""Kinds of fits: all starts of the study; one start at the true values; one start computed from the data."""

AT_ONCE = 32
"""Draws that a thread makes and fits at a time."""

RACE_EVALUATIONS = 450
"""Evaluations of the model with its derivatives behind one linearised start (`mcstudy.fitting.linearised`)."""

SAMPLE_EVALUATIONS = 0.05
"""Time to simulate one sample of a record, in evaluations of the model with its derivatives (10 ms for 52,000)."""


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
    """Estimates at designs of one group, every draw and kind of fit once.

    Parameters
    ----------
    group: of the study. seed: of the study. fmax: every Fmax that may be asked for, Hz. threads: that fit.
    """

    def __init__(self, group: Group, seed: int, fmax: Iterable[float], threads: int = 1) -> None:
        self.group = group.model_copy(update={"fmax": tuple(sorted(fmax)), "realizations": KEPT_REALIZATIONS})
        self.seed, self._threads = seed, threads
        self._experiments: dict[tuple[int, int], Experiment] = {}
        self._laws: dict[int, FrfLaw] = {}
        self._kept: dict[tuple[Design, str, bool], np.ndarray] = {}
        self._counts: dict[str, tuple[int, Spent]] = {}
        self.model: Model = self.experiment(group.stimulus.cycles).model

    @property
    def controls(self) -> tuple[str, ...]:
        """Kinds of controls that the group allows."""
        if self.group.simulator != "spectral":
            return ()
        other = self.model.weights or self.group.fit.starts == LINEARISED or not linear(self.model)
        return (TRUTH,) if other else (TRUTH, LINEARISED)

    @property
    def spent(self) -> Spent:
        """All fits so far."""
        total = Spent()
        for _, part in self._counts.values():
            total.add(part)
        return total

    def cost(self, kind: str) -> float:
        """Evaluations of the model behind one draw of that kind, from all so far; NaN before the first."""
        made, spent = self._counts.get(kind, (0, Spent()))
        return spent.evaluations / made if made else np.nan

    def simulation(self, cycles: int) -> float:
        """What it costs to simulate a record, in evaluations of the model."""
        s = self.group.stimulus
        return SAMPLE_EVALUATIONS * cycles * (3**s.stages - 1) * s.state_s * s.rate_hz

    def experiment(self, cycles: int, realization: int = 0) -> Experiment:
        """The experiment with so many cycles; each keeps the noise of `KEPT_REALIZATIONS` realizations."""
        key = (cycles, realization // KEPT_REALIZATIONS)
        if key not in self._experiments:
            section = self.group.stimulus.model_copy(update={"cycles": cycles})
            self._experiments[key] = Experiment(self.group.model_copy(update={"stimulus": section}), self.seed)
        return self._experiments[key]

    def law(self, cycles: int) -> FrfLaw:
        """Distribution of the FRFs up to the highest Fmax."""
        if cycles not in self._laws:
            g = self.group
            bands = self.experiment(cycles).bands.below(g.fmax[-1])
            noise, unit, removed = g.noise_source, stimulus(g, 1.0), g.spectra.ramp == "remove"
            measured = g.measurement_noise
            self._laws[cycles] = frf_law(self.model, unit, noise, bands, cycles, g.stimulus.discard, removed, measured)
        return self._laws[cycles]

    def realizations(self, design: Design, kind: str, n: int) -> np.ndarray:
        """Estimates (n, P) of the first ``n`` realizations; NaN where no start gave a usable fit."""
        return self._estimates(design, kind, n, drawn=False)

    def draws(self, design: Design, kind: str, n: int) -> np.ndarray:
        """Estimates (n, P) of a control for ``n`` draws of the data from their distribution."""
        return self._estimates(design, kind, n, drawn=True)

    def _estimates(self, design: Design, kind: str, n: int, drawn: bool) -> np.ndarray:
        key = (design, kind, drawn)
        kept = self._kept.get(key, np.empty((0, len(self.model.parameters))))
        if len(kept) >= n:
            return kept[:n]
        for first in range(0, n, KEPT_REALIZATIONS):  # made here, not by two threads at once
            self.experiment(design.cycles, 0 if drawn else first)
        if kind != FULL:
            self.law(design.cycles)
        make = self._drawn if drawn else self._measured
        with ThreadPoolExecutor(self._threads) as pool:
            blocks = list(_blocks(len(kept), n))
            parts = list(pool.map(lambda block: self._fitted(*make(design, kind, block), kind, block), blocks))
        for x, spent in parts:
            made, total = self._counts.get(kind, (0, Spent()))
            total.add(spent)
            self._counts[kind] = (made + len(x), total)
        self._kept[key] = np.concatenate([kept, *(x for x, _ in parts)])
        return self._kept[key]

    def _measured(self, design: Design, kind: str, block: range) -> tuple[Experiment, list[Problem]]:
        experiment = self.experiment(design.cycles, block[0])
        data = [experiment.measure(design.amplitude, r) for r in block]
        if kind == FULL:
            return experiment, [experiment.problem(d, design.fmax) for d in data]
        return experiment, self._problems(design, experiment, np.stack([d.frf for d in data]))

    def _drawn(self, design: Design, kind: str, block: range) -> tuple[Experiment, list[Problem]]:
        del kind
        law = self.law(design.cycles)
        normal = np.stack([stream(self.seed, "planning", r).standard_normal(law.size) for r in block])
        experiment = self.experiment(design.cycles)
        return experiment, self._problems(design, experiment, law.draw(normal, design.amplitude))

    def _problems(self, design: Design, experiment: Experiment, frfs: np.ndarray) -> list[Problem]:
        n = experiment.points[design.fmax]
        f = experiment.f[:n]
        if self.group.fit.cost == "paper":
            return [paper_cost(self.model, f, x[:n]) for x in frfs]
        covariance = self.law(design.cycles).covariance[:n] / design.amplitude**2
        return [ml_cost(self.model, f, x[:n], covariance) for x in frfs]

    def _fitted(
        self, experiment: Experiment, problems: list[Problem], kind: str, block: range
    ) -> tuple[np.ndarray, Spent]:
        starts, before = STARTS[kind](experiment, problems, block)
        R, S, P = starts.shape
        how = self.group.fit
        fits = fit_queue(problems, np.repeat(np.arange(R), S), starts.reshape(R * S, P), how.solver, how.options())
        usable = np.isin(fits.status, USABLE) & np.isfinite(fits.cost)
        cost = np.where(usable, fits.cost, np.inf).reshape(R, S)
        best = cost.argmin(axis=1)
        estimate = fits.estimate.reshape(R, S, P)[np.arange(R), best]
        # a control may be anything that is the same for realizations and for draws
        estimate[np.isinf(cost.min(axis=1))] = np.nan if kind == FULL else self.model.truth
        return estimate, Spent(R * S, int(fits.iterations.sum()) + before)


def _blocks(first: int, last: int) -> Iterator[range]:
    """Ranges from ``first`` to before ``last``, none over the edge of an experiment."""
    while first < last:
        end = min(first + AT_ONCE, last, (first // KEPT_REALIZATIONS + 1) * KEPT_REALIZATIONS)
        yield range(first, end)
        first = end


Starts = Callable[[Experiment, list[Problem], range], tuple[np.ndarray, int]]
"""Starts (R, S, P) of problems, and the evaluations of the model that they took."""


def _at_truth(experiment: Experiment, problems: list[Problem], block: range) -> tuple[np.ndarray, int]:
    del block
    return np.repeat(experiment.model.truth[None, None], len(problems), axis=0), 0


def _linearised(experiment: Experiment, problems: list[Problem], block: range) -> tuple[np.ndarray, int]:
    streams = [stream(experiment.seed, "control", r) for r in block]  # the first start uses none of their numbers
    return linearised_many(problems, streams, 1), RACE_EVALUATIONS * len(problems)


def _all(experiment: Experiment, problems: list[Problem], block: range) -> tuple[np.ndarray, int]:
    group = experiment.group
    race = RACE_EVALUATIONS * group.starts * len(problems) if group.fit.starts == LINEARISED else 0
    return experiment.starts(problems, list(block)), race


STARTS: dict[str, Starts] = {FULL: _all, TRUTH: _at_truth, LINEARISED: _linearised}
