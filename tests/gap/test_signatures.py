"""Effects that a recording cannot distinguish are found together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

from mcstudy.gap.candidates.signatures import alike_groups


def test_effects_are_together_when_a_chain_of_alike_ones_links_them() -> None:
    cosine = np.eye(4)
    for a, b in ((0, 2), (2, 3)):
        cosine[a, b] = cosine[b, a] = 0.99
    assert alike_groups("abcd", cosine) == [("a", "c", "d"), ("b",)]
    assert alike_groups([], np.zeros((0, 0))) == []


@pytest.mark.parametrize("seed", range(50))
def test_groups_are_the_connected_components(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 40))
    cosine = rng.random((n, n))
    cosine = np.maximum(cosine, cosine.T)
    np.fill_diagonal(cosine, 1.0)
    names, threshold = [str(k) for k in range(n)], 1 - 1 / n
    count, label = connected_components(cosine > threshold, directed=False)
    expected = [tuple(x for x, own in zip(names, label, strict=True) if own == k) for k in range(count)]
    assert alike_groups(names, cosine, threshold) == expected
