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
from mcstudy.effect_library.constants import low_pass_of_order
from mcstudy.effect_library.declare import Effect, Form, Size, TrialSetting
from mcstudy.stance.feedback import Filter, Model, Monomial, Term
from mcstudy.stance.rules import reweighted


def terms(*rows: Term, at_joint: bool = False) -> Callable[[Model], Model]:
    """Build step: more terms."""
    return lambda model: add.add_terms(model, *rows, at_joint=at_joint)


def terms_filter(which: Callable[[Term], bool], filt: Filter) -> Callable[[Model], Model]:
    """Build step: a filter on the terms that ``which`` selects."""
    return lambda model: add.filter_terms(model, which, filt)


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
    own = Term(row, sense, (gain,), -1, add.OWN, (leak,), noisy=True)

    def build(model: Model) -> Model:
        model = add.add_terms(model.with_terms(filters=(filt,)), own)
        return add.add_hip_share(model, own, ratio) if ratio else model

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
    return add.delay_stimulus(model, "Tstim")


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

_WHOLE = "collected range"
_SERIES = "no published value; no slower than muscle activation (0.025 to 0.107 s)"
_RATIO_OF_SIZES = "ratio of the usual sizes of the two joints"
_SPLIT = "no published value; K22 / K11 is about 0.2"
_LEAK = "no published value; forgotten within 4 s or later, many cycles of sway"
_SENSED = "no published value; faster than muscle activation"
_ACTUATOR = "actuator bandwidth 4-16 Hz"
_ARMS = "no published value; moment arms at the two joints differ"
_NECK = (
    "collected range; the relaxed neck is little damped, the stiff one more (Viviani & Berthoz 1975, Biol Cybern 19:19)"
)


