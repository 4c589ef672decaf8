"""How much is tried at random: little in every run of the tests, the same each time; more, and new, when asked.

``MCSTUDY_FUZZ=500 python -m tests`` tries 500 changes of every kind of file, every way of damage on every file of a
cube, and every numeric field of a study file at the ends of its range.
"""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

MANY = "MCSTUDY_FUZZ" in os.environ
"""Whether more is asked for."""

FUZZ = settings(
    max_examples=int(os.environ.get("MCSTUDY_FUZZ", "24")),
    deadline=None,
    derandomize=not MANY,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
"""Settings of tests that change a file at random."""
