"""Where in the body the gap arises: probabilities of place, with abstention, and the back-projected torque.

A place has the posterior probability of the causes that act there; an effect that acts at two places counts half for
each, and what has no place - the unknown that may be anywhere, or nothing missing - is abstained from. The torque
tau = A (y - H) that would close the gap is a picture and no verdict: after refitting, an ankle cause can be explained
up to 94 % as a hip torque.
"""

from __future__ import annotations

import numpy as np

from mcstudy.gap.declare import PLACES
from mcstudy.gap.effects import effect
from mcstudy.gap.explain import Explanation
from mcstudy.gap.fitting import Data, Fitted
from mcstudy.stance.response import system


def places(explanation: Explanation) -> tuple[dict[str, float], float]:
    """Probability of every place, and the probability that is given to none."""
    out: dict[str, float] = dict.fromkeys(PLACES, 0.0)
    for hypothesis, probability in explanation.hypotheses:
        where = [p for n in hypothesis.effects for p in effect(n).place]
        for p in where:
            out[p] += probability / len(where)
    for place, share in explanation.unknown_places.items():
        if place in out:
            out[place] += share
    # Sums of probabilities, which rounding may carry past 1.
    return {k: min(float(v), 1.0) for k, v in out.items()}, max(0.0, 1.0 - float(sum(out.values())))


def missing_torque(fitted: Fitted, data: Data) -> np.ndarray:
    """A(s) (y - H), the torque per stimulus by row (hip, ankle) that would close the gap, (N, 2) complex."""
    A, _ = system(fitted.model, fitted.theta, 2j * np.pi * data.f)
    return np.einsum("nij,nj->ni", A, data.y - fitted.response(data.f))
