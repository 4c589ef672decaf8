"""Recordings of foreign bodies (`mcstudy_challenge.bodies.foreign_body`), and how bodies and causes are drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy import fft

from mcstudy.effect_library.protocol import Protocol
from mcstudy.errors import FallsError
from mcstudy.recordings.checks import LARGEST_SWAY
from mcstudy.recordings.recording import Recording, Trial
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy_challenge.bodies.foreign_body import SENSES, STEPS_PER_SAMPLE, Person, sway
from mcstudy_challenge.bodies.foreign_effects import FOREIGN, ForeignEffect, recorded
from mcstudy_challenge.bodies.withheld_causes import Cause, Drawn, Simulate, draw_cause
from mcstudy_challenge.design import Series

UNSETTLED = 0.02
"""Largest difference between the last two cycles without noise, relative to the sway, of a body that has settled."""


def person_of(theta: np.ndarray, body: Body | None = None) -> Person:
    """The person with parameters ``theta`` (12,) of the two-segment model and its inertia."""
    b = body or Body()
    own = dict(zip(two_segment().names, map(float, theta), strict=True))
    return Person(M11=b.J1 - b.C1, M12=b.C1, M22=b.J2, W1=b.A1 * b.g, W2=b.A2 * b.g, **own)


def _sensed_noise(noise: SensorNoise, rng: np.random.Generator, samples: int, h: float) -> np.ndarray:
    """Noise of the sensed angles and rates (m, 4) at every step."""
    m = (samples - 1) * STEPS_PER_SAMPLE + 1
    if not any(noise.psd_deg2_hz):
        return np.zeros((m, SENSES))
    angle = noise.sample(rng, fft.next_fast_len(m), 1 / h)[:m]
    rate = np.gradient(angle, h, axis=0)
    return np.ascontiguousarray(np.stack([angle, rate], axis=2).reshape(m, SENSES))


def simulate_foreign(
    protocol: Protocol,
    theta: np.ndarray,
    rng: np.random.Generator,
    effect: ForeignEffect | None = None,
    size: float = 0.0,
    shapes: Mapping[str, float] | None = None,
) -> Recording:
    """A recording of a foreign body with parameters ``theta`` (12,) and one mechanism, or none.

    Raises `FallsError` when it falls, or, without noise, has not settled in the last cycle.
    """
    person = person_of(theta)
    if effect is not None and effect.change is not None:
        person = effect.change(person, size, shapes or {})
    rate, period = protocol.waveform.rate_hz, protocol.waveform.samples
    h = 1 / (rate * STEPS_PER_SAMPLE)
    trials = []
    for amplitude, stream in zip(protocol.amplitudes, rng.spawn(len(protocol.amplitudes)), strict=True):
        stimulus = np.tile(replace(protocol.waveform, amplitude=amplitude).waveform(), protocol.cycles)
        angles = sway(person, stimulus, _sensed_noise(protocol.noise, stream, stimulus.size, h), h)
        if not np.abs(angles).max() < LARGEST_SWAY:
            raise FallsError(f"foreign body: it falls with {effect.name if effect else 'the stimulus'}")
        if not any(protocol.noise.psd_deg2_hz) and (effect is None or effect.lasting):
            last, before = angles[-period:], angles[-2 * period : -period]
            if np.abs(last - before).max() > UNSETTLED * np.abs(last).max():
                raise FallsError("foreign body: it has not settled in the last cycle")
        if effect is not None and effect.change is None:
            angles = recorded(angles, rate, size)
        trials.append(Trial(stimulus, angles, amplitude))
    return Recording(
        tuple(trials),
        rate,
        protocol.waveform.period_s,
        protocol.stimulus,
        Body(),
        protocol.waveform.convention,
        "foreign",
        "foreign body",
    )


def draw_foreign(series: Series, rng: np.random.Generator, effect: ForeignEffect) -> Drawn | None:
    """A body, shape constants and a size at which a mechanism has about a drawn delta; None if no body is stable."""
    shapes = effect.draw(rng)
    sign = -1.0 if effect.both and rng.random() < 0.5 else 1.0

    def make(theta: np.ndarray) -> Simulate:
        def simulate(size: float, protocol: Protocol, stream: np.random.Generator) -> Recording:
            return simulate_foreign(protocol, theta, stream, effect if size else None, size, shapes)

        return simulate

    cause = Cause(
        make=make,
        start=sign * effect.start,
        top=effect.top,
        lasting=effect.lasting,
        named=bool(effect.mechanism),
        noisy=effect.bends,
        nimble=True,
    )
    return draw_cause(series, rng, cause, "size", shapes)


def foreign_pool(series: Series, outside: bool) -> list[ForeignEffect]:
    """Mechanisms that cases of a series may have: those named or all, of those that its recordings can show."""
    several = len(set(series.protocol.amplitudes)) > 1
    named = series.sizes.foreign
    return [
        e
        for e in FOREIGN.values()
        if (not e.mechanism) == outside and (not named or e.name in named) and (several or not e.contrast)
    ]
