"""Likeness: the noise of left-out residuals is known, and causes are ranked by what they predict."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mcstudy.effect_library import library
from mcstudy.fitting.penalised import Fitted, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.free_deviations import free_torques
from mcstudy.gap.questions.closure import smooth_directions
from mcstudy.gap.questions.likeness import _held_out, _likeness, likeness
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment

BASE = opened(two_segment())


def fit(data: Data, *names: str) -> Fitted:
    model = library.apply(BASE, *names)
    return Fitter(model, weak_prior(model, BASE), data.f).best(data, model.truth[None])


def directions(base: Fitted, data: Data) -> np.ndarray:
    along = np.linalg.qr(base.jacobian(data) * base.prior.scale)[0]
    columns = np.concatenate([x.columns for x in free_torques(base, data)[:4]], axis=1)
    return np.concatenate([along, smooth_directions(base, data, columns)], axis=1)


def test_the_expected_square_of_noise_is_that_of_recordings_without_a_gap(plain_lines: list[Lines]) -> None:
    ratios = []
    for lines in plain_lines[:8]:
        data = Data.of(lines)
        base = fit(data)
        inside, noise = _held_out(base, data, directions(base, data))
        ratios.append(inside @ inside / noise)
        own = len(inside)
    se = np.sqrt(2 / own / len(ratios))
    assert abs(np.mean(ratios) - 1) < 4 * se


def test_the_true_cause_resembles_the_gap_and_a_wrong_one_less(with_effects: Callable[..., Lines]) -> None:
    data = Data.of(with_effects(3, {"sensor_lag_theta1": {"tau_theta1": 0.01}}))
    base = fit(data)
    right, wrong = likeness(
        base,
        [fit(data, "sensor_lag_theta1"), fit(data, "trunk_inertia_error")],
        data,
        directions(base, data),
        1.2,
        np.random.default_rng(0),
    )
    assert right.low > 0.8
    assert wrong.high < right.low


def test_the_interval_holds_the_true_share_as_often_as_it_says() -> None:
    """Residuals drawn with known means and a common noise of 70 dimensions."""
    rng, K, n = np.random.default_rng(1), 70, 200
    held = 0
    for _ in range(n):
        before, after, true, along = np.zeros(K), np.zeros(K), rng.uniform(), rng.uniform()
        before[0] = rng.uniform(8, 20)
        after[:2] = before[0] * np.sqrt((1 - true) * np.array([along, 1 - along]))
        e = rng.standard_normal(K)
        found = _likeness(before + e, K, after + e, K, 1.0, rng)
        held += found.low <= true <= found.high
    assert held / n == pytest.approx(0.95, abs=0.05)
