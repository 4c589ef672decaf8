"""Bodies near the limit of stability: nothing is missing, but one oscillation takes long to die away.

The noise of such a body changes between neighbouring lines, and the start of a recording lasts longer than a cycle. A
detection is a false alarm, as in every case without a missing effect.
"""

from __future__ import annotations

import numpy as np

from mcstudy.errors import DesignError
from mcstudy.stance.body import two_segment
from mcstudy.stance.stability import rightmost_root
from mcstudy_challenge.bodies.geometry import REAL
from mcstudy_challenge.design import Series

DRAWN, ATTEMPTS = 200, 100
"""Bodies drawn at once, and how often."""


def draw_near_unstable(series: Series, rng: np.random.Generator) -> np.ndarray:
    """Parameters (12,) of a stable body whose least damped root oscillates and decays within ``near_decay`` (1/s).

    Every parameter is uniform within ``shifted_spread`` of its nominal value. Raises `DesignError` when none is found.
    """
    base, spread = two_segment(), series.body.shifted_spread
    slow, fast = series.body.near_decay
    for _ in range(ATTEMPTS):
        factor = 1 + rng.uniform(-spread, spread, (DRAWN, len(base.parameters)))
        theta = np.clip(base.truth * factor, base.lower, base.upper)
        root = rightmost_root(base, theta).root
        near = np.flatnonzero((-root.real >= slow) & (-root.real <= fast) & (np.abs(root.imag) > REAL))
        if near.size:
            return np.asarray(theta[near[0]])
    raise DesignError(
        f"body: near_decay: no body that decays with {slow:g} to {fast:g} 1/s found in {DRAWN * ATTEMPTS} draws with a "
        f"spread of {spread:g}"
    )
