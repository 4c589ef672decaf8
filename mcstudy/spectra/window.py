"""The parabolic (Welch) window for averages over neighbouring lines."""

from __future__ import annotations

import numpy as np


def parabolic(at: np.ndarray, among: np.ndarray, half_width: np.ndarray) -> np.ndarray:
    """Weights (L, E) of the lines ``among`` (E,) in a mean around each of ``at`` (L,); rows sum to 1.

    A weight is proportional to 1 - (distance / ``half_width``)^2 and is 0 beyond ``half_width`` (L,).
    """
    # |even - line| is exact for harmonics; dividing it gives bit-identical weights on both sides.
    distance = np.abs(among - np.asarray(at)[:, None]) / np.asarray(half_width)[:, None]
    window = np.clip(1.0 - distance**2, 0.0, None)
    return np.asarray(window / window.sum(axis=1, keepdims=True))
