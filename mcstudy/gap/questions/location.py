"""Location of the gap in the body: probabilities with abstention, and the torque that would close the gap.

The probability of a location is the posterior probability of the causes that act there. An effect that acts at two
locations counts half for each. The probability without a location (an unknown cause that may act anywhere, or no
missing effect) is assigned to none. The torque tau = A (y - H) that would close the gap is for illustration only: after
refitting, up to 94 % of an ankle cause can be explained as a hip torque.
"""

from __future__ import annotations

import numpy as np

from mcstudy.effect_library.library import library_of, places
from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.gap.questions.posterior import Explanation
from mcstudy.stance.body import standing
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import output_matrices, system

RECORDING = "recording"
"""The location of a mislabelling, which is judged of a standing body."""


def locations(explanation: Explanation, model: Model) -> tuple[dict[str, float], float]:
    """Probability of every location in a ``model``, and the probability that is assigned to none."""
    out: dict[str, float] = dict.fromkeys((*places(model), *((RECORDING,) if standing(model) else ())), 0.0)
    known = library_of(model)
    for hypothesis, probability in explanation.hypotheses:
        where = [p for n in hypothesis.effects for p in (known[n].place if n in known else (RECORDING,))]
        for p in where:
            out[p] += probability / len(where)
    for place, share in explanation.unknown_locations.items():
        if place in out:
            out[place] += share
    # Rounding may carry a sum of probabilities past 1.
    return {k: min(float(v), 1.0) for k, v in out.items()}, max(0.0, 1.0 - float(sum(out.values())))


def missing_torque(fitted: Fitted, data: Data) -> np.ndarray:
    """A(s) (y - H), the torque per stimulus by row that would close the gap, (N, R) complex.

    Where outputs are measured instead of all angles, it is the smallest torque that would close it.
    """
    s = 2j * np.pi * data.f
    A, _ = system(fitted.model, fitted.theta, s)
    if fitted.model.outputs:
        A = np.linalg.pinv(output_matrices(fitted.model, s)[0] @ np.linalg.inv(A))
    return np.einsum("nij,nj->ni", A, data.y - fitted.response(data.f))
