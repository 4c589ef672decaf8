"""One block on a worker: it announces its start and returns its result with the environment of the worker.

A block may wait on a worker behind others, so only the worker knows when it started. Counting these announcements also
separates a block that kills workers from the blocks that waited behind it.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from distributed import get_worker

from mcstudy.fitting.compilers import warm
from mcstudy.study.environment import environment, label
from mcstudy.study.execution import trust
from mcstudy.study.execution.tasks import Task, TaskReport, open_group, run_task
from mcstudy.study.experiment import Experiment
from mcstudy.study.kernels import parts_of


@dataclass(frozen=True)
class Failure:
    """The exception of a block, as text: an exception that cannot be pickled would be lost on its way.

    ``disk``: why the store could not be written, if that was the reason.
    """

    reason: str
    disk: str | None


@dataclass(frozen=True)
class Unlike:
    """A worker in another environment has not run a block yet; ``sample``: bits of a few fits (`trust`).

    The sample is empty when the worker runs other source code.
    """

    sample: str


@dataclass(frozen=True)
class Attempt:
    """Result of a block, the environment of the worker and its address."""

    ended: TaskReport | Failure | Unlike
    environment: dict[str, Any]
    worker: str


@dataclass(frozen=True)
class Trusted:
    """Environments whose bits are taken.

    Attributes
    ----------
    here: of the process that runs the study. made_in: label of the one that the cube was created in.
    agreed: others (label, group) that agreed in a sample of a group.
    """

    here: dict[str, Any]
    made_in: str
    agreed: frozenset[tuple[str, str]] = frozenset()


def topic(run: str) -> str:
    """Topic of the scheduler's event log on which the blocks of a run announce their start."""
    return f"mcstudy-{run}"


def attempt(task: Task, key: str, trusted: Trusted) -> Attempt:
    """Announce ``key`` and run the task. A worker that has not compiled the kernels yet does so before it announces.

    A worker in an environment that is not trusted for this group runs a sample of its fits instead.
    """
    worker, here = get_worker(), _environment(task.run)
    with contextlib.suppress(Exception):  # the block meets it too, and reports it
        warm(parts_of([_experiment(task).group]))
    ended: TaskReport | Failure | Unlike
    try:
        if here == trusted.here or (label(here), task.group) in trusted.agreed:
            worker.log_event(topic(task.run), {"key": key, "worker": worker.address})
            ended = run_task(task if label(here) == trusted.made_in else replace(task, here=label(here)))
        else:
            ended = Unlike(trust.sample(_experiment(task)) if trust.same_source(here, trusted.here) else "")
    except Exception as error:  # whatever a block raises is an outcome of that block
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        disk = (error.strerror or str(error)) if isinstance(error, OSError) else None
        ended = Failure(reason, disk)
    return Attempt(ended, here, worker.address)


@lru_cache(maxsize=8)
def _environment(run: str) -> dict[str, Any]:
    """Environment of this process when the first block of a run came: a file edited since does not end the run."""
    del run
    return environment()


def _experiment(task: Task) -> Experiment:
    return open_group(task.path, task.study, task.group, task.depth).experiment
