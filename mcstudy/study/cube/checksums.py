"""Checksum files, one per chunk, and a store that checks every chunk against them.

Every file of a chunk ends in its own CRC-32C. That detects a changed byte, but neither a missing file, which Zarr reads
as fill values, nor two swapped files, which Zarr reads as numbers. The checksum file of a chunk lists the checksum of
every file by its path. It is written after all files of the chunk are on disk and removed before one of them is written
again, so it is correct whenever it exists. A chunk without it is being written or comes from an older program.

It also names the environments that the chunk was computed in, if any of them is not the one that the cube was created
in; what the names stand for is in the attribute ``environments`` of the cube.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from google_crc32c import value as crc32c

from mcstudy.errors import StoreError
from mcstudy.files.untrusted import cube_bytes, real_bytes, zstd_claim
from mcstudy.study.cube import run_log
from mcstudy.study.cube.layout import ArraySpec, Chunk, Layout
from mcstudy.study.cube.metadata import whole_document
from mcstudy.study.cube.replacement import Stamp, stamp

LARGEST_NOTE = 1 << 16

TRIES = 5
"""Number of attempts to read a chunk that a run is changing at the same time."""

OTHER = "swapped or replaced?"
"""Probable cause when a file is intact but its checksum is not the one listed for its path."""

OWN, UNKNOWN = "own", "unknown"
"""Names of the environment that the cube was created in, where a checksum file names others besides it, and of one
that is not known: a kill came before the checksum file was written."""

_LINE = re.compile(r"([0-9a-f]{8})  (\S+)")

_ENVIRONMENTS = "# environments "


def note(fingerprint: str, files: Mapping[str, int], environments: Iterable[str] = ()) -> bytes:
    """Content of a checksum file: the study, the CRC-32C of every file by its path, and that of the text itself.

    ``environments``: labels of those that the chunk was computed in; none if that is the cube's alone.
    """
    named = " ".join(sorted(environments))
    lines = [f"# CRC-32C of the files of one chunk, study {fingerprint}", *([_ENVIRONMENTS + named] if named else [])]
    lines += [f"{crc:08x}  {file}" for file, crc in files.items()]
    text = "\n".join([*lines, ""]).encode()
    return text + f"# {crc32c(text):08x}\n".encode()


def noted(content: bytes, fingerprint: str, files: tuple[str, ...]) -> dict[str, int]:
    """CRC-32C by file, read from a checksum file; `ValueError` if it is damaged or of other files or another study."""
    lines = [_LINE.fullmatch(line) for line in content.decode("ascii", "replace").splitlines()]
    said = {line[2]: int(line[1], 16) for line in lines if line is not None}
    if tuple(said) != files or note(fingerprint, said, environments_of(content)) != content:
        raise ValueError
    return said


def environments_of(content: bytes) -> tuple[str, ...]:
    """Labels of the environments that a checksum file names; none where the chunk was computed in the cube's alone."""
    lines = content.decode("ascii", "replace").splitlines()
    named = (line.removeprefix(_ENVIRONMENTS) for line in lines if line.startswith(_ENVIRONMENTS))
    return tuple(next(named, "").split())


def checksum(content: bytes) -> int:
    """The CRC-32C that a chunk's file ends in."""
    return int.from_bytes(content[-4:], "little")


class Checked:
    """Reads the files of a cube by its stored checksums: a missing or swapped chunk gives an error, not numbers.

    ``layouts``: layouts of the groups that are read. ``fingerprint``: of the study. ``since``: `stamp` of the cube when
    it was opened, so that another one in its place gives an error that says so.
    """

    def __init__(self, root: Path, layouts: Mapping[str, Layout], fingerprint: str, since: Stamp | None = None) -> None:
        self.root, self.layouts, self.fingerprint, self.since = root, layouts, fingerprint, since

    def content(self, key: str) -> bytes | None:
        """One value; None where a chunk has not been run, `StoreError` where it is missing or swapped."""
        try:
            value = self._content(key)
        except StoreError:
            self._refuse_another()
            raise
        self._refuse_another()
        return value

    def _refuse_another(self) -> None:
        """Raise `StoreError` when the cube of another study is in the place of the one that was opened."""
        if self.since is None or stamp(self.root) == self.since:
            return
        fingerprint = whole_document(self.root).get("attributes", {}).get("fingerprint")
        if fingerprint != self.fingerprint:
            raise StoreError(f"{self.root}: replaced by another cube since it was opened; open it again")
        self.since = stamp(self.root)  # its root was repaired

    def _content(self, key: str) -> bytes | None:
        group, _, inner = key.partition("/")
        array, _, name = inner.partition("/")
        layout = self.layouts.get(group)
        chunk = None if layout is None else layout.place(array, name)
        if layout is None or chunk is None:
            value = cube_bytes(self.root, key)
            if layout is not None and value is not None and name != "zarr.json":
                self._check_size(key, layout.arrays.get(array), value)
            return value
        wrong = ""
        for _ in range(TRIES):
            before = self._note(group, layout, chunk)
            value = cube_bytes(self.root, key)
            wrong = self._wrong(key, group, layout, chunk, before, value)
            if not wrong:
                if value is not None:
                    self._check_size(key, layout.arrays[array], value)
                return value
            if self._note(group, layout, chunk) == before:
                break  # otherwise a run has written the chunk meanwhile
        raise StoreError(wrong)

    def _check_size(self, key: str, spec: ArraySpec | None, value: bytes) -> None:
        """Raise `StoreError` when a file does not hold as many numbers as its array requires: it was swapped."""
        if spec is None or spec.dtype == "string":  # whose number is checked when the cube is opened
            return
        expected, claim = math.prod(spec.chunks) * np.dtype(spec.dtype).itemsize, zstd_claim(value)
        if claim != expected:
            raise StoreError(f"{self.root / key}: expected {expected} bytes of numbers, found {claim} ({OTHER})")

    def _note(self, group: str, layout: Layout, chunk: Chunk) -> bytes | None:
        try:
            return real_bytes(self.root / group / layout.note(chunk), LARGEST_NOTE)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise StoreError(
                f"{self.root / group / layout.note(chunk)}: expected a readable file ({error.strerror})"
            ) from None

    def _wrong(
        self, key: str, group: str, layout: Layout, chunk: Chunk, content: bytes | None, value: bytes | None
    ) -> str:
        """Description of what is wrong with a chunk's file, else empty; ``content``: its checksum file at that time."""
        files = tuple(f"{group}/{array}/{layout.key(array, chunk)}" for array in layout.results)
        status, file = files[-1], self.root / key
        if content is not None:
            at = self.root / group / layout.note(chunk)
            try:
                said = noted(content, self.fingerprint, files)
            except ValueError:
                return f"{at}: expected the checksums of its chunk of this study"
            if value is None:
                return f"{file}: missing, though its checksum is in {at}"
            if checksum(value) != said[key]:
                return f"{file}: expected the file whose checksum is in {at}, found another one ({OTHER})"
        elif key != status:
            if value is None and (self.root / status).exists():
                return f"{file}: missing, though the chunk has a status"
        elif value is None and (group, chunk.amplitude, chunk.block) in run_log.reported(self.root, self.fingerprint):
            return f"{file}: missing, though a run has reported the chunk as complete"
        if key == status and value is not None:  # status alone tells what was run, so no other file may be missing
            for other in files[:-1]:
                if not (self.root / other).is_file():
                    return f"{self.root / other}: missing, though the chunk has a status"
        return ""
