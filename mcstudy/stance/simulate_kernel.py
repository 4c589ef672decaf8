"""Compiled integration of a delayed loop: fixed-step Dormand-Prince of 5th order (all compiled code of the simulator).

The kernel knows no model: it runs the signals, links and filter states of `mcstudy.stance.realize.Realisation`.
Because step and delays are constant, so are the places between stored samples where a stage reads; the caller
passes the interpolation weights (quintic Hermite) per stage and delay.

Coefficients: Dormand & Prince 1980, J Comput Appl Math 6:19, the 5th-order solution.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mcstudy.compiling.decorators import compiled, inner

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


class Loop(NamedTuple):
    """A `Realisation`: R rows, S signals, L links, Z filter states.

    inverse: (R, R), of the leading matrix. order: (R,). signal: (S, 4). current: signals that read what the rows are
    solved for, at the current instant. link: (L, 2), ``to_torques`` of them to torques. The others as there.
    """

    inverse: np.ndarray
    order: np.ndarray
    signal: np.ndarray
    current: np.ndarray
    link: np.ndarray
    to_torques: int
    gain: np.ndarray
    drift: np.ndarray
    head: np.ndarray
    last: np.ndarray
    coefficient: np.ndarray
    torque_of: np.ndarray


class Inputs(NamedTuple):
    """Records, and where stages read them: first sample (6, G) relative to the step, and weights.

    Of the history (R, N, 3), unknowns with rate and acceleration up to the step, they are Hermite weights (6, G, 3, 6)
    of those of order 2, and of the others weights (6, G, 6) of six samples. Of the known records, noise (R, N, 3) and
    stimulus (N, 3), which ``pad`` samples before time 0 precede, they are weights (6, G, 3, 6).
    """

    history: np.ndarray
    back: np.ndarray
    weight: np.ndarray
    first: np.ndarray
    sample_weight: np.ndarray
    input_back: np.ndarray
    input_weight: np.ndarray
    stimulus_weight: np.ndarray
    noise: np.ndarray
    stimulus: np.ndarray
    pad: int


class Limits(NamedTuple):
    """`mcstudy.stance.rules.Rules`: dead zones (2, R) by order and unknown, limits (R,) of the active torques, motor
    noise (N, R) or (0, R), whether gains drift, and the steps of the record.
    """

    dead: np.ndarray
    torque: np.ndarray
    motor: np.ndarray
    drifts: bool
    steps: int


class Scratch(NamedTuple):
    """What a stage computes: signals (S,), passive and active torques (2 R,), of these the active ones within their
    limits (R,), highest derivatives (R,).
    """

    values: np.ndarray
    torques: np.ndarray
    active: np.ndarray
    highest: np.ndarray


@inner
def _read(record: np.ndarray, start: int, weight: np.ndarray) -> float:
    """Weighted sum over (value, rate, acceleration) at two neighbouring samples of one channel (N, 3)."""
    total = 0.0
    for k in range(3):
        total += weight[k] * record[start, k] + weight[3 + k] * record[start + 1, k]
    return total


@inner
def _dead(x: float, threshold: float) -> float:
    if x > threshold:
        return x - threshold
    if x < -threshold:
        return x + threshold
    return 0.0


@inner
def _read_samples(record: np.ndarray, first: int, order: int, weight: np.ndarray) -> float:
    """Weighted sum of a derivative at neighbouring samples of one channel (N, 3), which are zero before time 0."""
    total = 0.0
    for k in range(weight.size):
        if first + k >= 0:
            total += weight[k] * record[first + k, order]
    return total


@inner
def _evaluate_signals(
    step: int, stage: int, y: np.ndarray, loop: Loop, inputs: Inputs, limits: Limits, out: Scratch
) -> None:
    """All signals; those at the current instant of what the rows are solved for without it."""
    n = loop.order.size
    for i in range(loop.signal.shape[0]):
        kind, g, unknown, order = loop.signal[i]
        x = 0.0
        if kind == _STIMULUS:
            start = step + inputs.input_back[stage, g] + inputs.pad
            x = _read(inputs.stimulus, start, inputs.stimulus_weight[stage, g, order])
        else:
            if kind != _NOISE:
                if g == 0:
                    if order < loop.order[unknown]:
                        x = y[n * order + unknown]
                elif loop.order[unknown] < 2:
                    start = step + inputs.first[stage, g]
                    x = _read_samples(inputs.history[unknown], start, order, inputs.sample_weight[stage, g])
                elif step + inputs.back[stage, g] >= 0:
                    x = _read(inputs.history[unknown], step + inputs.back[stage, g], inputs.weight[stage, g, order])
            if kind != _ANGLE:
                start = step + inputs.input_back[stage, g] + inputs.pad
                x += _read(inputs.noise[unknown], start, inputs.input_weight[stage, g, order])
            if kind == _SENSED and order < 2:
                x = _dead(x, limits.dead[order, unknown])
        out.values[i] = x


@inner
def _filter_slopes(y: np.ndarray, slope: np.ndarray, loop: Loop, torques: np.ndarray) -> None:
    """Derivatives of the filter states without their links; their outputs are added to the torques."""
    states = 2 * loop.order.size
    for i in range(loop.head.size):
        s = -loop.coefficient[i] * y[states + loop.head[i]]
        if not loop.last[i]:
            s += y[states + 1 + i]
        slope[states + i] = s
        if loop.torque_of[i] >= 0:
            torques[loop.torque_of[i]] += y[states + i]


@inner
def _add_links(
    first: int, after: int, clock: float, drifts: bool, loop: Loop, values: np.ndarray, out: np.ndarray
) -> None:
    """Add links ``first`` to ``after`` to their destinations."""
    for j in range(first, after):
        value = values[loop.link[j, 0]]
        x = loop.gain[j] * value
        if drifts:
            x += loop.drift[j] * clock * value
        out[loop.link[j, 1]] += x


@inner
def _solve(
    step: int,
    stage: int,
    y: np.ndarray,
    slope: np.ndarray,
    loop: Loop,
    limits: Limits,
    out: Scratch,
) -> None:
    """Highest derivatives from the torques, and the derivatives of the unknowns."""
    n, c = loop.order.size, _C[stage]
    for r in range(n):
        out.active[r] = min(max(out.torques[n + r], -limits.torque[r]), limits.torque[r])
        out.torques[r] = -out.torques[r] - out.active[r]
        if limits.motor.shape[0] > 0:
            motor = limits.motor[step, r]
            out.torques[r] += motor if c == 0.0 else (1.0 - c) * motor + c * limits.motor[step + 1, r]
    for k in range(n):
        total = loop.inverse[k, 0] * out.torques[0]
        for r in range(1, n):
            total += loop.inverse[k, r] * out.torques[r]
        out.highest[k] = total
        slope[k] = total if loop.order[k] == 1 else y[n + k]
        slope[n + k] = total if loop.order[k] == 2 else 0.0


@inner
def _slope(
    step: int,
    stage: int,
    y: np.ndarray,
    slope: np.ndarray,
    loop: Loop,
    inputs: Inputs,
    limits: Limits,
    out: Scratch,
) -> None:
    """Derivative of the state at one stage."""
    clock = (step + _C[stage]) / limits.steps - 0.5
    _evaluate_signals(step, stage, y, loop, inputs, limits, out)
    for r in range(out.torques.size):
        out.torques[r] = 0.0
    _filter_slopes(y, slope, loop, out.torques)
    _add_links(0, loop.to_torques, clock, limits.drifts, loop, out.values, out.torques)
    _solve(step, stage, y, slope, loop, limits, out)
    for i in loop.current:
        kind, _, unknown, order = loop.signal[i]
        x = out.highest[unknown]
        if kind == _SENSED:
            start = step + inputs.input_back[stage, 0] + inputs.pad
            x += _read(inputs.noise[unknown], start, inputs.input_weight[stage, 0, order])
            if order < 2:
                x = _dead(x, limits.dead[order, unknown])
        out.values[i] = x
    _add_links(loop.to_torques, loop.link.shape[0], clock, limits.drifts, loop, out.values, slope)


@inner
def _store(
    step: int, y: np.ndarray, loop: Loop, out: Scratch, history: np.ndarray, states: np.ndarray, torque: np.ndarray
) -> None:
    """Keep what is known of a sample: unknowns, with the derivatives that they have, filter states, active torques."""
    n = loop.order.size
    for c in range(n):
        history[c, step, 0] = y[c]
        history[c, step, 1] = y[n + c]
        history[c, step, loop.order[c]] = out.highest[c]
        torque[step, c] = out.active[c]
    for i in range(states.shape[1]):
        states[step, i] = y[2 * n + i]


@compiled
def integrate(
    h: float, states: np.ndarray, torque: np.ndarray, loop: Loop, inputs: Inputs, limits: Limits, scratch: Scratch
) -> None:
    """Run from rest at sample 0 to the last sample.

    Writes the history of the inputs; states (N, Z), the filter states; torque (N, R), the active torque of each row.
    """
    history = inputs.history
    rows, samples = history.shape[0], history.shape[1]
    n = 2 * rows + states.shape[1]
    y, stage_y, slopes = np.zeros(n), np.zeros(n), np.zeros((6, n))
    for step in range(samples):
        # A literal 0 would be a type of its own: `_slope` would be compiled twice.
        _slope(step, np.int64(0), y, slopes[0], loop, inputs, limits, scratch)
        _store(step, y, loop, scratch, history, states, torque)
        if step == samples - 1:
            break
        for stage in range(1, 6):
            for i in range(n):
                s = 0.0
                for j in range(stage):
                    s += _A[stage, j] * slopes[j, i]
                stage_y[i] = y[i] + h * s
            _slope(step, stage, stage_y, slopes[stage], loop, inputs, limits, scratch)
        for i in range(n):
            s = 0.0
            for j in range(6):
                s += _B[j] * slopes[j, i]
            y[i] += h * s
