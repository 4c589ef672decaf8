"""Random streams keyed by their purpose, not by the order in which work happens.

A stream belongs to (seed, purpose, realization). Amplitude, Fmax, group, start count, worker and chunk are not part
of the key. Therefore they share their random numbers (paired comparisons), and extending any axis later, or resuming
with another number of workers, gives the same bits.
"""

from __future__ import annotations

import hashlib

import numpy as np


def stream(seed: int, purpose: str, *coordinates: int) -> np.random.Generator:
    """A Philox generator seeded with a 128-bit hash of its arguments.

    ``purpose`` is e.g. ``"noise"`` or ``"start"``; ``coordinates`` are coordinate values (not positions on an axis).
    """
    label = "|".join(["mcstudy", str(seed), purpose, *(str(int(c)) for c in coordinates)])
    entropy = int.from_bytes(hashlib.sha256(label.encode()).digest()[:16], "little")
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(entropy)))


def noise_stream(seed: int, realization: int, stimulus: int = 0) -> np.random.Generator:
    """Sensor noise of one realization, in the recording of one of several stimuli."""
    return stream(seed, "noise", realization, *([stimulus] if stimulus else []))


def start_stream(seed: int, realization: int) -> np.random.Generator:
    """Starts of one realization, to be drawn start by start."""
    return stream(seed, "start", realization)
