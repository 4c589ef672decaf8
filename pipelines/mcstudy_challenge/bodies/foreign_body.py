"""A standing person in nonlinear mechanics, integrated by a multistep method; for the challenge only.

Nothing of the models, effects and simulators that a diagnosis uses is imported here: the equations of motion are
written from the Lagrangian of a chain of rigid segments, and every further mechanism from its own equation. So an error
of the library's rules cannot hide in these recordings. Derived.

The chain has two segments (legs; head, arms and trunk), or three with one that is joined to the trunk. With the angles
phi of the segments from the vertical, v = dphi/dt, the matrix M of inertia of the upright chain and the moments W of
weight,

    T = 1/2 sum M_ij cos(phi_i - phi_j) v_i v_j,        V = sum W_i cos(phi_i),

    sum_j M_ij (cos(phi_i - phi_j) dv_j/dt + sin(phi_i - phi_j) v_j^2) - W_i sin(phi_i) = Q_i,

where Q_1 = ankle torque - hip torque, Q_2 = hip torque - torque of the third joint, Q_3 = torque of the third joint.

Integration: Adams-Bashforth-Moulton of 4th order with fixed step (predict, evaluate, correct, evaluate). Delayed angles
and rates are cubic Lagrange interpolation between stored steps. The person stands at rest before time 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mcstudy.compiling.decorators import compiled

STEPS_PER_SAMPLE = 5
"""Steps of the integration per sample: 1 ms at 200 Hz."""

STATES = 15
"""Number of states: see `_slope`."""

PI, SENSES = 3.141592653589793, 4


class Person(NamedTuple):
    """Constants of one person, SI units and radians; a mechanism is absent where its constant is 0.

    M11, M12, M22, W1, W2: inertia (kg m^2) and moments of weight (N m) of the chain. M13, M23, M33, W3: the same of the
    third segment; joint_k, joint_c: stiffness and damping of its joint. K11 to B22, Kpas1, Kpas2, Td1, Td2: feedback,
    passive stiffness and delays. tissue_ankle, tissue_hip: passive damping, which falls above tissue_rate.
    friction: of the ankle (N m), full above friction_rate. stiffening: of the hip, N m/rad^3. strap: stiffness of a
    muscle over both joints, with strap_arm as its lever at the hip relative to that at the ankle. rise, fall: time
    constants of muscle activation. load_gain, load_time, load_limit: positive feedback of the ankle's torque.
    bias_gain, bias_leak: feedback of the integral of the ankle's angle. reflex_gain, reflex_delay, reflex_lag: stretch
    reflex of the ankle, with reflex_share as its gain in the other direction. motor, motor_damping: angular frequency
    and damping ratio of the stimulus' motor. blind_angle, blind_rate: soft thresholds of what is sensed. fatigue:
    relative change of the active torque over the record. hold: time (s) for which a command is held. delay_swing,
    delay_period: amplitude and period of the ankle's delay. pad_k, pad_c: stiffness and damping of a pad under the
    foot.
    """

    M11: float
    M12: float
    M22: float
    W1: float
    W2: float
    K11: float
    B11: float
    K12: float
    B12: float
    K21: float
    B21: float
    K22: float
    B22: float
    Kpas1: float
    Kpas2: float
    Td1: float
    Td2: float
    M13: float = 0.0
    M23: float = 0.0
    M33: float = 0.0
    W3: float = 0.0
    joint_k: float = 0.0
    joint_c: float = 0.0
    tissue_ankle: float = 0.0
    tissue_hip: float = 0.0
    tissue_rate: float = 1.0
    friction: float = 0.0
    friction_rate: float = 1.0
    stiffening: float = 0.0
    strap: float = 0.0
    strap_arm: float = 1.0
    rise: float = 0.0
    fall: float = 0.0
    load_gain: float = 0.0
    load_time: float = 1.0
    load_limit: float = 1.0
    bias_gain: float = 0.0
    bias_leak: float = 0.0
    reflex_gain: float = 0.0
    reflex_delay: float = 0.05
    reflex_lag: float = 0.01
    reflex_share: float = 1.0
    motor: float = 0.0
    motor_damping: float = 0.7
    blind_angle: float = 0.0
    blind_rate: float = 0.0
    fatigue: float = 0.0
    hold: float = 0.0
    delay_swing: float = 0.0
    delay_period: float = 30.0
    pad_k: float = 0.0
    pad_c: float = 0.0


@compiled
def _tissue(rate: float, damping: float, yields: float) -> float:
    """Torque of soft tissue; its damping falls by a third at six times the rate ``yields``."""
    return damping * rate * (1.0 + (rate / yields) ** 2) ** -0.1


@compiled
def _follow(command: float, state: float, rise: float, fall: float) -> float:
    """Rate of a muscle's activation, faster while its torque grows than while it falls."""
    return (command - state) / (rise if abs(command) > abs(state) else fall)


