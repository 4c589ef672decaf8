"""Simulated recordings of planned trials: over time with the solver, which the fits do not use, or as steady states.

Sway of a linear body under a periodic stimulus and stationary noise is Gaussian, with the periodic response as its mean
and the density of the noise-evoked sway. `steady` draws records from this law, in a hundredth of the time of
`simulated`. They differ in the start of a trial, which a diagnosis leaves out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mcstudy.effect_library.protocol import Protocol, body_with_effects, simulate_recording, smoothed
from mcstudy.gap.trial_planning.trials import PlannedTrial
from mcstudy.recordings.recording import Recording, Trial
from mcstudy.stance.body import TORQUES, Body, two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.simulate_spectral import NoiseSway, stimulus_sway


def simulated(
    trial: PlannedTrial,
    theta: np.ndarray,
    rng: np.random.Generator,
    effects: Sequence[str] = (),
    sizes: Mapping[str, float] | None = None,
    body: Body | None = None,
) -> Recording:
    """A recording of a planned trial of a body with parameters ``theta`` (P,) and effects; see `simulate_recording`."""
    amplitudes = (trial.amplitude,) * trial.trials
    protocol = Protocol(trial.kind, trial.waveform, amplitudes, trial.cycles)
    return simulate_recording(protocol, theta, rng, effects=effects, sizes=sizes, body=body, name=trial.kind)


def steady(
    trial: PlannedTrial,
    theta: np.ndarray,
    rng: np.random.Generator,
    effects: Sequence[str] = (),
    sizes: Mapping[str, float] | None = None,
    body: Body | None = None,
) -> Recording:
    """The same as `simulated` in the steady state, for linear effects, from closed forms.

    Raises `FallsError` for an unstable body.
    """
    body = body or Body()
    model, theta = body_with_effects(two_segment(body, trial.kind), theta, effects, sizes or {})
    waveform = trial.waveform
    stimulus, rate = waveform.waveform(), waveform.rate_hz
    if trial.kind not in TORQUES:
        stimulus = smoothed(stimulus, rate, trial.amplitude)
    moved = stimulus_sway(model, theta, _between(trial, stimulus), rate)
    n = trial.cycles * stimulus.size
    noise = NoiseSway(model, theta, SensorNoise(), n, rate)
    whole = np.tile(stimulus, trial.cycles)
    trials = tuple(
        Trial(whole, np.tile(moved, (trial.cycles, 1)) + noise.sample(rng), trial.amplitude)
        for _ in range(trial.trials)
    )
    return Recording(
        trials, rate, waveform.period_s, trial.kind, body, waveform.convention, trial.kind, "mcstudy simulate"
    )


def _between(trial: PlannedTrial, stimulus: np.ndarray) -> np.ndarray:
    """The band-limited cycle (n,) with the spectrum of the torque: a PRTS is linear between samples, cosines are not.

    What a straight line adds above half of the sampling rate is left out.
    """
    if trial.spectrum != "prts" or trial.kind not in TORQUES:
        return stimulus
    spectrum = np.fft.rfft(stimulus)
    return np.fft.irfft(spectrum * np.sinc(np.arange(spectrum.size) / stimulus.size) ** 2, stimulus.size)
