"""What runs on a worker: one block, announced when it starts, with the environment it ran in.

A block waits on a worker behind others, so only the worker can say when its time began, and only counting these
announcements tells the block that kills workers from those that waited behind it.
"""

from __future__ import annotations

from typing import Any

from distributed import get_worker

from mcstudy.study.environment import environment
from mcstudy.study.tasks import Report, Task, run_task


def topic(run: str) -> str:
    """Topic of the scheduler's event log on which the blocks of a run announce their start."""
    return f"mcstudy-{run}"


def attempt(task: Task, key: str) -> tuple[Report, dict[str, Any]]:
    """Announce ``key``, run the task; its report and the environment of the worker."""
    worker = get_worker()
    worker.log_event(topic(task.run), {"key": key, "worker": worker.address})
    return run_task(task), environment()
