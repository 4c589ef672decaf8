"""What the tests of studies share."""

from __future__ import annotations

import pytest

from mcstudy.study.execution import tasks


@pytest.fixture(autouse=True)
def fresh_worker() -> None:
    """A worker that has opened no cube: they lie at the same place in every test."""
    tasks.open_group.cache_clear()
