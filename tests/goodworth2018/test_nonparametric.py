"""Neural controllers can be read off two independent stimuli without a model of them, and not off one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from mcstudy_goodworth2018.alternatives import nonparametric
from mcstudy_goodworth2018.alternatives.two_stimuli import Spectra, TwoStimuli

from mcstudy.errors import InputError
from mcstudy.spectra.bands import odd_lines, published
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf, neural_controllers, system
from mcstudy.stance.stimulus import Prts

POINTS = odd_lines(1.2)
MODEL = two_segment()
TRUE = neural_controllers(MODEL, MODEL.truth, POINTS.f)
HIP, ANKLE = 0, 1
Estimator = Callable[[Spectra], np.ndarray]


def two(s: Spectra) -> np.ndarray:
    return nonparametric.indirect(s.sway, s.torque, s.stimuli, POINTS)


def over_angle(s: Spectra) -> np.ndarray:
    return nonparametric.one_angle(s.sway, s.torque, s.stimuli[..., 0], POINTS)


def regressed(s: Spectra) -> np.ndarray:
    return nonparametric.direct(s.sway, s.torque, POINTS)


@pytest.fixture(scope="module")
def both() -> TwoStimuli:
    return TwoStimuli(Prts(), 2.0, POINTS)


@pytest.fixture(scope="module")
def single() -> TwoStimuli:
    return TwoStimuli(Prts(), 0.0, POINTS)


def monte_carlo(experiment: TwoStimuli, estimator: Estimator, n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Bias (N, 2, 2) complex and the squared Monte Carlo standard error of it."""
    estimates = np.stack([estimator(experiment.realization(rng)) for rng in np.random.default_rng(5).spawn(n)])
    return estimates.mean(axis=0) - TRUE, estimates.var(axis=0, ddof=1) / n


def test_inverse_dynamics_gives_the_torque_of_the_controllers(both: TwoStimuli) -> None:
    s = both.noise_free()
    feedback = -np.einsum("lij,rlj->rli", TRUE, s.sway)
    np.testing.assert_allclose(s.torque, feedback, rtol=1e-9, atol=1e-12 * np.abs(feedback).max())


def test_two_stimuli_without_noise_give_all_four_controllers_at_every_line(both: TwoStimuli) -> None:
    np.testing.assert_allclose(two(both.noise_free()), TRUE, rtol=1e-9)


def test_two_stimuli_are_unbiased_within_monte_carlo_error(both: TwoStimuli) -> None:
    bias, variance = monte_carlo(both, two)
    # squared bias over its variance averages to one, over 104 values that share some noise
    assert np.mean(np.abs(bias) ** 2 / variance) == pytest.approx(1.0, abs=0.5)


@pytest.mark.parametrize("estimator", [over_angle, regressed])
def test_one_stimulus_is_grossly_wrong(single: TwoStimuli, estimator: Estimator) -> None:
    bias, variance = monte_carlo(single, estimator, 20)
    relative = (np.abs(bias) / np.abs(TRUE)).mean(axis=0)
    assert (relative > 0.25).all()
    assert (np.abs(bias).mean(axis=0) > 5 * np.sqrt(variance).mean(axis=0)).all()


def test_torque_over_one_angle_mixes_the_two_controllers_of_a_row(single: TwoStimuli) -> None:
    H = frf(MODEL, MODEL.truth, POINTS.f)
    mixed = over_angle(single.noise_free())
    ratio = H[:, 1] / H[:, 0]
    for row in (HIP, ANKLE):
        np.testing.assert_allclose(mixed[:, row, 0], TRUE[:, row, 0] + TRUE[:, row, 1] * ratio, rtol=1e-9)
        np.testing.assert_allclose(mixed[:, row, 1], TRUE[:, row, 1] + TRUE[:, row, 0] / ratio, rtol=1e-9)


def test_regression_without_a_hip_stimulus_returns_the_body_instead_of_the_hip_controllers(single: TwoStimuli) -> None:
    body = system(MODEL, MODEL.truth, 2j * np.pi * POINTS.f)[0] - TRUE
    estimate = regressed(single.realization(np.random.default_rng(1)))
    np.testing.assert_allclose(estimate[:, HIP], -body[:, HIP], rtol=1e-6)


def test_one_stimulus_is_refused_where_two_are_needed(single: TwoStimuli) -> None:
    with pytest.raises(InputError, match=r"two independent ones, at 0\.023 Hz"):
        two(single.noise_free())


def test_two_copies_of_one_stimulus_are_refused(both: TwoStimuli) -> None:
    s = both.noise_free()
    same = np.repeat(s.stimuli[..., :1], 2, axis=-1)
    with pytest.raises(InputError, match="independent"):
        nonparametric.indirect(s.sway, s.torque, same, POINTS)


def test_averaging_over_lines_costs_only_the_bending_of_a_controller_within_a_point() -> None:
    bands = published().below(1.2)
    s = TwoStimuli(Prts(), 2.0, bands).noise_free()
    estimate = nonparametric.indirect(s.sway, s.torque, s.stimuli, bands)
    np.testing.assert_allclose(estimate, neural_controllers(MODEL, MODEL.truth, bands.f), rtol=0.02)


@pytest.mark.parametrize(("settings", "field"), [({"trials": 3}, "trials"), ({"discard": 0}, "cycles")])
def test_an_unusable_design_is_one_line(settings: dict[str, int], field: str) -> None:
    with pytest.raises(InputError, match=f"^{field}: expected"):
        TwoStimuli(Prts(), 2.0, POINTS, **settings)  # type: ignore[arg-type]
