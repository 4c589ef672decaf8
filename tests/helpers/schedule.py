"""In which order, and on which worker, tests run that are distributed over processes (pytest-xdist).

Tests of one file stay together, for they share what it sets up, unless each takes long by itself; those of the pages,
which share a few expensive ones, stay together all. What takes longest begins first, so that nobody waits at the end.
"""

from __future__ import annotations

import pytest
from xdist.scheduler import LoadScopeScheduling

LONGEST = (
    "tests/system/test_wheel.py",
    "tests/docs/test_site.py",
    "tests/system/test_slurm.py",
    "tests/system/test_state_machine.py",
    "tests/system/test_kill_campaign.py",
    "tests/docs/test_code_blocks.py",
    "tests/system/",
    "tests/report/",
    "tests/study/",
    "tests/challenge/",
    "tests/gap/",
    "tests/stance/",
    "tests/recordings/",
    "tests/fitting/",
    "tests/analysis/",
)
"""Beginnings of names, in the order in which the tests begin; all others come after them."""

TOGETHER = ("tests/report/",)
"""Folders whose tests share fixtures."""

APART = (
    "tests/docs/test_code_blocks.py",
    "tests/study/test_mutations.py",
    "tests/study/test_power_cut.py",
    "tests/system/test_kill_campaign.py",
    "tests/system/test_stop.py",
    "tests/system/test_wheel.py",
)
"""Files whose tests share little."""


def rank(name: str) -> int:
    """The smaller, the sooner a test begins."""
    return next((k for k, start in enumerate(LONGEST) if name.startswith(start)), len(LONGEST))


class LongestFirst(LoadScopeScheduling):
    """Work in the order in which it was collected, in units of files."""

    def _split_scope(self, nodeid: str) -> str:
        folder = next((folder for folder in TOGETHER if nodeid.startswith(folder)), None)
        return folder or (nodeid if nodeid.startswith(APART) else nodeid.partition("::")[0])


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> LongestFirst | None:
    if config.option.dist != "load":  # somebody asked for something else
        return None
    config.option.loadscopereorder = False
    return LongestFirst(config, log)  # type: ignore[arg-type]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if hasattr(config, "workerinput"):
        items.sort(key=lambda item: rank(item.nodeid))
