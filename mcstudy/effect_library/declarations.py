"""The effects of the library: one declaration per effect, with its published size.

A linear effect changes the term table of the model (`mcstudy.effect_library.edits`), so both simulators, the closed
form and the compiled kernel include it. A nonlinear or drifting effect is a rule of the time-domain simulator instead.
It also declares a linear trace (its appearance in a linear fit) and the contrast that reveals it. To add an effect, add
one `Effect` to `DECLARATIONS`, or register it with `mcstudy.effect_library.library.LIBRARY.register`.

``source`` names the paper that a range is from, says how it is derived, or says "assumption": a plausible range for
which no publication is claimed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mcstudy.effect_library import edits as add
from mcstudy.effect_library.constants import low_pass_of_order
from mcstudy.effect_library.effect import Effect, Form, Size, TrialSetting
from mcstudy.stance.feedback import ANGLES, Filter, Model, Monomial, Term
from mcstudy.stance.rules import reweighted


def terms(*rows: Term) -> Callable[[Model], Model]:
    """Build step: more terms."""
    return lambda model: add.add_terms(model, *rows)


def terms_filter(selects: Callable[[Term], bool], filt: Filter) -> Callable[[Model], Model]:
    """Build step: a filter on the terms that ``selects`` selects."""
    return lambda model: add.filter_terms(model, selects, filt)


def output(angles: tuple[int, ...], time_constant: str, curvature: str) -> Callable[[Model], Model]:
    """Build step: a lag on measured angles, of first order unless the form has a curvature."""
    return lambda model: add.filter_output(model, angles, low_pass_of_order(time_constant, time_constant, curvature))


def _output_both(model: Model) -> Model:
    first, second = (
        Monomial(1.0, 1, (("tau_sensors", 1),)),
        Monomial(1.0, 1, (("tau_sensors", 1), ("ratio_sensors", 1))),
    )
    model = add.filter_output(model, (0,), Filter("tau_sensors", (add.ONE,), (add.ONE, first)))
    return add.filter_output(model, (1,), Filter("tau_sensors_hip", (add.ONE,), (add.ONE, second)))


def through(model: Model, corner: str, row: Term, ratio: str = "") -> Model:
    """A term behind a first-order lag and, if a ratio is named, the same at the hip."""
    lag = add.low_pass(corner, corner)
    row = replace(row, filters=(*row.filters, lag.name))
    model = add.add_terms(model.with_terms(filters=(lag,)), row)
    return add.add_hip_share(model, row, ratio) if ratio else model


def _integral(row: str, sense: str, gain: str, leak: str, ratio: str = "") -> Callable[[Model], Model]:
    """Build step: gain / (s + leak) of an angle, late as the row's feedback."""
    filt = Filter(leak, (Monomial(1.0, 1),), (Monomial(1.0, 1), Monomial(1.0, 0, ((leak, 1),))))
    integral = Term(row, sense, (gain,), -1, add.OWN, (leak,), noisy=True)

    def build(model: Model) -> Model:
        model = add.add_terms(model.with_terms(filters=(filt,)), integral)
        return add.add_hip_share(model, integral, ratio) if ratio else model

    return build


def _activation(model: Model) -> Model:
    """A filter of second order on the active torque, at the hip with its own ratio of the time constant."""
    T, rho, zeta = ("Tact", 1), ("ratio_activation", 1), ("zeta_activation", 1)
    ankle = Filter("activation", (add.ONE,), (add.ONE, Monomial(2.0, 1, (T, zeta)), Monomial(1.0, 2, (("Tact", 2),))))
    square = Monomial(1.0, 2, (("Tact", 2), ("ratio_activation", 2)))
    hip = Filter("activation_hip", (add.ONE,), (add.ONE, Monomial(2 * ACTIVATION_DAMPING, 1, (T, rho)), square))
    model = add.filter_terms(model, add.is_active_ankle, ankle)
    return add.filter_terms(model, _is_active_hip, hip) if any(map(_is_active_hip, model.terms)) else model


