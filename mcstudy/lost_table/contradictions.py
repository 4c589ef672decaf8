"""Which printed numbers cannot be reproduced together: how near each pair of rows can be met at once.

For a row that the posterior does not reproduce, configurations are sought that meet this row and one other row alone,
everything else left open. If none meets both, the two contradict each other under the model; the pairs of distances
that cannot be improved in both form the trade-off. If every pair can be met, the contradiction is with several rows
together, and the row's own column says how near it can be met at all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mcstudy.lost_table.emulator import Emulator
from mcstudy.lost_table.posterior import Likelihood, sample
from mcstudy.lost_table.rows import KEYS, ROWS, rounding, stated
from mcstudy.streams import stream

PARTICLES = 300
SHARPEN = 4.0
"""Power of the likelihood of the two rows: what can be reached is sought, not what is probable."""

POINTS = 9
"""Points of a trade-off."""

REACHED = 2.0
"""Distance, in standard errors of a study, below which a row counts as met."""


def distance(emulator: Emulator, u: np.ndarray) -> np.ndarray:
    """Distances (N, R) of expected from printed rows, in standard errors of a study; rankings that hold count 0."""
    error = np.sqrt(np.diag(emulator.covariance) + rounding() ** 2)
    gap = (emulator.rows(u) - stated()) / error
    above = np.array([row.kind == "above" for row in ROWS])
    return np.asarray(np.where(above, np.maximum(-gap, 0.0), np.abs(gap)))


def front(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Pairs (x, y) that no other pair improves in both, (POINTS, 2), thinned; repeated where there are fewer."""
    order = np.lexsort((y, x))
    x, y = x[order], y[order]
    keep = y <= np.minimum.accumulate(y)
    points = np.stack([x[keep], y[keep]], axis=1)
    return np.asarray(points[np.linspace(0, len(points) - 1, POINTS).round().astype(int)])


def trade_offs(emulator: Emulator, rows: Sequence[str], seed: int) -> np.ndarray:
    """Trade-offs (len(rows), R, POINTS, 2) of each of ``rows`` with every row; NaN with itself and unused rows."""
    out = np.full((len(rows), len(KEYS), POINTS, 2), np.nan)
    for i, first in enumerate(rows):
        for j, second in enumerate(KEYS):
            if second == first or ROWS[j].kind == "told":
                continue
            others = tuple(k for k in KEYS if k not in (first, second))
            likelihood = Likelihood.of(emulator, stated(), leave_out=others)
            found = sample(likelihood, stream(seed, "table_pair", KEYS.index(first), j), PARTICLES, SHARPEN)
            d = distance(emulator, found.u)
            out[i, j] = front(d[:, KEYS.index(first)], d[:, j])
    return out
