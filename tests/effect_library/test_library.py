"""The library of effects: null values change nothing, derivatives are exact, any pair can be added in any order."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from mcstudy.effect_library import library
from mcstudy.effect_library.edits import body_of, trunk_mass
from mcstudy.effect_library.effect import LOCATIONS
from mcstudy.errors import InputError, ModelError
from mcstudy.stance.body import STIMULI, WEIGHTS, Body, one_segment, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf, frf_jacobian, system
from mcstudy.stance.stability import growth_rate

F = np.array([0.023, 0.1, 0.41, 1.2, 3.0, 8.0])
BASE = two_segment()


def at_published(model: Model, *names: str) -> np.ndarray:
    """Nominal parameters with the named effects at the middle of their published range."""
    values = {s.name: sum(s.published) / 2 for n in names for s in library.effect(n).sizes}
    return model.with_values(values).truth


@pytest.mark.parametrize("name", library.LIBRARY.linear)
def test_null_value_reproduces_the_base_model(name: str) -> None:
    for stimulus in STIMULI:
        base = two_segment(stimulus=stimulus)
        model = library.apply(base, name)
        assert model.names[: len(base.names)] == base.names
        np.testing.assert_allclose(frf(model, model.truth, F), frf(base, base.truth, F), rtol=1e-13)


@pytest.mark.parametrize("name", [e.name for e in library.LIBRARY.values() if e.rule])
def test_trace_of_a_gain_change_is_the_base_model_at_its_null(name: str) -> None:
    model = library.trace(BASE, name)
    np.testing.assert_allclose(frf(model, model.truth, F), frf(BASE, BASE.truth, F), rtol=1e-13)


@pytest.mark.parametrize("name", library.LIBRARY.linear)
def test_published_size_changes_the_response(name: str) -> None:
    model = library.apply(BASE, name)
    H = frf(model, at_published(model, name), F)
    assert np.abs(H / frf(BASE, BASE.truth, F) - 1).max() > 1e-3


@pytest.mark.parametrize("stimulus", ["ankle_torque", *WEIGHTS])
@pytest.mark.parametrize("name", library.LIBRARY.linear)
def test_derivatives_are_exact(name: str, stimulus: str) -> None:
    base = two_segment(stimulus=stimulus)
    model = library.apply(base, name)
    theta = at_published(model, name)
    H, dH = frf_jacobian(model, theta, F)
    for p in range(len(base.names), len(model.names)):
        size = library.effect(name).sizes[p - len(base.names)]
        h = 2e-3 * max(abs(x) for x in size.published)
        low, high = theta.copy(), theta.copy()

        def slope(step: float, p: int = p, low: np.ndarray = low, high: np.ndarray = high) -> np.ndarray:
            low[p], high[p] = theta[p] - step, theta[p] + step
            return (frf(model, high, F) - frf(model, low, F)) / (2 * step)

        # Richardson extrapolation of central differences: error of order h^6
        d1, d2, d3 = slope(h), slope(h / 2), slope(h / 4)
        e1, e2 = (4 * d2 - d1) / 3, (4 * d3 - d2) / 3
        reference = (16 * e2 - e1) / 15
        scale = np.abs(reference).max() + np.abs(H).max() / abs(theta[p]) * 1e-2
        assert np.abs(dH[..., p] - reference).max() < 1e-8 * scale


def test_any_pair_can_be_added_in_any_order() -> None:
    for a, b in combinations(library.LIBRARY.linear, 2):
        one, other = library.apply(BASE, a, b), library.apply(BASE, b, a)
        assert one.name == other.name
        theta = at_published(one, a, b)
        swapped = at_published(other, a, b)
        first, second = frf(one, theta, F), frf(other, swapped, F)
        assert np.isfinite(first).all()
        np.testing.assert_allclose(first, second, rtol=1e-12)
        np.testing.assert_allclose(frf(one, one.truth, F), frf(BASE, BASE.truth, F), rtol=1e-12)


@pytest.mark.parametrize("names", [*combinations([n for n in library.LIBRARY.linear if n.startswith("sensor_lag")], 2)])
def test_lags_of_what_is_measured_multiply(names: tuple[str, str]) -> None:
    def lag(*effects: str) -> np.ndarray:
        model = library.apply(BASE, *effects)
        return frf(model, at_published(model, *effects), F) / frf(BASE, BASE.truth, F)

    np.testing.assert_allclose(lag(*names), lag(names[0]) * lag(names[1]), rtol=1e-12)


def test_trunk_error_is_the_model_of_a_heavier_trunk() -> None:
    segments = {"m1": 22.7, "h1": 0.4665, "I1": 1.716, "m2": 48.43, "h2": 0.329055, "I2": 3.2919, "L1": 0.84353}
    heavier = segments | {"m2": segments["m2"] * 1.2, "I2": segments["I2"] * 1.2}
    legs = segments | {"m1": segments["m1"] * 1.2, "I1": segments["I1"] * 1.2}
    for stimulus in ("ankle_torque", "platform_translation"):
        base = two_segment(Body.from_segments(**segments), stimulus)
        assert trunk_mass(body_of(base)) == pytest.approx(segments["m2"], rel=1e-3)
        for name, changed in (("trunk_inertia_error", heavier), ("leg_inertia_error", legs)):
            model = library.apply(base, name)
            theta = model.truth
            theta[-1] = 0.2
            true = two_segment(Body.from_segments(**changed), stimulus)
            np.testing.assert_allclose(frf(model, theta, F), frf(true, true.truth, F), rtol=5e-3)


def test_stimulus_gain_of_minus_half_is_the_amplitude_convention() -> None:
    model = library.apply(BASE, "stimulus_gain")
    theta = model.truth
    theta[-1] = -0.5
    np.testing.assert_allclose(frf(model, theta, F), 0.5 * frf(BASE, BASE.truth, F), rtol=1e-12)


def test_sensor_lag_of_both_channels_is_a_stimulus_lag() -> None:
    """The exact ambiguity that makes one group of the two for a single stimulus."""
    sensors, torque = (library.apply(BASE, n) for n in ("sensor_lag_both", "stimulus_lag"))
    a, b = sensors.truth, torque.truth
    a[-1] = b[-1] = 0.03
    np.testing.assert_allclose(frf(sensors, a, F), frf(torque, b, F), rtol=1e-12)


def test_effects_reach_the_one_segment_model_where_they_can() -> None:
    model = library.apply(one_segment(), "activation_dynamics", "integral_ankle")
    assert model.names == ("K", "B", "Kpas", "Td", "Tact", "Ki1")
    with pytest.raises(ModelError, match="no hip row"):
        library.apply(one_segment(), "passive_damping_hip")
    with pytest.raises(ModelError, match="no trunk"):
        library.apply(one_segment(), "trunk_inertia_error")


def test_bad_names_get_one_clear_line() -> None:
    with pytest.raises(InputError, match="unknown effect 'lag'; the library has passive_damping_ankle"):
        library.apply(BASE, "lag")
    with pytest.raises(InputError, match="no closed form"):
        library.apply(BASE, "dead_zone")
    with pytest.raises(InputError, match="named once"):
        library.apply(BASE, "head_mode", "head_mode")


def test_declarations_are_complete() -> None:
    names = [s.name for e in library.LIBRARY.values() for s in e.sizes]
    assert len(set(names)) == len(names)
    for e in library.LIBRARY.values():
        assert set(e.place) <= set(LOCATIONS)
        assert e.source
        assert not e.size.is_shape
        assert (e.kind == "linear") == (e.rule is None)
        assert e.contrast is None or e.kind != "linear"
        for s in e.sizes:
            assert s.lower <= s.published[0] <= s.published[1] <= s.upper
            assert s.null is None or s.lower <= s.null <= s.upper


@pytest.mark.parametrize("width", [50, 100])
def test_the_list_of_effects_fits_the_terminal_and_states_where_every_size_comes_from(
    width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    blocks = library.table_text().split("\n\n")
    assert [block.split()[0] for block in blocks] == list(library.LIBRARY)
    for block, e in zip(blocks, library.LIBRARY.values(), strict=True):
        assert max(map(len, block.splitlines())) <= width
        shown = " ".join(block.split())
        for part in (e.equation, e.source, e.size.name, library.size_text(e.size)):
            assert " ".join(part.split()) in shown
        for part in (e.source, e.size.meaning, *(f.source for f in e.forms)):
            assert " ".join(part.split()) in shown
            shown = shown.replace(" ".join(part.split()), "")
        assert "published" not in shown


@pytest.mark.parametrize("stimulus", WEIGHTS)
def test_an_effect_of_the_feedback_senses_the_tilt_as_the_feedback_does(stimulus: str) -> None:
    """With Wprop = 1 all that senses theta1 senses the surface: b is then the column of theta1 without the body's."""
    base = two_segment(stimulus=stimulus).with_values({WEIGHTS[stimulus].name: 1.0})
    scene = stimulus == "visual_tilt"
    for name, companions in (
        ("passive_damping_ankle", 0 if scene else 1),
        ("biarticular_coupling", 0 if scene else 1),
        ("integral_ankle", 1),
        ("acceleration_feedback", 1),
        ("short_latency_reflex", 0 if scene else 1),
        ("passive_damping_hip", 0),
        ("integral_hip", 0),
        ("joint_stretch_frame", 8),
    ):
        model = library.apply(base, name)
        theta = at_published(model, name)
        new = [t for t in model.terms[len(base.terms) :] if t.sense == "stimulus"]
        assert len(new) == companions, name
        if not scene:
            b = system(model, theta, 2j * np.pi * F)[1]
            A = system(model, theta, 2j * np.pi * F)[0]
            inertia = system(replace(model, terms=base.terms[:7]), theta, 2j * np.pi * F)[0]
            np.testing.assert_allclose(b, A[..., 0] - inertia[..., 0], rtol=1e-12)


@pytest.mark.parametrize("stimulus", STIMULI)
def test_a_delayed_stimulus_is_the_response_times_a_delay(stimulus: str) -> None:
    base = two_segment(stimulus=stimulus)
    model = library.apply(base, "stimulus_delay")
    for late in (0.03, -0.02):
        theta = np.r_[base.truth, late]
        expected = frf(base, base.truth, F) * np.exp(-2j * np.pi * F * late)[:, None]
        np.testing.assert_allclose(frf(model, theta, F), expected, rtol=1e-12)
        assert growth_rate(model, theta) == growth_rate(base, base.truth)


def test_stimulus_gain_scales_a_tilt() -> None:
    base = two_segment(stimulus="surface_tilt")
    model = library.apply(base, "stimulus_gain")
    theta = model.truth
    theta[-1] = 0.25
    np.testing.assert_allclose(frf(model, theta, F), 1.25 * frf(base, base.truth, F), rtol=1e-12)
    assert frf_jacobian(model, theta, F)[1][..., -1] == pytest.approx(frf(base, base.truth, F), rel=1e-12)
