"""Simulated recordings of planned trials: the time-domain simulator, which the fits do not use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mcstudy.effect_library.simulate import Protocol, simulate_recording
from mcstudy.gap.planned.trials import PlannedTrial
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import Body


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
