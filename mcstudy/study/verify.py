"""Check a cube against its study: metadata, checksums, impossible values, and a sample of recomputed fits.

Metadata and coordinates are compared with those of a new empty cube of the same study. All chunks are read completely.
Randomly chosen fits are run again and compared bit for bit or, where they were computed in another environment, within
a tolerance.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from mcstudy.errors import StoreError
from mcstudy.files.durable import tree_digest
from mcstudy.files.json_files import plain
from mcstudy.files.local_path import local_path
from mcstudy.files.schema import identifier
from mcstudy.files.sections import leaves
from mcstudy.files.untrusted import real_bytes
from mcstudy.fitting.status import NOT_RUN, USABLE, Status
from mcstudy.scheduler.activity import doing
from mcstudy.streams import stream
from mcstudy.study import environment
from mcstudy.study.cube import identity, run_log
from mcstudy.study.cube.checksums import LARGEST_NOTE, OTHER, OWN, TRIES, checksum, noted
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.repair import skeleton
from mcstudy.study.cube.replacement import settled
from mcstudy.study.cube.rounding import TOLERANCE, Compared, alike, apart, compared
from mcstudy.study.cube.store import Cube, GroupStore
from mcstudy.study.cube.strays import NOT_PART, parts, strays
from mcstudy.study.execution.tasks import again, left_out

T = TypeVar("T")

SCHEMA = "verification"

STARTS_A_CELL = 4
"""Number of starts recomputed in each sampled cell, at every Fmax."""


@dataclass
class Findings:
    """Result of `verify`.

    Attributes
    ----------
    damage: one line per finding, each naming a file or a cell.
    beyond: cells computed in another environment that differ from what comes out here by more than that explains.
    notes: information that is no damage.
    elsewhere: cells computed in another environment that differ bit for bit from what comes out here.
    chunks, pending, recomputed: chunks checked, fits not run yet, fits run again.
    digest: SHA-256 of the tree (`mcstudy.files.durable.tree_digest`).
    """

    damage: list[str] = field(default_factory=list)
    beyond: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    elsewhere: Compared = field(default_factory=Compared)
    chunks: int = 0
    pending: int = 0
    recomputed: int = 0
    digest: str = ""

    def text(self, path: Path) -> str:
        """What was found, in lines; the last one counts."""
        lines = [f"note: {note}" for note in self.notes]
        lines += [f"damage: {line}" for line in self.damage]
        lines += [f"differs by more than rounding explains (computed in another environment): {x}" for x in self.beyond]
        other = ""
        if cells := self.elsewhere.cells:
            lines.append(
                f"computed in another environment, and not bit for bit what comes out here: {cells} cells; "
                f"{self.elsewhere.text()}"
            )
            kind = "beyond" if self.beyond else "within"
            other = f", {cells} cells not reproduced here (other environment, {kind} the tolerance)"
        lines.append(
            f"{path}: {len(self.damage)} damaged{other}; {self.chunks} chunks read, "
            f"{self.recomputed} fits recomputed, {self.pending} not run yet"
        )
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """What was found, as the schema ``verification`` describes it."""
        compared = plain(asdict(self.elsewhere) | {"within": not self.beyond})
        return {
            "schema": identifier(SCHEMA),
            "damage": self.damage,
            "notes": self.notes,
            "beyond": self.beyond,
            "other_environment": compared if self.elsewhere.cells else None,
            "chunks": self.chunks,
            "recomputed": self.recomputed,
            "pending": self.pending,
            "sha256": self.digest,
        }


def verify(path: str | Path, cells: int = 20, seed: int = 0, tolerance: float = TOLERANCE) -> Findings:
    """Check a cube.

    Parameters
    ----------
    path: the cube.
    cells: number of (amplitude, realization) cells to recompute, chosen at random over all groups.
    seed: random seed of this choice.
    tolerance: relative difference of data and costs that another environment explains.

    Raises
    ------
    StoreError: nothing can be checked, because the study stored in the cube cannot be read.
    """
    path = local_path(path)
    return settled([path], lambda: _verify(path, cells, seed, tolerance))


def _verify(path: Path, cells: int, seed: int, tolerance: float) -> Findings:
    findings = Findings(elsewhere=Compared(tolerance))
    cube = _readable(path, findings)
    made_in, now = identity.made_in(path) or cube.attributes["environment"], environment.environment()
    others = identity.environments(path)
    cube.attributes |= {"environment": made_in, "environments": others}
    if lines := environment.differences(made_in, now):
        findings.notes.append(f"made in another environment: {'; '.join(lines)}")
    skeleton_damage = list(_skeleton_damage(cube, made_in, made_in != now))
    findings.damage += [f"{file}: {what}" for file, what in skeleton_damage]
    damaged = {file for file, _ in skeleton_damage}
    sound: list[tuple[GroupStore, Chunk]] = []
    if lost := run_log.unreadable(path):
        findings.notes.append(
            f"{run_log.file(path)}: {lost} line{'s' * (lost > 1)} cannot be read (a stop in the middle, or damage): "
            "a chunk that was reported there alone, and is lost, counts as not run yet"
        )
    reported = run_log.reported(path, cube.study.fingerprint)
    with_checksums = run_log.reported(path, cube.study.fingerprint, checksums=True)
    seen: dict[tuple[str, int], dict[bytes, int]] = {}
    for name, store in cube.groups.items():
        findings.notes += _without_checksums(store, with_checksums)
        unreadable = {array for array in store.layout.results if store.path / array / "zarr.json" in damaged}
        for chunk in store.layout.chunks:
            findings.chunks += 1
            doing(f"{path}: reading chunk {findings.chunks}, group {name}")
            damage = _still(store, chunk, partial(_damage_of, store, chunk, unreadable))
            status_file = store.chunk_file("status", chunk)
            if (name, chunk.amplitude, chunk.block) in reported and _lost(cube, name, chunk):
                damage = [f"{status_file}: missing, though a run has reported the chunk as complete"]
            elif (name, chunk.amplitude, chunk.block) in with_checksums and not store.annotated(chunk):
                damage.append(f"{store.note_file(chunk)}: missing, though a run has reported the chunk as complete")
            findings.damage += damage
            if unreadable:
                continue  # the content of the chunk is unknown until this is repaired
            if not damage and (left := store.pending(chunk)) < store.layout.fits(chunk):
                findings.pending += left
                sound.append((store, chunk))
                findings.damage += _repeated(store, chunk, seen.setdefault((name, chunk.amplitude), {}))
            elif not damage:
                findings.pending += store.layout.fits(chunk)
    findings.notes += _other_environments(cube, [(s, c) for s, c in sound if s.environments(c)], now)
    rng = stream(seed, "verify")
    chosen = rng.permutation(len(sound))[:cells].tolist()
    for number, k in enumerate(chosen, 1):
        doing(f"{path}: repeating the fits of cell {number} of {len(chosen)}")
        store, chunk = sound[k]
        _recompute(store, chunk, rng, findings, apart(cube, store, chunk, now))
    findings.digest = tree_digest(path)
    return findings


def _repeated(store: GroupStore, chunk: Chunk, seen: dict[bytes, int]) -> Iterator[str]:
    """Realizations with the data of another one of the same amplitude; ``seen``: realizations by their data."""
    if not store.experiment.group.noisy:
        return
    for realization, frf in zip(store.layout.realizations(chunk), store.read("frf", chunk)[0], strict=True):
        first = seen.setdefault(frf.tobytes(), realization) if np.isfinite(frf).all() else realization
        if first != realization:
            yield (
                f"{store.chunk_file('frf', chunk)}: expected noise of its own in every realization, "
                f"found the data of {first} in {realization}"
            )


def _still(store: GroupStore, chunk: Chunk, read: Callable[[], T]) -> T:
    """What ``read`` returns of a chunk that no run writes meanwhile: half of it old and half new looks like damage."""
    files = [*(store.chunk_file(name, chunk) for name in store.layout.results), store.note_file(chunk)]

    def state() -> list[tuple[int, int] | None]:
        return [(about.st_ino, about.st_mtime_ns) if (about := _about(file)) else None for file in files]

    for _ in range(TRIES):
        before = state()
        reading = read()
        if state() == before:
            break
    return reading


def _about(file: Path) -> os.stat_result | None:
    with contextlib.suppress(OSError):
        return file.lstat()
    return None


def _damage_of(store: GroupStore, chunk: Chunk, unreadable: set[str]) -> list[str]:
    return list(_chunk_damage(store, chunk, unreadable))


def _lost(cube: Cube, group: str, chunk: Chunk) -> bool:
    """Whether a chunk that was reported has no status, and no run that writes it again has said so meanwhile."""
    if cube.groups[group].chunk_file("status", chunk).exists():
        return False
    return (group, chunk.amplitude, chunk.block) in run_log.reported(cube.path, cube.study.fingerprint)


def _other_environments(cube: Cube, sound: list[tuple[GroupStore, Chunk]], now: dict[str, Any]) -> Iterator[str]:
    """Chunks that were computed in another environment than the cube's, by that environment."""
    count = Counter(name for store, chunk in sound for name in store.environments(chunk) if name != OWN)
    for name, chunks in sorted(count.items()):
        known = cube.attributes["environments"].get(name)
        how = "not known" if known is None else "; ".join(environment.differences(known, now)) or "this one"
        yield f"{chunks} chunks were computed, in part or whole, in environment {name}: {how}"


