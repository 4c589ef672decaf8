"""``mcstudy`` with fits that return at once: ``python -m pipelines.benchmarks.instant ARGUMENTS...``.

Scheduler, store and verbs run unchanged. Only what fills a chunk with the results of fits is replaced: it draws numbers
(`benchmarks.invented`). Blocks run in threads of this process, so the replacement reaches them; a cluster would fit.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

from mcstudy.cli import main, outcome
from mcstudy.fitting.status import Status
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.store import GroupStore
from mcstudy.study.execution import tasks
from pipelines.benchmarks.invented import invented


def fill(store: GroupStore, chunk: Chunk, data: dict[str, np.ndarray], stopped: Callable[[], bool]) -> None:
    """Stands in for `mcstudy.study.execution.tasks.fill`: every pending fit gets its numbers, unless ``stopped()``."""
    if stopped():
        return
    pending = data["status"] == Status.PENDING
    for name, values in invented(store, chunk).items():
        if "fmax" in store.layout.arrays[name].dims:  # one value or row per fit
            data[name][pending] = values[pending]
        else:
            data[name][...] = values


if __name__ == "__main__":
    tasks.fill = fill
    outcome.LEAST_FITS = sys.maxsize  # the statistics are measured where they are looked at
    sys.exit(main())
