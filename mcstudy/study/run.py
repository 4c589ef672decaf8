"""Run a study: pending chunks are submitted block by block, and every block is on disk when it is reported done.

Only a limited number of blocks is submitted at any time. Therefore memory does not grow with the size of the study, and
a stop leaves little to wait for (`mcstudy.study.execution.submission`).
"""

from __future__ import annotations

import contextlib
import shlex
import threading
import uuid
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from mcstudy import program
from mcstudy.errors import StoreError, StudyChangedError
from mcstudy.files.durable import locked, recover, resumable, sweep
from mcstudy.files.local_path import resolved
from mcstudy.scheduler.cluster import ClusterOptions, connect, reach
from mcstudy.scheduler.compiling import compile_kernels
from mcstudy.scheduler.progress import Progress
from mcstudy.scheduler.stopping import stop_requests
from mcstudy.study import environment, study_file
from mcstudy.study.cube import run_log
from mcstudy.study.cube.checksums import UNKNOWN
from mcstudy.study.cube.repair import Repairs, note_environment, refuse_part, repair, repairable
from mcstudy.study.cube.run_log import RunLog
from mcstudy.study.cube.store import Cube
from mcstudy.study.design import Study
from mcstudy.study.execution.submission import ATTEMPTS, Block, Outcome, Run, Submission
from mcstudy.study.execution.tasks import STOP
from mcstudy.study.extent import chunks_a_block
from mcstudy.study.growth import Growth, growths
from mcstudy.study.instability import refuse_unstable, warnings_of
from mcstudy.study.kernels import compile_for_check, parts_of
from mcstudy.study.watch import Watch

__all__ = ["ATTEMPTS", "Block", "Outcome", "default_out", "open_or_create", "pending_blocks", "run_cube", "run_study"]

SECOND_LOOKS = 2
"""Number of passes over blocks that more than one worker may have run."""


def default_out(study: Study) -> Path:
    """Default path of a study's cube."""
    return Path("results") / f"{study.study.name}.zarr"


def open_or_create(path: Path, study: Study, quarantine: bool = False) -> tuple[Cube, Repairs]:
    """The cube at ``path`` for ``study``, and the repairs made to its metadata and coordinates.

    ``quarantine``: set aside files that do not belong to the cube.

    Raises `StudyChangedError` when it belongs to another study, `StoreError` when its study cannot be determined.
    """
    if held(path, study) is None and not path.exists():
        return Cube.create(path, study), Repairs()
    return repair(path, study, quarantine)


def held(path: Path, study: Study) -> Cube | None:
    """The cube of ``study`` at ``path``; None when there is none yet or it must be repaired first. Changes nothing.

    Raises the errors of `open_or_create`.
    """
    refuse_part(path)
    if not path.exists():
        return None
    try:
        cube = Cube.open(path)
    except StoreError:
        if not repairable(path, study):
            raise
        return None
    if cube.study.fingerprint != study.fingerprint:
        raise StudyChangedError(f"{path}: {_what_changed(path, cube.study, study)}")
    return cube


def _what_changed(path: Path, held: Study, study: Study) -> str:
    """Difference between the study of a cube and the study to be run, and what the user can do."""
    changed = study_file.changes(held, study)
    lines = "; ".join(changed[:5]) + (f"; and {len(changed) - 5} more" if len(changed) > 5 else "")
    if steps := growths(held, study):
        commands = " && ".join(step.command(path) for step in steps)
        return f"was made with {lines} as in this study file; to grow it: {commands}"
    if growths(study, held):
        return (
            f"was extended: it has {lines} as in this study file, and holds all that this file asks for; "
            f"to see it: mcstudy show {shlex.quote(str(path))}; to run what is pending in it: {Growth().command(path)}"
        )
    return f"was made with another study file: {lines} as in this one; give this study a cube of its own (-o)"


def run_study(
    study: Study,
    out: str | Path,
    options: ClusterOptions | None = None,
    block: int | None = None,
    quarantine: bool = False,
    *,
    allow_unstable: bool = False,
) -> Outcome:
    """Run all pending fits of ``study`` in the cube ``out``.

    Parameters
    ----------
    study: a resolved study (`mcstudy.study.study_file.read_study`).
    out: path of the cube; created if it does not exist, otherwise resumed and, where damaged, repaired.
    options: where to run.
    block: chunks per block; by default enough for about half a second.
    quarantine: whether files and folders that do not belong to the cube are moved to a folder next to it.
    allow_unstable: whether the closed loop of the true parameters may be unstable.

    Raises
    ------
    DesignError: the closed loop of a group is unstable and ``allow_unstable`` is false.
    StudyChangedError: the cube belongs to another study.
    StoreError: the cube cannot be used, or another run is writing to it.
    Interrupted: stopped by Ctrl-C, SIGTERM, SIGHUP, a disk that could not be written, or a lost scheduler; the same
        call resumes.
    """
    out, options = resolved(out), options or ClusterOptions()
    compile_for_check(study, fits=options.here)
    refuse_unstable(study, allow_unstable)
    check_scheduler(held(out, study), options)  # what is refused is refused before anything is changed
    with locked(out) as unlocked, resumable(out):
        recover(out)
        if out.exists():
            sweep(out)
        cube, repairs = open_or_create(out, study, quarantine)
        repairs.said[:0] = unlocked
        return run_cube(cube, repairs, options, block)


def check_scheduler(cube: Cube | None, options: ClusterOptions) -> None:
    """Raise `InputError` when a scheduler that will be needed cannot be used; ``cube``: None where all is pending."""
    stores = () if cube is None else cube.groups.values()
    if options.scheduler is not None and (
        not stores or any(not s.annotated(c) for s in stores for c in s.layout.chunks)
    ):
        reach(options)


