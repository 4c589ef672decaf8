"""Which printed numbers cannot be reproduced together, by simulated studies: no emulator takes part in a trade-off.

For a row that the best configuration misses, further studies are simulated where the emulator promises this row first
and as many others as possible next (`mcstudy_goodworth2018.lost_table.search`). Over all simulated studies, the pairs
of the distance of this row and of another one that no study improves in both form the trade-off of the two; so do the
distance of the row and the number of the others that are missed. If no study comes near both of a pair, the two
contradict each other as far as they were sought; if every pair can be met, the contradiction is with several rows
together.

A distance is that of one study, whose luck is in it: it makes contradictions look smaller, not larger.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mcstudy_goodworth2018.lost_table.checks import LIMIT, apart
from mcstudy_goodworth2018.lost_table.rows import KEYS, ROWS

POINTS = 12
"""Points of a trade-off."""

REACHED = 2.0
"""Distance, in errors of the difference of two studies, below which a row counts as met in a pair."""


def front(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Pairs (x, y) that no other pair improves in both, (POINTS, 2), thinned; repeated where there are fewer."""
    order = np.lexsort((y, x))
    x, y = x[order], y[order]
    best = np.minimum.accumulate(y)
    keep = np.concatenate([[True], y[1:] < best[:-1]])
    points = np.stack([x[keep], y[keep]], axis=1)
    return np.asarray(points[np.linspace(0, len(points) - 1, POINTS).round().astype(int)])


def trade_offs(rows: np.ndarray, error: np.ndarray, missed: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Trade-offs of each of ``missed`` over simulated studies ``rows`` (N, R); ``error``: of a row of one study, (R,).

    Returns
    -------
    with every other row, (missed, R, POINTS, 2), NaN with itself; and with the number of the other rows that are missed
    (further than `LIMIT`), (missed, POINTS, 2). Second readings of a row (``told``) are left out.
    """
    d = np.abs(apart(rows, error))
    used = np.array([row.kind != "told" for row in ROWS])
    pairs = np.full((len(missed), len(KEYS), POINTS, 2), np.nan)
    many = np.full((len(missed), POINTS, 2), np.nan)
    for i, key in enumerate(missed):
        own = KEYS.index(key)
        others = used & (np.arange(len(KEYS)) != own)
        for j in np.flatnonzero(others):
            pairs[i, j] = front(d[:, own], d[:, j])
        many[i] = front(d[:, own], (d[:, others] > LIMIT).sum(axis=1))
    return pairs, many
