"""Sway in the time domain: the loop integrated from rest with true delays.

Fixed-step Dormand-Prince of 5th order at the sampling rate (the paper's route: Goodworth & Peterka 2018, Methods) on
`mcstudy.stance.realize.Realisation`, that is on the same term table as the closed form; the only simulator that can
carry the nonlinear and time-varying rules of `mcstudy.stance.rules`.

Between samples:

* delayed angles are read from the stored angle, rate and acceleration by quintic Hermite interpolation (error h^6 in
  the angle, h^5 in the rate, h^4 in a delayed acceleration); delayed unknowns without inertia, which have no
  acceleration, from six samples by Lagrange's interpolation (h^6);
* a stimulus given as samples (n,) is linear between them, which is exact for a PRTS torque; before time 0 it is
  zero. A stimulus whose rate or acceleration the model senses (platform translation, tilt) must be given with its
  derivatives, (n, 3), and is then quintic Hermite; `with_derivatives` makes them for a band-limited periodic record;
* sensor noise is taken as one period of a band-limited record: its rate and acceleration, which order-1 and order-2
  terms sense, are its exact derivatives (the closed form's s * n), and its values before time 0 those of its end.

The kinks of a PRTS fall on samples, but a delay that is not a whole number of steps carries them into the middle of a
step, where they limit the order to three; on smooth inputs the order is five.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import fft

from mcstudy.errors import ModelError
from mcstudy.stance.feedback import Model
from mcstudy.stance.realize import ANGLE, NOISE, SENSED, STIMULUS, Realisation, realise
from mcstudy.stance.rules import LINEAR, Rules, tilt_at_threshold
from mcstudy.stance.simulate_kernel import NODES, Inputs, Limits, Loop, Scratch, integrate

STABLE_STEP = 3.0
"""Largest step * |pole| of a filter: the real stability limit of the method is 3.3."""


@dataclass(frozen=True, slots=True)
class Sway:
    """A simulated record of n samples of a model with R rows and Y outputs.

    Attributes
    ----------
    theta: (n, Y) the outputs as measured: the angles, rad, with the sensors' filters, or the declared outputs.
    angle, rate, acceleration: (n, R) the true angles and their derivatives, rad, rad/s, rad/s^2; zero where an unknown
        has no such derivative, for want of inertia.
    active_torque: (n, R) active feedback torque by row, N m, with the sign of the model's left side (it opposes the
        angle when positive gains act).
    """

    theta: np.ndarray
    angle: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray
    active_torque: np.ndarray


def simulate(
    model: Model,
    theta: np.ndarray,
    stimulus: np.ndarray,
    rate_hz: float,
    *,
    noise: np.ndarray | None = None,
    rules: Rules = LINEAR,
    substeps: int = 1,
) -> Sway:
    """Sway evoked by a stimulus and sensor noise from rest.

    Parameters
    ----------
    theta: (P,) parameters.
    stimulus: (n,) samples in the model's stimulus unit, or (n, 3) with first and second derivative.
    rate_hz: sampling rate.
    noise: (n, R) sensor noise on the angles, rad; None for none.
    rules: nonlinear and time-varying rules.
    substeps: steps per sample.

    An unstable loop grows without bound; the record then holds very large numbers, infinities or NaN.

    Raises
    ------
    ModelError: shapes that do not fit; a delay of sensed motion shorter than a step; a filter too fast for the step;
        a stimulus term that needs derivatives that were not given; whatever `realise` raises.
    """
    stimulus = np.asarray(stimulus, dtype=float)
    n = stimulus.shape[0] if stimulus.ndim else 0
    if n < 2 or stimulus.shape not in ((n,), (n, 3)):
        raise ModelError(f"stimulus: expected shape (n,) or (n, 3) with n >= 2, got {stimulus.shape}")
    R = model.n_rows
    for name, record in (("noise", noise), ("motor_noise", rules.motor_noise)):
        if record is not None and np.shape(record) != (n, R):
            raise ModelError(f"{name}: expected shape ({n}, {R}) as the stimulus has, got {np.shape(record)}")
    if substeps < 1:
        raise ModelError(f"substeps: expected a whole number >= 1, got {substeps}")
    tilt = tilt_at_threshold(model, rules)
    loop = realise(model, theta, entries=~tilt, scale=_scale(model, rules), drift=_drift(model, rules))
    h = 1.0 / (rate_hz * substeps)
    samples = (n - 1) * substeps + 1
    limits = _limits(model, rules, bool(loop.drift.any()), substeps, samples - 1)
    _check(model, loop, limits, h, stimulus.ndim == 2, bool(tilt.any()))
    inputs = _inputs(loop, noise, stimulus, rate_hz, substeps)
    if tilt.any():
        inputs.noise[0] -= float(np.asarray(theta)[model.names.index(model.weights[0])]) * inputs.stimulus
    states, torque = np.zeros((samples, loop.head.size)), np.zeros((samples, R))
    scratch = Scratch(np.zeros(len(loop.signal)), np.zeros(2 * R), np.zeros(R), np.zeros(R))
    integrate(h, states, torque, _kernel_loop(loop), inputs, limits, scratch)
    history, states = inputs.history[:, ::substeps], states[::substeps]
    measured = np.zeros((n, model.n_outputs))
    for part in loop.readings:
        if part.order < 0:
            record = states[:, part.unknown]
        elif part.unknown < R:
            record = history[part.unknown, :, part.order]
        else:
            record = inputs.stimulus[inputs.pad : inputs.pad + samples : substeps, part.order]
        measured[:, part.output] += part.coefficient * record
    angle, rate, acceleration = np.ascontiguousarray(np.transpose(history, (2, 1, 0)))
    return Sway(measured, angle, rate, acceleration, torque[::substeps])


def _kernel_loop(loop: Realisation) -> Loop:
    """The loop as the kernel takes it."""
    kind, group, unknown, order = loop.signal.T
    current = np.isin(kind, (ANGLE, SENSED)) & (group == 0) & (order == loop.order[unknown])
    to_torques = int((loop.link[:, 1] < 2 * loop.order.size).sum())
    links = loop.link, to_torques, loop.gain, loop.drift
    filters = loop.head, loop.last, loop.coefficient, loop.torque_of
    return Loop(np.linalg.inv(loop.leading), loop.order, loop.signal, np.flatnonzero(current), *links, *filters)


def _inputs(loop: Realisation, noise: np.ndarray | None, stimulus: np.ndarray, rate_hz: float, substeps: int) -> Inputs:
    """Noise and stimulus on the fine grid, and where stages read them and the history."""
    h, n = 1.0 / (rate_hz * substeps), len(stimulus)
    pad = int(np.ceil(loop.delay.max() / h)) + 1
    back, weight = _places(loop.delay, h, known=False)
    input_back, input_weight = _places(loop.delay, h, known=True)
    stimulus_weight = _places(loop.delay, h, known=True, linear=stimulus.ndim == 1)[1]
    return Inputs(
        np.zeros((loop.order.size, (n - 1) * substeps + 1, 3)),
        back,
        weight,
        *_samples_around(loop.delay, h),
        input_back,
        input_weight,
        stimulus_weight,
        _refined_noise(noise, (loop.order.size, n), rate_hz, substeps, pad),
        _refined_stimulus(stimulus, h, substeps, pad),
        pad,
    )


def _limits(model: Model, rules: Rules, drifts: bool, substeps: int, steps: int) -> Limits:
    """The rules as the kernel takes them."""
    R = model.n_rows

    def each(name: str, default: float) -> np.ndarray:
        given = getattr(rules, name)
        if given and len(given) != R:
            raise ModelError(f"rules {name}: expected {R} numbers, one for each angle or row, got {given!r}")
        return np.array(given or [default] * R, dtype=float)

    dead = np.stack([each("dead_angle", 0.0), each("dead_rate", 0.0)])
    motor = np.empty((0, R)) if rules.motor_noise is None else _linear(np.asarray(rules.motor_noise, float), substeps)
    return Limits(dead, each("torque_limit", np.inf), motor, drifts, steps)


def with_derivatives(signal: np.ndarray, rate_hz: float) -> np.ndarray:
    """A band-limited periodic record (n, ...) with its first two derivatives on a new last axis, (n, ..., 3).

    Exact for a record that is one period of a signal without power at or above half the rate.
    """
    signal = np.asarray(signal, dtype=float)
    return _band_limited(signal, rate_hz, 1)


def _band_limited(signal: np.ndarray, rate_hz: float, substeps: int) -> np.ndarray:
    """Values and two derivatives of a periodic band-limited record on a grid ``substeps`` times finer."""
    n = signal.shape[0]
    spectrum = fft.rfft(signal, axis=0)
    s = 2j * np.pi * np.arange(spectrum.shape[0]) * (rate_hz / n)
    s = s.reshape(-1, *[1] * (signal.ndim - 1))
    out = np.empty((n * substeps, *signal.shape[1:], 3))
    for k in range(3):
        lines = spectrum * s**k
        if n % 2 == 0 and (k == 1 or substeps > 1):
            # A Nyquist line has no derivative on its own grid, and is half a pair of lines on a finer one.
            lines[-1] *= 0.0 if k == 1 else 0.5
        out[..., k] = fft.irfft(lines, n * substeps, axis=0) * substeps
    if substeps == 1:
        out[..., 0] = signal
    return out


def _scale(model: Model, rules: Rules) -> np.ndarray:
    return np.where(model.table.noisy, rules.active_gain, 1.0)


def _drift(model: Model, rules: Rules) -> np.ndarray:
    """Relative drift of every entry of the table, the sum over its gains."""
    drift = np.zeros(len(model.table.entry))
    for name, change in rules.gain_drift.items():
        if name not in model.names:
            raise ModelError(f"rules gain_drift: unknown parameter {name!r}; the model has {', '.join(model.names)}")
        uses = (model.table.entry[:, 3:] == model.names.index(name)).any(axis=1)
        if not uses.any():
            raise ModelError(f"rules gain_drift: {name} is not the gain of a term")
        drift[uses] += change
    return drift * _scale(model, rules)


def _check(model: Model, loop: Realisation, limits: Limits, h: float, derivatives: bool, tilt: bool) -> None:
    kind, group, unknown, order = loop.signal.T
    reading = np.isin(kind, (ANGLE, SENSED)) & (group > 0)
    if reading.any() and loop.delay[group[reading]].min() < h * (1 - 1e-9):
        raise ModelError(
            f"model {model.name}: a delay of {loop.delay[group[reading]].min():.3g} s is shorter than the step of "
            f"{h:.3g} s; raise the rate or the substeps"
        )
    if loop.fastest_pole * h > STABLE_STEP:
        raise ModelError(
            f"model {model.name}: a filter or a row with a pole at {loop.fastest_pole:.3g} 1/s is too fast for the "
            f"step of {h:.3g} s; raise the rate or the substeps"
        )
    read = max((part.order for part in loop.readings if part.unknown == model.n_rows), default=0)
    if not derivatives and (tilt or read > 0 or ((kind == STIMULUS) & (order > 0)).any()):
        raise ModelError(
            f"model {model.name}: it senses derivatives of the stimulus; give the stimulus as (n, 3) samples of value, "
            "first and second derivative"
        )
    # Only noise is left where an undelayed active term of the highest order became part of the leading matrix.
    solved = (kind == NOISE) & (order == loop.order[unknown])
    if (limits.dead[order[solved & (order < 2)], unknown[solved & (order < 2)]] > 0).any():
        raise ModelError(
            f"rules dead_angle: undelayed active feedback of an unknown without inertia, as in model {model.name}, "
            "cannot have a threshold"
        )
    for row in np.flatnonzero(np.isfinite(limits.torque)):
        mine = loop.link[:, 1] == model.n_rows + row
        if solved[loop.link[mine, 0]].any():
            raise ModelError(
                f"rules torque_limit: the active {model.rows[row]} torque of model {model.name} holds undelayed "
                "feedback of the highest order, which cannot be limited"
            )
        if not mine.any() and not (loop.torque_of == model.n_rows + row).any():
            raise ModelError(f"rules torque_limit: model {model.name} has no active {model.rows[row]} torque")


def _samples_around(delay: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """First of six samples around stage times minus delays, (6, G) relative to the step, and weights (6, G, 6).

    No sample is later than the step, nor, where the step itself is computed, than the one before.
    """
    first, weight = np.zeros((NODES.size, delay.size), dtype=np.int64), np.zeros((NODES.size, delay.size, 6))
    for stage, g in np.ndindex(*first.shape):
        x = NODES[stage] - delay[g] / h
        first[stage, g] = min(int(np.floor(x)) - 2, -5 if stage else -6)
        at = first[stage, g] + np.arange(6)
        for k in range(6):
            others = np.delete(at, k)
            weight[stage, g, k] = np.prod((x - others) / (at[k] - others))
    return first, weight


def _places(delay: np.ndarray, h: float, *, known: bool, linear: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Where stage times minus delays fall: first sample (6, G), relative to the step, and weights (6, G, 3, 6).

    ``known`` records (noise, stimulus) may be read ahead of the step's start; the history may not, so that a stage
    that falls on a sample reads the interval that ends there.
    """
    back = np.zeros((NODES.size, delay.size), dtype=np.int64)
    weight = np.zeros((NODES.size, delay.size, 3, 6))
    for stage, g in np.ndindex(*back.shape):
        x = float(NODES[stage] - delay[g] / h)
        if abs(x - round(x)) < 1e-9:
            x = float(round(x))
        back[stage, g] = np.floor(x) if known and x <= 0 else np.ceil(x) - 1
        fraction = x - float(back[stage, g])
        weight[stage, g] = _linear_weights(fraction) if linear else _hermite_weights(fraction, h)
    return back, weight


