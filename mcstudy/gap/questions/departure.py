"""What a mechanism in roughly its form leaves: a small smooth remainder beside every named effect.

Shape constants describe some departures of a real mechanism from its declaration
(`mcstudy.gap.questions.other_forms`); others have no constant. Every effect therefore has a discrepancy of its own, a
smooth torque or error of the sensors (`mcstudy.gap.candidates.remainder`) whose root mean square is one of `SHARES` of
that of the effect's own trace. So evidence falls gently as a form departs. A larger remainder is a cause outside the
library beside the effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.remainder import Remainder
from mcstudy.gap.questions.evidence import Hypothesis

SHARES = (0.05, 0.1, 0.2)
"""Root mean square of the remainder as parts of that of the effect's own trace, with equal probabilities."""

VISIBLE = 1.0
"""Energy, in units of the variance of noise, that the largest remainder must have to be considered."""

EXACT = 0.5
"""Probability of a form without remainder."""

NEAR = 25.0
"""ln evidence below that of the best effect from which a remainder cannot matter."""


def with_departures(base: Fitted, data: Data, singles: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The hypotheses with the evidence of a small remainder beside each, in the same order."""
    best = max(h.log_evidence for h in singles)
    return [departed(base, data, h) if h.log_evidence > best - NEAR else h for h in singles]


def departed(base: Fitted, data: Data, h: Hypothesis) -> Hypothesis:
    """A hypothesis with the evidence of a remainder in proportion to what its effect explains."""
    beside = remainder(base, h.fitted, data)
    if beside is None:
        return h
    gain = np.logaddexp(np.log(EXACT), np.log(1 - EXACT) + beside.log_factor)
    return replace(h, log_evidence=h.log_evidence + float(gain))


def remainder(base: Fitted, fitted: Fitted, data: Data) -> Remainder | None:
    """The remainder beside effects in ``fitted``; None where they explain so little that none could be seen."""
    explained = base.chi2 + base.penalty - fitted.chi2 - fitted.penalty
    energies = explained * np.square(SHARES)
    return Remainder(fitted, data, energies) if energies.max() > VISIBLE else None


def left_energies(base: Fitted, fitted: Fitted, data: Data, rng: np.random.Generator, n: int) -> np.ndarray:
    """Posterior samples (n,) of the squared residual that the remainder adds, 0 for a form without one."""
    beside = remainder(base, fitted, data)
    if beside is None:
        return np.zeros(n)
    odds = np.exp(min(beside.log_factor, 600.0)) * (1 - EXACT) / EXACT
    return np.where(rng.random(n) < odds / (1 + odds), beside.samples(rng, n), 0.0)
