"""What runs on a worker: one block, announced when it starts, with the environment it ran in.

A block waits on a worker behind others, so only the worker can say when its time began, and only counting these
announcements tells the block that kills workers from those that waited behind it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from distributed import get_worker

from mcstudy.study.environment import environment
from mcstudy.study.tasks import Report, Task, run_task


@dataclass(frozen=True)
class Failure:
    """What a block raised, as text: an exception that cannot be pickled would be lost on its way, and waited for.

    ``disk``: why the store could not be written, if that is what it was.
    """

    reason: str
    disk: str | None


@dataclass(frozen=True)
class Attempt:
    """How a block ended, and the environment of the worker."""

    ended: Report | Failure
    environment: dict[str, Any]


def topic(run: str) -> str:
    """Topic of the scheduler's event log on which the blocks of a run announce their start."""
    return f"mcstudy-{run}"


def attempt(task: Task, key: str) -> Attempt:
    """Announce ``key`` and run the task."""
    worker = get_worker()
    worker.log_event(topic(task.run), {"key": key, "worker": worker.address})
    ended: Report | Failure
    try:
        ended = run_task(task)
    except Exception as error:  # whatever a block raises is an outcome of that block
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        disk = (error.strerror or str(error)) if isinstance(error, OSError) else None
        ended = Failure(reason, disk)
    return Attempt(ended, environment())