def _force_feedback(model: Model) -> Model:
    lag, gain = Monomial(1.0, 1, (("tau_force", 1),)), ("Gforce", 1)
    above = (lag, add.ONE)
    ankle = Filter("force_feedback", above, (*above, Monomial(-1.0, 0, (gain,))))
    hip = Filter("force_feedback_hip", above, (*above, Monomial(-1.0, 0, (gain, ("ratio_force", 1)))))
    model = add.filter_terms(model, add.is_active_ankle, ankle)
    return add.filter_terms(model, _is_active_hip, hip) if any(map(_is_active_hip, model.terms)) else model


def _is_active_hip(term: Term) -> bool:
    return term.noisy and term.row == "hip"


def _late_stimulus(model: Model) -> Model:
    lag = Monomial(1.0, 1, (("Tstim", 1), ("lag_Tstim", 1)))
    model = add.filter_terms(model, add.is_stimulus, Filter("lag_Tstim", (add.ONE,), (add.ONE, lag)))
    return add.delay_terms(model, add.is_stimulus, "Tstim")


def _stretch_frame(model: Model) -> Model:
    frame = [t for t in model.terms if t.noisy and t.sense == "theta2" and len(t.gain) == 1]
    legs = [replace(t, sense="theta1", gain=(*t.gain, "kappa")) for t in frame]
    return add.sense_tilt(model.with_terms(terms=legs), frame, "kappa")


def active_gain(error: str) -> Callable[[Model], Model]:
    """Build step: active feedback times (1 + error), the linear trace of all effects that change the active gains."""
    filt = Filter(error, (add.ONE, Monomial(1.0, 0, ((error, 1),))), (add.ONE,))
    return terms_filter(add.is_active, filt)


RATE_PER_ANGLE = 0.33 / 0.07
"""Published ratio of the thresholds of angular rate and angle, 1/s."""

HIP_SHARE = 0.3
"""Motor noise at the hip relative to the ankle; about the ratio of the torques."""


def _dead_zone(sizes: Mapping[str, float], _: TrialSetting) -> dict[str, Any]:
    angle = sizes["dead_angle"]
    rate = RATE_PER_ANGLE * angle
    return {"dead_angle": (angle, angle), "dead_rate": (rate, rate)}


def _reweighting(sizes: Mapping[str, float], trial: TrialSetting) -> dict[str, Any]:
    return {"active_gain": reweighted(trial.amplitude, trial.reference, sizes["reweighting"])}


def _reweighting_exponent(gain: float, between: tuple[float, float]) -> float | None:
    low, high = between
    return float(-np.log1p(gain) / np.log(high / low)) if gain > -0.9 else None


def _drift_from_halves(gain: float, _: tuple[float, float]) -> float:
    return 2.0 * gain  # the centres of the two halves are half a recording apart


def _drift(sizes: Mapping[str, float], trial: TrialSetting) -> dict[str, Any]:
    gains = {g for t in trial.model.terms if t.noisy for g in t.gain[:1]}
    return {"gain_drift": dict.fromkeys(sorted(gains), sizes["drift"])}


def _saturation(sizes: Mapping[str, float], _: TrialSetting) -> dict[str, Any]:
    return {"torque_limit": (np.inf, 1.0 / sizes["saturation"] if sizes["saturation"] > 0 else np.inf)}


def _motor_noise(sizes: Mapping[str, float], trial: TrialSetting) -> dict[str, Any]:
    scale = sizes["motor_noise"] * np.sqrt(trial.rate_hz / 2) * np.array([HIP_SHARE, 1.0])
    return {"motor_noise": trial.rng.standard_normal((trial.samples, 2)) * scale}


ACTIVATION_DAMPING = 1.15
"""Damping ratio of the activation filter, the middle of the published 1 to 1.3; the lag absorbs an error in it."""

FORCE_TIME_CONSTANT = 16.5
"""Time constant of force feedback in s, the middle of 15 to 18; small loop gains determine only G / tau."""

RESONANCE_DAMPING = 0.2
"""Damping ratio of a head or trunk mode."""

HEAVIEST_HEAD = 12.0
"""Largest mass of head and neck in kg: 8.1 % of the body (Winter 2009, Table 4.1) of a person of 150 kg."""

