"""Named effects in other forms than the declared one: the shape constants that their declarations leave open.

A real mechanism never has exactly the declared damping ratio, order or split over the joints. Half of the prior
probability of an effect belongs to its declared form, half to other forms, whose constants (`Form`) have normal priors
and are integrated over like all other parameters (`mcstudy.gap.questions.evidence.profiled`). So evidence falls gently
as a form departs from the declaration.

Every effect is fitted again in other forms, and integrated over where that fit comes near the best. How much its
constants can gain to first order around the declared form is no guide to which effects deserve it: of three recordings
in which another form was decisive, it pointed to the right effect in none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mcstudy.effect_library import library
from mcstudy.fitting.penalised import Fitted, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.questions.evidence import Hypothesis, profiled
from mcstudy.lines.priors import weak_prior

OTHER = 0.5
"""Prior probability that an effect has another form than the declared one."""

LEADS = -3.0
"""ln evidence, relative to no effect, of a declared form from which other forms are fitted."""

HOPELESS = 60.0
"""Squared residual and penalty above the best of all effects from which the constants are not integrated over."""


def in_other_forms(base: Fitted, data: Data, none: Hypothesis, declared: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The hypotheses, each with the evidence of the declared and of other forms together, in the same order.

    The fit and the sizes are those of the more probable of the two. Where no effect comes near ``none``, the base
    model, nothing is fitted again.
    """
    if not any(h.log_evidence > none.log_evidence + LEADS for h in declared):
        return list(declared)
    known = library.library_of(base.model)
    fits = [_other(base, data, h) if known[h.effects[0]].forms else None for h in declared]
    best = min([_cost(h.fitted) for h in declared] + [_cost(x[1]) for x in fits if x is not None])
    return [
        h if x is None or _cost(x[1]) > best + HOPELESS else mixed(h, _profiled(base, data, h, *x))
        for h, x in zip(declared, fits, strict=True)
    ]


def mixed(declared: Hypothesis, other: Hypothesis) -> Hypothesis:
    """The declared form or another one, with their prior probabilities."""
    a, b = np.log(1 - OTHER) + declared.log_evidence, np.log(OTHER) + other.log_evidence
    return replace(other if b > a else declared, log_evidence=float(np.logaddexp(a, b)))


def reformed(base: Fitted, data: Data, declared: Hypothesis) -> Hypothesis:
    """An effect in other forms, its shape constants integrated over."""
    return _profiled(base, data, declared, *_other(base, data, declared))


def _other(base: Fitted, data: Data, declared: Hypothesis) -> tuple[Fitter, Fitted]:
    """The best fit with estimated shape constants.

    It starts from the declared form, from both ends of the ranges of the constants, and from usual sizes on the nominal
    body, because the best fit of the declared form may be far from that of the right one.
    """
    effect = library.library_of(base.model)[declared.effects[0]]
    model = library.apply(base.model, effect.name, opened=[effect.name])
    fitter = Fitter(model, weak_prior(model, base.model), data.f)
    starts = [[*declared.fitted.theta, *c] for c in effect.corner_forms]
    usual, middle = [sum(s.published) / 2 for s in effect.sizes], [f.prior[0] for f in effect.forms]
    for factor in (1.0, 0.2, -1.0, -0.2) if effect.size.signed else (1.0, 0.2):
        starts.append([*base.prior.mean, factor * usual[0], *usual[1:], *middle])
    return fitter, fitter.pick(fitter.fits(fitter.packed(data), np.clip(np.array(starts), model.lower, model.upper)))


def _profiled(base: Fitted, data: Data, declared: Hypothesis, fitter: Fitter, mode: Fitted) -> Hypothesis:
    return profiled(fitter, data, library.library_of(base.model)[declared.effects[0]], mode, base.theta.size)


def _cost(fitted: Fitted) -> float:
    return fitted.chi2 + fitted.penalty
