"""Cases are as visible as the key says: covariance, delta and ceilings against simulation and theory."""

from __future__ import annotations

import numpy as np
import pytest
from mcstudy_challenge.bodies import stability_margin
from mcstudy_challenge.bodies.draws import draw_body, draw_linear, pool, protocol_of, shared
from mcstudy_challenge.bodies.geometry import Geometry, cycle_responses, free
from mcstudy_challenge.bodies.stability_margin import draw_near_unstable
from mcstudy_challenge.bodies.withheld_causes import draw_out_of_library
from mcstudy_challenge.design import Noise, Series

from mcstudy.effect_library import library
from mcstudy.effect_library.protocol import simulate_recording
from mcstudy.errors import DesignError
from mcstudy.gap.candidates.signatures import alike_groups, similarity
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SILENT, SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.stability import roots_chebyshev

SERIES = Series(cases=1)
BASE = two_segment()


@pytest.fixture(scope="module")
def geometry() -> Geometry:
    setting, _ = shared(SERIES)
    return Geometry(free(BASE), BASE.truth, setting, SERIES.noise.sensor)


def test_pink_is_the_paper_s_noise_and_colours_meet_at_the_reference() -> None:
    f = np.array([0.05, 0.5, 2.0])
    np.testing.assert_allclose(Noise().sensor.psd(f), SensorNoise().psd(f))
    white, brown = (Noise(colour=c).sensor.psd(f) for c in (0.0, 2.0))
    np.testing.assert_allclose(white[1], brown[1])
    assert (brown[0] > white[0]).all()
    np.testing.assert_allclose(Noise(level=4.0).sensor.psd(f), 4 * SensorNoise().psd(f))


def test_predicted_covariance_is_that_of_recordings(geometry: Geometry) -> None:
    recording = simulate_recording(protocol_of(SERIES), BASE.truth, np.random.default_rng(0))
    lines = measure(recording)
    np.testing.assert_allclose(lines.f, geometry.setting.f)
    ratio = lines.noise.variance / np.einsum("nii->ni", geometry.C).real
    assert np.median(ratio) == pytest.approx(1.0, abs=0.15)
    # Residuals of the true model count one per degree of freedom.
    x = geometry.whiten(lines.y - frf(BASE, BASE.truth, lines.f))
    assert x @ x / x.size == pytest.approx(1.0, abs=0.2)


def test_delta_is_what_a_fit_of_noise_free_responses_leaves(geometry: Geometry) -> None:
    truth = draw_linear(SERIES, np.random.default_rng(4), ["stimulus_gain"])
    assert truth is not None
    own = Geometry(free(BASE), truth.theta, geometry.setting, geometry.noise)
    y = own.response(["stimulus_gain"], truth.sizes, 0.0)
    assert y is not None
    assert 0.9 < np.linalg.norm(own.unexplained(y)) < 16.5
    assert np.linalg.norm(own.unexplained(frf(BASE, truth.theta, geometry.setting.f))) < 1e-6


def test_delta_grows_with_the_root_of_the_number_of_trials(geometry: Geometry) -> None:
    four = Series(cases=1, protocol=SERIES.protocol.model_copy(update={"amplitudes": (5.0,) * 8}))
    longer = Geometry(free(BASE), BASE.truth, shared(four)[0], geometry.noise)
    y = geometry.response(["stimulus_gain"], {"eps_stim": 0.05}, 0.0)
    assert y is not None
    ratio = np.linalg.norm(longer.unexplained(y)) / np.linalg.norm(geometry.unexplained(y))
    assert ratio == pytest.approx(2.0, rel=1e-3)


def test_effects_that_the_parameters_absorb_are_not_drawn() -> None:
    drawable = pool(SERIES)
    assert "joint_stretch_frame" not in drawable
    assert {"head_mode", "stimulus_gain", "sensor_lag_theta1", "activation_dynamics"} <= set(drawable)
    assert set(drawable) <= set(library.LIBRARY.linear)


def test_an_integral_term_stands_though_it_is_slow(geometry: Geometry) -> None:
    for name in ("integral_ankle", "force_feedback"):
        assert draw_linear(SERIES, np.random.default_rng(2), [name]) is not None
    assert geometry.response(["activation_dynamics"], {"Tact": 0.1}, 0.0) is None


def test_a_sensor_lag_and_an_actuator_lag_are_one_group(geometry: Geometry) -> None:
    columns = geometry.columns(shared(SERIES)[1])
    names, cosine = similarity([c.effect for c in columns], np.array([c.unit for c in columns]))
    own = next(g for g in alike_groups(names, cosine) if "sensor_lag_both" in g)
    assert "stimulus_lag" in own
    assert next(g for g in alike_groups(names, cosine) if "acceleration_feedback" in g) == ("acceleration_feedback",)


def test_a_smooth_torque_holds_what_effects_do_and_not_scatter(geometry: Geometry) -> None:
    y = geometry.response(["acceleration_feedback"], {"Ka1": 5.0}, 0.0)
    assert y is not None
    x = geometry.unexplained(y)
    assert geometry.smooth_delta(x) > 0.85 * np.linalg.norm(x)
    noise = np.random.default_rng(0).standard_normal(x.size)
    assert geometry.smooth_delta(noise) ** 2 == pytest.approx(geometry.smooth_dof + 12, rel=0.6)
    assert noise @ noise > 10 * geometry.smooth_dof


def test_noise_free_simulation_gives_the_closed_form_cycle_by_cycle(geometry: Geometry) -> None:
    from dataclasses import replace

    protocol = replace(protocol_of(SERIES), noise=SILENT, amplitudes=(5.0,), cycles=3)
    cycles = cycle_responses(
        simulate_recording(protocol, BASE.truth, np.random.default_rng(0)), replace(geometry.setting, protocol=protocol)
    )
    assert cycles.shape == (2, geometry.setting.f.size, 2)
    off = geometry.whiten(cycles[-1] - frf(BASE, BASE.truth, geometry.setting.f))
    assert np.linalg.norm(off) < 1.0


def test_shifted_bodies_are_far_off_and_stand() -> None:
    for seed in range(5):
        theta = draw_body(SERIES, np.random.default_rng(seed), shifted=True)
        change = np.abs(theta / BASE.truth - 1)
        assert change.max() <= 0.3 + 1e-9
        assert change.min() > 0.1


def test_an_effect_outside_the_library_is_drawn_at_a_visible_size() -> None:
    drawn = draw_out_of_library(SERIES, np.random.default_rng(1), "sensor_crosstalk")
    assert drawn is not None
    assert 0.5 < drawn.measured.delta < 17
    assert drawn.measured.total >= drawn.measured.delta - 1e-9


def test_near_unstable_bodies_keep_within_their_decay() -> None:
    for seed, near in enumerate([(0.1, 0.5), (0.01, 0.1)]):
        series = Series(cases=1, body=SERIES.body.model_copy(update={"near_decay": near}))
        theta = draw_near_unstable(series, np.random.default_rng(seed))
        roots = roots_chebyshev(BASE, theta)  # by collocation, not by the search that drew the body
        assert near[0] <= -roots[0].real <= near[1]
        assert abs(roots[0].imag) > 0.1


def test_a_body_that_cannot_be_near_unstable_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stability_margin, "ATTEMPTS", 1)
    still = Series(cases=1, body=SERIES.body.model_copy(update={"shifted_spread": 0.0}))
    with pytest.raises(DesignError, match=r"near_decay: no body that decays with 0\.1 to 0\.5 1/s"):
        draw_near_unstable(still, np.random.default_rng(0))