def _linear_weights(x: float) -> np.ndarray:
    weights = np.zeros((3, 6))
    weights[0, [0, 3]] = 1.0 - x, x
    return weights


@lru_cache(maxsize=1024)  # trials, iterations and both kinds of records ask for the same places
def _hermite_weights(x: float, h: float) -> np.ndarray:
    """Quintic Hermite at x in [0, 1]: weights (derivative, (value, rate, acceleration) at both ends), read-only."""
    powers = np.arange(6)

    def row(at: float, k: int) -> np.ndarray:
        """k-th derivative of the monomials, times the step."""
        factor = np.array([np.prod(np.arange(p, p - k, -1.0)) for p in powers])
        return factor * at ** np.maximum(powers - k, 0) / h**k

    conditions = np.array([row(end, k) for end in (0.0, 1.0) for k in range(3)])
    weights = np.array([np.linalg.solve(conditions.T, row(x, k)) for k in range(3)])
    weights.setflags(write=False)
    return weights


def _linear(samples: np.ndarray, substeps: int) -> np.ndarray:
    """Samples (n, ...) on a grid ``substeps`` times finer, linear in between."""
    if substeps == 1:
        return samples
    fine = np.arange((samples.shape[0] - 1) * substeps + 1) / substeps
    coarse = np.arange(samples.shape[0])
    flat = samples.reshape(samples.shape[0], -1)
    return np.stack([np.interp(fine, coarse, column) for column in flat.T], axis=1).reshape(-1, *samples.shape[1:])


