"""Which tests are quick, and in which order and on which worker tests run that are distributed (pytest-xdist).

``tests/durations.txt`` holds the seconds that a test takes with all its parameters, or a fixture, and its name;
``python -m tests --note-durations`` runs everything and writes it. What takes more than `QUICK_S`, and whatever needs a
fixture that does, has the marker ``slow``, which ``--quick`` leaves out. Tests of one file run on one worker, for they
share what it sets up, unless the file takes long and they do not; those that take longest begin first.
"""

from __future__ import annotations

import os
import time
from collections import defaultdict
from collections.abc import Generator, Iterable
from pathlib import Path

import pytest
from xdist.scheduler import LoadScopeScheduling

FILE = Path(__file__).parents[1] / "durations.txt"

QUICK_S = 0.2
"""What takes longer is slow."""

NOTED_S = 0.05
"""What takes less is not noted."""

LONG_S = 40.0
"""A file that takes longer is spread over workers."""

SHARED_S = 10.0
"""Tests whose file or folder has fixtures that take longer run on one worker."""

WAITS = 0.2
"""Share of processor time in elapsed time below which elapsed time counts: a busy machine has its time."""


def read(text: str) -> dict[str, float]:
    """Seconds by name of test or fixture."""
    return {name: float(seconds) for seconds, name in (line.split(maxsplit=1) for line in text.splitlines())}


KNOWN = read(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}


def name_of(nodeid: str) -> str:
    """Name of a test without its parameters."""
    return nodeid.partition("[")[0]


def file_of(name: str) -> str:
    """The file of a test, the file or folder of a fixture."""
    return name.removeprefix("fixture ").partition("::")[0]


def summed(names: Iterable[str]) -> dict[str, float]:
    """Seconds by file or folder."""
    sums: dict[str, float] = defaultdict(float)
    for name in names:
        sums[file_of(name)] += KNOWN.get(name, 0.0)
    return sums


FIXTURES = summed(name for name in KNOWN if name.startswith("fixture "))
TESTS = summed(name for name in KNOWN if not name.startswith("fixture "))


def unit(nodeid: str) -> str:
    """What runs on one worker: a test, a file, or a folder."""
    file = file_of(nodeid)
    folder = file.rpartition("/")[0]
    if FIXTURES.get(folder, 0.0) > SHARED_S:
        return folder
    return nodeid if TESTS.get(file, 0.0) > LONG_S and FIXTURES.get(file, 0.0) < SHARED_S else file


class LongestFirst(LoadScopeScheduling):
    """Work in the order in which it was collected, in `unit`s."""

    def _split_scope(self, nodeid: str) -> str:
        return unit(nodeid)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> LongestFirst | None:
    if config.option.dist != "load":  # somebody asked for something else
        return None
    config.option.loadscopereorder = False
    return LongestFirst(config, log)  # type: ignore[arg-type]


def slow_fixtures(item: pytest.Item) -> list[str]:
    """Fixtures that a test needs and that take long."""
    known = getattr(item, "_fixtureinfo", None)
    definitions = [d for several in known.name2fixturedefs.values() for d in several] if known else []
    return [key for d in definitions if KNOWN.get(key := f"fixture {d.baseid}::{d.argname}", 0.0) > QUICK_S]


class Clock:
    """Seconds of a block: of the processor, this process and those that it started, unless it mostly waits."""

    def __enter__(self) -> Clock:
        self.begun, self.used = time.perf_counter(), sum(os.times()[:4])
        return self

    def __exit__(self, *_: object) -> None:
        elapsed, used = time.perf_counter() - self.begun, sum(os.times()[:4]) - self.used
        self.seconds = used if used > WAITS * elapsed else elapsed


TAKEN: dict[str, float] = {}


def note(name: str, seconds: float) -> None:
    """Add what a test took; a fixture is made several times, but needed once."""
    longest = name.startswith("fixture ")
    TAKEN[name] = max(TAKEN.get(name, 0.0), seconds) if longest else TAKEN.get(name, 0.0) + seconds


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[object]) -> Generator[None, object, object]:
    with Clock() as clock:
        value = yield
    note(f"fixture {fixturedef.baseid}::{fixturedef.argname}", clock.seconds)
    return value


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    with Clock() as clock:
        value = yield
    note(name_of(item.nodeid), clock.seconds)
    return value


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--quick", action="store_true", help="leave out what takes long (tests/durations.txt)")
    parser.addoption("--note-durations", action="store_true", help="write tests/durations.txt")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    fixtures = {item.nodeid: slow_fixtures(item) for item in items}
    for item in items:
        if fixtures[item.nodeid] or KNOWN.get(name_of(item.nodeid), 0.0) > QUICK_S:
            item.add_marker("slow")
    if config.getoption("--quick"):
        kept = [item for item in items if item.get_closest_marker("slow") is None]
        config.hook.pytest_deselected(items=[item for item in items if item not in kept])
        items[:] = kept
    if hasattr(config, "workerinput"):
        seconds: dict[str, float] = defaultdict(float)
        # Sums of sorted numbers: every worker must come to the same order, to the last bit.
        for key, name in sorted({(unit(item.nodeid), name_of(item.nodeid)) for item in items}):
            seconds[key] += KNOWN.get(name, 0.0)
        for key in sorted({key for keys in fixtures.values() for key in keys}):
            seconds[file_of(key)] += KNOWN[key]
        items.sort(key=lambda item: (-seconds[unit(item.nodeid)], unit(item.nodeid)))


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: object, error: object) -> None:
    del error
    for name, seconds in getattr(node, "workeroutput", {}).get("durations", {}).items():
        note(name, seconds)


def pytest_sessionfinish(session: pytest.Session) -> None:
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["durations"] = TAKEN
    elif session.config.getoption("--note-durations"):
        ran = {file_of(name) for name in TAKEN}
        kept = {name: s for name, s in KNOWN.items() if file_of(name) not in ran}
        noted = kept | {name: s for name, s in TAKEN.items() if s > NOTED_S}
        FILE.write_text("".join(f"{s:.2f} {name}\n" for name, s in sorted(noted.items())), encoding="utf-8")
