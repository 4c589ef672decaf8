"""Extend a cube by realizations, starts, Fmax values or amplitudes; only the new cells are run.

Random streams are keyed by coordinate values, so a cell has the same bits in a small and in a large study. The chunks
differ, however. Therefore the larger cube is built next to the old one from its finished cells and then replaces it in
one step.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.errors import StoreError
from mcstudy.files.durable import locked, recover, recoverable, replace_tree, resumable, sweep, unwritable
from mcstudy.files.local_path import resolved
from mcstudy.fitting.status import Status
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube.checksums import OWN
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.repair import refuse_part, repair
from mcstudy.study.cube.store import ChunkState, Cube, GroupStore
from mcstudy.study.design import Study
from mcstudy.study.growth import Growth, grown_study
from mcstudy.study.run import Outcome, check_scheduler, run_cube

CELL = ("amplitude", "fmax", "realization", "start")


__all__ = ["Growth", "extend", "grow", "grown_study"]


def extend(out: str | Path, growth: Growth, options: ClusterOptions | None = None, block: int | None = None) -> Outcome:
    """Extend the cube ``out`` and run its pending fits.

    A stop at any moment leaves either the old or the new cube at ``out``, complete and with all finished fits; the same
    call resumes.

    Raises
    ------
    DesignError: the extension is empty or gives no valid study. StoreError, Interrupted: as `run_study`.
    """
    out, options = resolved(out), options or ClusterOptions()
    if not recoverable(out):
        cube = _extensible(out, growth)  # what is refused is refused before anything is changed
        grows = grown_study(cube.study, growth).fingerprint != cube.study.fingerprint
        check_scheduler(None if grows else cube, options)
    with locked(out) as unlocked, resumable(out):
        recover(out)
        sweep(out)
        old, repairs = repair(out, _extensible(out, growth).study)
        repairs.said[:0] = unlocked
        return run_cube(grow(old, growth), repairs, options, block)


def _extensible(out: Path, growth: Growth) -> Cube:
    """The cube at ``out``, for which the extension is possible."""
    refuse_part(out)
    cube = Cube.open(out)
    grown_study(cube.study, growth)
    return cube


def grow(old: Cube, growth: Growth) -> Cube:
    """Replace ``old`` by the larger cube, with its finished cells copied; the caller holds the lock of the cube."""
    study, out = grown_study(old.study, growth), old.path
    building = out.with_name(f".{out.name}.extending")
    if study.fingerprint == old.study.fingerprint:
        shutil.rmtree(building, ignore_errors=True)
        return old
    new = _begin(building, study, old)
    try:
        for name, store in new.groups.items():
            if (source := old.groups.get(name)) is None:  # a further cell of a sweep
                continue
            for chunk in store.layout.chunks:
                match store.state(chunk):
                    case ChunkState.BROKEN:
                        _copy(source, store, chunk)
                    case ChunkState.WHOLE:  # a kill came before the last step
                        store.annotate(chunk, _environments(source, store, chunk))
        replace_tree(out, building)
    except OSError as error:
        raise unwritable(out, "disk space for a larger copy of the cube next to it", error) from None
    return Cube.open(out)


def _begin(building: Path, study: Study, old: Cube) -> Cube:
    """The cube being built: the remainder of an interrupted call for the same extension, or a new one."""
    try:
        left = Cube.open(building)
        if left.study.fingerprint == study.fingerprint and _made(left) == _made(old):
            sweep(building)
            return left
    except StoreError:
        pass
    shutil.rmtree(building, ignore_errors=True)
    made_in, others = _made(old)
    return Cube.create(building, study, made_in, others=others)


def _made(cube: Cube) -> tuple[dict[str, Any], dict[str, Any]]:
    """The environment that a cube was created in, and the others that its chunks name."""
    return cube.attributes["environment"], cube.attributes.get("environments", {})


def _copy(old: GroupStore, new: GroupStore, chunk: Chunk) -> None:
    """Write a chunk of the new cube with all cells that the old cube has; write nothing if there are none."""
    a, b = old.layout.group, new.layout.group
    if b.amplitude[chunk.amplitude] not in a.amplitude:
        return
    amplitude = a.amplitude.index(b.amplitude[chunk.amplitude])
    at_fmax = [b.fmax.index(f) for f in a.fmax]
    cell_axes = (np.arange(1), np.array(at_fmax))
    starts = np.arange(a.starts)

    @lru_cache(maxsize=2)
    def chunk_of(block: int) -> dict[str, np.ndarray]:
        return old.existing(Chunk(amplitude, block))

    data, depth = new.layout.empty(chunk), old.layout.realizations_a_chunk
    for r, realization in enumerate(new.layout.realizations(chunk)):
        if realization >= a.realizations:
            break
        source = chunk_of(realization // depth)
        for name, dims in _results(new):
            if dims[:4] == CELL:
                place = np.ix_(*cell_axes, np.array([r]), starts)
                data[name][place] = source[name][:, :, [realization % depth]]
            elif "fmax" in dims:  # of the best of all starts: computed again where there are more of them
                if a.starts == b.starts:
                    data[name][0, at_fmax, r] = source[name][0, :, realization % depth]
            else:
                data[name][0, r] = source[name][0, realization % depth]
    if (data["status"] != Status.PENDING).any():
        new.write(chunk, data, _environments(old, new, chunk))


def _environments(old: GroupStore, new: GroupStore, chunk: Chunk) -> tuple[str, ...]:
    """Environments that the cells of a new chunk come from; none if that is the cube's alone."""
    amplitude = old.layout.group.amplitude.index(new.layout.group.amplitude[chunk.amplitude])
    depth, n = old.layout.realizations_a_chunk, old.layout.group.realizations
    blocks = {r // depth for r in new.layout.realizations(chunk) if r < n}
    named = [set(old.environments(Chunk(amplitude, block))) or {OWN} for block in blocks]
    made = set().union(*named)
    return () if made <= {OWN} else tuple(sorted(made))


def _results(store: GroupStore) -> Iterator[tuple[str, tuple[str, ...]]]:
    for name in store.layout.results:
        yield name, store.layout.arrays[name].dims