def _refined_noise(
    noise: np.ndarray | None, shape: tuple[int, int], rate_hz: float, substeps: int, lags: int
) -> np.ndarray:
    """Noise with derivatives (R, lags + samples + 1, 3) on the fine grid, its end in front of its beginning.

    ``shape``: R, and the number n of samples.
    """
    rows, n = shape
    if noise is None:
        return np.zeros((rows, lags + (n - 1) * substeps + 2, 3))
    fine = _band_limited(np.asarray(noise, dtype=float), rate_hz, substeps)
    at = np.arange(-lags, (n - 1) * substeps + 2) % fine.shape[0]
    return np.ascontiguousarray(np.swapaxes(fine[at], 0, 1))


def _refined_stimulus(stimulus: np.ndarray, h: float, substeps: int, lags: int) -> np.ndarray:
    """Stimulus (lags + samples + 1, 3) on the fine grid: zero before time 0, held after the end."""
    if stimulus.ndim == 1:
        fine = np.zeros(((stimulus.size - 1) * substeps + 1, 3))
        fine[:, 0] = _linear(stimulus, substeps)
    else:
        fine = np.empty(((len(stimulus) - 1) * substeps + 1, 3))
        fine[::substeps] = stimulus
        for j in range(1, substeps):
            weights = _hermite_weights(j / substeps, h * substeps)
            fine[j::substeps] = stimulus[:-1] @ weights[:, :3].T + stimulus[1:] @ weights[:, 3:].T
    return np.concatenate([np.zeros((lags, 3)), fine, fine[-1:]])
