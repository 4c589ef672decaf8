"""Misshapen forms: with the constants of the library each is the declared effect, with others it is not."""

from __future__ import annotations

import numpy as np
import pytest
from mcstudy_challenge.bodies.forms import FORMS
from mcstudy_challenge.bodies.other_forms import draw_form, shaped
from mcstudy_challenge.cases import list_cases
from mcstudy_challenge.challenge_file import resolve
from mcstudy_challenge.design import Mix, Series, Sizes, Stratum, Trials
from mcstudy_challenge.design_checks import check_series
from mcstudy_challenge.truth import make_case, same_change

from mcstudy.effect_library import library
from mcstudy.effect_library.declarations import ACTIVATION_DAMPING, FORCE_TIME_CONSTANT, RESONANCE_DAMPING
from mcstudy.errors import DesignError
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf

BASE = two_segment()
F = np.array([0.05, 0.3, 1.0, 2.5, 6.0])
NONE = 1e-9  # a constant of this size has no influence

DECLARED = {
    "head_damped": (4.0, {"z": RESONANCE_DAMPING, "f": 2.0, "h": 0.6}, {"f_head": 2.0}),
    "loose_head_damped": (4.0, {"z": RESONANCE_DAMPING, "f": 2.0, "h": 0.6}, {"f_loose": 2.0}),
    "ankle_damper_in_series": (30.0, {"T": NONE}, {}),
    "dampers_of_both_joints": (30.0, {"r": NONE}, {}),
    "hip_damper_in_series": (8.0, {"T": NONE}, {}),
    "activation_damped": (0.02, {"z": ACTIVATION_DAMPING}, {}),
    "force_feedback_of_both_joints": (0.8, {"T": FORCE_TIME_CONSTANT, "r": NONE}, {}),
    "leaky_integral_ankle": (80.0, {"b": NONE}, {}),
    "integral_of_both_joints": (80.0, {"r": NONE}, {}),
    "leaky_integral_hip": (20.0, {"b": NONE}, {}),
    "acceleration_of_both_joints": (5.0, {"r": NONE}, {}),
    "acceleration_smoothed": (5.0, {"T": NONE}, {}),
    "acceleration_delayed": (5.0, {"r": 1.0}, {}),
    "trunk_mass_and_height": (0.2, {"r": NONE}, {}),
    "leg_inertia_and_moment": (0.2, {"r": 1.0}, {}),
    "fading_gain": (0.1, {"T": NONE}, {}),
    "delay_and_lag": (0.02, {"r": NONE}, {}),
    "sensors_unequal": (0.02, {"r": 1.0}, {}),
    "reflex_smoothed": (40.0, {"d": 0.05, "T": NONE}, {"Tsl": 0.05}),
    "asymmetric_coupling": (60.0, {"r": 1.0, "T": NONE}, {}),
}
"""Size, the shape constants with which a form is the declared effect, and the latter's shape parameters."""


@pytest.mark.parametrize("name", DECLARED)
def test_a_form_with_the_constants_of_the_library_is_the_declared_effect(name: str) -> None:
    form, (size, constants, shapes) = FORMS[name], DECLARED[name]
    declared = library.effect(form.mechanism)
    model = library.apply(BASE, form.mechanism)
    sizes = {declared.size.name: size, **shapes}
    expected = frf(model, np.array([*BASE.truth, *(sizes[s.name] for s in declared.sizes)]), F)
    found = shaped(form, BASE, BASE.truth, size, constants)
    assert found is not None
    np.testing.assert_allclose(frf(found, found.truth, F), expected, rtol=2e-6)
    # and with constants from its range it is another one
    other = shaped(form, BASE, BASE.truth, size, {k: high for k, (_, high) in form.shapes.items()})
    assert other is not None
    assert np.abs(frf(other, other.truth, F) / expected - 1).max() > 1e-3


def test_every_form_is_of_one_mechanism_of_the_library_and_most_mechanisms_have_one() -> None:
    assert all((f.build is None) != (f.rule is None) for f in FORMS.values())
    mechanisms = {library.effect(f.mechanism).cause for f in FORMS.values()}
    assert len(mechanisms) >= 0.75 * len(library.LIBRARY)


def test_a_form_is_drawn_at_the_wanted_delta() -> None:
    series = Series(cases=1, sizes=Sizes(strata=(Stratum(share=1.0, low=6.0, high=8.0),)))
    for name in ("head_damped", "acceleration_of_both_joints"):
        form = FORMS[name]
        drawn = draw_form(series, np.random.default_rng(0), form)
        assert drawn is not None
        left = drawn.geometry.unexplained(drawn.measured.response)
        assert drawn.measured.delta == pytest.approx(np.linalg.norm(left))
        assert 5.4 < drawn.measured.delta < 8.8
        for k, (low, high) in form.shapes.items():
            assert low <= drawn.sizes[k] <= high


def test_the_key_of_a_misshapen_case_names_the_mechanism_and_the_form() -> None:
    raw = {
        "challenge": {"name": "tiny", "seed": 5, "cases": 1},
        "mix": {**dict.fromkeys(Mix.model_fields, 0.0), "misshapen": 1.0},
        "sizes": {"effects": ["acceleration_feedback"], "forms": ["acceleration_of_both_joints", "dead_angle_only"]},
        "protocol": Trials(amplitudes=(5.0,), cycles=3).model_dump(),
    }
    file = resolve(raw)
    recording, entry = make_case(file, list_cases(file)[0])
    assert entry["kind"] == "misshapen"
    assert entry["form"] == "acceleration_of_both_joints"  # one amplitude shows no dead zone
    (cause,) = entry["effects"]
    assert cause["effect"] == "acceleration_feedback"
    assert cause["effect"] in cause["group"]
    assert set(cause["sizes"]) == {"Ka1", "r"}
    assert 0 < entry["closable"]["acceleration_feedback"] <= 1
    # the library leaves the strength at the hip open, so this form is the effect exactly
    assert entry["any_form"]["closable"]["acceleration_feedback"] > 0.999
    assert entry["any_form"]["residual_delta"] < 0.1 < entry["residual_delta"]
    assert "acceleration" not in recording.name + recording.provenance


def test_changes_of_the_gains_in_one_direction_are_one_group() -> None:
    assert same_change("amplitude_reweighting") == ["torque_saturation"]
    assert same_change("dead_zone") == []
    assert same_change("head_mode") == []


def test_an_unknown_form_is_refused() -> None:
    with pytest.raises(DesignError, match=r"sizes\.forms: expected one of head_damped, .*got 'ghost'"):
        check_series(Series(cases=1, sizes=Sizes(forms=("ghost",))))