_WHOLE = "assumption: a plausible range"
_SERIES = "assumption: no slower than muscle activation (0.025 to 0.107 s)"
_RATIO_OF_SIZES = "ratio of the usual sizes of the two joints"
_SPLIT = "assumption: K22 / K11 is about 0.2"
_LEAK = "assumption: forgotten within 4 s or later, many cycles of sway"
_SENSED = "assumption: faster than muscle activation"
_ACTUATOR = "actuator bandwidth 4-16 Hz"
_ARMS = "assumption: moment arms at the two joints differ"
_NECK = "assumption: the relaxed neck is little damped, the stiff one more (Viviani & Berthoz 1975, Biol Cybern 19:19)"


def _order(name: str) -> Form:
    """Curvature of a low-pass."""
    return Form(
        name=name,
        high=0.5,
        meaning="curvature: 0 of first order, 0.25 of two lags",
        source="0.5 for a Butterworth filter",
    )


def _reflex(model: Model) -> Model:
    lag = add.low_pass("T_Bsl", "T_Bsl")
    term = Term("ankle", "theta1", ("Bsl",), 1, "Tsl", (lag.name,), noisy=True)
    return add.add_terms(model.with_terms(filters=(lag,)), term, at_joint=True)


def _resonance(name: str, frequency: str, zeta: str, detached: bool) -> Filter:
    w = 2 * np.pi
    stiffness = Monomial(w**2, 0, ((frequency, 2),))
    damping = Monomial(2 * w, 1, ((frequency, 1), (zeta, 1)))
    inertia = Monomial(1.0, 2)
    above = (Monomial(-1.0, 2),) if detached else (stiffness, damping)
    return Filter(name, above, (inertia, damping, stiffness))


def _sensor_lag(angle: int, sensor: str) -> Effect:
    """A lag of the sensor of one angle."""
    measured = ANGLES[angle]
    return Effect(
        name=f"sensor_lag_{measured}",
        equation=f"measured {measured} = {measured} / (tau s + 1)",
        place=("sensor",),
        sizes=(
            Size(
                name=f"tau_{measured}",
                unit="s",
                lower=0.0,
                upper=0.20,
                published=(0.010, 0.050),
                meaning=f"lag of the {sensor} sensor",
            ),
        ),
        build=output((angle,), f"tau_{measured}", f"q_tau_{measured}"),
        source="soft tissue and filters, 10-50 ms",
        order=2,
        forms=(_order(f"q_tau_{measured}"),),
    )


def _mode(name: str, suffix: str, *, equation: str, mass: str, frequency: str, detached: bool) -> Effect:
    """A mode of the head: a mass on a spring, that is added to the trunk or, ``detached``, is part of it."""
    size, resonance, zeta = f"m_{suffix}", f"f_{suffix}", f"zeta_{suffix}"
    return Effect(
        name=name,
        equation=equation,
        place=("body",),
        sizes=(
            Size(name=size, unit="kg", lower=-3.0, upper=15.0, published=(4.0, 6.0), meaning=mass, most=HEAVIEST_HEAD),
            Size(name=resonance, unit="Hz", null=None, lower=0.8, upper=6.0, published=(1.5, 4.0), meaning=frequency),
        ),
        build=lambda model: add.resonant_mass(model, size, _resonance(name, resonance, zeta, detached)),
        source="assumption: head and neck 4-6 kg, 1.5-4 Hz",
        family="head_mode",
        forms=(
            Form(
                name=zeta,
                nominal=RESONANCE_DAMPING,
                low=0.05,
                high=0.4,
                meaning="damping ratio of the mode",
                source=_NECK,
            ),
        ),
    )


