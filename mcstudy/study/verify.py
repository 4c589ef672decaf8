"""Is a cube what its study says it is: metadata, checksums, values that may not be, and a sample recomputed.

Metadata and coordinates are compared with those of an empty cube made afresh from the study, chunks are read whole,
and randomly chosen fits are run again and compared bit for bit.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.errors import StoreError
from mcstudy.fit.status import USABLE, Status
from mcstudy.study import environment, identity, runlog
from mcstudy.study.durable import PARTIAL
from mcstudy.study.layout import Chunk
from mcstudy.study.repair import skeleton
from mcstudy.study.store import Cube, GroupStore
from mcstudy.study.streams import stream
from mcstudy.study.tasks import fill
from mcstudy.study.untrusted import real_bytes

STARTS_A_CELL = 4
"""Starts recomputed of each sampled cell, at every Fmax."""


@dataclass
class Verdict:
    """What was looked at and what is wrong.

    Attributes
    ----------
    damage: one line per finding, each naming a file or a cell.
    notes: what is worth knowing but not wrong.
    chunks, pending, recomputed: chunks checked, fits not run yet, fits run again.
    """

    damage: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    chunks: int = 0
    pending: int = 0
    recomputed: int = 0


def verify(path: Path, cells: int = 20, seed: int = 0) -> Verdict:
    """Check a cube.

    Parameters
    ----------
    path: the cube.
    cells: (amplitude, realization) cells to recompute, chosen at random over all groups.
    seed: chooses them.

    Raises
    ------
    StoreError: nothing of it can be checked, since its own study cannot be read.
    """
    verdict = Verdict()
    cube = _readable(path, verdict)
    made_in, now = identity.made_in(path) or cube.attributes["environment"], environment.environment()
    for line in environment.differences(made_in, now):
        verdict.notes.append(f"made in another environment: {line}")
    skeleton_damage = list(_skeleton_damage(cube, made_in))
    verdict.damage += [f"{file}: {what}" for file, what in skeleton_damage]
    damaged = {file for file, _ in skeleton_damage}
    sound: list[tuple[GroupStore, Chunk]] = []
    reported = runlog.reported(path, cube.study.fingerprint)
    for name, store in cube.groups.items():
        unreadable = {array for array in store.layout.results if store.path / array / "zarr.json" in damaged}
        for chunk in store.layout.chunks:
            verdict.chunks += 1
            damage = list(_chunk_damage(store, chunk, unreadable))
            status_file = store.chunk_file("status", chunk)
            if (name, chunk.amplitude, chunk.block) in reported and not status_file.exists():
                damage.append(f"{status_file}: missing, though a run has reported the chunk as complete")
            verdict.damage += damage
            if unreadable:
                continue  # what is in the chunk cannot be told before that is repaired
            if not damage and (left := store.pending(chunk)) < store.layout.fits(chunk):
                verdict.pending += left
                sound.append((store, chunk))
            elif not damage:
                verdict.pending += store.layout.fits(chunk)
    rng = stream(seed, "verify")
    for k in rng.permutation(len(sound))[:cells].tolist():
        store, chunk = sound[k]
        _recompute(store, chunk, rng, verdict)
    return verdict


def _readable(path: Path, verdict: Verdict) -> Cube:
    try:
        return Cube.open(path)
    except StoreError as error:
        cube = Cube.open_unchecked(path)
        verdict.damage.append(str(error))
        return cube


def _skeleton_damage(cube: Cube, made_in: dict[str, Any]) -> Iterator[tuple[Path, str]]:
    """Metadata and constant arrays against those of the same study made afresh: file, what is wrong."""
    expected = skeleton(cube, made_in)
    chunks = {
        store.chunk_file(name, chunk).relative_to(cube.path)
        for store in cube.groups.values()
        for chunk in store.layout.chunks
        for name in store.layout.results
    }
    found = set()
    for path in cube.path.rglob("*"):
        if path.is_symlink():
            yield path, "expected a file or a folder, found a link"
        elif path.is_file():
            found.add(path.relative_to(cube.path))
    for file, content in expected.items():
        if file not in found:
            yield cube.path / file, "missing"
        elif (actual := real_bytes(cube.path / file)) != content:
            yield cube.path / file, _difference(content, actual)
    for file in sorted(found - set(expected) - chunks):
        if not file.name.endswith(PARTIAL):
            yield cube.path / file, "not part of the cube"


def _difference(expected: bytes, actual: bytes) -> str:
    try:
        old, new = json.loads(expected), json.loads(actual)
    except ValueError:
        return "content differs from that of the study"
    for field_name, value in _leaves("", old):
        other = dict(_leaves("", new)).get(field_name)
        if other != value:
            return f"{field_name}: expected {value!r}, found {other!r}"[:300]
    return "holds fields that the study does not"


def _leaves(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _leaves(f"{path}.{key}" if path else key, inner)
    else:
        yield path, value


def _chunk_damage(store: GroupStore, chunk: Chunk, unreadable: set[str]) -> Iterator[str]:
    """Missing and damaged files of a chunk, and values no run can have written.

    ``unreadable``: arrays whose own metadata is damaged; sound files of theirs are not to blame for it.
    """
    status_file = store.chunk_file("status", chunk)
    if not status_file.exists():
        return  # status is written last: whatever else is there belongs to a run that was stopped
        # (for the same reason a pending fit may have an estimate already)
    data: dict[str, np.ndarray] = {}
    for name in store.layout.results:
        file = store.chunk_file(name, chunk)
        if file.is_symlink():
            continue  # named with the files that do not belong
        if not file.exists():
            yield f"{file}: missing"
        elif not store.intact(name, chunk):
            yield f"{file}: checksum does not match (a changed byte or a truncated file)"
        elif name not in unreadable:
            try:
                data[name] = store.read(name, chunk)
            except StoreError as error:
                yield str(error)
    if len(data) < len(store.layout.results):
        return
    status, model = data["status"], store.experiment.model
    if not np.isin(status, [int(s) for s in Status]).all():
        yield f"{status_file}: a status that does not exist"
    usable = np.isin(status, USABLE)
    estimate = data["estimate"][usable]
    if not ((estimate >= model.lower) & (estimate <= model.upper)).all():
        yield f"{store.chunk_file('estimate', chunk)}: an estimate outside the bounds"
    if not (data["cost"][usable] >= 0).all():
        yield f"{store.chunk_file('cost', chunk)}: a negative or missing cost of a finished fit"


def _recompute(store: GroupStore, chunk: Chunk, rng: np.random.Generator, verdict: Verdict) -> None:
    """Run a few fits of one realization of a chunk again, as if they were pending, and compare all arrays."""
    group, realizations = store.layout.group, store.layout.realizations(chunk)
    r = int(rng.integers(len(realizations)))
    stored = {name: store.read(name, chunk) for name in store.layout.results}
    again = {name: values.copy() for name, values in stored.items()}
    chosen = np.zeros(stored["status"].shape, dtype=bool)
    chosen[0, :, r, rng.choice(group.starts, min(STARTS_A_CELL, group.starts), replace=False)] = True
    chosen &= stored["status"] != Status.PENDING
    again["status"][chosen] = Status.PENDING
    waiting = stored["status"] == Status.PENDING
    again["status"][waiting] = Status.SOLVER_ERROR  # not chosen: keep `fill` away from them
    fill(store, chunk, again, lambda: False)
    for name in store.layout.results:
        if "fmax" in store.layout.arrays[name].dims:  # a value or row a fit
            again[name][waiting] = stored[name][waiting]  # what a fit not run yet holds is nobody's promise
    verdict.recomputed += int(chosen.sum())
    differ = [n for n in store.layout.results if stored[n].tobytes() != again[n].tobytes()]
    if differ:
        verdict.damage.append(
            f"{store.chunk_file('status', chunk)}: amplitude {group.amplitude[chunk.amplitude]:g}, realization "
            f"{realizations[r]}: recomputed values differ from the stored ones ({', '.join(differ)})"
        )
