"""Lines of simulated recordings for the tests of the diagnosis, made once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mcstudy.effect_library import library
from mcstudy.recordings.recording import Recording, Trial
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_spectral import NoiseSway, stimulus_sway
from mcstudy.stance.stimulus import Prts

CYCLES, TRIALS = 6, 2


@pytest.fixture(scope="session")
def plain_recordings() -> list[Recording]:
    """Twelve recordings of the nominal body with nothing missing."""
    model, prts = two_segment(), Prts(rate_hz=100.0)
    waveform = prts.waveform()
    evoked = stimulus_sway(model, model.truth, waveform, prts.rate_hz)
    n = CYCLES * waveform.size
    noise = NoiseSway(model, model.truth, SensorNoise(), 2 * n, prts.rate_hz)
    out = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        trials = tuple(
            Trial(np.tile(waveform, CYCLES), np.tile(evoked, (CYCLES, 1)) + noise.sample(rng)[:n], 5.0)
            for _ in range(TRIALS)
        )
        out.append(Recording(trials, prts.rate_hz, prts.period_s))
    return out


@pytest.fixture(scope="session")
def plain_lines(plain_recordings: list[Recording]) -> list[Lines]:
    """Their lines."""
    return [measure(r) for r in plain_recordings]


@pytest.fixture(scope="session")
def with_effects(plain_lines: list[Lines]) -> Callable[..., Lines]:
    """with_effects(k, {effect: {parameter: value}}): the lines of recording k as if the body had the effects."""

    def add(k: int, effects: dict[str, dict[str, float]]) -> Lines:
        lines, base = plain_lines[k], two_segment()
        names = list(effects)
        model = library.apply(base, *names)
        own = [effects[n][s.name] for n in names for s in library.effect(n).sizes]
        change = frf(model, np.concatenate([base.truth, own]), lines.f) - frf(base, base.truth, lines.f)
        return replace(lines, y=lines.y + change, repeats=lines.repeats + change)

    return add
