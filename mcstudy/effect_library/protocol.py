"""Recordings from the time-domain simulator: any model, any effects, from rest and with sensor noise.

The simulator does not use the closed form that is fitted. Every trial has its own random streams, so a recording with
more trials begins with the same trials.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import fft

from mcstudy.effect_library import library
from mcstudy.effect_library.effect import TrialSetting
from mcstudy.errors import FallsError, InputError
from mcstudy.recordings.checks import LARGEST_SWAY
from mcstudy.recordings.recording import AMPLITUDE, ANY_AMPLITUDE, RATE_HZ, Recording, Trial, refuse_size
from mcstudy.stance.body import STIMULI, TORQUES, Body, standing, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.line_stimulus import LineStimulus, Stimulus
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.realize import realise
from mcstudy.stance.rules import Rules
from mcstudy.stance.simulate_time import Sway, simulate, with_derivatives
from mcstudy.stance.stability import growth_rate
from mcstudy.stance.stimulus import Prts

PLATFORM_HZ = 6.0
"""Corner frequency, Hz, of the fourth-order zero-phase low-pass that smooths the motion of a platform or a scene."""

LARGEST_SIZE = 1e6
"""Largest size of an effect; a larger one is an error in any unit."""

COMFORTABLE_STEP = 2.5
"""Largest step * |pole| of a filter without substeps; the limit of the method is 3.3."""

MOST_SUBSTEPS = 1000
"""Most steps of the simulation per sample; a lag that needs more is unrealistically short."""

Torque = Callable[[Sway, float], np.ndarray]
"""(sway, rate in Hz) -> additional torque (n, 2) by row (hip, ankle) in N m, on the side of the stimulus."""

Distortion = Callable[[np.ndarray, float], np.ndarray]
"""(measured angles (n, 2), rate in Hz) -> what is recorded (n, 2)."""

Rule = Callable[[TrialSetting], Mapping[str, Any]]
"""(trial) -> fields of `mcstudy.stance.rules.Rules`."""


@dataclass(frozen=True)
class Protocol:
    """How a recording is made.

    Attributes
    ----------
    stimulus: kind of stimulus; "" for a declared model, whose stimulus has none.
    waveform: one period; its rate is the recording's, its convention is recorded.
    amplitudes: per trial, in the stimulus' unit and the waveform's convention.
    cycles: periods per trial. periodic: when False every trial has its own random waveform of the same length,
        spectrum and amplitude that never repeats.
    noise: sensor noise inside the loop. measurement_sd: of white noise on a sample of each output, outside the loop, or
        one for all, in the unit of the output; none when empty.
    """

    stimulus: str = "ankle_torque"
    waveform: Stimulus = field(default_factory=Prts)
    amplitudes: tuple[float, ...] = (5.0, 5.0)
    cycles: int = 6
    periodic: bool = True
    noise: SensorNoise = field(default_factory=SensorNoise)
    measurement_sd: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.stimulus and self.stimulus not in STIMULI:
            raise InputError(f"stimulus: expected one of {', '.join(STIMULI)}, got {self.stimulus!r}")
        if not self.amplitudes:
            raise InputError("amplitudes: expected at least one number, got none")
        allowed = AMPLITUDE[STIMULI[self.stimulus]] if self.stimulus else ANY_AMPLITUDE
        for amplitude in self.amplitudes:
            if fault := allowed.fault(amplitude):
                raise InputError(f"amplitudes: {fault}")
        if fault := RATE_HZ.fault(self.waveform.rate_hz):
            raise InputError(f"rate_hz: {fault}")
        if self.cycles < 1:
            raise InputError(f"cycles: expected at least 1, got {self.cycles}")
        refuse_size(len(self.amplitudes), len(self.amplitudes) * self.cycles * self.waveform.samples, "protocol")


def simulate_recording(
    protocol: Protocol,
    theta: np.ndarray,
    rng: np.random.Generator,
    *,
    effects: Sequence[str] = (),
    sizes: Mapping[str, float] | None = None,
    model: Model | None = None,
    body: Body | None = None,
    torque: Torque | None = None,
    measure: Distortion | None = None,
    rule: Rule | None = None,
    name: str = "simulated",
    provenance: str = "mcstudy simulate",
) -> Recording:
    """A recording of a body that follows the model plus effects.

    Parameters
    ----------
    theta: parameters of ``model`` without effects, (P,).
    effects: names from the library. sizes: a value for every parameter they add; shape parameters default to the
        middle of their range.
    model: `two_segment` of ``body`` when None; its outputs are recorded if it is a declared one.
    body: what the recording states as the body.
    torque: a torque that depends on the sway itself (solved by iteration); measure: a distortion of the recorded
        angles; rule: fields of `Rules` by trial, in place of those of ``effects``. All three are for effects outside
        the library.

    Raises `InputError` for an effect without a size, `FallsError` for a body that is unstable
    or falls in the simulation (an angle exceeds `LARGEST_SWAY`).
    """
    body, declared = body or Body(), model if model is not None and not standing(model) else None
    base = model or two_segment(body, protocol.stimulus)
    acting = [library.effect(n, library.library_of(base)) for n in effects]
    model, theta = body_with_effects(base, theta, effects, sizes or {})
    reference = float(np.exp(np.mean(np.log(protocol.amplitudes))))
    trials = []
    for amplitude, stream in zip(protocol.amplitudes, rng.spawn(len(protocol.amplitudes)), strict=True):
        noise_stream, rule_stream, stimulus_stream = stream.spawn(3)
        stimulus = _stimulus(protocol, amplitude, stimulus_stream, model.senses_motion)
        n, rate = stimulus.shape[0], protocol.waveform.rate_hz
        setting = TrialSetting(model, amplitude, reference, n, rate, rule_stream)
        rules = library.rules(acting, dict(sizes or {}), setting) if rule is None else Rules(**rule(setting))
        noise = protocol.noise.sample(noise_stream, n, rate)
        sway = _with_torque(model, theta, stimulus, rate, noise, rules, torque)
        if not np.abs(sway.theta).max() < (LARGEST_SWAY if declared is None else np.inf):
            raise FallsError(f"{name}: the body falls; reduce the size of {', '.join(effects) or 'the stimulus'}")
        recorded = sway.theta if measure is None else measure(sway.theta, rate)
        if declared is not None:
            recorded = recorded[:, : declared.n_outputs]
        if protocol.measurement_sd:
            recorded = recorded + stream.spawn(1)[0].standard_normal(recorded.shape) * protocol.measurement_sd
        trials.append(Trial(stimulus if stimulus.ndim == 1 else stimulus[:, 0].copy(), recorded, amplitude))
    period_s = protocol.waveform.period_s if protocol.periodic else None
    convention = protocol.waveform.convention
    return Recording(
        tuple(trials),
        protocol.waveform.rate_hz,
        period_s,
        protocol.stimulus,
        body,
        convention,
        name,
        provenance,
        model=declared,
    )


def body_with_effects(
    model: Model, theta: np.ndarray, effects: Sequence[str], sizes: Mapping[str, float]
) -> tuple[Model, np.ndarray]:
    """The model with its linear effects, and all its parameters; `FallsError` when it is unstable.

    Sizes of nonlinear effects are left to `mcstudy.effect_library.library.rules`. A size may lie outside the bounds of
    a fit.
    """
    declared = [library.effect(n, library.library_of(model)) for n in effects]
    known = {s.name: s for e in declared for s in e.sizes}
    for name in sizes:
        if name not in known:
            raise InputError(f"size {name!r}: expected one of {', '.join(known) or 'none (no effect given)'}")
    for e in declared:
        if e.size.name not in sizes:
            raise InputError(f"effect {e.name!r}: expected its size {e.size.name} in {e.size.unit or 'no unit'}")
    linear = [e for e in declared if e.kind == "linear"]
    augmented = library.apply(model, *(e.name for e in linear))
    for name, value in sizes.items():
        if not abs(value) <= LARGEST_SIZE:
            raise InputError(f"size {name}: expected a number up to {LARGEST_SIZE:g}, got {value:g}")
    added = [sizes.get(s.name, s.parameter.value) for e in linear for s in e.sizes]
    theta = np.concatenate([np.asarray(theta, dtype=float), added])
    if not float(growth_rate(augmented, theta)) < 0:
        listed = ", ".join(f"{k} = {v:.4g}" for k, v in sizes.items())
        raise FallsError(
            f"the closed loop is unstable with {listed or 'these parameters'}, so there is no steady state"
        )
    return augmented, theta


def draw_case(
    model: Model,
    effects: Sequence[str],
    rng: np.random.Generator,
    scale: float = 1.0,
    spread: float = 0.10,
    attempts: int = 400,
) -> tuple[np.ndarray, dict[str, float]]:
    """Random parameters (P,) around the model's nominal ones and sizes for effects, of a stable body.

    Parameters are uniform within ``spread`` of the nominal values; sizes are from the published ranges times
    ``scale``. After every 20 unstable attempts the sizes shrink by a quarter and delays may be up to a quarter shorter
    (slower muscles need shorter delays for stability). Raises `FallsError` after ``attempts``.
    """
    lag, known = np.array([p.name in model.delays for p in model.parameters]), library.library_of(model)
    for attempt in range(attempts):
        harder = attempt // 20
        factor = rng.uniform(1 - spread, 1 + spread, len(model.parameters))
        factor[lag] *= 1 - min(0.25, 0.05 * harder) * rng.random()
        theta = np.clip(model.truth * factor, model.lower, model.upper)
        size = scale * 0.75**harder
        sizes = {s.name: s.draw(rng, size) for n in effects for s in library.effect(n, known).sizes}
        try:
            body_with_effects(model, theta, effects, sizes)
        except FallsError:
            continue
        return theta, sizes
    raise FallsError(f"effects {', '.join(effects)}: no stable body found in {attempts} attempts")


def _stimulus(protocol: Protocol, amplitude: float, rng: np.random.Generator, senses_motion: bool) -> np.ndarray:
    """Whole record of one trial, (n,), or (n, 3) with derivatives for a motion (of a platform or a visual scene).

    Of a declared model with derivatives if it ``senses_motion``.
    """
    waveform = replace(protocol.waveform, amplitude=amplitude)
    period, rate = waveform.waveform(), waveform.rate_hz
    if not protocol.periodic:
        spectrum = np.abs(fft.rfft(np.tile(period, protocol.cycles)))
        smooth = np.interp(np.arange(spectrum.size), np.flatnonzero(spectrum > 1e-9), spectrum[spectrum > 1e-9])
        draws = rng.standard_normal((2, spectrum.size))
        coefficients = smooth * (draws[0] + 1j * draws[1])
        coefficients[0] = 0.0
        period = fft.irfft(coefficients, period.size * protocol.cycles)
        period *= waveform.peak / np.abs(period).max()
    if protocol.stimulus and protocol.stimulus not in TORQUES:
        record = with_derivatives(smoothed(period, rate, waveform.peak), rate)
    else:  # a PRTS is linear between samples, cosines are not
        smooth_record = isinstance(waveform, LineStimulus) or (not protocol.stimulus and senses_motion)
        record = with_derivatives(period, rate) if smooth_record else period
    return (
        np.tile(record, (protocol.cycles, *[1] * (record.ndim - 1)))[: _length(protocol)]
        if protocol.periodic
        else record
    )


def smoothed(period: np.ndarray, rate: float, peak: float) -> np.ndarray:
    """A cycle (n,) of a motion as an apparatus can follow it: without what is far above `PLATFORM_HZ`, same peak."""
    coefficients = fft.rfft(period)
    f = np.arange(coefficients.size) * rate / period.size
    period = fft.irfft(coefficients / (1 + (f / PLATFORM_HZ) ** 4), period.size)
    return np.asarray(period * peak / (np.ptp(period) / 2))


def _length(protocol: Protocol) -> int:
    return protocol.cycles * protocol.waveform.samples


ITERATIONS = 60
"""Most fixed-point iterations for a torque that depends on the sway."""

CONVERGED = 1e-6
"""Largest change of an angle between iterations, relative to the sway, that counts as converged."""


def substeps_of(model: Model, theta: np.ndarray, rate: float) -> int:
    """Steps per sample for the lags of sensors and actuators, which may be far shorter than a sample.

    Raises `InputError` for one that is too short for any number of steps.
    """
    steps = realise(model, theta).fastest_pole / (COMFORTABLE_STEP * rate)
    if not steps <= MOST_SUBSTEPS:
        raise InputError(
            f"a filter is {steps:.2g} times too fast for {rate:g} Hz; expected at most {MOST_SUBSTEPS}: give its lag "
            "a larger size, or 0"
        )
    return max(1, math.ceil(steps))


def _with_torque(
    model: Model,
    theta: np.ndarray,
    stimulus: np.ndarray,
    rate: float,
    noise: np.ndarray,
    rules: Rules,
    torque: Torque | None,
) -> Sway:
    """One trial; an additional torque that follows from the sway is found by damped fixed-point iteration."""
    substeps = substeps_of(model, theta, rate)
    sway = simulate(model, theta, stimulus, rate, noise=noise, rules=rules, substeps=substeps)
    if torque is None:
        return sway
    motor_noise = np.zeros_like(noise) if rules.motor_noise is None else rules.motor_noise
    extra, step, last = np.zeros_like(noise), 0.8, np.inf
    for _ in range(ITERATIONS):
        with np.errstate(over="ignore", invalid="ignore"):
            wanted = torque(sway, rate)
        if not np.isfinite(wanted).all():
            break
        extra = extra + step * (wanted - extra)
        changed = replace(rules, motor_noise=motor_noise + extra)
        after = simulate(model, theta, stimulus, rate, noise=noise, rules=changed, substeps=substeps)
        change = float(np.abs(after.theta - sway.theta).max() / np.abs(after.theta).max())
        sway = after
        if change < CONVERGED:
            return sway
        if change > last:
            step *= 0.6
        last = change
    raise InputError("the additional torque is too strong: its iteration does not converge")
