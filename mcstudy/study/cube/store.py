"""The results cube on disk: a Zarr v3 group tree, one group per group of the study.

- It can be opened with ``xarray.open_zarr(path, group=...)``. Zarr creates it; `encoding` writes chunks.
- Every chunk is one file, compressed with zstd and followed by a CRC-32C: a flipped bit gives an error, not a number.
- The ``status`` of a chunk is written after all its other files are on disk; status 0 means "pending".
- The checksums of a chunk's files are stored after that, so that a missing or swapped file gives an error, too.
- The tree holds no times, host names or other traces of the run: the same study gives the same bytes.
"""

from __future__ import annotations

import os
import shutil
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from mcstudy.errors import DesignError, StoreError
from mcstudy.files import durable, schema
from mcstudy.files.durable import sync_folder, sync_tree, unwritable
from mcstudy.files.local_path import local_path
from mcstudy.files.unfinished import unfinished
from mcstudy.files.untrusted import LARGEST_CHUNK, real_bytes, real_end, refuse_links, sealed
from mcstudy.fitting.status import USABLE, Status
from mcstudy.study.cube.checksums import LARGEST_NOTE, Checked, checksum, environments_of, note, noted
from mcstudy.study.cube.encoding import codecs, decoded, encoded
from mcstudy.study.cube.layout import ArraySpec, Chunk, ChunkData, Layout, realizations_a_chunk, with_empty_angle
from mcstudy.study.cube.metadata import (
    KEYS,
    check_array,
    chunk_bytes,
    depth_votes,
    describe,
    holds_empty_angle,
    own_document,
)
from mcstudy.study.design import Study
from mcstudy.study.environment import environment
from mcstudy.study.experiment import Experiment
from mcstudy.study.study_file import parse_study

if TYPE_CHECKING:
    import zarr

SCHEMA = "study_cube"

T = TypeVar("T")

WRITERS = 16
"""Number of threads that wait for the disk."""


class ChunkState(Enum):
    """What is on disk of a chunk."""

    BROKEN = "a part is missing or damaged, or is not the one whose checksum is stored: all its fits count as pending"
    WHOLE = "every part is intact, but no checksums are stored: a kill came before that step, or the cube is older"
    NOTED = "every part is intact and the one whose checksum is stored"


