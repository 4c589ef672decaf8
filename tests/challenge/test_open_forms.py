"""Shape constants of the library against the challenge's forms, which are written apart from it."""

from __future__ import annotations

import numpy as np
import pytest
from mcstudy_challenge.bodies.forms import FORMS
from mcstudy_challenge.bodies.other_forms import shaped

from mcstudy.effect_library import library
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf

BASE = two_segment()
F = np.array([0.05, 0.3, 1.0, 2.5, 6.0])

SAME = {
    "head_damped": (4.0, {"z": 0.08, "f": 2.0, "h": 0.6}, {"f_head": 2.0, "zeta_head": 0.08}),
    "loose_head_damped": (4.0, {"z": 0.4, "f": 2.0, "h": 0.6}, {"f_loose": 2.0, "zeta_loose": 0.4}),
    "ankle_damper_in_series": (30.0, {"T": 0.05}, {"T_Bpas1": 0.05}),
    "dampers_of_both_joints": (30.0, {"r": 0.1}, {"ratio_Bpas1": 0.1}),
    "hip_damper_in_series": (8.0, {"T": 0.05}, {"T_Bpas2": 0.05}),
    "force_feedback_of_both_joints": (0.8, {"T": 10.0, "r": 0.3}, {"tau_force": 10.0, "ratio_force": 0.3}),
    "leaky_integral_ankle": (80.0, {"b": 0.2}, {"leak_Ki1": 0.2}),
    "integral_of_both_joints": (80.0, {"r": 0.2}, {"ratio_Ki1": 0.2}),
    "leaky_integral_hip": (20.0, {"b": 0.2}, {"leak_Ki2": 0.2}),
    "acceleration_of_both_joints": (5.0, {"r": 0.3}, {"ratio_Ka1": 0.3}),
    "acceleration_smoothed": (5.0, {"T": 0.03}, {"T_Ka1": 0.03}),
    "trunk_mass_and_height": (1e-4, {"r": 0.3}, {"height_eps_trunk": 0.3}),
    "leg_inertia_and_moment": (0.2, {"r": 0.6}, {"moment_eps_leg": 0.6}),
    "fading_gain": (0.1, {"T": 0.03}, {"T_eps_stim": 0.03}),
    "delay_and_lag": (0.02, {"r": 0.4}, {"lag_Tstim": 0.4}),
    "actuator_second_order": (0.02, {"z": 0.8}, {"tau_stim": 0.032, "q_tau_stim": 1 / 2.56}),
    "sensor1_second_order": (0.02, {"z": 0.8}, {"tau_theta1": 0.032, "q_tau_theta1": 1 / 2.56}),
    "sensor2_second_order": (0.02, {"z": 1.2}, {"tau_theta2": 0.048, "q_tau_theta2": 1 / 5.76}),
    "sensors_unequal": (0.02, {"r": 1.3}, {"ratio_sensors": 1.3}),
    "reflex_smoothed": (40.0, {"d": 0.05, "T": 0.02}, {"Tsl": 0.05, "T_Bsl": 0.02}),
    "asymmetric_coupling": (60.0, {"r": 1.0, "T": 0.05}, {"T_Kbi": 0.05}),
}
"""Size and shape constants of a form, and the same as parameters of the declared effect."""


@pytest.mark.parametrize("name", SAME)
def test_an_open_form_of_the_library_is_the_form_of_the_challenge(name: str) -> None:
    form, (size, constants, own) = FORMS[name], SAME[name]
    effect = library.effect(form.mechanism)
    model = library.apply(BASE, effect.name, opened=[effect.name])
    values = {**effect.nominal_form, effect.size.name: size, **own}
    found = frf(model, np.array([*BASE.truth, *(values[n] for n in model.names[12:])]), F)
    expected = shaped(form, BASE, BASE.truth, size, constants)
    assert expected is not None
    np.testing.assert_allclose(found, frf(expected, expected.truth, F), rtol=1e-7)


def test_activation_has_its_own_damping_at_the_ankle_and_its_own_time_constant_at_the_hip() -> None:
    model = library.apply(BASE, "activation_dynamics", opened=["activation_dynamics"])
    values = dict(zip(model.names, [*BASE.truth, 0.03, 0.9, 1.4], strict=True))
    s = 2j * np.pi * F
    filters = {f.name: f for f in model.filters}
    for name, T, zeta in (("activation", 0.03, 0.9), ("activation_hip", 0.042, 1.15)):
        below = sum(
            m.coefficient * s**m.order * np.prod([values[n] ** k for n, k in m.powers])
            for m in filters[name].denominator
        )
        np.testing.assert_allclose(below, T**2 * s**2 + 2 * zeta * T * s + 1)
    used = {(t.row, f) for t in model.terms for f in t.filters}
    assert used == {("ankle", "activation"), ("hip", "activation_hip")}
