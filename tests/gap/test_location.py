"""Where the gap arises: locations share the posterior, and what has no place is abstained from."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.questions.evidence import Hypothesis
from mcstudy.gap.questions.location import locations, missing_torque
from mcstudy.gap.questions.posterior import Explanation
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf

BASE = opened(two_segment())


def _explanation(lines: Lines, *shares: tuple[tuple[str, ...], float], unknown: dict[str, float]) -> Explanation:
    data = Data.of(lines)
    base = Fitter(BASE, weak_prior(BASE, BASE), data.f).best(data, BASE.truth[None])
    hypotheses = tuple((Hypothesis(names, 0.0, base), p) for names, p in shares)
    none = sum(p for names, p in shares if not names)
    return Explanation((), none, sum(unknown.values()), unknown, hypotheses, 0.0)


def test_places_share_the_posterior(plain_lines: list[Lines]) -> None:
    explanation = _explanation(
        plain_lines[0],
        (("passive_damping_ankle",), 0.4),
        (("activation_dynamics",), 0.2),
        (("sensor_lag_both", "stimulus_gain"), 0.1),
        ((), 0.1),
        unknown={"hip": 0.05, "": 0.15},
    )
    place, abstained = locations(explanation, BASE)
    assert place == pytest.approx(
        {"ankle": 0.5, "hip": 0.15, "stimulus": 0.05, "sensor": 0.05, "body": 0.0, "recording": 0.0}
    )
    assert abstained == pytest.approx(0.25)


def test_missing_torque_is_the_torque_that_is_missing(plain_lines: list[Lines]) -> None:
    """A torque of 1 % of the stimulus at the hip comes back at the hip alone."""
    lines = plain_lines[0]
    data = Data.of(lines)
    base = Fitter(BASE, weak_prior(BASE, BASE), data.f).best(data, BASE.truth[None])
    hip = frf(two_segment(stimulus="hip_torque"), BASE.truth, data.f)
    with_torque = data.with_y(frf(BASE, BASE.truth, data.f) + 0.01 * hip)
    at_truth = type(base)(BASE, base.prior, BASE.truth, 0.0, 0.0, base.information)
    torque = missing_torque(at_truth, with_torque)
    np.testing.assert_allclose(torque[:, 0], 0.01, rtol=1e-9)
    np.testing.assert_allclose(torque[:, 1], 0.0, atol=1e-9)