class GroupStore:
    """One group of a cube: reading and writing whole chunks.

    ``stored``: its arrays on disk, which are those of its ``layout`` but in ``older`` cubes (`with_empty_angle`); None
    looks there.
    """

    def __init__(
        self,
        path: Path,
        name: str,
        experiment: Experiment,
        depth: int,
        fingerprint: str,
        older: bool | None = None,
    ) -> None:
        self.path, self.name, self.experiment, self.fingerprint = path / name, name, experiment, fingerprint
        self.layout: Layout = experiment.layout(depth)
        single = experiment.model.n_rows == 1 and not experiment.model.outputs
        self.older = single and (holds_empty_angle(self.path) if older is None else older)
        self.stored = with_empty_angle(self.layout) if self.older else self.layout

    def write(self, chunk: Chunk, data: dict[str, np.ndarray], environments: Iterable[str] = ()) -> None:
        """Write one chunk: arrays, folders, status, checksums, in this order; on return all of it is on disk.

        ``environments``: labels of those that it was computed in; none if that is the cube's alone.
        """
        *first, last = self.layout.results
        self._take_back(self.note_file(chunk))
        sums = _together(lambda name: self.put(name, chunk, data[name]), first)
        _together(lambda name: sync_folder(self.path / name), first)
        sums.append(self.put(last, chunk, data[last]))
        sync_folder(self.path / last)
        self._annotate(chunk, self._note(chunk, sums, environments))

    def put(self, name: str, chunk: Chunk, values: np.ndarray) -> int:
        """Write one array of a chunk and return its CRC-32C; its name is durable once the array's folder is synced."""
        content = encoded(self.stored.arrays[name], values)
        durable.write(self.chunk_file(name, chunk), content)
        return checksum(content)

    def read(self, name: str, chunk: Chunk) -> np.ndarray:
        """One array of a chunk; fill values where it was never written.

        Needs neither Zarr, which is slow to import, nor the metadata of the array, which follow from the study.
        Raises `StoreError` when it is damaged or, according to the stored checksums, missing or swapped.
        """
        spec, key = self.stored.arrays[name], f"{self.name}/{name}/{self.layout.key(name, chunk)}"
        content = Checked(self.path.parent, {self.name: self.stored}, self.fingerprint).content(key)
        if content is None:
            return self.layout.empty(chunk)[name]
        try:
            whole = decoded(spec, content)
        except Exception as error:  # every codec fails on damaged bytes with its own exceptions
            raise StoreError(f"{self.chunk_file(name, chunk)}: damaged ({_reason(error)})") from None
        size = dict(zip(spec.dims, self.layout.arrays[name].shape, strict=True))
        size["realization"] = len(self.layout.realizations(chunk))  # the last chunk of an axis is filled up
        return whole[tuple(slice(size[dim]) for dim in spec.dims)].copy()

    def chunk_file(self, name: str, chunk: Chunk) -> Path:
        """The file of one array's chunk."""
        return self.path / name / self.layout.key(name, chunk)

    def seal(self, name: str, chunk: Chunk) -> int | None:
        """CRC-32C of an array's chunk if it is on disk and correct, else None; reads the file without decoding it."""
        try:
            content = real_bytes(self.chunk_file(name, chunk))
        except (OSError, StoreError):
            return None
        return checksum(content) if sealed(content) else None  # it is the outermost codec

    def note_file(self, chunk: Chunk) -> Path:
        """The file with the checksums of a chunk's files (`mcstudy.study.cube.checksums`)."""
        return self.path / self.layout.note(chunk)

    def note(self, chunk: Chunk, environments: Iterable[str] = ()) -> bytes:
        """Content of the checksum file for the chunk's present files; `OSError` or `StoreError` if they are missing."""
        sums = [checksum(real_bytes(self.chunk_file(name, chunk))) for name in self.layout.results]
        return self._note(chunk, sums, environments)

    def _note(self, chunk: Chunk, sums: list[int], environments: Iterable[str] = ()) -> bytes:
        return note(self.fingerprint, dict(zip(self.files(chunk), sums, strict=True)), environments)

    def files(self, chunk: Chunk) -> tuple[str, ...]:
        """The files of a chunk by their path in the cube, in the order of writing."""
        return tuple(f"{self.name}/{name}/{self.layout.key(name, chunk)}" for name in self.layout.results)

    def annotated(self, chunk: Chunk) -> bool:
        """Whether a chunk has stored checksums; a chunk that is being written has none, nor have older cubes."""
        return os.path.lexists(self.note_file(chunk))

    def annotate(self, chunk: Chunk, environments: Iterable[str] = ()) -> None:
        """Store the checksums of a chunk that has none; ``environments`` as in `write`."""
        self._annotate(chunk, self.note(chunk, environments))

    def environments(self, chunk: Chunk) -> tuple[str, ...]:
        """Labels of the environments that a chunk was computed in; none where that is the cube's alone."""
        try:
            return environments_of(real_bytes(self.note_file(chunk), LARGEST_NOTE))
        except (OSError, StoreError):
            return ()

    def _annotate(self, chunk: Chunk, content: bytes) -> None:
        durable.write(self.note_file(chunk), content)
        sync_folder(self.note_file(chunk).parent)

    def state(self, chunk: Chunk) -> ChunkState:
        """What is on disk of a chunk; reads every byte of it."""
        sums = [self.seal(name, chunk) for name in self.layout.results]
        if None in sums:
            return ChunkState.BROKEN
        if not self.annotated(chunk):
            return ChunkState.WHOLE
        try:
            said = real_bytes(self.note_file(chunk), LARGEST_NOTE)
        except (OSError, StoreError):
            return ChunkState.BROKEN
        noted = said == self._note(chunk, [crc for crc in sums if crc is not None], environments_of(said))
        return ChunkState.NOTED if noted else ChunkState.BROKEN

    def status(self, chunk: Chunk) -> np.ndarray | None:
        """Status of every fit of a chunk, None when it is not whole: a quick look, which reads little of a large cube.

        Of the other arrays only the ends of the files are compared with the stored checksums, which finds missing,
        swapped and truncated files; `state` reads every byte.
        """
        try:
            if not self.annotated(chunk):
                return None if self.state(chunk) is ChunkState.BROKEN else self.read("status", chunk)
            said = noted(real_bytes(self.note_file(chunk), LARGEST_NOTE), self.fingerprint, self.files(chunk))
            ends = (checksum(real_end(self.chunk_file(name, chunk), 4)) for name in self.layout.results)
            return self.read("status", chunk) if tuple(ends) == tuple(said.values()) else None
        except (OSError, StoreError, ValueError):
            return None

    def consistent(self, chunk: Chunk) -> bool:
        """Whether a chunk is intact and holds an estimate exactly where its status says so."""
        if self.state(chunk) is ChunkState.BROKEN:
            return False
        usable = np.isin(self.read("status", chunk), USABLE)
        estimated = np.isfinite(self.read("estimate", chunk)).all(axis=-1)
        return bool(((np.isfinite(self.read("cost", chunk)) == usable) & (estimated == usable)).all())

    def pending(self, chunk: Chunk) -> int:
        """Number of fits of a chunk still to run; all of them when any part of it is missing or damaged."""
        if self.state(chunk) is ChunkState.BROKEN:
            return self.layout.fits(chunk)
        return int(np.count_nonzero(self.read("status", chunk) == Status.PENDING))

    def existing(self, chunk: Chunk) -> ChunkData:
        """Present content of a chunk, or all fill values when any part of it is missing or damaged."""
        return self.layout.empty(chunk) if self.state(chunk) is ChunkState.BROKEN else self.held(chunk)

    def taken_up(self, chunk: Chunk) -> ChunkData:
        """Like `existing`, for a chunk that will be written again: damaged content is removed first.

        Otherwise a kill between two arrays could leave an old status together with unfinished new arrays.
        """
        if self.state(chunk) is ChunkState.BROKEN:
            self.forget(chunk)
            return self.layout.empty(chunk)
        return self.held(chunk)

    def held(self, chunk: Chunk) -> ChunkData:
        """Every array of a chunk as it is on disk."""
        return ChunkData({name: self.read(name, chunk) for name in self.layout.results})

    def forget(self, chunk: Chunk) -> None:
        """Set all fits of a chunk back to pending, on disk."""
        self._take_back(self.note_file(chunk), self.chunk_file(self.layout.results[-1], chunk))

    def _take_back(self, *files: Path) -> None:
        """Remove files of one folder, durably."""
        there = [file for file in files if os.path.lexists(file)]
        for file in there:
            file.unlink()
        if there:
            sync_folder(there[0].parent)


