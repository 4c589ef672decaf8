"""Sway in the time domain: the loop integrated from rest with true delays.

Fixed-step Dormand-Prince of 5th order at the sampling rate (the paper's route: Goodworth & Peterka 2018, Methods) on
`mcstudy.stance.realize.Realisation`, that is on the same term table as the closed form; the only simulator that can
carry the nonlinear and time-varying rules of `mcstudy.stance.rules`.

Between samples:

* delayed angles are read from the stored angle, rate and acceleration by quintic Hermite interpolation (error h^6 in
  the angle, h^5 in the rate, h^4 in a delayed acceleration);
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
from mcstudy.stance.feedback import Model, require_plain
from mcstudy.stance.realize import ACTIVE, ANGLE, SENSED, STIMULUS, Realisation, realise
from mcstudy.stance.rules import LINEAR, Rules, tilt_at_threshold
from mcstudy.stance.simulate_kernel import NODES, integrate

STABLE_STEP = 3.0
"""Largest step * |pole| of a filter: the real stability limit of the method is 3.3."""


@dataclass(frozen=True, slots=True)
class Sway:
    """A simulated record of n samples; angles are the model's (theta1, theta2).

    Attributes
    ----------
    theta: (n, 2) measured angles, rad (output filters on).
    angle, rate, acceleration: (n, 2) the true angles and their derivatives, rad, rad/s, rad/s^2.
    active_torque: (n, 2) active feedback torque by row (hip, ankle), N m, with the sign of the model's left side (it
        opposes the angle when positive gains act).
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
    noise: (n, 2) sensor noise on (theta1, theta2), rad; None for none.
    rules: nonlinear and time-varying rules.
    substeps: steps per sample.

    An unstable loop grows without bound; the record then holds very large numbers, infinities or NaN.

    Raises
    ------
    ModelError: shapes that do not fit; a delay of sensed motion shorter than a step; a filter too fast for the step;
        a stimulus term that needs derivatives that were not given; whatever `realise` raises.
    """
    stimulus = np.asarray(stimulus, dtype=float)
    require_plain(model, "a simulation in time")
    n = stimulus.shape[0] if stimulus.ndim else 0
    if n < 2 or stimulus.shape not in ((n,), (n, 3)):
        raise ModelError(f"stimulus: expected shape (n,) or (n, 3) with n >= 2, got {stimulus.shape}")
    for name, record in (("noise", noise), ("motor_noise", rules.motor_noise)):
        if record is not None and np.shape(record) != (n, 2):
            raise ModelError(f"{name}: expected shape ({n}, 2) as the stimulus has, got {np.shape(record)}")
    if substeps < 1:
        raise ModelError(f"substeps: expected a whole number >= 1, got {substeps}")
    tilt = tilt_at_threshold(model, rules)
    loop = realise(model, theta, entries=~tilt, scale=_scale(model, rules), drift=_drift(model, rules))
    h = 1.0 / (rate_hz * substeps)
    _check(model, loop, rules, h, stimulus.ndim == 2, bool(tilt.any()))
    lags = np.ceil(loop.delay.max() / h).astype(int) + 1
    fine_noise = _refined_noise(noise, n, rate_hz, substeps, lags)
    fine_stimulus = _refined_stimulus(stimulus, h, substeps, lags)
    if tilt.any():
        fine_noise[0] -= float(np.asarray(theta)[model.names.index(model.weights[0])]) * fine_stimulus
    motor = np.empty((0, 2)) if rules.motor_noise is None else _linear(np.asarray(rules.motor_noise, float), substeps)
    samples = (n - 1) * substeps + 1
    history, torque = np.zeros((2, samples, 3)), np.zeros((samples, 2))
    states = np.zeros((samples, loop.head.size))
    integrate(
        h,
        history,
        states,
        torque,
        (
            np.linalg.inv(loop.mass),
            loop.signal,
            loop.link,
            loop.gain,
            loop.drift,
            loop.head,
            loop.last,
            loop.coefficient,
            loop.torque_of,
            np.zeros(len(loop.signal)),
        ),
        (
            *_places(loop.delay, h, known=False),
            *_places(loop.delay, h, known=True),
            _places(loop.delay, h, known=True, linear=stimulus.ndim == 1)[1],
            fine_noise,
            fine_stimulus,
            lags,
        ),
        (
            np.array([rules.dead_angle, rules.dead_rate], dtype=float),
            np.array(rules.torque_limit, dtype=float),
            motor,
            bool(loop.drift.any()),
            samples - 1,
        ),
    )
    history, states = history[:, ::substeps], states[::substeps]
    measured = np.einsum("cnk,ck->nc", history, loop.output[:, :3])
    for c in (0, 1):
        if loop.output[c, 3] >= 0:
            measured[:, c] += states[:, int(loop.output[c, 3])]
    angle, rate, acceleration = np.ascontiguousarray(np.transpose(history, (2, 1, 0)))
    return Sway(measured, angle, rate, acceleration, torque[::substeps])


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


def _check(model: Model, loop: Realisation, rules: Rules, h: float, derivatives: bool, tilt: bool) -> None:
    kind, group, _, order = loop.signal.T
    reading = np.isin(kind, (ANGLE, SENSED)) & (group > 0)
    if reading.any() and loop.delay[group[reading]].min() < h * (1 - 1e-9):
        raise ModelError(
            f"model {model.name}: a delay of {loop.delay[group[reading]].min():.3g} s is shorter than the step of "
            f"{h:.3g} s; raise the rate or the substeps"
        )
    if loop.fastest_pole * h > STABLE_STEP:
        raise ModelError(
            f"model {model.name}: a filter with a pole at {loop.fastest_pole:.3g} 1/s is too fast for the step of "
            f"{h:.3g} s; raise the rate or the substeps"
        )
    if not derivatives and (tilt or ((kind == STIMULUS) & (order > 0)).any()):
        raise ModelError(
            f"model {model.name}: it senses derivatives of the stimulus; give the stimulus as (n, 3) samples of value, "
            "first and second derivative"
        )
    for row in np.flatnonzero(np.isfinite(rules.torque_limit)):
        undelayed = (model.table.group_delay[model.table.entry[:, 2], 0] < 0) & (model.table.entry[:, 1] == 2)
        if (undelayed & model.table.noisy & (model.table.entry[:, 0] == row)).any():
            raise ModelError(
                f"rules torque_limit: the active {model.rows[row]} torque of model {model.name} holds undelayed "
                "acceleration, which cannot be limited"
            )
        if not np.isin(loop.link[:, 1], (ACTIVE + row,)).any() and not (loop.torque_of == ACTIVE + row).any():
            raise ModelError(f"rules torque_limit: model {model.name} has no active {model.rows[row]} torque")


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


def _refined_noise(noise: np.ndarray | None, n: int, rate_hz: float, substeps: int, lags: int) -> np.ndarray:
    """Noise with derivatives (2, lags + samples + 1, 3) on the fine grid, its end in front of its beginning."""
    if noise is None:
        return np.zeros((2, lags + (n - 1) * substeps + 2, 3))
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