def _readable(path: Path, findings: Findings) -> Cube:
    try:
        return Cube.open(path)
    except StoreError as error:
        cube = Cube.open_unchecked(path)
        findings.damage.append(str(error))
        return cube


def _skeleton_damage(cube: Cube, made_in: dict[str, Any], elsewhere: bool) -> Iterator[tuple[Path, str]]:
    """Differences of metadata and constant arrays from those of a new cube of the same study: (file, difference).

    ``elsewhere``: the cube was made in another environment, so that last digits may differ.
    """
    expected = skeleton(cube, made_in, cube.attributes["environments"])
    files = parts(cube, expected)
    for path in sorted(cube.path / file for file in files):
        if path.is_symlink():
            yield path, "expected a file or a folder, found a link"
    for stray in strays(cube.path, files):
        path = cube.path / stray.path
        if path.is_symlink():
            yield path, "expected a file or a folder, found a link"
        elif stray.in_the_way:
            yield path, "expected a file, found a folder" if path.is_dir() else "expected a folder, found a file"
        else:
            yield path, NOT_PART
    for file, content in expected.items():
        if (cube.path / file).is_symlink() or (cube.path / file).is_dir():
            continue  # named above
        if not (cube.path / file).exists():
            yield cube.path / file, "missing"
        elif (actual := real_bytes(cube.path / file)) != content and not (
            _reordered(content, actual) or (elsewhere and alike(cube, file, content, actual))
        ):
            yield cube.path / file, _difference(content, actual)