class Cube:
    """A cube on disk and the study it belongs to.

    ``depths``: realizations per chunk, by group; a new cube takes them from the design, an existing one keeps its own.
    ``older``: groups of the form of earlier versions (`GroupStore`); None looks on disk.
    """

    def __init__(
        self,
        path: Path,
        study: Study,
        attributes: dict[str, Any],
        depths: dict[str, int],
        older: Collection[str] | None = None,
    ) -> None:
        self.path, self.study, self.attributes, self.depths, self.older = path, study, attributes, depths, older

    @cached_property
    def groups(self) -> dict[str, GroupStore]:
        """The groups, in the order of the study file."""
        return {
            name: GroupStore(
                self.path,
                name,
                Experiment(group, self.study.study.seed),
                self.depths[name],
                self.study.fingerprint,
                None if self.older is None else name in self.older,
            )
            for name, group in self.study.groups.items()
        }

    @classmethod
    def create(
        cls,
        path: str | Path,
        study: Study,
        made_in: dict[str, Any] | None = None,
        depths: dict[str, int] | None = None,
        others: Mapping[str, dict[str, Any]] | None = None,
        older: Collection[str] = (),
    ) -> Cube:
        """Create an empty cube; it appears at ``path`` complete and on disk, or not at all.

        ``made_in`` is the environment to store and ``depths`` are the realizations per chunk; defaults are the present
        environment and the layout of the design. ``others``: further environments that its chunks will name.
        ``older``: as in `Cube`.
        Raises `StoreError` when ``path`` cannot be written.
        """
        path = local_path(path)
        depths = depths or {name: realizations_a_chunk(group) for name, group in study.groups.items()}
        building = path.with_name(f".{path.name}.creating")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if building.exists():
                shutil.rmtree(building)
            attributes = _root_attributes(study, made_in or environment())
            if others:
                attributes["environments"] = dict(sorted(others.items()))
            cube = cls(building, study, attributes, depths, older)
            with unfinished(building, building.mkdir):
                _refuse_one_name(building, list(cube.groups))
                for name, content in _files(_Empty.of(cube)).items():
                    (building / name).parent.mkdir(parents=True, exist_ok=True)
                    (building / name).write_bytes(content)
                schema.validate(SCHEMA, describe(building), str(path))
                sync_tree(building)
                building.rename(path)
                sync_folder(path.parent)
        except OSError as error:
            raise unwritable(path, "a writable folder", error) from None
        return cls(path, study, attributes, depths, older)

    @classmethod
    def open(cls, path: str | Path) -> Cube:
        """Open an existing cube; raises `StoreError` when it is not one this version can use.

        The file is untrusted: the arrays are compared with those that the study requires before any of them is read.
        """
        path = local_path(path)
        description = describe(path)
        schema_name = description["attributes"].get("schema")
        if schema_name != schema.identifier(SCHEMA):
            raise StoreError(f"{path}: expected a cube of schema {schema.identifier(SCHEMA)!r}, found {schema_name!r}")
        schema.validate(SCHEMA, description, str(path))
        depths = {name: group["attributes"]["realizations_a_chunk"] for name, group in description["groups"].items()}
        cube = cls._of(path, description["attributes"], depths)
        cube._check_arrays(description["groups"])
        return cube

    def _check_arrays(self, metadata: dict[str, Any]) -> None:
        if set(metadata) != set(self.groups):
            raise StoreError(f"{self.path}: expected groups {', '.join(self.groups)}, found {', '.join(metadata)}")
        for name, group in self.groups.items():
            if chunk_bytes(group.stored) > LARGEST_CHUNK:
                raise StoreError(
                    f"{group.path}: realizations_a_chunk: expected chunks of at most {LARGEST_CHUNK} bytes"
                )
            if metadata[name]["attributes"].get("design") != group.experiment.group.model_dump(mode="json"):
                raise StoreError(f"{group.path / 'zarr.json'}: attribute design: expected the group of the study")
            fingerprint = self.study.fingerprint
            if metadata[name]["attributes"].get("fingerprint", fingerprint) != fingerprint:
                raise StoreError(
                    f"{group.path / 'zarr.json'}: attribute fingerprint: expected {fingerprint}, as in the root"
                )
            for array, spec in group.stored.arrays.items():
                document = metadata[name]["arrays"].get(array)
                if document is None:
                    raise StoreError(f"{group.path / array}: missing")
                check_array(group.path / array, document, spec)
            for array in set(metadata[name]["arrays"]) - set(group.layout.arrays):
                raise StoreError(f"{group.path / array}: expected no such array in this group")

    @classmethod
    def open_unchecked(cls, path: str | Path) -> Cube:
        """Open a cube whose metadata may be damaged, by the study it names; raises `StoreError` without one."""
        path = local_path(path)
        refuse_links(path)
        attributes = own_document(path).get("attributes", {})
        for name, kind in (("study", str), ("fingerprint", str), ("environment", dict)):
            if not isinstance(attributes.get(name), kind):
                raise StoreError(
                    f"{path / 'zarr.json'}: attribute {name}: missing; expected the root of a results cube"
                )
        return cls._of(path, attributes, depth_votes(path))

    @classmethod
    def _of(cls, path: Path, attributes: dict[str, Any], depths: dict[str, int]) -> Cube:
        try:
            study = parse_study(attributes["study"])
        except DesignError as error:
            raise StoreError(f"{path}: attribute study: {error}") from None
        if study.fingerprint != attributes["fingerprint"]:
            raise StoreError(f"{path}: attribute fingerprint: expected {study.fingerprint}, the study's own hash")
        full_depths = {name: depths.get(name, realizations_a_chunk(group)) for name, group in study.groups.items()}
        return cls(path, study, attributes, full_depths)


