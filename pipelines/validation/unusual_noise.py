"""How often the checks of the noise speak: in sound recordings, and where trials are unequally noisy or a mode rings.

    python pipelines/validation/unusual_noise.py [RECORDINGS]

Half a CPU second per recording; 200 sound ones by default, and a quarter of that number of each other kind.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from mcstudy_challenge.bodies.draws import draw_body
from mcstudy_challenge.bodies.geometry import stands
from mcstudy_challenge.bodies.stability_margin import draw_near_unstable
from mcstudy_challenge.design import Bodies, Series
from mcstudy_challenge.scores.rates import rate

from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.stimulus import Prts

BASE = two_segment()
PROTOCOLS = (((5.0, 5.0), 6), ((3.0, 5.0), 6), ((5.0,), 10), ((5.0, 5.0, 5.0), 4))
"""Amplitudes and cycles of the sound recordings, in turn."""

RINGING = Series(cases=1, body=Bodies(near_decay=(0.005, 0.05)))


def protocol(amplitudes: tuple[float, ...], cycles: int = 6) -> Protocol:
    """At 100 Hz."""
    return Protocol(waveform=Prts(rate_hz=100.0), amplitudes=amplitudes, cycles=cycles)


def sound(seed: int) -> Recording:
    """A body within 15 % of the nominal one, whose oscillations decay faster than 0.2 1/s."""
    rng = np.random.default_rng([seed, 31])
    theta = BASE.truth * (1 + rng.uniform(-0.15, 0.15, BASE.truth.size))
    while not stands(BASE, theta, 0.2):
        theta = BASE.truth * (1 + rng.uniform(-0.15, 0.15, BASE.truth.size))
    return simulate_recording(protocol(*PROTOCOLS[seed % len(PROTOCOLS)]), theta, rng)


def unequal(seed: int) -> Recording:
    """The second of two trials has four times the noise amplitude."""
    rng = np.random.default_rng([seed, 32])
    theta = draw_body(Series(cases=1), rng, False)
    psd = SensorNoise().psd_deg2_hz
    loud = replace(protocol((5.0,)), noise=SensorNoise((16 * psd[0], 16 * psd[1])))
    first, second = simulate_recording(protocol((3.0,)), theta, rng), simulate_recording(loud, theta, rng)
    return replace(first, trials=first.trials + second.trials)


def ringing(seed: int) -> Recording:
    """A body whose least damped oscillation decays with 0.005 to 0.05 1/s."""
    rng = np.random.default_rng([seed, 33])
    return simulate_recording(protocol((5.0, 5.0)), draw_near_unstable(RINGING, rng), rng)


def noted(make: Callable[[int], Recording], word: str, recordings: int) -> str:
    """Share of recordings with a note that contains ``word``, as text."""
    hits = [any(word in note for note in measure(make(seed)).notes) for seed in range(recordings)]
    return f"{sum(hits)} of {recordings}, {rate(hits).text()}"


def main(recordings: int = 200) -> None:
    """Print the table."""
    few = max(1, recordings // 4)
    print("sound, sharp lines noted:", noted(sound, "the cycles differ", recordings), flush=True)
    print("sound, unequal trials noted:", noted(sound, "the noise of trial", recordings), flush=True)
    print("unequal trials, noted:", noted(unequal, "the noise of trial", few), flush=True)
    print("ringing, sharp lines noted:", noted(ringing, "the cycles differ", few), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