def run_cube(cube: Cube, repairs: Repairs, options: ClusterOptions, block: int | None) -> Outcome:
    """Run all pending fits of a cube whose lock the caller holds; ``repairs`` are shown and logged."""
    out, study = cube.path, cube.study
    run = uuid.uuid4().hex[:12]
    log, here = RunLog(out, run, study.fingerprint), environment.environment()
    outcome = Outcome(out)
    noted = _annotate(cube, here)
    blocks = list(pending_blocks(cube, options.threads, block))
    total = sum(b.fits for b in blocks)
    outcome.skipped = study.fits - total
    progress = Progress(total, chunks=sum(len(b.chunks) for b in blocks), headlines=Watch(cube).news)
    differ = "; ".join(environment.differences(cube.attributes["environment"], here))
    log.add(
        "begin",
        made_in=cube.attributes["environment"],
        environment=here,
        pending_fits=total,
        threads=options.threads,
        repaired=repairs.written,
    )
    _log_presence(cube, blocks, log)
    for line in (*repairs.said, *(f"repaired: {file}" for file in repairs.written)):
        progress.say(line)
    if noted:
        progress.say(f"repaired: missing checksums of {noted} chunks")
    for line in warnings_of(study):
        progress.say(f"warning: {line}")
    if total and not program.unchanged():
        progress.say("warning: files of mcstudy have changed since this process started: it may run parts of both")
    if total and differ:
        progress.say(f"warning: the cube was created in another environment, so last digits may differ: {differ}")
    if blocks:
        note_environment(cube, here)
        with _stop_requests(run, partial(progress.how_far, out)) as stop, connect(options, progress.say) as client:
            if options.here:  # other workers do so themselves before their first block
                compile_kernels(parts_of(study.groups.values()), stop)
            progress.begin(ready=options.here)
            submission = Submission(cube, client, options, Run(run, stop, log, progress, outcome))
            submission.warned.add(differ)
            doubtful = submission.run(deque(blocks))
            for _ in range(SECOND_LOOKS):
                again = deque(_unsound(cube, doubtful, log, here))
                if not again:
                    break
                doubtful = submission.run(again)
            for lost in _unsound(cube, doubtful, log, here):
                outcome.failed_blocks.append(f"{lost}: reported as done, but not in the cube")
    outcome.seconds = progress.seconds
    log.add("end", fits=outcome.fits, seconds=round(outcome.seconds, 3), failed_blocks=outcome.failed_blocks)
    return outcome


def _log_presence(cube: Cube, blocks: list[Block], log: RunLog) -> None:
    """Log the chunks whose presence is not as the log has it."""
    pending = {(b.group, c.amplitude, c.block) for b in blocks for c in b.chunks}
    chunks = {(name, c.amplitude, c.block) for name, store in cube.groups.items() for c in store.layout.chunks}
    reported = run_log.reported(cube.path, cube.study.fingerprint)
    if gone := sorted(pending & reported):
        log.add("taken_back", chunks=gone)
    if new := sorted(chunks - pending - reported):  # of an extended cube, or of a log that lost lines
        log.add("present", chunks=new)


def _annotate(cube: Cube, here: dict[str, Any]) -> int:
    """Store the checksums of complete chunks that lack them: a kill came before that step, or the cube is older.

    A chunk that lacks an estimate it should hold is set back to pending. Returns the number of new checksum files.
    """
    noted = 0
    for store in cube.groups.values():
        for chunk in store.layout.chunks:
            if store.annotated(chunk) or store.pending(chunk):
                continue
            if store.consistent(chunk):
                store.annotate(chunk, _probably(cube, here))
                noted += 1
            else:
                store.forget(chunk)
    return noted


def _probably(cube: Cube, here: dict[str, Any]) -> tuple[str, ...]:
    """Environments of a chunk without a checksum file: the cube's, unless it can have been another."""
    alone = here == cube.attributes["environment"] and not cube.attributes.get("environments")
    return () if alone else (UNKNOWN,)


def _unsound(cube: Cube, blocks: list[Block], log: RunLog, here: dict[str, Any]) -> Iterator[Block]:
    """Chunks that two workers may have written at once, and whose later write was the less complete one."""
    for block in blocks:
        store = cube.groups[block.group]
        for chunk in block.chunks:
            if not store.consistent(chunk):
                log.add("taken_back", chunks=[[block.group, chunk.amplitude, chunk.block]])
                store.forget(chunk)
            if left := store.pending(chunk):
                yield Block(block.group, (chunk,), left)
            elif not store.annotated(chunk):  # the other worker set it back to pending and did not finish it
                store.annotate(chunk, _probably(cube, here))


def pending_blocks(cube: Cube, threads: int, per_block: int | None) -> Iterator[Block]:
    """All pending blocks, in the order of the study file."""
    for name, store in cube.groups.items():
        pending = {chunk: n for chunk in store.layout.chunks if (n := store.pending(chunk))}
        chunks = list(pending)
        size = per_block or chunks_a_block(store.layout, len(chunks), threads)
        for k in range(0, len(chunks), size):
            part = tuple(chunks[k : k + size])
            yield Block(name, part, sum(pending[c] for c in part))


@contextlib.contextmanager
def _stop_requests(run: str, words: Callable[[], str]) -> Iterator[threading.Event]:
    """`stop_requests` that also reach the blocks of a run that run in this process."""
    with stop_requests(words) as stop:
        STOP[run] = stop  # for good: a block that a thread begins after the end of its run stops too
        try:
            yield stop
        finally:
            stop.set()  # blocks that still run when something failed
