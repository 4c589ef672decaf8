"""How much is tried at random: little in every run of the tests, the same each time; more, and new, when asked.

``MCSTUDY_FUZZ=500 python -m tests`` tries 500 changes of every kind of file, every way of damage on every file of a
cube, and every numeric field of a study file at the ends of its range.
"""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

MANY = "MCSTUDY_FUZZ" in os.environ
"""Whether more is asked for."""

FUZZ = settings(
    max_examples=int(os.environ.get("MCSTUDY_FUZZ", "24")),
    deadline=None,
    derandomize=not MANY,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
"""Settings of tests that change a file at random."""

EDITS = st.lists(
    st.tuples(st.floats(0, 1), st.binary(min_size=0, max_size=8), st.integers(0, 8)), min_size=1, max_size=6
)
"""Places of a file, as shares of its length, what is written there, and how many bytes that replaces."""


def mutated(content: bytes, edits: list[tuple[float, bytes, int]], front: int = 1 << 30) -> bytes:
    """The content with some places, all in its first ``front`` bytes, overwritten, grown or shortened."""
    for where, new, gone in edits:
        at = int(where * min(len(content), front))
        content = content[:at] + new + content[at + gone :]
    return content
