"""Windows over neighbouring lines: the parabolic (Welch) one for averages, and the plain values of the neighbours."""

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


def neighbourhood(values: np.ndarray, width: int) -> np.ndarray:
    """(..., N, width) values of each line and of those around it; the first and the last stand for what is beyond.

    ``width``: odd, the line itself included. SciPy's filters do the same, but importing its images takes longer than
    reading and measuring a recording.
    """
    side = width // 2
    padded = np.pad(values, [(0, 0)] * (values.ndim - 1) + [(side, side)], mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, width, axis=-1)
