"""Break the promises on purpose, and see that the campaign of kills, or the state machine, notices each time.

    python tests/system/sabotage.py
    python tests/system/sabotage.py --states

Prints one line a sabotage; 0 when each was noticed. Deaths between lines are aimed at the lines of the sabotage, so
that this takes a minute and not an hour.
"""

from __future__ import annotations

import itertools
import logging
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import forked
import kill_campaign
import numpy as np
import state_machine
from forked import MEMORY
from hypothesis import settings
from kill_campaign import KILLS, Campaign

from mcstudy.files import durable
from mcstudy.fitting.solvers import solvers
from mcstudy.streams import stream
from mcstudy.study import experiment, extend, verify
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.store import ChunkState, Cube, GroupStore

SEED = 2
"""Of the faults of every sabotage: one with which each of them soon hits."""

MOST = 40
"""Faults after which a sabotage counts as unnoticed."""


def write_in_place(path: Path, content: bytes | memoryview) -> None:
    """A write that is not atomic."""
    with path.open("wb") as file:
        file.write(content[: len(content) // 2])
        file.flush()
        file.write(content[len(content) // 2 :])


write = GroupStore.write


def write_later(self: GroupStore, chunk: Chunk, data: dict[str, np.ndarray], *environments: Iterable[str]) -> None:
    """A chunk that is reported before it is written."""
    copied = {name: values.copy() for name, values in data.items()}
    later = threading.Timer(0.2, write, (self, chunk, copied, *environments))
    later.start()


def status_first(self: GroupStore, chunk: Chunk, data: dict[str, np.ndarray], *environments: Iterable[str]) -> None:
    """A chunk whose status does not come last."""
    del environments
    *first, last = self.layout.results
    for name in (last, *first):
        self.put(name, chunk, data[name])


drawn = itertools.count()


def next_stream(seed: int, realization: int) -> np.random.Generator:
    """Random numbers by the order in which they are asked for."""
    del realization
    return stream(seed, "noise", next(drawn))


def replace_in_two_steps(old: Path, new: Path) -> None:
    """An old cube that is gone before the new one is there."""
    shutil.rmtree(old)
    new.rename(old)


def there(self: GroupStore, chunk: Chunk) -> ChunkState:
    """Files that are not looked into."""
    if not all(self.chunk_file(name, chunk).exists() for name in self.layout.results):
        return ChunkState.BROKEN
    return ChunkState.NOTED if self.annotated(chunk) else ChunkState.WHOLE


LINES = f"{KILLS}run, between"
SABOTAGES: tuple[tuple[str, Any, str, Any], ...] = (
    (LINES, durable, "write", write_in_place),
    (f"{KILLS}run, any moment", GroupStore, "write", write_later),
    (LINES, GroupStore, "write", status_first),
    (f"{KILLS}run, any moment", experiment, "start_stream", next_stream),
    (f"{KILLS}extend, between", extend, "replace_tree", replace_in_two_steps),
    ("file damaged", GroupStore, "state", there),
)
"""Faults that are tried, and what is replaced by what."""


@contextmanager
def sabotaged(place: Any, name: str, by: Any) -> Iterator[None]:
    honest = getattr(place, name)
    setattr(place, name, by)
    try:
        yield
    finally:
        setattr(place, name, honest)


def noticed(campaign: Campaign, faults: str) -> bool:
    """Whether the campaign finds something lost or wrong, or a run that does not end as it should."""
    campaign.random.seed(SEED)
    for count in (campaign.tried, campaign.lost, campaign.wrong):
        count.clear()
    for kills in range(1, MOST + 1):
        try:
            if kills == 1 and "between" in faults:
                work = campaign.extension if "extend" in faults else campaign.small_run
                campaign.look_at_lines(work)
                campaign.lines[work] = [at for at in campaign.lines[work] if at[0] == __file__]
            campaign.run(kills, faults)
        except AssertionError:
            return True
        if any(campaign.lost.values()) or any(campaign.wrong.values()):
            return True
    return False


def blind(cube: Cube, made_in: dict[str, Any], elsewhere: bool) -> Iterator[tuple[Path, str]]:
    """Metadata that nobody compares."""
    del cube, made_in, elsewhere
    return iter(())


STATE_SABOTAGES: tuple[tuple[Any, str, Any], ...] = (
    (GroupStore, "state", there),
    (GroupStore, "write", status_first),
    (extend, "replace_tree", replace_in_two_steps),
    (verify, "_skeleton_damage", blind),
)
"""What is replaced by what under the state machine."""

HISTORIES = 100
"""Histories after which it counts as unnoticed."""


def states() -> int:
    """Try the state machine under every sabotage; the number of those that went unnoticed."""
    how = settings(state_machine.SETTINGS, max_examples=HISTORIES)
    missed = 0
    for place, name, by in STATE_SABOTAGES:
        state_machine.TRIED.clear()
        found = False
        with sabotaged(place, name, by):
            try:
                state_machine.try_histories(how, aim=__file__)
            except AssertionError:
                found = True
        missed += not found
        n = state_machine.TRIED["histories"]
        print(f"{'noticed' if found else 'MISSED'} in history {n}: {by.__doc__}", flush=True)
    return missed


def main() -> int:
    """Try every sabotage; the number of those that went unnoticed."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    solvers()["lm"] = replace(solvers()["lm"], fits_a_chunk=(8, 8))
    kill_campaign.WRITERS.add(__file__)
    if "--states" in sys.argv[1:]:
        return states()
    missed = 0
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder, open(os.devnull, "w") as nowhere:
        sys.stderr = nowhere
        campaign = Campaign(Path(folder), SEED, realizations=8)
        try:
            for faults, place, name, by in SABOTAGES:
                with sabotaged(place, name, by):
                    found = noticed(campaign, faults)
                missed += not found
                n = sum(campaign.tried.values())
                print(f"{'noticed' if found else 'MISSED'} after {n} faults: {by.__doc__}", flush=True)
        finally:
            forked.kill_all()
    return missed


if __name__ == "__main__":
    sys.exit(main())
