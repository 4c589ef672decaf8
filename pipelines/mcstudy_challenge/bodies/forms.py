"""Misshapen forms of the library's effects, for the challenge only; no module that answers may import this one.

A form is the mechanism of an effect of the library, written in another way than the library declares it: another
damping, order, time constant or split over the joints, or a second weaker part. Shape constants are drawn from ranges
that are wider than what the library assumes and are not centred on it. No range is a published value.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mcstudy.effect_library import edits
from mcstudy_challenge.bodies import form_steps as steps


@dataclass(frozen=True)
class Form:
    """One form of a mechanism.

    Attributes
    ----------
    name, equation: for the key; a is the size, the other letters are shape constants. mechanism: the effect of the
        library that it is a form of. shapes: range (low, high) of every shape constant, drawn uniformly on a log scale.
    limit: largest magnitude of the size. both: whether both signs occur. build: adds the form of a size to a model.
    rule: the same as a rule of the time-domain simulator; one of the two is given. lasting: whether it is the same in
        every cycle.
    """

    name: str
    mechanism: str
    equation: str
    shapes: Mapping[str, tuple[float, float]]
    limit: float
    build: steps.Build | None = None
    rule: steps.Rule | None = None
    both: bool = False
    lasting: bool = True

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Random shape constants."""
        return {k: float(np.exp(rng.uniform(np.log(low), np.log(high)))) for k, (low, high) in self.shapes.items()}


_LAG = (0.015, 0.15)
_HALF = (0.05, 0.6)
_AROUND = (0.4, 2.5)

