"""The experiment of one group: frequency points, data of a realization, fit problems and starts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf
from mcstudy.streams import start_stream
from mcstudy.study.cube.layout import Layout, layout
from mcstudy.study.design import Group
from mcstudy.study.group import EffectsSection
from mcstudy.study.measure import Measurement, kept_points, measuring
from mcstudy.study.models import build_model, simulated_model

if TYPE_CHECKING:
    from mcstudy.fitting.problem import Problem


class Experiment:
    """The experiment of one group; everything that is common to all cells is prepared once. Thread-safe.

    Parameters
    ----------
    group: the resolved group.
    seed: seed of the study.
    """

    def __init__(self, group: Group, seed: int) -> None:
        self.group, self.seed = group, seed
        self.model: Model = build_model(group)
        self.bands = kept_points(group)
        stimuli = len(self.model.stimulus_names)
        self.f = np.repeat(self.bands.f, stimuli)
        self.points = {fmax: stimuli * len(self.bands.below(fmax)) for fmax in group.fmax}
        """Frequencies up to each Fmax of the group, every point once for each stimulus."""
        self.n_frequencies = tuple(self.points[fmax] for fmax in group.fmax)
        body = self.model if group.effects == EffectsSection() else simulated_model(group)
        self.true_frf = frf(body, body.truth, self.f)
        self.measure = measuring(group, body, self.bands, seed)

    def layout(self, depth: int) -> Layout:
        """The arrays of the group in a cube, with ``depth`` realizations a chunk."""
        return layout(self.group, self.model, self.f, self.n_frequencies, self.true_frf, depth)

    def problem(self, data: Measurement, fmax: float) -> Problem:
        """The fit problem of a measurement on the frequencies up to ``fmax``, one of the group's."""
        from mcstudy.fitting.problem import ml_cost, paper_cost  # who only reads a cube fits nothing

        n = self.points[fmax]
        if self.group.fit.cost == "ml":
            assert data.covariance is not None  # a study file with ml and without noise is refused
            return ml_cost(self.model, self.f[:n], data.frf[:n], data.covariance[:n])
        return paper_cost(self.model, self.f[:n], data.frf[:n])

    def standard_errors(self, problem: Problem, theta: np.ndarray, data: Measurement) -> np.ndarray:
        """Standard errors (P,) of the estimate ``theta`` of a problem of this measurement, NaN on a bound."""
        from mcstudy.fitting.standard_errors import standard_errors

        assert data.covariance is not None  # a study file with standard errors and without noise is refused
        n = len(problem.f)
        likelihood = self.group.fit.cost == "ml"
        return standard_errors(problem, theta, data.covariance[:n], self._overlap[:n, :n], likelihood)

    @cached_property
    def _overlap(self) -> np.ndarray:
        from mcstudy.fitting.standard_errors import overlap_of

        return overlap_of(self.bands, len(self.model.stimulus_names))

    def starts(self, problems: Sequence[Problem], realizations: Sequence[int], first: int | None = None) -> np.ndarray:
        """The ``first`` starts, or all, for one problem per realization, (R, starts, P).

        They are the same at every Fmax unless taken from the data.
        """
        from mcstudy.fitting.linearised import linearised_many
        from mcstudy.fitting.starts import STARTS

        n = self.group.starts if first is None else first
        streams = [start_stream(self.seed, realization) for realization in realizations]
        if self.group.fit.starts == "linearised":
            return linearised_many(problems, streams, n)
        draw = STARTS[self.group.fit.starts]
        return np.stack([draw(self.model, rng, n) for rng in streams])