def _order(name: str) -> Form:
    """Curvature of a low-pass."""
    return Form(
        name, "", 0.0, 0.0, 0.5, "curvature: 0 of first order, 0.25 of two lags", "0.5 for a Butterworth filter"
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


DECLARATIONS: tuple[Effect, ...] = (
    Effect(
        "passive_damping_ankle",
        "ankle torque + Bpas1 s theta1",
        ("ankle",),
        (Size("Bpas1", "N m s/rad", 0.0, -40.0, 140.0, (11.0, 69.0), "passive damping of the ankle"),),
        lambda model: through(model, "T_Bpas1", Term("ankle", "theta1", ("Bpas1",), 1), "ratio_Bpas1"),
        "lower end: Loram & Lakie 2002 (J Physiol 545:1041); collected range",
        forms=(
            Form("T_Bpas1", "s", 0.0, 0.0, 0.08, "time constant of a spring in series with the damper", _SERIES),
            Form("ratio_Bpas1", "", 0.0, 0.0, 0.2, "damping of the hip relative to the ankle", _RATIO_OF_SIZES),
        ),
    ),
    Effect(
        "passive_damping_hip",
        "hip torque + Bpas2 s theta2",
        ("hip",),
        (Size("Bpas2", "N m s/rad", 0.0, -15.0, 40.0, (3.0, 14.0), "passive damping of the hip"),),
        lambda model: through(model, "T_Bpas2", Term("hip", "theta2", ("Bpas2",), 1)),
        "half to twice 0.05 m g h of the trunk (7 N m s/rad for this body)",
        forms=(Form("T_Bpas2", "s", 0.0, 0.0, 0.08, "time constant of a spring in series with the damper", _SERIES),),
    ),
    Effect(
        "activation_dynamics",
        "active torque x 1 / (T^2 s^2 + 2 zeta T s + 1), T = 1/omega",
        ("ankle", "hip"),
        (Size("Tact", "s", 0.0, 0.0, 0.20, (0.025, 0.107), "time constant of muscle activation, 1/omega"),),
        _activation,
        "omega 9.3-16.8 rad/s and zeta 1-1.3 including excitation, 20-40 rad/s for contraction alone; " + _WHOLE,
        order=2,
        forms=(
            Form(
                "zeta_activation",
                "",
                ACTIVATION_DAMPING,
                0.7,
                1.7,
                "damping ratio of the activation filter of the ankle",
                "around the published 1 to 1.3; from almost second order without overshoot to nearly first order",
            ),
            Form(
                "ratio_activation",
                "",
                1.0,
                0.5,
                1.5,
                "time constant of the hip relative to the ankle",
                "no published value; the range of the time constant within one joint is as wide",
            ),
        ),
    ),
    Effect(
        "force_feedback",
        "active ankle torque / (1 - G / (tau s + 1)), G = Kf K11",
        ("ankle",),
        (Size("Gforce", "", 0.0, -1.5, 4.0, (1.0, 2.0), "loop gain of positive force feedback"),),
        _force_feedback,
        "Kf 0.0018 rad/(N m), tau 15-18 s (Peterka 2003, IEEE Eng Med Biol Mag 22:63)",
        order=2,
        forms=(
            Form(
                "tau_force",
                "s",
                FORCE_TIME_CONSTANT,
                8.0,
                33.0,
                "time constant of force feedback",
                "half to twice the published 15 to 18 s, which are fits of group means",
            ),
            Form("ratio_force", "", 0.0, 0.0, 0.4, "loop gain of the hip relative to the ankle", _SPLIT),
        ),
    ),
    Effect(
        "integral_ankle",
        "ankle torque + Ki1 / s e^{-Td1 s} theta1",
        ("ankle",),
        (Size("Ki1", "N m/(rad s)", 0.0, -100.0, 300.0, (77.0, 134.0), "integral gain of the ankle loop"),),
        _integral("ankle", "theta1", "Ki1", "leak_Ki1", "ratio_Ki1"),
        "Peterka 2002 (J Neurophysiol 88:1097) and later studies",
        forms=(
            Form("leak_Ki1", "1/s", 0.0, 0.0, 0.25, "rate at which the integral is forgotten", _LEAK),
            Form("ratio_Ki1", "", 0.0, 0.0, 0.25, "integral gain of the hip relative to the ankle", _RATIO_OF_SIZES),
        ),
    ),
    Effect(
        "integral_hip",
        "hip torque + Ki2 / s e^{-Td2 s} theta2",
        ("hip",),
        (Size("Ki2", "N m/(rad s)", 0.0, -60.0, 80.0, (15.0, 40.0), "integral gain of the hip loop"),),
        _integral("hip", "theta2", "Ki2", "leak_Ki2"),
        "range of the ankle times K22 / K11",
        forms=(Form("leak_Ki2", "1/s", 0.0, 0.0, 0.25, "rate at which the integral is forgotten", _LEAK),),
    ),
    Effect(
        "acceleration_feedback",
        "ankle torque + Ka1 s^2 e^{-Td1 s} theta1",
        ("ankle",),
        (Size("Ka1", "N m s^2/rad", 0.0, -17.0, 17.0, (6.0, 15.0), "acceleration gain of the ankle loop"),),
        lambda model: through(model, "T_Ka1", Term("ankle", "theta1", ("Ka1",), 2, add.OWN, noisy=True), "ratio_Ka1"),
        "89 N m s^2/rad is published for one segment; with a free hip the loop is unstable above 19 (= 1 / (M^-1)_11)",
        forms=(
            Form("T_Ka1", "s", 0.0, 0.0, 0.05, "time constant of the sensed acceleration", _SENSED),
            Form("ratio_Ka1", "", 0.0, 0.0, 0.4, "acceleration gain of the hip relative to the ankle", _SPLIT),
        ),
    ),
    Effect(
        "trunk_inertia_error",
        "m2 x (1 + eps), which changes A2, J2, C1, C2 and, through L1, A1 and J1",
        ("body",),
        (Size("eps_trunk", "", 0.0, -0.5, 0.8, (0.10, 0.30), "relative error of the trunk's mass", True),),
        lambda model: add.scale_trunk(model, "eps_trunk", "height_eps_trunk"),
        "10-30 %: differences between anthropometric tables (collected range)",
        forms=(
            Form(
                "height_eps_trunk",
                "",
                0.0,
                0.0,
                0.5,
                "relative error of the height of the trunk's centre per relative error of its mass",
                "0 for mass alone, 1/3 for a trunk that is larger in every direction",
            ),
        ),
    ),
    Effect(
        "leg_inertia_error",
        "m1 x (1 + eps), which changes the contribution of the legs to A1 and J1",
        ("body",),
        (Size("eps_leg", "", 0.0, -0.8, 1.5, (0.10, 0.30), "relative error of the legs' mass", True),),
        lambda model: add.scale_legs(model, "eps_leg", "moment_eps_leg"),
        "10-30 %: differences between anthropometric tables (collected range)",
        forms=(
            Form(
                "moment_eps_leg",
                "",
                1.0,
                0.5,
                1.5,
                "relative error of the legs' first moment per relative error of their inertia",
                "1 for mass alone, 1/2 for the place of the mass alone (inertia goes with its square)",
            ),
        ),
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
        lambda model: add.scale_stimulus(model, "eps_stim", "T_eps_stim"),
        "actuator calibration error 10 %",
        order=1,
        forms=(Form("T_eps_stim", "s", 0.0, 0.0, 0.04, "time constant with which the error fades", _ACTUATOR),),
    ),
    Effect(
        "stimulus_delay",
        "stimulus x e^{-s T}",
        ("stimulus",),
        (Size("Tstim", "s", 0.0, -0.05, 0.12, (0.010, 0.040), "delay of the stimulus"),),
        _late_stimulus,
        "actuator and acquisition latency 10-40 ms; a negative value means that the clock of the angles is late",
        order=2,
        forms=(Form("lag_Tstim", "", 0.0, 0.0, 0.5, "time constant of a lag relative to the delay", _ACTUATOR),),
    ),
    Effect(
        "stimulus_lag",
        "stimulus x 1 / (tau s + 1)",
        ("stimulus",),
        (Size("tau_stim", "s", 0.0, 0.0, 0.15, (0.010, 0.040), "time constant of the actuator"),),
        terms_filter(add.is_stimulus, low_pass_of_order("tau_stim", "tau_stim", "q_tau_stim")),
        "actuator bandwidth 4-16 Hz",
        order=2,
        forms=(_order("q_tau_stim"),),
    ),
    Effect(
        "sensor_lag_theta1",
        "measured theta1 = theta1 / (tau s + 1)",
        ("sensor",),
        (Size("tau_theta1", "s", 0.0, 0.0, 0.20, (0.010, 0.050), "lag of the lower-body sensor"),),
        output((0,), "tau_theta1", "q_tau_theta1"),
        "soft tissue and filters, 10-50 ms",
        order=2,
        forms=(_order("q_tau_theta1"),),
    ),
    Effect(
        "sensor_lag_theta2",
        "measured theta2 = theta2 / (tau s + 1)",
        ("sensor",),
        (Size("tau_theta2", "s", 0.0, 0.0, 0.20, (0.010, 0.050), "lag of the hip sensor"),),
        output((1,), "tau_theta2", "q_tau_theta2"),
        "soft tissue and filters, 10-50 ms",
        order=2,
        forms=(_order("q_tau_theta2"),),
    ),
    Effect(
        "sensor_lag_both",
        "both measured angles / (tau s + 1)",
        ("sensor",),
        (Size("tau_sensors", "s", 0.0, 0.0, 0.20, (0.010, 0.050), "lag of both sensors"),),
        _output_both,
        "anti-alias filters, 10-50 ms",
        order=2,
        forms=(
            Form(
                "ratio_sensors",
                "",
                1.0,
                0.7,
                1.3,
                "lag of the hip sensor relative to the other",
                "1 for one filter on both channels; soft tissue differs between segments",
            ),
        ),
    ),
    Effect(
        "head_mode",
        "reaction m s^2 (2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2) of an extra mass on the trunk",
        ("body",),
        (
            Size("m_head", "kg", 0.0, -3.0, 15.0, (4.0, 6.0), "mass of the mode", most=HEAVIEST_HEAD),
            Size("f_head", "Hz", None, 0.8, 6.0, (1.5, 4.0), "resonance frequency of the mode"),
        ),
        lambda model: add.resonant_mass(
            model, "m_head", _resonance("head_mode", "f_head", "zeta_head", detached=False)
        ),
        "head and neck 4-6 kg, 1.5-4 Hz (collected range)",
        family="head_mode",
        forms=(Form("zeta_head", "", RESONANCE_DAMPING, 0.05, 0.4, "damping ratio of the mode", _NECK),),
    ),
    Effect(
        "loose_head",
        "reaction -m s^2 s^2 / (s^2 + 2 zeta w s + w^2) of a part of the trunk's mass that is attached by a spring",
        ("body",),
        (
            Size("m_loose", "kg", 0.0, -3.0, 15.0, (4.0, 6.0), "mass attached by the spring", most=HEAVIEST_HEAD),
            Size("f_loose", "Hz", None, 0.8, 6.0, (1.5, 4.0), "resonance frequency of that mass"),
        ),
        lambda model: add.resonant_mass(
            model, "m_loose", _resonance("loose_head", "f_loose", "zeta_loose", detached=True)
        ),
        "head and neck 4-6 kg, 1.5-4 Hz (collected range)",
        family="head_mode",
        forms=(Form("zeta_loose", "", RESONANCE_DAMPING, 0.05, 0.4, "damping ratio of the mode", _NECK),),
    ),
    Effect(
        "short_latency_reflex",
        "ankle torque + Bsl s e^{-Tsl s} theta1",
        ("ankle",),
        (
            Size("Bsl", "N m s/rad", 0.0, -60.0, 200.0, (20.0, 80.0), "gain of the short-latency stretch reflex"),
            Size("Tsl", "s", None, 0.030, 0.070, (0.040, 0.060), "latency of the short-latency stretch reflex"),
        ),
        _reflex,
        "latency 40-60 ms; gain of the order of magnitude of the passive damping (collected range)",
        forms=(Form("T_Bsl", "s", 0.0, 0.0, 0.03, "time constant of the reflex torque", _SENSED),),
    ),
    Effect(
        "biarticular_coupling",
        "hip torque + Kbi theta1, ankle torque + Kbi theta2",
        ("ankle", "hip"),
        (Size("Kbi", "N m/rad", 0.0, -250.0, 250.0, (30.0, 120.0), "passive cross stiffness", True),),
        terms(
            Term("hip", "theta1", ("Kbi",)),
            Term("ankle", "theta2", ("Kbi", "ratio_Kbi")),
            Term("hip", "theta1", ("Kbi", "T_Kbi"), 1),
            Term("ankle", "theta2", ("Kbi", "T_Kbi"), 1),
        ),
        "collected range for two-joint leg muscles",
        forms=(
            Form("ratio_Kbi", "", 1.0, 0.5, 1.5, "stiffness at the ankle relative to the hip", _ARMS),
            Form("T_Kbi", "s", 0.0, 0.0, 0.08, "damping relative to the stiffness", _SERIES),
        ),
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
        scatters=True,
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
        scatters=True,
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