FORMS: dict[str, Form] = {
    f.name: f
    for f in (
        Form(
            "head_damped",
            "head_mode",
            "damping ratio z at height h",
            {"z": (0.05, 0.6), "f": (1.2, 5.0), "h": (0.4, 0.8)},
            15.0,
            steps.head(False),
        ),
        Form(
            "loose_head_damped",
            "loose_head",
            "damping ratio z at height h",
            {"z": (0.05, 0.6), "f": (1.2, 5.0), "h": (0.4, 0.8)},
            15.0,
            steps.head(True),
        ),
        Form(
            "ankle_damper_in_series",
            "passive_damping_ankle",
            "a s theta1 / (T s + 1)",
            {"T": _LAG},
            140.0,
            steps.terms(("ankle", "theta1", 1, ""), below="T"),
        ),
        Form(
            "dampers_of_both_joints",
            "passive_damping_ankle",
            "a s theta1, and r a s theta2 at the hip",
            {"r": (0.02, 0.10)},
            140.0,
            steps.terms(("ankle", "theta1", 1, ""), ("hip", "theta2", 1, "r")),
        ),
        Form(
            "hip_damper_in_series",
            "passive_damping_hip",
            "a s theta2 / (T s + 1)",
            {"T": _LAG},
            40.0,
            steps.terms(("hip", "theta2", 1, ""), below="T"),
        ),
        Form(
            "activation_first_order",
            "activation_dynamics",
            "1 / (a s + 1)",
            {},
            0.3,
            steps.through(edits.is_active, lambda a, _: (1.0, a)),
        ),
        Form(
            "activation_damped",
            "activation_dynamics",
            "1 / (a^2 s^2 + 2 z a s + 1)",
            {"z": (0.5, 2.2)},
            0.2,
            steps.through(edits.is_active, lambda a, c: (1.0, 2 * c["z"] * a, a**2)),
        ),
        Form(
            "activation_third_order",
            "activation_dynamics",
            "1 / (a s + 1)^3",
            {},
            0.15,
            steps.through(edits.is_active, lambda a, _: (1.0, 3 * a, 3 * a**2, a**3)),
        ),
        Form(
            "activation_by_joint",
            "activation_dynamics",
            "1 / (a s + 1)^2 at the ankle, 1 / (r a s + 1)^2 at the hip",
            {"r": _AROUND},
            0.2,
            steps.two_filters,
        ),
        Form(
            "force_feedback_of_both_joints",
            "force_feedback",
            "G = a at the ankle and r a at the hip, time constant T",
            {"T": (4.0, 40.0), "r": _HALF},
            4.0,
            steps.force,
        ),
        Form(
            "leaky_integral_ankle",
            "integral_ankle",
            "a / (s + b) theta1",
            {"b": (0.03, 0.5)},
            300.0,
            steps.leaky("ankle", "theta1"),
        ),
        Form(
            "integral_of_both_joints",
            "integral_ankle",
            "a / s theta1, and r a / s theta2 at the hip",
            {"r": (0.03, 0.3)},
            300.0,
            steps.terms(("ankle", "theta1", -1, ""), ("hip", "theta2", -1, "r"), late=True),
        ),
        Form(
            "leaky_integral_hip",
            "integral_hip",
            "a / (s + b) theta2",
            {"b": (0.03, 0.5)},
            80.0,
            steps.leaky("hip", "theta2"),
        ),
        Form(
            "acceleration_of_both_joints",
            "acceleration_feedback",
            "a s^2 theta1, and r a s^2 theta2 at the hip",
            {"r": (0.05, 0.5)},
            17.0,
            steps.terms(("ankle", "theta1", 2, ""), ("hip", "theta2", 2, "r"), late=True),
        ),
        Form(
            "acceleration_smoothed",
            "acceleration_feedback",
            "a s^2 / (T s + 1) theta1",
            {"T": (0.01, 0.1)},
            17.0,
            steps.terms(("ankle", "theta1", 2, ""), below="T", late=True),
        ),
        Form(
            "acceleration_delayed",
            "acceleration_feedback",
            "a s^2 theta1 with r times the delay",
            {"r": (0.5, 1.6)},
            17.0,
            steps.own_delay,
        ),
        Form(
            "trunk_mass_and_height",
            "trunk_inertia_error",
            "mass (1 + a), height (1 + a)^r",
            {"r": (0.05, 0.6)},
            0.45,
            steps.trunk,
            both=True,
        ),
        Form(
            "leg_inertia_and_moment",
            "leg_inertia_error",
            "inertia (1 + a), moment (1 + r a)",
            {"r": (0.3, 2.0)},
            0.7,
            steps.legs,
            both=True,
        ),
        Form(
            "fading_gain",
            "stimulus_gain",
            "stimulus x (1 + a / (T s + 1))",
            {"T": (0.003, 0.1)},
            0.7,
            steps.fading_gain,
            both=True,
        ),
        Form("delay_and_lag", "stimulus_delay", "e^(-a s) / (r a s + 1)", {"r": (0.1, 1.0)}, 0.12, steps.delay_and_lag),
        Form(
            "actuator_second_order",
            "stimulus_lag",
            "1 / (a^2 s^2 + 2 z a s + 1)",
            {"z": (0.4, 1.5)},
            0.15,
            steps.through(edits.is_stimulus, lambda a, c: (1.0, 2 * c["z"] * a, a**2)),
        ),
        Form(
            "sensor1_second_order",
            "sensor_lag_theta1",
            "1 / (a^2 s^2 + 2 z a s + 1)",
            {"z": (0.4, 1.5)},
            0.15,
            steps.sensors(0),
        ),
        Form(
            "sensor2_second_order",
            "sensor_lag_theta2",
            "1 / (a^2 s^2 + 2 z a s + 1)",
            {"z": (0.4, 1.5)},
            0.15,
            steps.sensors(1),
        ),
        Form(
            "sensors_unequal",
            "sensor_lag_both",
            "1 / (a s + 1) and 1 / (r a s + 1)",
            {"r": (0.6, 1.7)},
            0.15,
            steps.sensors(0, 1, first=True),
        ),
        Form(
            "reflex_smoothed",
            "short_latency_reflex",
            "a s e^(-d s) / (T s + 1) theta1",
            {"d": (0.025, 0.09), "T": (0.003, 0.05)},
            200.0,
            steps.reflex,
        ),
        Form(
            "asymmetric_coupling",
            "biarticular_coupling",
            "a (1 + T s) theta1 at the hip, r a (1 + T s) theta2 at the ankle",
            {"r": _AROUND, "T": (0.005, 0.15)},
            250.0,
            steps.crossed,
            both=True,
        ),
        Form(
            "dead_angle_only",
            "dead_zone",
            "threshold a on theta1, r a on theta2",
            {"r": (0.3, 3.0)},
            0.008,
            rule=steps.dead(True, False),
        ),
        Form(
            "dead_rate_only",
            "dead_zone",
            "threshold 4 a /s on the rate of theta1, 4 r a on that of theta2",
            {"r": (0.3, 3.0)},
            0.008,
            rule=steps.dead(False, True),
        ),
        Form(
            "dead_zone_ratio",
            "dead_zone",
            "thresholds a and r a on angles, q times these on rates",
            {"r": (0.3, 3.0), "q": (0.5, 20.0)},
            0.008,
            rule=steps.dead(True, True),
        ),
        Form(
            "reweighting_and_drift",
            "amplitude_reweighting",
            "exponent a; gains drift by r a",
            {"r": (0.05, 0.5)},
            0.9,
            rule=steps.reweighting_and_drift,
            lasting=False,
        ),
        Form(
            "drift_of_stiffness",
            "gain_drift",
            "stiffness drifts by a",
            {},
            0.8,
            rule=steps.partial_drift(lambda t: t.order == 0),
            lasting=False,
        ),
        Form(
            "drift_of_the_ankle",
            "gain_drift",
            "gains of the ankle drift by a",
            {},
            0.8,
            rule=steps.partial_drift(lambda t: t.row == "ankle"),
            lasting=False,
        ),
    )
}
"""All forms by name."""