@compiled
def _accelerate(p: Person, y: np.ndarray, q: np.ndarray, out: np.ndarray) -> None:
    """Angular accelerations out[3:6] of the chain from the states and generalised torques q (3,)."""
    c12, s12 = np.cos(y[0] - y[1]), np.sin(y[0] - y[1])
    r1 = q[0] + p.W1 * np.sin(y[0]) - p.M12 * s12 * y[4] ** 2
    r2 = q[1] + p.W2 * np.sin(y[1]) + p.M12 * s12 * y[3] ** 2
    a, b, d = p.M11, p.M12 * c12, p.M22
    if p.M33 > 0.0:
        c13, s13 = np.cos(y[0] - y[2]), np.sin(y[0] - y[2])
        c23, s23 = np.cos(y[1] - y[2]), np.sin(y[1] - y[2])
        r1 -= p.M13 * s13 * y[5] ** 2
        r2 -= p.M23 * s23 * y[5] ** 2
        r3 = q[2] + p.W3 * np.sin(y[2]) + p.M13 * s13 * y[3] ** 2 + p.M23 * s23 * y[4] ** 2
        e, f = p.M13 * c13, p.M23 * c23
        a, b, d = a - e * e / p.M33, b - e * f / p.M33, d - f * f / p.M33
        r1, r2 = r1 - e * r3 / p.M33, r2 - f * r3 / p.M33
    whole = a * d - b * b
    out[3] = (d * r1 - b * r2) / whole
    out[4] = (a * r2 - b * r1) / whole
    out[5] = 0.0
    if p.M33 > 0.0:
        out[5] = (r3 - e * out[3] - f * out[4]) / p.M33


@compiled
def _slope(p: Person, y: np.ndarray, u: np.ndarray, gain: float, q: np.ndarray, out: np.ndarray) -> None:
    """Derivatives of the states.

    States: 0-2 angles and 3-5 rates of the segments; 6, 7 ankle and 8, 9 hip activation; 10 sensed load; 11 integral of
    the sensed angle; 12 reflex; 13 angle of the pad; 14 motor (its rate is u[5], see `sway`). u: commands of ankle and
    hip, delayed angle, delayed stretch, torque of the motor.
    """
    for i in range(3):
        out[i] = y[3 + i]
    for i in range(6, STATES):
        out[i] = 0.0
    ankle, hip = u[0] + p.bias_gain * y[11], u[1]
    if p.load_gain > 0.0:
        ankle += p.load_gain * p.load_limit * np.tanh(y[10] / p.load_limit)
        out[10] = (ankle - y[10]) / p.load_time
    if p.bias_gain != 0.0:
        out[11] = u[2] - p.bias_leak * y[11]
    if p.rise > 0.0:
        out[6], out[7] = _follow(ankle, y[6], p.rise, p.fall), (y[6] - y[7]) / p.rise
        out[8], out[9] = _follow(hip, y[8], p.rise, p.fall), (y[8] - y[9]) / p.rise
        ankle, hip = y[7], y[9]
    ankle *= gain
    hip *= gain
    if p.reflex_gain != 0.0:
        stretch = u[3] if u[3] > 0.0 else p.reflex_share * u[3]
        out[12] = (stretch - y[12]) / p.reflex_lag
        ankle += p.reflex_gain * y[12]
    joint, bend, rate = y[0] - y[13], y[1] - y[0], y[4] - y[3]
    ankle += p.Kpas1 * joint + _tissue(y[3], p.tissue_ankle, p.tissue_rate)
    ankle += p.friction * np.tanh(y[3] / p.friction_rate) + p.strap * (joint + p.strap_arm * bend)
    hip += p.Kpas2 * bend + p.stiffening * bend**3 + _tissue(rate, p.tissue_hip, p.tissue_rate)
    hip += p.strap * p.strap_arm * (joint + p.strap_arm * bend)
    if p.pad_k > 0.0:  # the foot is pressed against the pad by the ankle's torque
        out[13] = (ankle - p.pad_k * y[13]) / p.pad_c
    third = -p.joint_k * (y[2] - y[1]) - p.joint_c * (y[5] - y[4])
    q[0], q[1], q[2] = u[4] - ankle + hip, -hip - third, third
    _accelerate(p, y, q, out)


