"""Phases of the lines of a stimulus that keep its crest factor low.

The start is Schroeder's formula (Schroeder 1970, IEEE Trans Inf Theory 16:85-89); the improvement is the swapping of
Van der Ouderaa, Schoukens & Renneboog (1988, IEEE Trans Instrum Meas 37:145-147): the waveform is clipped, the phases
of its spectrum are kept and the amplitudes restored, again and again, with less and less clipped. Random phases are
tried as further starts, and the best of all is kept.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

ROUNDS = 120
"""Rounds of clipping per start."""

LEVELS = (0.80, 0.99)
"""Clipping level, of the peak, in the first and in the last round."""


def crest_factor(waveform: np.ndarray) -> float:
    """Largest absolute value over root mean square."""
    return float(np.abs(waveform).max() / np.sqrt(np.mean(waveform**2)))


def schroeder(power: np.ndarray) -> np.ndarray:
    """Schroeder's phases (K,), rad, for lines with ``power`` (K,)."""
    before = np.concatenate([[0.0], np.cumsum(power)[:-1]]) / power.sum()
    return np.asarray(-2 * np.pi * np.cumsum(before))


def low_crest(
    harmonic: np.ndarray, power: np.ndarray, samples: int, rng: np.random.Generator, starts: int
) -> np.ndarray:
    """Phases (K,), rad, of cosines at ``harmonic`` with ``power`` (K,), for a low crest factor over ``samples``.

    ``starts``: phases improved: Schroeder's, and random ones.
    """
    # the crest of band-limited lines does not need the prime factors of the laboratory's cycle
    n = min(fft.next_fast_len(max(8 * int(harmonic[-1]), 64), real=True), samples)
    amplitude = np.sqrt(power)
    best, lowest = schroeder(power), np.inf
    for start in range(starts):
        phase = schroeder(power) if start == 0 else rng.uniform(-np.pi, np.pi, harmonic.size)
        for level in (*np.linspace(*LEVELS, ROUNDS), None):
            wave = _wave(harmonic, amplitude, phase, n)
            if (crest := crest_factor(wave)) < lowest:
                best, lowest = phase, crest
            if level is not None:
                top = level * np.abs(wave).max()
                phase = np.angle(fft.rfft(np.clip(wave, -top, top))[harmonic])
    return best


def _wave(harmonic: np.ndarray, amplitude: np.ndarray, phase: np.ndarray, n: int) -> np.ndarray:
    spectrum = np.zeros(n // 2 + 1, dtype=complex)
    spectrum[harmonic] = amplitude * np.exp(1j * phase)
    return np.asarray(fft.irfft(spectrum, n, norm="forward"))
