"""One block on a worker: it announces its start and returns its result with the environment of the worker.

A block may wait on a worker behind others, so only the worker knows when it started. Counting these announcements also
separates a block that kills workers from the blocks that waited behind it.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

from distributed import get_worker

from mcstudy.fitting.compilers import warm
from mcstudy.study.environment import environment
from mcstudy.study.kernels import parts_of
from mcstudy.study.tasks import Task, TaskReport, open_group, run_task


@dataclass(frozen=True)
class Failure:
    """The exception of a block, as text: an exception that cannot be pickled would be lost on its way.

    ``disk``: why the store could not be written, if that was the reason.
    """

    reason: str
    disk: str | None


@dataclass(frozen=True)
class Attempt:
    """Result of a block, and the environment of the worker."""

    ended: TaskReport | Failure
    environment: dict[str, Any]


def topic(run: str) -> str:
    """Topic of the scheduler's event log on which the blocks of a run announce their start."""
    return f"mcstudy-{run}"


def attempt(task: Task, key: str) -> Attempt:
    """Announce ``key`` and run the task. A worker that has not compiled the kernels yet does so before it announces."""
    with contextlib.suppress(Exception):  # the block meets it too, and reports it
        warm(parts_of([open_group(task.path, task.study, task.group, task.depth).experiment.group]))
    worker = get_worker()
    worker.log_event(topic(task.run), {"key": key, "worker": worker.address})
    ended: TaskReport | Failure
    try:
        ended = run_task(task)
    except Exception as error:  # whatever a block raises is an outcome of that block
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        disk = (error.strerror or str(error)) if isinstance(error, OSError) else None
        ended = Failure(reason, disk)
    return Attempt(ended, environment())
