"""The effects of the library: one declaration per effect, with its published size.

A linear effect changes the term table of the model (`mcstudy.effect_library.edits`), so both simulators, the closed
form and the compiled kernel include it. A nonlinear or drifting effect is a rule of the time-domain simulator instead.
It also declares a linear trace (its appearance in a linear fit) and the contrast that reveals it. To add an effect, add
one `Effect` to `DECLARATIONS`, or register it with `mcstudy.effect_library.library.LIBRARY.register`.

``source`` names the paper when the published range is from one paper; "collected range" means several publications.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mcstudy.effect_library import edits as add
from mcstudy.effect_library.declare import Effect, Size, TrialSetting
from mcstudy.stance.feedback import Filter, Model, Monomial, Term
from mcstudy.stance.rules import reweighted


def terms(*rows: Term, at_joint: bool = False) -> Callable[[Model], Model]:
    """Build step: more terms."""
    return lambda model: add.add_terms(model, *rows, at_joint=at_joint)


def terms_filter(which: Callable[[Term], bool], filt: Filter) -> Callable[[Model], Model]:
    """Build step: a filter on the terms that ``which`` selects."""
    return lambda model: add.filter_terms(model, which, filt)


def output(angles: tuple[int, ...], time_constant: str) -> Callable[[Model], Model]:
    """Build step: a first-order lag on measured angles."""
    return lambda model: add.filter_output(model, angles, add.low_pass(time_constant, time_constant))


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
"""Time constant of force feedback in s, the middle of 15 to 18; stance data determine only G / tau."""

RESONANCE_DAMPING = 0.2
"""Damping ratio of a head or trunk mode."""

HEAVIEST_HEAD = 12.0
"""Largest mass of head and neck in kg: 8.1 % of the body (Winter 2009, Table 4.1) of a person of 150 kg."""

_WHOLE = "collected range"


def _resonance(name: str, frequency: str, detached: bool) -> Filter:
    w = 2 * np.pi
    stiffness = Monomial(w**2, 0, ((frequency, 2),))
    damping = Monomial(2 * RESONANCE_DAMPING * w, 1, ((frequency, 1),))
    inertia = Monomial(1.0, 2)
    above = (Monomial(-1.0, 2),) if detached else (stiffness, damping)
    return Filter(name, above, (inertia, damping, stiffness))


DECLARATIONS: tuple[Effect, ...] = (
    Effect(
        "passive_damping_ankle",
        "ankle torque + Bpas1 s theta1",
        ("ankle",),
        (Size("Bpas1", "N m s/rad", 0.0, -40.0, 140.0, (11.0, 69.0), "passive damping of the ankle"),),
        terms(Term("ankle", "theta1", ("Bpas1",), 1)),
        "lower end: Loram & Lakie 2002 (J Physiol 545:1041); collected range",
    ),
    Effect(
        "passive_damping_hip",
        "hip torque + Bpas2 s theta2",
        ("hip",),
        (Size("Bpas2", "N m s/rad", 0.0, -15.0, 40.0, (3.0, 14.0), "passive damping of the hip"),),
        terms(Term("hip", "theta2", ("Bpas2",), 1)),
        "half to twice 0.05 m g h of the trunk (7 N m s/rad for this body)",
    ),
    Effect(
        "activation_dynamics",
        "active torque x 1 / (T^2 s^2 + 2 zeta T s + 1), T = 1/omega",
        ("ankle", "hip"),
        (Size("Tact", "s", 0.0, 0.0, 0.20, (0.025, 0.107), "time constant of muscle activation, 1/omega"),),
        terms_filter(
            add.is_active,
            Filter(
                "activation",
                (add.ONE,),
                (
                    add.ONE,
                    Monomial(2 * ACTIVATION_DAMPING, 1, (("Tact", 1),)),
                    Monomial(1.0, 2, (("Tact", 2),)),
                ),
            ),
        ),
        "omega 9.3-16.8 rad/s and zeta 1-1.3 including excitation, 20-40 rad/s for contraction alone; " + _WHOLE,
        order=2,
    ),
    Effect(
        "force_feedback",
        "active ankle torque / (1 - G / (tau s + 1)), G = Kf K11",
        ("ankle",),
        (Size("Gforce", "", 0.0, -1.5, 4.0, (1.0, 2.0), "loop gain of positive force feedback"),),
        terms_filter(
            add.is_active_ankle,
            Filter(
                "force_feedback",
                (Monomial(FORCE_TIME_CONSTANT, 1), add.ONE),
                (Monomial(FORCE_TIME_CONSTANT, 1), add.ONE, Monomial(-1.0, 0, (("Gforce", 1),))),
            ),
        ),
        "Kf 0.0018 rad/(N m), tau 15-18 s (Peterka 2003, IEEE Eng Med Biol Mag 22:63)",
        order=2,
    ),
    Effect(
        "integral_ankle",
        "ankle torque + Ki1 / s e^{-Td1 s} theta1",
        ("ankle",),
        (Size("Ki1", "N m/(rad s)", 0.0, -100.0, 300.0, (77.0, 134.0), "integral gain of the ankle loop"),),
        terms(Term("ankle", "theta1", ("Ki1",), -1, add.OWN, noisy=True)),
        "Peterka 2002 (J Neurophysiol 88:1097) and later studies",
    ),
    Effect(
        "integral_hip",
        "hip torque + Ki2 / s e^{-Td2 s} theta2",
        ("hip",),
        (Size("Ki2", "N m/(rad s)", 0.0, -60.0, 80.0, (15.0, 40.0), "integral gain of the hip loop"),),
        terms(Term("hip", "theta2", ("Ki2",), -1, add.OWN, noisy=True)),
        "range of the ankle times K22 / K11",
    ),
    Effect(
        "acceleration_feedback",
        "ankle torque + Ka1 s^2 e^{-Td1 s} theta1",
        ("ankle",),
        (Size("Ka1", "N m s^2/rad", 0.0, -17.0, 17.0, (6.0, 15.0), "acceleration gain of the ankle loop"),),
        terms(Term("ankle", "theta1", ("Ka1",), 2, add.OWN, noisy=True)),
        "89 N m s^2/rad is published for one segment; with a free hip the loop is unstable above 19 (= 1 / (M^-1)_11)",
    ),
    Effect(
        "trunk_inertia_error",
        "m2 x (1 + eps), which changes A2, J2, C1, C2 and, through L1, A1 and J1",
        ("body",),
        (Size("eps_trunk", "", 0.0, -0.5, 0.8, (0.10, 0.30), "relative error of the trunk's mass", True),),
        lambda model: add.scale_trunk(model, "eps_trunk"),
        "10-30 %: differences between anthropometric tables (collected range)",
    ),
    Effect(
        "leg_inertia_error",
        "m1 x (1 + eps), which changes the contribution of the legs to A1 and J1",
        ("body",),
        (Size("eps_leg", "", 0.0, -0.8, 1.5, (0.10, 0.30), "relative error of the legs' mass", True),),
        lambda model: add.scale_legs(model, "eps_leg"),
        "10-30 %: differences between anthropometric tables (collected range)",
    ),
    Effect(
        "stimulus_gain",
        "stimulus x (1 + eps)",
        ("stimulus",),
        (
            Size(
                "eps_stim",
                "",
                0.0,
                -0.7,
                1.5,
                (0.05, 0.10),
                "relative error of the stimulus amplitude",
                signed=True,
            ),
        ),
        lambda model: add.scale_stimulus(model, "eps_stim"),
        "actuator calibration error 10 %",
        order=1,
    ),
    Effect(
        "stimulus_delay",
        "stimulus x e^{-s T}",
        ("stimulus",),
        (Size("Tstim", "s", 0.0, -0.05, 0.12, (0.010, 0.040), "delay of the stimulus"),),
        lambda model: add.delay_stimulus(model, "Tstim"),
        "actuator and acquisition latency 10-40 ms; a negative value means that the clock of the angles is late",
        order=2,
    ),
    Effect(
        "stimulus_lag",
        "stimulus x 1 / (tau s + 1)",
        ("stimulus",),
        (Size("tau_stim", "s", 0.0, 0.0, 0.15, (0.010, 0.040), "time constant of the actuator"),),
        terms_filter(add.is_stimulus, add.low_pass("tau_stim", "tau_stim")),
        "actuator bandwidth 4-16 Hz",
        order=2,
    ),
    Effect(
        "sensor_lag_theta1",
        "measured theta1 = theta1 / (tau s + 1)",
        ("sensor",),
        (Size("tau_theta1", "s", 0.0, 0.0, 0.20, (0.010, 0.050), "lag of the lower-body sensor"),),
        output((0,), "tau_theta1"),
        "soft tissue and filters, 10-50 ms",
        order=2,
    ),
    Effect(
        "sensor_lag_theta2",
        "measured theta2 = theta2 / (tau s + 1)",
        ("sensor",),
        (Size("tau_theta2", "s", 0.0, 0.0, 0.20, (0.010, 0.050), "lag of the hip sensor"),),
        output((1,), "tau_theta2"),
        "soft tissue and filters, 10-50 ms",
        order=2,
    ),
    Effect(
        "sensor_lag_both",
        "both measured angles / (tau s + 1)",
        ("sensor",),
        (Size("tau_sensors", "s", 0.0, 0.0, 0.20, (0.010, 0.050), "lag of both sensors"),),
        output((0, 1), "tau_sensors"),
        "anti-alias filters, 10-50 ms",
        order=2,
    ),
    Effect(
        "head_mode",
        "reaction m s^2 (2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2) of an extra mass on the trunk",
        ("body",),
        (
            Size("m_head", "kg", 0.0, -3.0, 15.0, (4.0, 6.0), "mass of the mode", most=HEAVIEST_HEAD),
            Size("f_head", "Hz", None, 0.8, 6.0, (1.5, 4.0), "resonance frequency of the mode"),
        ),
        lambda model: add.resonant_mass(model, "m_head", _resonance("head_mode", "f_head", detached=False)),
        "head and neck 4-6 kg, 1.5-4 Hz (collected range)",
        family="head_mode",
    ),
    Effect(
        "loose_head",
        "reaction -m s^2 s^2 / (s^2 + 2 zeta w s + w^2) of a part of the trunk's mass that is attached by a spring",
        ("body",),
        (
            Size("m_loose", "kg", 0.0, -3.0, 15.0, (4.0, 6.0), "mass attached by the spring", most=HEAVIEST_HEAD),
            Size("f_loose", "Hz", None, 0.8, 6.0, (1.5, 4.0), "resonance frequency of that mass"),
        ),
        lambda model: add.resonant_mass(model, "m_loose", _resonance("loose_head", "f_loose", detached=True)),
        "head and neck 4-6 kg, 1.5-4 Hz (collected range)",
        family="head_mode",
    ),
    Effect(
        "short_latency_reflex",
        "ankle torque + Bsl s e^{-Tsl s} theta1",
        ("ankle",),
        (
            Size("Bsl", "N m s/rad", 0.0, -60.0, 200.0, (20.0, 80.0), "gain of the short-latency stretch reflex"),
            Size("Tsl", "s", None, 0.030, 0.070, (0.040, 0.060), "latency of the short-latency stretch reflex"),
        ),
        terms(Term("ankle", "theta1", ("Bsl",), 1, "Tsl", noisy=True), at_joint=True),
        "latency 40-60 ms; gain of the order of magnitude of the passive damping (collected range)",
    ),
    Effect(
        "biarticular_coupling",
        "hip torque + Kbi theta1, ankle torque + Kbi theta2",
        ("ankle", "hip"),
        (Size("Kbi", "N m/rad", 0.0, -250.0, 250.0, (30.0, 120.0), "passive cross stiffness", True),),
        terms(Term("hip", "theta1", ("Kbi",)), Term("ankle", "theta2", ("Kbi",))),
        "collected range for two-joint leg muscles",
    ),
    Effect(
        "joint_stretch_frame",
        "active feedback of theta2 becomes feedback of theta2 + kappa theta1",
        ("ankle", "hip"),
        (Size("kappa", "", 0.0, -1.0, 1.5, (0.3, 1.0), "share of the space frame"),),
        _stretch_frame,
        "frame of trunk control, fraction 0 to 1; K12, B12, K21 and B21 absorb it inside their bounds",
        order=1,
    ),
    Effect(
        "dead_zone",
        "active feedback of an angle is zero below its threshold",
        ("ankle", "hip"),
        (Size("dead_angle", "rad", 0.0, 0.0, np.deg2rad(0.5), (np.deg2rad(0.05), np.deg2rad(0.2)), "threshold"),),
        active_gain("gain_dead_zone"),
        "0.07 deg and 0.33 deg/s (order of Fitzpatrick & McCloskey 1994, J Physiol 478:173)",
        order=2,
        kind="nonlinear",
        contrast="amplitude",
        gain_sign=1,  # small sway stays below the threshold, so the gain grows with amplitude
        rule=_dead_zone,
    ),
    Effect(
        "amplitude_reweighting",
        "active gains x (amplitude / reference)^-p",
        ("ankle", "hip"),
        (Size("reweighting", "", 0.0, -0.5, 1.0, (0.1, 0.35), "exponent p of the gains against amplitude"),),
        active_gain("gain_amplitude_reweighting"),
        "sensory weight 0.8 to 0.4 over 0.5 to 4 deg, p = 1/3 (Peterka 2002, J Neurophysiol 88:1097)",
        order=2,
        kind="nonlinear",
        contrast="amplitude",
        gain_sign=-1,
        size_from_gain=_reweighting_exponent,
        rule=_reweighting,
    ),
    Effect(
        "gain_drift",
        "active gains x (1 + d (t / duration - 1/2))",
        ("ankle", "hip"),
        (
            Size(
                "drift", "", 0.0, -0.8, 0.8, (0.1, 0.3), "relative change of the active gains over the recording", True
            ),
        ),
        active_gain("gain_gain_drift"),
        "no published value; habituation over minutes",
        order=2,
        kind="nonstationary",
        contrast="time",
        gain_sign=1,
        size_from_gain=_drift_from_halves,
        rule=_drift,
    ),
    Effect(
        "torque_saturation",
        "active ankle torque limited to +- the limit",
        ("ankle",),
        (Size("saturation", "1/(N m)", 0.0, 0.0, 0.5, (0.08, 0.10), "inverse of the torque limit"),),
        active_gain("gain_torque_saturation"),
        "no published value; active torque peaks at 12 N m under 5 N m; the body falls with limits below 9 N m",
        order=2,
        kind="nonlinear",
        contrast="amplitude",
        gain_sign=-1,
        rule=_saturation,
    ),
    Effect(
        "motor_noise",
        "white torque noise at the ankle and the hip",
        ("ankle", "hip"),
        (Size("motor_noise", "N m/sqrt(Hz)", 0.0, 0.0, 5.0, (0.2, 1.0), "spectral density of torque noise"),),
        active_gain("gain_motor_noise"),
        "no published value; changes the remnant, not the responses",
        order=2,
        kind="nonstationary",
        rule=_motor_noise,
    ),
)
"""All effects, in the order in which they are listed."""
