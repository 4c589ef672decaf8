"""Effects that a recording cannot distinguish are found together."""

from __future__ import annotations

import numpy as np

from mcstudy.gap.candidates.signatures import alike_groups


def test_effects_are_together_when_a_chain_of_alike_ones_links_them() -> None:
    cosine = np.eye(4)
    for a, b in ((0, 2), (2, 3)):
        cosine[a, b] = cosine[b, a] = 0.99
    assert alike_groups("abcd", cosine) == [("a", "c", "d"), ("b",)]
    assert alike_groups([], np.zeros((0, 0))) == []
