"""Which file belongs where: the checksums of one chunk, noted beside its ``status``, and a store that reads by them.

Every file of a chunk ends in its own CRC-32C. That finds a changed byte, but not a file that is gone, or that has
changed places with its neighbour: Zarr reads the one as fill values and the other as numbers. The note says which file
is in which place. It is written after all files of the chunk are on disk and taken back before one of them is written
again, so what it says holds whenever it is there; a chunk without one is being written, or of an older program.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Self

import numpy as np
from google_crc32c import value as crc32c
from zarr.abc.store import ByteRequest
from zarr.core.buffer import Buffer, BufferPrototype

from mcstudy.errors import StoreError
from mcstudy.study import runlog
from mcstudy.study.layout import ArraySpec, Chunk, Layout
from mcstudy.study.untrusted import CubeStore, real_bytes, zstd_claim

LARGEST_NOTE = 1 << 16

TRIES = 5
"""Times a chunk is read that a run changes at the same moment."""

OTHER = "swapped or replaced?"
"""What may have happened to a file whose own checksum is right and which is not that of its place."""

_LINE = re.compile(r"([0-9a-f]{8})  (\S+)")


def note(fingerprint: str, files: Mapping[str, int]) -> bytes:
    """The note of a chunk: the study, the CRC-32C of every file by its place in the cube, and that of the note."""
    lines = (f"{crc:08x}  {file}" for file, crc in files.items())
    text = "\n".join([f"# CRC-32C of the files of one chunk, study {fingerprint}", *lines, ""]).encode()
    return text + f"# {crc32c(text):08x}\n".encode()


def noted(content: bytes, fingerprint: str, files: tuple[str, ...]) -> dict[str, int]:
    """CRC-32C by file, from a note; `ValueError` when it is damaged, or not of these files of this study."""
    lines = [_LINE.fullmatch(line) for line in content.decode("ascii", "replace").splitlines()]
    said = {line[2]: int(line[1], 16) for line in lines if line is not None}
    if tuple(said) != files or note(fingerprint, said) != content:
        raise ValueError
    return said


def checksum(content: bytes) -> int:
    """The CRC-32C that a chunk's file ends in."""
    return int.from_bytes(content[-4:], "little")


class CheckedStore(CubeStore):
    """The store of a cube that knows which chunks there are: one that is missing or out of place is never numbers.

    ``layouts``: of the groups that are read. ``fingerprint``: of the study.
    """

    def __init__(
        self, root: Path | str, layouts: Mapping[str, Layout], fingerprint: str, *, read_only: bool = True
    ) -> None:
        super().__init__(root, read_only=read_only)
        self.layouts, self.fingerprint = layouts, fingerprint

    def with_read_only(self, read_only: bool = False) -> Self:
        """The same store, to read or also to write."""
        return type(self)(self.root, self.layouts, self.fingerprint, read_only=read_only)

    def get_sync(
        self, key: str, *, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """One value; None where a chunk has not been run, `StoreError` where it is missing or another one's."""
        group, _, inner = key.partition("/")
        array, _, name = inner.partition("/")
        layout = self.layouts.get(group)
        chunk = None if layout is None else layout.place(array, name)
        if layout is None or chunk is None:
            value = super().get_sync(key, prototype=prototype, byte_range=byte_range)
            if layout is not None and value is not None and name != "zarr.json":
                self._check_size(key, layout.arrays.get(array), value)
            return value
        wrong = ""
        for _ in range(TRIES):
            before = self._note(group, layout, chunk)
            value = super().get_sync(key, prototype=prototype, byte_range=byte_range)
            wrong = self._wrong(key, group, layout, chunk, before, value)
            if not wrong:
                if value is not None:
                    self._check_size(key, layout.arrays[array], value)
                return value
            if self._note(group, layout, chunk) == before:
                break  # else a run has written the chunk meanwhile
        raise StoreError(wrong)

    def _check_size(self, key: str, spec: ArraySpec | None, value: Buffer) -> None:
        """Raise `StoreError` when a file does not hold as many numbers as its array asks for: it is another one's."""
        if spec is None or spec.dtype == "string":  # whose number is checked when the cube is opened
            return
        expected, claim = math.prod(spec.chunks) * np.dtype(spec.dtype).itemsize, zstd_claim(value.to_bytes())
        if claim != expected:
            raise StoreError(f"{self.root / key}: expected {expected} bytes of numbers, found {claim} ({OTHER})")

    def _note(self, group: str, layout: Layout, chunk: Chunk) -> bytes | None:
        try:
            return real_bytes(self.root / group / layout.note(chunk), LARGEST_NOTE)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise StoreError(
                f"{self.root / group / layout.note(chunk)}: expected a file that can be read ({error.strerror})"
            ) from None

    def _wrong(
        self, key: str, group: str, layout: Layout, chunk: Chunk, content: bytes | None, value: Buffer | None
    ) -> str:
        """What is wrong with a chunk's file, empty if nothing is; ``content``: the note when the file was read."""
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
            if checksum(value.to_bytes()) != said[key]:
                return f"{file}: expected the file whose checksum is in {at}, found another one ({OTHER})"
        elif key != status:
            if value is None and (self.root / status).exists():
                return f"{file}: missing, though the chunk has a status"
        elif value is None and (group, chunk.amplitude, chunk.block) in runlog.reported(self.root, self.fingerprint):
            return f"{file}: missing, though a run has reported the chunk as complete"
        if key == status and value is not None:  # what was run is told by it alone, so nothing else may lack
            for other in files[:-1]:
                if not (self.root / other).is_file():
                    return f"{self.root / other}: missing, though the chunk has a status"
        return ""