def _refuse_one_name(folder: Path, names: list[str]) -> None:
    """Raise `StoreError` where the file system takes two of the names for one, as some do of upper and lower case."""
    for k, name in enumerate(names):
        for other in names[:k]:
            if name.casefold() == other.casefold():
                (folder / other).mkdir()
                same = (folder / name).exists()
                (folder / other).rmdir()
                if same:
                    raise StoreError(
                        f"{folder.parent}: group.{name}: expected names that this file system can tell apart, "
                        f"got {other} and {name}"
                    )


@cache
def _writers() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(WRITERS, "mcstudy-writer")


def _together(work: Callable[[str], T], names: Iterable[str]) -> list[T]:
    """Do ``work`` for all names in parallel and wait for all of them; raises the first error.

    A file system commits concurrent syncs together: a chunk takes a tenth of the time that it takes file by file.
    """
    futures = [_writers().submit(work, name) for name in names]
    wait(futures)
    return [future.result() for future in futures]


def _root_attributes(study: Study, made_in: dict[str, Any]) -> dict[str, Any]:
    return {
        "schema": schema.identifier(SCHEMA),
        "title": study.study.name,
        "study": study.to_toml(),
        "fingerprint": study.fingerprint,
        "seed": study.study.seed,
        "environment": made_in,
    }