@compiled
def _read(record: np.ndarray, at: float, sense: int) -> float:
    """Cubic Lagrange interpolation of a stored signal at a step number; 0 before the record."""
    first = int(np.floor(at)) - 1
    if first < 0:
        return 0.0
    x = at - first
    return (
        -record[first, sense] * (x - 1) * (x - 2) * (x - 3) / 6
        + record[first + 1, sense] * x * (x - 2) * (x - 3) / 2
        - record[first + 2, sense] * x * (x - 1) * (x - 3) / 2
        + record[first + 3, sense] * x * (x - 1) * (x - 2) / 6
    )


@compiled
def _blind(x: float, threshold: float) -> float:
    """What passes a soft threshold: little below it, nearly everything far above it."""
    return x if threshold == 0.0 else x**3 / (x**2 + threshold**2)


@compiled
def _command(p: Person, sensed: np.ndarray, k: int, h: float, u: np.ndarray) -> None:
    """Commands u[0:4] at step ``k`` from what was sensed before."""
    swing = p.delay_swing * np.sin(2 * PI * k * h / p.delay_period)
    for row in range(2):
        at = k - (p.Td1 + swing if row == 0 else p.Td2) / h
        a1, v1 = _blind(_read(sensed, at, 0), p.blind_angle), _blind(_read(sensed, at, 1), p.blind_rate)
        a2, v2 = _blind(_read(sensed, at, 2), p.blind_angle), _blind(_read(sensed, at, 3), p.blind_rate)
        if row == 0:
            u[0], u[2] = p.K11 * a1 + p.B11 * v1 + p.K21 * a2 + p.B21 * v2, a1
        else:
            u[1] = p.K12 * a1 + p.B12 * v1 + p.K22 * a2 + p.B22 * v2
    if p.reflex_gain != 0.0:
        u[3] = _read(sensed, k - p.reflex_delay / h, 1)


@compiled
def sway(p: Person, stimulus: np.ndarray, noise: np.ndarray, h: float) -> np.ndarray:
    """Angles (n, 2) of legs from the vertical and of the hip joint, rad, at every sample.

    ``stimulus`` (n,): torque of the motor's command at the ankle, N m, linear between samples. ``noise`` (m, 4): noise
    of the sensed angle and rate of the legs, then of the hip, at the m = (n - 1) * STEPS_PER_SAMPLE + 1 steps of ``h``
    seconds. A body that falls gives large numbers.
    """
    n, m = stimulus.size, (stimulus.size - 1) * STEPS_PER_SAMPLE + 1
    out, sensed = np.zeros((n, 2)), np.zeros((m, SENSES))
    y, trial, f, u, q = np.zeros(STATES), np.zeros(STATES), np.zeros((5, STATES)), np.zeros(5), np.zeros(3)
    sensed[0] = noise[0]
    held, motor_rate, motor_slope = -1, 0.0, 0.0
    for k in range(1, m):
        sample, part = divmod(k, STEPS_PER_SAMPLE)
        text = stimulus[sample]
        if part:
            text += (stimulus[sample + 1] - stimulus[sample]) * part / STEPS_PER_SAMPLE
        if p.motor > 0.0:  # second order; its torque lags the command, or rings
            motor_rate += h * motor_slope
            y[14] += h * motor_rate
            motor_slope = p.motor**2 * (text - y[14]) - 2 * p.motor_damping * p.motor * motor_rate
            text = y[14]
        u[4] = text
        if p.hold == 0.0 or int(k * h / p.hold) != held:
            held = int(k * h / p.hold) if p.hold > 0.0 else -1
            _command(p, sensed, k, h, u)
        elapsed = k / m
        gain = 1.0 + p.fatigue * ((1.0 - np.exp(-2.0 * elapsed)) / (1.0 - np.exp(-2.0)) - 0.5)
        for i in range(14):
            trial[i] = y[i] + h / 24 * (55 * f[0, i] - 59 * f[1, i] + 37 * f[2, i] - 9 * f[3, i])
        _slope(p, trial, u, gain, q, f[4])
        for i in range(14):
            y[i] += h / 24 * (9 * f[4, i] + 19 * f[0, i] - 5 * f[1, i] + f[2, i])
        for j in range(3, 0, -1):
            f[j] = f[j - 1]
        _slope(p, y, u, gain, q, f[0])
        for i in range(2):
            sensed[k, i] = y[3 * i] + noise[k, i]
            sensed[k, 2 + i] = y[3 * i + 1] - y[3 * i] + noise[k, 2 + i]
        if not part:
            out[sample, 0], out[sample, 1] = y[0], y[1] - y[0]
    return out
