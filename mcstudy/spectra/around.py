"""The lines around each line.

SciPy has filters for this, but to import its images takes longer than to read and measure a recording.
"""

from __future__ import annotations

import numpy as np


def around(values: np.ndarray, width: int) -> np.ndarray:
    """(..., N, width) values of each line and of those around it; the first and the last stand for what is beyond.

    ``width``: odd, the line itself included.
    """
    side = width // 2
    padded = np.pad(values, [(0, 0)] * (values.ndim - 1) + [(side, side)], mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, width, axis=-1)
