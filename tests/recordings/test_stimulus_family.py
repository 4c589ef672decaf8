"""A sequence is recognised from the stimulus itself: its base, its order and the duration of its states."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from mcstudy.recordings.stimulus_family import family
from mcstudy.stance.stimulus import Prts

RATE = 100.0


def m_sequence(base: int, order: int) -> np.ndarray:
    """One period of an m-sequence, found by trying all recurrences: independent of the package's."""
    for taps in product(range(base), repeat=order):
        first = state = (0,) * (order - 1) + (1,)
        seen = [state[-1]]
        while len(seen) < base**order:
            state = (*state[1:], sum(a * b for a, b in zip(taps, state, strict=True)) % base)
            if state == first:
                break
            seen.append(state[-1])
        if len(seen) == base**order - 1:
            values = np.array(seen, dtype=float)
            return values - base * (values > base // 2)
    raise AssertionError(f"no m-sequence of base {base}, order {order}")


@pytest.mark.parametrize(("stages", "state_s", "states"), [(4, 0.25, 80), (5, 0.25, 242), (7, 0.02, 2186)])
def test_a_ternary_sequence_is_named_wherever_a_cycle_begins(stages: int, state_s: float, states: int) -> None:
    wave = np.roll(Prts(stages=stages, state_s=state_s, rate_hz=200.0).waveform(), 37)
    words = family(wave, 200.0)
    assert words == f"PRTS of {states} states of {state_s:g} s (base 3, order {stages}), odd harmonics only"


def test_noise_of_a_measured_platform_does_not_hide_it() -> None:
    wave = Prts(stages=4, state_s=0.25, rate_hz=RATE).waveform()
    noise = np.random.default_rng(0).normal(0, 0.002 * np.ptp(wave), wave.size)
    assert family(wave + noise, RATE).startswith("PRTS of 80 states of 0.25 s")


def test_states_need_not_last_whole_samples() -> None:
    wave = Prts(stages=4, state_s=0.25, rate_hz=RATE).waveform()
    at_90 = np.interp(np.arange(1800) / 90, np.arange(2001) / 100, np.append(wave, wave[0]))
    assert family(at_90, 90.0).startswith("PRTS of 80 states of 0.25 s (base 3, order 4)")


@pytest.mark.parametrize(("base", "order", "name"), [(2, 7, "binary"), (5, 3, "five-state")])
@pytest.mark.parametrize("of", ["position", "velocity"])
def test_sequences_of_other_bases_are_named(base: int, order: int, name: str, of: str) -> None:
    held = np.repeat(m_sequence(base, order), 8)
    wave = held if of == "position" else np.cumsum(held - held.mean())
    assert family(wave, RATE).startswith(
        f"pseudorandom {name} sequence of {base**order - 1} states of 0.08 s (base {base}, order {order})"
    )


def test_sines_are_named_with_their_frequencies() -> None:
    t = np.arange(2000) / RATE
    assert family(np.sin(2 * np.pi * 0.2 * t), RATE) == "sine (0.2 Hz)"
    several = sum(np.sin(2 * np.pi * k / 20 * t + k) for k in (1, 3, 7, 11))
    assert family(several, RATE) == "sum of 4 sines (0.05, 0.15, 0.35, 0.55 Hz)"


def test_a_stimulus_on_twice_odd_harmonics_is_told() -> None:
    half = Prts(stages=4, state_s=0.125, rate_hz=200.0).waveform()
    assert family(np.tile(half + 0.2 * half**3, 2), 200.0).endswith("harmonics 2, 6, 10, ... only")


def test_what_is_no_sequence_is_not_called_one() -> None:
    walk = np.random.default_rng(0).normal(size=2000).cumsum()
    assert family(walk, RATE) == "no sequence that is known here"