def _group_attributes(group: GroupStore, root: dict[str, Any]) -> dict[str, Any]:
    model = group.experiment.model
    return {
        # Repeated from the root: a group opened alone has its provenance, and damage to one copy can be repaired.
        "fingerprint": root["fingerprint"],
        "environment": root["environment"],
        "design": group.experiment.group.model_dump(mode="json"),
        "model": model.name,
        "truth_provenance": model.provenance,
        "stimulus_unit": model.stimulus_unit,
        "realizations_a_chunk": group.layout.realizations_a_chunk,
    }


KEPT = 16
"""Empty cubes whose files stay in memory: a run needs them several times, and Zarr takes half a second."""


@dataclass(frozen=True)
class _Empty:
    """An empty cube, known by a text that holds all that decides about its files."""

    text: str
    cube: Cube = field(compare=False)

    @classmethod
    def of(cls, cube: Cube) -> _Empty:
        groups = {
            name: (_group_attributes(group, cube.attributes), [*map(_content, group.stored.arrays.items())])
            for name, group in cube.groups.items()
        }
        return cls(repr((cube.attributes, groups)), cube)


def _content(item: tuple[str, ArraySpec]) -> tuple[str, ArraySpec, Any]:
    """What decides about the files of an array, so that its ``repr`` is all of it."""
    name, spec = item
    return name, replace(spec, values=None), None if spec.values is None else np.asarray(spec.values).tolist()


@lru_cache(KEPT)
def _files(empty: _Empty) -> dict[str, bytes]:
    """Every file of an empty cube, by its path in the cube."""
    import zarr
    from zarr.errors import ZarrUserWarning
    from zarr.storage import MemoryStore

    held: dict[str, Any] = {}
    root = zarr.create_group(MemoryStore(held), zarr_format=3, attributes=empty.cube.attributes)
    made: dict[str, str] = {}
    for name, group in empty.cube.groups.items():
        node = root.create_group(name, attributes=_group_attributes(group, empty.cube.attributes))
        for item in group.stored.arrays.items():
            place = f"{name}/{item[0]}/"
            if (equal := made.setdefault(repr(_content(item)), place)) == place:
                _create(node, item[1])
            else:  # groups are often alike in all but a few arrays, and Zarr takes several times as long as a copy
                held |= {place + key.removeprefix(equal): held[key] for key in list(held) if key.startswith(equal)}
    with warnings.catch_warnings():
        # inline metadata is not in the v3 specification; without it, xarray.open_zarr prints a warning
        warnings.simplefilter("ignore", ZarrUserWarning)
        for name in empty.cube.groups:
            zarr.consolidate_metadata(root.store, path=name)
        zarr.consolidate_metadata(root.store)
    return {key: value.to_bytes() for key, value in held.items()}


def _create(node: zarr.Group, spec: ArraySpec) -> None:
    array = node.create_array(
        spec.name,
        shape=spec.shape,
        chunks=spec.chunks,
        dtype=str if spec.dtype == "string" else spec.dtype,
        fill_value=spec.fill,
        compressors=codecs(),
        dimension_names=spec.dims,
        attributes=spec.attributes,
        chunk_key_encoding=KEYS,
        config={"write_empty_chunks": True},
    )
    if spec.values is not None:
        array[...] = spec.values


def _reason(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
