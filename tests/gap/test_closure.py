"""How far the gap shrinks: no energy is left when only noise is left, and all of it when the wrong cause is added."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mcstudy.effect_library import library
from mcstudy.fitting.penalised import Fitted, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.fitting.small_linear import gaussian_factor, orthonormal
from mcstudy.gap.candidates.free_deviations import free_torques
from mcstudy.gap.candidates.signatures import applicable, signatures
from mcstudy.gap.questions.closure import (
    Belief,
    close,
    energy,
    floor_rms_deg,
    noise_rms_deg,
    smooth_directions,
    sway_rms_deg,
)
from mcstudy.gap.questions.evidence import Hypothesis
from mcstudy.lines.base_fit import drawn_starts
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment

BASE = opened(two_segment())


def _fit(data: Data, *names: str, start: dict[str, float] | None = None) -> Fitted:
    model = library.apply(BASE, *names)
    fitter = Fitter(model, weak_prior(model, BASE), data.f)
    theta = model.with_values(start or {}).truth
    return fitter.best(data, np.concatenate([theta[None], drawn_starts(BASE, 0, 1) if not names else theta[None]]))


def _space(data: Data, base: Fitted) -> np.ndarray:
    found = signatures(base, data, applicable(BASE))
    families = [f.columns for f in free_torques(base, data)[:4]]
    return np.concatenate([*(s.vector[:, None] for s in found), *families], axis=1)


def test_energy_of_noise_is_zero_on_average(plain_lines: list[Lines]) -> None:
    values = []
    for lines in plain_lines:
        data = Data.of(lines)
        base = _fit(data)
        basis = smooth_directions(base, data, _space(data, base))
        values.append(energy(base, data, lines, basis))
        assert 20 < basis.shape[1] < 150
    se = np.std(values) / np.sqrt(len(values))
    assert abs(np.mean(values)) < 3.5 * se


def test_the_true_cause_closes_the_gap_and_a_wrong_one_does_not(with_effects: Callable[..., Lines]) -> None:
    lines = with_effects(3, {"sensor_lag_theta1": {"tau_theta1": 0.008}})
    data = Data.of(lines)
    base = _fit(data)
    true = _fit(data, "sensor_lag_theta1", start={"tau_theta1": 0.008})
    wrong = _fit(data, "trunk_inertia_error", start={"eps_trunk": 0.05})
    space, rng = _space(data, base), np.random.default_rng(0)
    certain = Belief([(Hypothesis(("sensor_lag_theta1",), 0.0, true), 0.97)], 0.03, rng.chisquare(690, 500))
    right = close(base, true, data, lines, space, certain, rng)
    assert right.fraction > 0.9
    assert right.low > 0.8
    assert right.high <= 1.0
    assert right.before > 100
    other = close(base, wrong, data, lines, space, certain, rng)
    assert other.fraction < 0.8
    assert not other.at_noise_floor
    assert sway_rms_deg(true, data, lines) < sway_rms_deg(base, data, lines)
    assert floor_rms_deg(true, data, lines) == pytest.approx(sway_rms_deg(true, data, lines), rel=0.8)


def test_sway_of_the_right_model_lies_in_the_range_of_noise(plain_lines: list[Lines]) -> None:
    """95 % of recordings without a gap do; of twelve, ten or more in 98 %."""
    inside = 0
    for k, lines in enumerate(plain_lines):
        data = Data.of(lines)
        base = _fit(data)
        low, high = noise_rms_deg(base, data, lines, np.random.default_rng(k))
        assert low < floor_rms_deg(base, data, lines) < high
        inside += low <= sway_rms_deg(base, data, lines) <= high
    assert inside >= 10


def test_basis_is_orthonormal_and_at_right_angles() -> None:
    rng = np.random.default_rng(0)
    J, X = rng.standard_normal((3, 40)), rng.standard_normal((6, 40))
    X[5] = X[4] + J[0]
    Q = orthonormal(J, X, 0.05)
    assert Q.shape[0] == 5
    np.testing.assert_allclose(Q @ Q.T, np.eye(5), atol=1e-12)
    np.testing.assert_allclose(Q @ J.T, 0, atol=1e-12)


def test_gaussian_factor_is_the_ratio_of_two_normal_densities() -> None:
    from scipy.stats import multivariate_normal

    rng = np.random.default_rng(1)
    F, r, v = rng.standard_normal((9, 4)), rng.standard_normal(9), 0.7
    with_it = multivariate_normal(cov=np.eye(9) + v * F @ F.T).logpdf(r)
    without = multivariate_normal(cov=np.eye(9)).logpdf(r)
    found = gaussian_factor(F.T @ F, (F.T @ r)[:, None], v)[0]
    assert found == pytest.approx(with_it - without, rel=1e-10)
