"""Effects that no test can tell apart, before and after a planned trial.

Two effects are twins if their signatures, at the base fit and after all its parameters have been fitted again, have a
|cosine| above `mcstudy.gap.candidates.signatures.ALIKE`. With a planned trial the signatures are those of the recorded
and the planned lines together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mcstudy.effect_library.library import library_of
from mcstudy.fitting.penalised import Fitted, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.signatures import alike_groups, applicable, signatures, similarity
from mcstudy.gap.trial_planning.predictions import moved
from mcstudy.gap.trial_planning.trials import PlannedTrial, SwayNoise
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.spectra.line_noise import LineNoise
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import Body
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import joined, members, under
from mcstudy.stance.response import frf

KNOWN = 1e9
"""Degrees of freedom of a noise covariance that is not estimated."""


@dataclass(frozen=True)
class Twins:
    r"""Similarity of the effects.

    Attributes
    ----------
    effects
        Their names, E of them.
    cosine
        (E, E), largest \|cosine\| of their signatures.
    """

    effects: tuple[str, ...]
    cosine: np.ndarray

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Effects with an indistinguishable twin, group by group."""
        return tuple(g for g in alike_groups(self.effects, self.cosine) if len(g) > 1)

    @property
    def count(self) -> int:
        """Number of effects with an indistinguishable twin."""
        return sum(map(len, self.groups))


def twins(base: Fitted, data: Data) -> Twins:
    """Twins at a fit of the base model."""
    shapes = signatures(base, data, applicable(base.model))
    unit = np.array([s.vector / max(s.delta, 1e-300) for s in shapes])
    names, cosine = similarity([s.effect for s in shapes], unit, library_of(base.model))
    return Twins(tuple(names), cosine)


def twins_after(base: Fitted, lines: Lines, plan: Sequence[PlannedTrial], noise: SwayNoise, body: Body) -> Twins:
    """Twins with the lines of planned trials beside the recorded ones."""
    kinds = [under(base.model, t.kind, body) for t in plan]
    names = tuple(dict.fromkeys(p for m in kinds for p in m.parameters))
    added = [replace(m, parameters=names) for m in kinds]
    theta = moved(base, added[0])[0].theta
    models = [replace(m, parameters=names) for m in members(base.model)]
    model = joined([*models, *added], (*lines.counts, *(t.f.size for t in plan)))
    f = np.concatenate([lines.f, *(t.f for t in plan)])
    weight = np.concatenate([lines.noise.whitener, *(_whitener(t.covariance(noise)) for t in plan)])
    return twins(*_at(model, theta, f, weight))


def twins_of_design(model: Model, trials: Sequence[PlannedTrial], noise: SwayNoise, body: Body) -> Twins:
    """Twins in planned trials alone, at the nominal values of ``model``."""
    several = [under(model, t.kind, body) for t in trials]
    names = dict.fromkeys(p for m in several for p in m.parameters)
    every = [replace(m, parameters=tuple(names)) for m in several]
    joint = opened(joined(every, [t.f.size for t in trials]) if len(every) > 1 else every[0])
    weight = np.concatenate([_whitener(t.covariance(noise)) for t in trials])
    return twins(*_at(joint, joint.truth, np.concatenate([t.f for t in trials]), weight))


def at_own_responses(model: Model, theta: np.ndarray, f: np.ndarray, C: np.ndarray) -> tuple[Fitted, Data]:
    """The fit of a model to its own responses at ``theta`` (P,), with noise of covariance ``C`` (N, 2, 2)."""
    return _at(model, theta, f, _whitener(C))


def _whitener(C: np.ndarray) -> np.ndarray:
    return LineNoise(C, np.full(len(C), KNOWN)).whitener


def _at(model: Model, theta: np.ndarray, f: np.ndarray, weight: np.ndarray) -> tuple[Fitted, Data]:
    """The fit of a model to its own responses at ``theta``."""
    data = Data(f, frf(model, theta, f), weight)
    return Fitter(model, weak_prior(model, model), f).best(data, theta), data