def _reordered(expected: bytes, actual: bytes) -> bool:
    """Whether a document holds the same in another order: that of groups whose names differ in case is the disk's."""
    if sorted(expected) != sorted(actual):
        return False
    try:
        return bool(json.loads(expected) == json.loads(actual))
    except ValueError:
        return False


def _difference(expected: bytes, actual: bytes) -> str:
    try:
        old, new = json.loads(expected), json.loads(actual)
    except ValueError:
        return "content differs from that of the study"
    new_values = dict(leaves(new))
    for field_name, value in leaves(old):
        if (other := new_values.get(field_name)) != value:
            return f"{field_name}: expected {value!r}, found {other!r}"[:300]
    return "holds fields that the study does not"


def _without_checksums(store: GroupStore, reported: set[tuple[str, int, int]]) -> Iterator[str]:
    """Finished chunks without stored checksums."""
    chunks = [c for c in store.layout.chunks if store.chunk_file("status", c).exists() and not store.annotated(c)]
    files = [store.note_file(c) for c in chunks if (store.name, c.amplitude, c.block) not in reported]
    why = "a file of the chunk that was swapped with another would not be noticed; mcstudy run notes them"
    if files:
        more = f" and {len(files) - 1} more" if len(files) > 1 else ""
        yield f"{files[0]}{more}: no checksums (from an older program or a stopped run): {why}"


