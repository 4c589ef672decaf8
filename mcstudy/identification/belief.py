"""Whether the model is good enough to believe its parameters: the test for a gap, and the fit with effects added.

The test is that of ``mcstudy gap diagnose --fast`` on the same lines. Effects that are added to the fit are judged in
two ways that do not share their assumptions: by evidence, with the published sizes as prior, and by cycles that the fit
did not see, without any prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.effect_library.library import effect
from mcstudy.fitting.penalised import Fitter, whiten
from mcstudy.fitting.problem import Data
from mcstudy.gap.questions.any_gap import GapTest, gap_test
from mcstudy.gap.questions.evidence import Hypothesis, single, together
from mcstudy.gap.settings import DiagnosisSettings
from mcstudy.identification.minimum import Minima, without_prior
from mcstudy.lines.base_fit import base_fit
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf

LEADING = 4
"""Minima of each model from which the fits to half of the cycles start."""


@dataclass(frozen=True)
class GapFound:
    """The test for a gap between recording and model without effects.

    Attributes
    ----------
    p_value, p_least
        Its p-value, and the smallest one that its null samples can give.
    """

    p_value: float
    p_least: float


@dataclass(frozen=True)
class WithEffects:
    """The model with added effects against the model without.

    Attributes
    ----------
    effects
        Their names.
    log_bayes_factor
        ln of the evidence with the effects over that without. For one effect its size is integrated numerically; all
        else by Laplace's approximation.
    unseen, unseen_se
        Squared residual of cycles that the fit did not see, without minus with the effects (positive: the effects
        predict better), and its standard error; None for fewer than two repeats.
    """

    effects: tuple[str, ...]
    log_bayes_factor: float
    unseen: float | None
    unseen_se: float | None


def gap_found(lines: Lines, base: Model, seed: int) -> tuple[GapFound, GapTest]:
    """The test of ``mcstudy gap diagnose --fast``, and all that it computed."""
    test = gap_test(lines, base_fit(lines, base, seed), DiagnosisSettings(fast=True, seed=seed))
    return GapFound(test.p_value, test.p_least), test


def with_effects(
    test: GapTest, lines: Lines, models: tuple[Model, Model], minima: tuple[Minima, Minima], effects: Sequence[str]
) -> WithEffects:
    """The comparison; ``models`` and their ``minima`` without and with the ``effects``."""
    factor = _evidence(test, minima[1], effects).log_evidence - test.fit.best.log_evidence
    fitters = [Fitter(m, without_prior(m, models[0]), lines.f) for m in models]
    unseen = unseen_cycles(lines, fitters, minima)
    return WithEffects(tuple(effects), float(factor), *(unseen or (None, None)))


def _evidence(test: GapTest, minima: Minima, effects: Sequence[str]) -> Hypothesis:
    fit = test.fit
    if len(effects) == 1:
        signatures = [s for s in test.signatures if s.effect == effects[0]]
        return single(fit.best, fit.minima, fit.data, effects[0], signatures, fit.best.residual(fit.data))
    middle = [sum(s.published) / 2 for name in effects for s in effect(name).sizes]
    starts = np.vstack([minima.theta[:LEADING], *(np.append(theta, middle) for theta in fit.minima)])
    return together(fit.best, fit.data, tuple(effects), starts)  # type: ignore[arg-type]


def unseen_cycles(lines: Lines, fitters: Sequence[Fitter], minima: Sequence[Minima]) -> tuple[float, float] | None:
    """Squared residual of unseen cycles, first minus second model, and its standard error; None for one repeat.

    Both models, each with its ``fitters`` and ``minima``, are fitted to every second repeat and judged on the others,
    and the other way round.
    """
    if min(len(part.repeats) for part in lines.parts) < 2:
        return None
    order = np.lexsort((lines.cycle, lines.trial))
    even = np.zeros(order.size, dtype=bool)
    even[order[::2]] = True
    difference, variance = 0.0, 0.0
    for seen in (even, ~even):
        seen_data, unseen_data = Data.of(lines.subset(seen)), Data.of(lines.subset(~seen))
        fitted = [_refitted(m, k, seen_data) for m, k in zip(fitters, minima, strict=True)]
        left = [whiten(unseen_data.weight, unseen_data.y - H) for H in fitted]
        apart = left[0] - left[1]
        difference += float(left[0] @ left[0] - left[1] @ left[1])
        variance += 4 * float(apart @ apart)
    return difference, float(np.sqrt(variance))


def _refitted(fitter: Fitter, minima: Minima, data: Data) -> np.ndarray:
    """FRFs (N, Y) of the best fit to ``data`` from the lowest minima."""
    return frf(fitter.model, fitter.best(data, minima.theta[:LEADING]).theta, data.f)
