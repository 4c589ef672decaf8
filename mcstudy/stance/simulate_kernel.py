"""Compiled integration of a delayed loop: fixed-step Dormand-Prince of 5th order (all compiled code of the simulator).

The kernel knows no model: it runs the signals, links and filter states of `mcstudy.stance.realize.Realisation`.
Because step and delays are constant, so are the places between stored samples where a stage reads; the caller
passes the interpolation weights (quintic Hermite) per stage and delay.

Coefficients: Dormand & Prince 1980, J Comput Appl Math 6:19, the 5th-order solution.
"""

from __future__ import annotations

import numpy as np

from mcstudy.compiling.decorators import compiled

NODES = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0])
"""Stage times of a step, in steps."""

_A = np.array(
    [
        [0, 0, 0, 0, 0],
        [1 / 5, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
    ]
)
_B = np.array([35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84])
_C = NODES
_ANGLE, _SENSED, _STIMULUS, _NOISE = 0, 1, 2, 3  # kinds of signal, as in the realisation


@compiled
def _read(record: np.ndarray, start: int, weight: np.ndarray) -> float:
    """Weighted sum over (value, rate, acceleration) at two neighbouring samples of one channel (N, 3)."""
    total = 0.0
    for k in range(3):
        total += weight[k] * record[start, k] + weight[3 + k] * record[start + 1, k]
    return total


@compiled
def _dead(x: float, threshold: float) -> float:
    if x > threshold:
        return x - threshold
    if x < -threshold:
        return x + threshold
    return 0.0


@compiled
def _slope(
    step: int,
    stage: int,
    y: np.ndarray,
    slope: np.ndarray,
    active: np.ndarray,
    history: np.ndarray,
    loop: tuple,
    inputs: tuple,
    rules: tuple,
) -> None:
    """Derivative of the state at one stage; ``active`` receives the active torque of both rows."""
    inverse, signal, link, gain, drift, head, last, coefficient, torque_of, values = loop
    back, weight, input_back, input_weight, stimulus_weight, noise, stimulus, pad = inputs
    dead, limit, motor, drifts, steps = rules
    for i in range(signal.shape[0]):
        kind, g, angle, order = signal[i]
        x = 0.0
        if kind == _STIMULUS:
            x = _read(stimulus, step + input_back[stage, g] + pad, stimulus_weight[stage, g, order])
        else:
            if kind != _NOISE:
                if g == 0:
                    x = y[2 * order + angle]
                elif step + back[stage, g] >= 0:
                    x = _read(history[angle], step + back[stage, g], weight[stage, g, order])
            if kind != _ANGLE:
                x += _read(noise[angle], step + input_back[stage, g] + pad, input_weight[stage, g, order])
            if kind == _SENSED and order < 2:
                x = _dead(x, dead[order, angle])
        values[i] = x
    clock = (step + _C[stage]) / steps - 0.5
    passive0, passive1, active0, active1 = 0.0, 0.0, 0.0, 0.0
    for i in range(head.size):
        s = -coefficient[i] * y[4 + head[i]]
        if not last[i]:
            s += y[5 + i]
        slope[4 + i] = s
        to = torque_of[i]
        if to == 0:
            passive0 += y[4 + i]
        elif to == 1:
            passive1 += y[4 + i]
        elif to == 2:
            active0 += y[4 + i]
        elif to == 3:
            active1 += y[4 + i]
    for j in range(link.shape[0]):
        x = gain[j] * values[link[j, 0]]
        if drifts:
            x += drift[j] * clock * values[link[j, 0]]
        to = link[j, 1]
        if to == 0:
            passive0 += x
        elif to == 1:
            passive1 += x
        elif to == 2:
            active0 += x
        elif to == 3:
            active1 += x
        else:
            slope[to] += x
    active[0] = min(max(active0, -limit[0]), limit[0])
    active[1] = min(max(active1, -limit[1]), limit[1])
    torque0, torque1 = -passive0 - active[0], -passive1 - active[1]
    if motor.shape[0] > 0:
        c = _C[stage]
        torque0 += motor[step, 0] if c == 0.0 else (1.0 - c) * motor[step, 0] + c * motor[step + 1, 0]
        torque1 += motor[step, 1] if c == 0.0 else (1.0 - c) * motor[step, 1] + c * motor[step + 1, 1]
    slope[0], slope[1] = y[2], y[3]
    slope[2] = inverse[0, 0] * torque0 + inverse[0, 1] * torque1
    slope[3] = inverse[1, 0] * torque0 + inverse[1, 1] * torque1


@compiled
def integrate(
    h: float,
    history: np.ndarray,
    states: np.ndarray,
    torque: np.ndarray,
    loop: tuple,
    inputs: tuple,
    rules: tuple,
) -> None:
    """Run from rest at sample 0 to the last sample.

    Writes history (2, N, 3), the angles with rate and acceleration; states (N, Z), the filter states; torque (N, 2),
    the active torque of each row. The tuples: loop - inverse mass, signal, link, gain, drift, head, last,
    coefficient, torque_of, scratch (S,); inputs - first sample and weights per stage and delay for the history, the
    noise and the stimulus, noise (2, N, 3), stimulus (N, 3), their samples before time zero; rules - dead zones
    (order, angle), limits, motor noise, whether gains drift, steps of the record.
    """
    samples, n = history.shape[1], 4 + states.shape[1]
    y, stage_y, slopes, scratch = np.zeros(n), np.zeros(n), np.zeros((6, n)), np.zeros(2)
    for step in range(samples):
        # A literal 0 would be a type of its own: `_slope` would be compiled twice.
        _slope(step, np.int64(0), y, slopes[0], torque[step], history, loop, inputs, rules)
        for c in range(2):
            history[c, step, 0] = y[c]
            history[c, step, 1] = y[2 + c]
            history[c, step, 2] = slopes[0, 2 + c]
        for i in range(n - 4):
            states[step, i] = y[4 + i]
        if step == samples - 1:
            break
        for stage in range(1, 6):
            for i in range(n):
                s = 0.0
                for j in range(stage):
                    s += _A[stage, j] * slopes[j, i]
                stage_y[i] = y[i] + h * s
            _slope(step, stage, stage_y, slopes[stage], scratch, history, loop, inputs, rules)
        for i in range(n):
            s = 0.0
            for j in range(6):
                s += _B[j] * slopes[j, i]
            y[i] += h * s