def _chunk_damage(store: GroupStore, chunk: Chunk, unreadable: set[str]) -> Iterator[str]:
    """Missing and damaged files of a chunk, and values that no run can have written.

    ``unreadable``: arrays with damaged metadata; their chunk files are not reported as damaged for that reason.
    """
    status_file, note_file = store.chunk_file("status", chunk), store.note_file(chunk)
    if not status_file.exists():
        if store.annotated(chunk):
            yield f"{status_file}: missing, though its checksum is in {note_file}"
        return  # status is written last: other files without it belong to a run that was stopped
        # (for the same reason a pending fit may have an estimate already)
    said: dict[str, int] | None = None
    if note_file.is_file() and not note_file.is_symlink():
        try:
            said = noted(real_bytes(note_file, LARGEST_NOTE), store.fingerprint, store.files(chunk))
        except (ValueError, StoreError):
            yield f"{note_file}: expected the checksums of its chunk of this study"
    files = zip(store.layout.results, store.files(chunk), strict=True)
    faults = [_file_damage(store, name, chunk, None if said is None else said[place]) for name, place in files]
    yield from filter(None, faults)
    if not (unreadable or any(fault is not None for fault in faults) or (said is None and store.annotated(chunk))):
        yield from _content_damage(store, chunk)


def _file_damage(store: GroupStore, name: str, chunk: Chunk, sealed: int | None) -> str | None:
    """What is wrong with the file of an array: empty when that is reported elsewhere, None when nothing is."""
    file = store.chunk_file(name, chunk)
    if file.is_symlink() or file.is_dir():
        return ""  # already reported among the files that do not belong to the cube
    if not file.exists():
        return f"{file}: missing"
    if store.seal(name, chunk) is None:
        return f"{file}: checksum does not match (a changed byte or a truncated file)"
    if sealed is not None and checksum(real_bytes(file)) != sealed:
        note_file = store.note_file(chunk)
        return f"{file}: expected the file whose checksum is in {note_file}, found another one ({OTHER})"
    return None


def _content_damage(store: GroupStore, chunk: Chunk) -> Iterator[str]:
    """Values that no run can have written."""
    data: dict[str, np.ndarray] = {}
    for name in store.layout.results:
        try:
            data[name] = store.read(name, chunk)
        except StoreError as error:
            yield str(error)
    if len(data) < len(store.layout.results):
        return
    status_file = store.chunk_file("status", chunk)
    status, model = data["status"], store.experiment.model
    if not np.isin(status, [int(s) for s in Status]).all():
        yield f"{status_file}: a status that does not exist"
    expected, whole_cells = left_out(store.layout.group, status, data["cost"]), (status != Status.PENDING).all(axis=-1)
    if (expected != status)[whole_cells].any():
        yield f"{status_file}: starts marked as not needed where they are needed, or the other way round"
    usable = np.isin(status, USABLE)
    estimate = data["estimate"][usable]
    if not ((estimate >= model.lower) & (estimate <= model.upper)).all():
        yield f"{store.chunk_file('estimate', chunk)}: an estimate outside the bounds"
    if not (data["cost"][usable] >= 0).all():
        yield f"{store.chunk_file('cost', chunk)}: a negative or missing cost of a finished fit"


def _recompute(
    store: GroupStore, chunk: Chunk, rng: np.random.Generator, findings: Findings, elsewhere: list[str]
) -> None:
    """Run a few fits of one realization of a chunk again and compare all arrays with the stored ones.

    ``elsewhere``: in what the environment of the chunk differs from this one.
    """
    group, realizations = store.layout.group, store.layout.realizations(chunk)
    r = int(rng.integers(len(realizations)))
    stored = _still(store, chunk, lambda: store.held(chunk))
    chosen = np.zeros(stored["status"].shape, dtype=bool)
    ran = ~np.isin(stored["status"], NOT_RUN)
    some = np.flatnonzero(ran[0, :, r].any(axis=0))
    chosen[0, :, r, rng.choice(some, min(STARTS_A_CELL, some.size), replace=False)] = True
    chosen &= ran
    recomputed = again(store, chunk, stored, chosen)
    findings.recomputed += int(chosen.sum())
    differ = [n for n in store.layout.results if stored[n].tobytes() != recomputed[n].tobytes()]
    where = (
        f"{store.chunk_file('status', chunk)}: amplitude {group.amplitude[chunk.amplitude]:g}, realization "
        f"{realizations[r]}: "
    )
    if differ and not elsewhere:
        findings.damage.append(f"{where}recomputed values differ from the stored ones ({', '.join(differ)})")
    elif differ:
        comparison = compared(store, chunk, r, (stored, recomputed), chosen, findings.elsewhere.tolerance)
        findings.elsewhere.add(comparison)
        if not comparison.within:
            findings.beyond.append(f"{where}{comparison.text()}")