DECLARATIONS: tuple[Effect, ...] = (
    Effect(
        name="passive_damping_ankle",
        equation="ankle torque + Bpas1 s theta1",
        place=("ankle",),
        sizes=(
            Size(
                name="Bpas1",
                unit="N m s/rad",
                lower=-40.0,
                upper=140.0,
                published=(11.0, 69.0),
                meaning="passive damping of the ankle",
            ),
        ),
        build=lambda model: through(model, "T_Bpas1", Term("ankle", "theta1", ("Bpas1",), 1), "ratio_Bpas1"),
        source="lower end: Loram & Lakie 2002 (J Physiol 545:1041); upper end: assumption",
        forms=(
            Form(
                name="T_Bpas1",
                unit="s",
                high=0.08,
                meaning="time constant of a spring in series with the damper",
                source=_SERIES,
            ),
            Form(
                name="ratio_Bpas1", high=0.2, meaning="damping of the hip relative to the ankle", source=_RATIO_OF_SIZES
            ),
        ),
    ),
    Effect(
        name="passive_damping_hip",
        equation="hip torque + Bpas2 s theta2",
        place=("hip",),
        sizes=(
            Size(
                name="Bpas2",
                unit="N m s/rad",
                lower=-15.0,
                upper=40.0,
                published=(3.0, 14.0),
                meaning="passive damping of the hip",
            ),
        ),
        build=lambda model: through(model, "T_Bpas2", Term("hip", "theta2", ("Bpas2",), 1)),
        source="half to twice 0.05 m g h of the trunk (7 N m s/rad for this body)",
        forms=(
            Form(
                name="T_Bpas2",
                unit="s",
                high=0.08,
                meaning="time constant of a spring in series with the damper",
                source=_SERIES,
            ),
        ),
    ),
    Effect(
        name="activation_dynamics",
        equation="active torque x 1 / (T^2 s^2 + 2 zeta T s + 1), T = 1/omega",
        place=("ankle", "hip"),
        sizes=(
            Size(
                name="Tact",
                unit="s",
                lower=0.0,
                upper=0.20,
                published=(0.025, 0.107),
                meaning="time constant of muscle activation, 1/omega",
            ),
        ),
        build=_activation,
        source="omega 9.3-16.8 rad/s and zeta 1-1.3 including excitation, 20-40 rad/s for contraction alone; " + _WHOLE,
        order=2,
        forms=(
            Form(
                name="zeta_activation",
                nominal=ACTIVATION_DAMPING,
                low=0.7,
                high=1.7,
                meaning="damping ratio of the activation filter of the ankle",
                source="around the published 1 to 1.3; from almost second order without overshoot to nearly "
                "first order",
            ),
            Form(
                name="ratio_activation",
                nominal=1.0,
                low=0.5,
                high=1.5,
                meaning="time constant of the hip relative to the ankle",
                source="assumption: the range of the time constant within one joint is as wide",
            ),
        ),
    ),
    Effect(
        name="force_feedback",
        equation="active ankle torque / (1 - G / (tau s + 1)), G = Kf K11",
        place=("ankle",),
        sizes=(
            Size(
                name="Gforce",
                lower=-1.5,
                upper=4.0,
                published=(1.0, 2.0),
                meaning="loop gain of positive force feedback",
            ),
        ),
        build=_force_feedback,
        source="Kf 0.0018 rad/(N m), tau 15-18 s (Peterka 2003, IEEE Eng Med Biol Mag 22:63)",
        order=2,
        forms=(
            Form(
                name="tau_force",
                unit="s",
                nominal=FORCE_TIME_CONSTANT,
                low=8.0,
                high=33.0,
                meaning="time constant of force feedback",
                source="half to twice the published 15 to 18 s, which are fits of group means",
            ),
            Form(name="ratio_force", high=0.4, meaning="loop gain of the hip relative to the ankle", source=_SPLIT),
        ),
    ),
    Effect(
        name="integral_ankle",
        equation="ankle torque + Ki1 / s e^{-Td1 s} theta1",
        place=("ankle",),
        sizes=(
            Size(
                name="Ki1",
                unit="N m/(rad s)",
                lower=-100.0,
                upper=300.0,
                published=(77.0, 134.0),
                meaning="integral gain of the ankle loop",
            ),
        ),
        build=_integral("ankle", "theta1", "Ki1", "leak_Ki1", "ratio_Ki1"),
        source="Peterka 2002 (J Neurophysiol 88:1097) and later studies",
        forms=(
            Form(
                name="leak_Ki1", unit="1/s", high=0.25, meaning="rate at which the integral is forgotten", source=_LEAK
            ),
            Form(
                name="ratio_Ki1",
                high=0.25,
                meaning="integral gain of the hip relative to the ankle",
                source=_RATIO_OF_SIZES,
            ),
        ),
    ),
    Effect(
        name="integral_hip",
        equation="hip torque + Ki2 / s e^{-Td2 s} theta2",
        place=("hip",),
        sizes=(
            Size(
                name="Ki2",
                unit="N m/(rad s)",
                lower=-60.0,
                upper=80.0,
                published=(15.0, 40.0),
                meaning="integral gain of the hip loop",
            ),
        ),
        build=_integral("hip", "theta2", "Ki2", "leak_Ki2"),
        source="range of the ankle times K22 / K11",
        forms=(
            Form(
                name="leak_Ki2", unit="1/s", high=0.25, meaning="rate at which the integral is forgotten", source=_LEAK
            ),
        ),
    ),
    Effect(
        name="acceleration_feedback",
        equation="ankle torque + Ka1 s^2 e^{-Td1 s} theta1",
        place=("ankle",),
        sizes=(
            Size(
                name="Ka1",
                unit="N m s^2/rad",
                lower=-17.0,
                upper=17.0,
                published=(6.0, 15.0),
                meaning="acceleration gain of the ankle loop",
            ),
        ),
        build=lambda model: through(
            model, "T_Ka1", Term("ankle", "theta1", ("Ka1",), 2, add.OWN, noisy=True), "ratio_Ka1"
        ),
        source="89 N m s^2/rad is published for one segment; with a free hip the loop is unstable above 19 "
        "(= 1 / (M^-1)_11)",
        forms=(
            Form(name="T_Ka1", unit="s", high=0.05, meaning="time constant of the sensed acceleration", source=_SENSED),
            Form(
                name="ratio_Ka1", high=0.4, meaning="acceleration gain of the hip relative to the ankle", source=_SPLIT
            ),
        ),
    ),
    Effect(
        name="trunk_inertia_error",
        equation="m2 x (1 + eps), which changes A2, J2, C1, C2 and, through L1, A1 and J1",
        place=("body",),
        sizes=(
            Size(
                name="eps_trunk",
                lower=-0.5,
                upper=0.8,
                published=(0.10, 0.30),
                meaning="relative error of the trunk's mass",
                signed=True,
            ),
        ),
        build=lambda model: add.scale_trunk(model, "eps_trunk", "height_eps_trunk"),
        source="assumption: 10-30 %, of the order of the differences between anthropometric tables",
        forms=(
            Form(
                name="height_eps_trunk",
                high=0.5,
                meaning="relative error of the height of the trunk's centre per relative error of its mass",
                source="0 for mass alone, 1/3 for a trunk that is larger in every direction",
            ),
        ),
    ),
    Effect(
        name="leg_inertia_error",
        equation="m1 x (1 + eps), which changes the contribution of the legs to A1 and J1",
        place=("body",),
        sizes=(
            Size(
                name="eps_leg",
                lower=-0.8,
                upper=1.5,
                published=(0.10, 0.30),
                meaning="relative error of the legs' mass",
                signed=True,
            ),
        ),
        build=lambda model: add.scale_legs(model, "eps_leg", "moment_eps_leg"),
        source="assumption: 10-30 %, of the order of the differences between anthropometric tables",
        forms=(
            Form(
                name="moment_eps_leg",
                nominal=1.0,
                low=0.5,
                high=1.5,
                meaning="relative error of the legs' first moment per relative error of their inertia",
                source="1 for mass alone, 1/2 for the place of the mass alone (inertia goes with its square)",
            ),
        ),
    ),
    Effect(
        name="stimulus_gain",
        equation="stimulus x (1 + eps)",
        place=("stimulus",),
        sizes=(
            Size(
                name="eps_stim",
                lower=-0.7,
                upper=1.5,
                published=(0.05, 0.10),
                meaning="relative error of the stimulus amplitude",
                signed=True,
            ),
        ),
        build=lambda model: add.scale_stimulus(model, "eps_stim", "T_eps_stim"),
        source="actuator calibration error 10 %",
        order=1,
        forms=(
            Form(
                name="T_eps_stim",
                unit="s",
                high=0.04,
                meaning="time constant with which the error fades",
                source=_ACTUATOR,
            ),
        ),
    ),
    Effect(
        name="stimulus_delay",
        equation="stimulus x e^{-s T}",
        place=("stimulus",),
        sizes=(
            Size(
                name="Tstim",
                unit="s",
                lower=-0.05,
                upper=0.12,
                published=(0.010, 0.040),
                meaning="delay of the stimulus",
            ),
        ),
        build=_late_stimulus,
        source="actuator and acquisition latency 10-40 ms; a negative value means that the clock of the angles is late",
        order=2,
        forms=(
            Form(name="lag_Tstim", high=0.5, meaning="time constant of a lag relative to the delay", source=_ACTUATOR),
        ),
    ),
    Effect(
        name="stimulus_lag",
        equation="stimulus x 1 / (tau s + 1)",
        place=("stimulus",),
        sizes=(
            Size(
                name="tau_stim",
                unit="s",
                lower=0.0,
                upper=0.15,
                published=(0.010, 0.040),
                meaning="time constant of the actuator",
            ),
        ),
        build=terms_filter(add.is_stimulus, low_pass_of_order("tau_stim", "tau_stim", "q_tau_stim")),
        source="actuator bandwidth 4-16 Hz",
        order=2,
        forms=(_order("q_tau_stim"),),
    ),
    _sensor_lag(0, "lower-body"),
    _sensor_lag(1, "hip"),
    Effect(
        name="sensor_lag_both",
        equation="both measured angles / (tau s + 1)",
        place=("sensor",),
        sizes=(
            Size(
                name="tau_sensors",
                unit="s",
                lower=0.0,
                upper=0.20,
                published=(0.010, 0.050),
                meaning="lag of both sensors",
            ),
        ),
        build=_output_both,
        source="anti-alias filters, 10-50 ms",
        order=2,
        forms=(
            Form(
                name="ratio_sensors",
                nominal=1.0,
                low=0.7,
                high=1.3,
                meaning="lag of the hip sensor relative to the other",
                source="1 for one filter on both channels; soft tissue differs between segments",
            ),
        ),
    ),
    _mode(
        "head_mode",
        "head",
        equation="reaction m s^2 (2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2) of an extra mass on the trunk",
        mass="mass of the mode",
        frequency="resonance frequency of the mode",
        detached=False,
    ),
    _mode(
        "loose_head",
        "loose",
        equation="reaction -m s^2 s^2 / (s^2 + 2 zeta w s + w^2) of a part of the trunk's mass that is "
        "attached by a spring",
        mass="mass attached by the spring",
        frequency="resonance frequency of that mass",
        detached=True,
    ),
    Effect(
        name="short_latency_reflex",
        equation="ankle torque + Bsl s e^{-Tsl s} theta1",
        place=("ankle",),
        sizes=(
            Size(
                name="Bsl",
                unit="N m s/rad",
                lower=-60.0,
                upper=200.0,
                published=(20.0, 80.0),
                meaning="gain of the short-latency stretch reflex",
            ),
            Size(
                name="Tsl",
                unit="s",
                null=None,
                lower=0.030,
                upper=0.070,
                published=(0.040, 0.060),
                meaning="latency of the short-latency stretch reflex",
            ),
        ),
        build=_reflex,
        source="assumption: latency 40-60 ms, gain of the order of magnitude of the passive damping",
        forms=(Form(name="T_Bsl", unit="s", high=0.03, meaning="time constant of the reflex torque", source=_SENSED),),
    ),
    Effect(
        name="biarticular_coupling",
        equation="hip torque + Kbi theta1, ankle torque + Kbi theta2",
        place=("ankle", "hip"),
        sizes=(
            Size(
                name="Kbi",
                unit="N m/rad",
                lower=-250.0,
                upper=250.0,
                published=(30.0, 120.0),
                meaning="passive cross stiffness",
                signed=True,
            ),
        ),
        build=terms(
            Term("hip", "theta1", ("Kbi",)),
            Term("ankle", "theta2", ("Kbi", "ratio_Kbi")),
            Term("hip", "theta1", ("Kbi", "T_Kbi"), 1),
            Term("ankle", "theta2", ("Kbi", "T_Kbi"), 1),
        ),
        source="assumption: two-joint leg muscles",
        forms=(
            Form(
                name="ratio_Kbi",
                nominal=1.0,
                low=0.5,
                high=1.5,
                meaning="stiffness at the ankle relative to the hip",
                source=_ARMS,
            ),
            Form(name="T_Kbi", unit="s", high=0.08, meaning="damping relative to the stiffness", source=_SERIES),
        ),
    ),
    Effect(
        name="joint_stretch_frame",
        equation="active feedback of theta2 becomes feedback of theta2 + kappa theta1",
        place=("ankle", "hip"),
        sizes=(Size(name="kappa", lower=-1.0, upper=1.5, published=(0.3, 1.0), meaning="share of the space frame"),),
        build=_stretch_frame,
        source="frame of trunk control, fraction 0 to 1; K12, B12, K21 and B21 absorb it inside their bounds",
        order=1,
    ),
    Effect(
        name="dead_zone",
        equation="active feedback of an angle is zero below its threshold",
        place=("ankle", "hip"),
        sizes=(
            Size(
                name="dead_angle",
                unit="rad",
                lower=0.0,
                upper=np.deg2rad(0.5),
                published=(np.deg2rad(0.05), np.deg2rad(0.2)),
                meaning="threshold",
            ),
        ),
        build=active_gain("gain_dead_zone"),
        source="0.07 deg and 0.33 deg/s (order of Fitzpatrick & McCloskey 1994, J Physiol 478:173)",
        order=2,
        kind="nonlinear",
        contrast="amplitude",
        gain_sign=1,  # small sway stays below the threshold, so the gain grows with amplitude
        unvaried="large",
        rule=_dead_zone,
        scatters=True,
    ),
    Effect(
        name="amplitude_reweighting",
        equation="active gains x (amplitude / reference)^-p",
        place=("ankle", "hip"),
        sizes=(
            Size(
                name="reweighting",
                lower=-0.5,
                upper=1.0,
                published=(0.1, 0.35),
                meaning="exponent p of the gains against amplitude",
            ),
        ),
        build=active_gain("gain_amplitude_reweighting"),
        source="sensory weight 0.8 to 0.4 over 0.5 to 4 deg, p = 1/3 (Peterka 2002, J Neurophysiol 88:1097)",
        order=2,
        kind="nonlinear",
        contrast="amplitude",
        gain_sign=-1,
        size_from_gain=_reweighting_exponent,
        rule=_reweighting,
    ),
    Effect(
        name="gain_drift",
        equation="active gains x (1 + d (t / duration - 1/2))",
        place=("ankle", "hip"),
        sizes=(
            Size(
                name="drift",
                lower=-0.8,
                upper=0.8,
                published=(0.1, 0.3),
                meaning="relative change of the active gains over the recording",
                signed=True,
            ),
        ),
        build=active_gain("gain_gain_drift"),
        source="assumption: habituation over minutes",
        order=2,
        kind="nonstationary",
        contrast="time",
        gain_sign=1,
        size_from_gain=_drift_from_halves,
        rule=_drift,
    ),
    Effect(
        name="torque_saturation",
        equation="active ankle torque limited to +- the limit",
        place=("ankle",),
        sizes=(
            Size(
                name="saturation",
                unit="1/(N m)",
                lower=0.0,
                upper=0.5,
                published=(0.08, 0.10),
                meaning="inverse of the torque limit",
            ),
        ),
        build=active_gain("gain_torque_saturation"),
        source="assumption: active torque peaks at 12 N m under 5 N m; the body falls with limits below 9 N m",
        order=2,
        kind="nonlinear",
        contrast="amplitude",
        gain_sign=-1,
        unvaried="small",
        rule=_saturation,
        scatters=True,
    ),
    Effect(
        name="motor_noise",
        equation="white torque noise at the ankle and the hip",
        place=("ankle", "hip"),
        sizes=(
            Size(
                name="motor_noise",
                unit="N m/sqrt(Hz)",
                lower=0.0,
                upper=5.0,
                published=(0.2, 1.0),
                meaning="spectral density of torque noise",
            ),
        ),
        build=active_gain("gain_motor_noise"),
        source="assumption: changes the remnant, not the responses",
        order=2,
        kind="nonstationary",
        rule=_motor_noise,
    ),
)
"""All effects, in the order in which they are listed."""
