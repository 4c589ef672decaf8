"""Reading files that a stranger may have made: regular files only, no links, nothing larger than it may be.

A Zarr store names its codecs, shapes and sizes itself. Links could lead out of it, and the header of a compressed
chunk may claim any size, which the decoder would allocate. Here a file is looked at before a codec sees it.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import re
import stat
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from google_crc32c import value as crc32c
from zarr.abc.store import ByteRequest
from zarr.core.buffer import Buffer, BufferPrototype, default_buffer_prototype
from zarr.storage import LocalStore

from mcstudy.errors import StoreError

LARGEST_CHUNK = 1 << 29
"""Bytes that one stored chunk may decode to; a study file may not ask for larger ones."""

LARGEST_METADATA = 20_000_000
"""Bytes of one metadata document: a thousand groups need fewer."""

DEEPEST_KEY = 16

DEEPEST_VALUE = 64
"""Tables and lists inside each other in a JSON document; ours have at most ten."""

LONGEST_WHOLE = 20
"""Digits of a whole number in a JSON document: no integer of 64 bits has more."""

_PART = r"""(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')"""

DEEP_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{DEEPEST_KEY}}}")
"""A dotted key of more than `DEEPEST_KEY` parts."""

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


def real_bytes(path: Path, limit: int = LARGEST_CHUNK, follow: bool = False) -> bytes:
    """Content of a regular file of at most ``limit`` bytes; `StoreError` for anything else, `OSError` as `open`.

    ``follow``: whether the name may be a link, as that of a file the user gave may.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | (0 if follow else os.O_NOFOLLOW))
    status = os.fstat(handle)
    if not stat.S_ISREG(status.st_mode):
        os.close(handle)
        what = "a folder" if stat.S_ISDIR(status.st_mode) else "something else"
        raise StoreError(f"{path}: expected a regular file, found {what}")
    with os.fdopen(handle, "rb") as file:
        if status.st_size > limit:
            raise StoreError(f"{path}: expected at most {limit} bytes, found {status.st_size}")
        return file.read(limit)


def toml(text: str) -> dict[str, Any]:
    """A TOML document; `ValueError`, one line, for what is none, or nests deeper than any of ours."""
    # The parser keeps every prefix of a dotted key: 200 kB of "a.a.a..." would take 40 GB.
    if DEEP_KEY.search(text):
        raise ValueError(f"expected keys of at most {DEEPEST_KEY} parts")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(" ".join(str(error).split())) from None


def json_document(content: bytes) -> Any:
    """A JSON document in UTF-8; `ValueError`, one line, for what is none.

    Python's parser takes more than JSON and more than we can use: NaN and infinities, numbers beyond any float, a key
    given twice (the last one counts), halves of characters that cannot be printed, nesting that only a deeper stack
    can walk. None of that is a document here.
    """
    try:
        value = json.loads(
            content.decode("utf-8"),
            parse_constant=_no_number,
            parse_float=_finite,
            parse_int=_whole,
            object_pairs_hook=_once_each,
        )
        if b"\\u" in content:
            json.dumps(value, ensure_ascii=False).encode("utf-8")
    except UnicodeDecodeError:
        raise ValueError("expected UTF-8 text") from None
    except UnicodeEncodeError:
        raise ValueError("expected whole characters, found one half of a surrogate pair") from None
    except RecursionError:
        raise ValueError(f"expected nesting of at most {DEEPEST_VALUE} levels") from None
    _shallow(value)
    return value


def _no_number(text: str) -> float:
    raise ValueError(f"expected finite numbers, found {text}")


def _finite(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _no_number(text[:40])


def _whole(text: str) -> int:
    if len(text.lstrip("-")) > LONGEST_WHOLE:
        raise ValueError(f"expected whole numbers of at most {LONGEST_WHOLE} digits, found {len(text)} digits")
    return int(text)


def _once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"expected every key once in a table, found {twice[:40]!r} twice")
    return table


def _shallow(value: Any) -> None:
    level = [value]
    for _ in range(DEEPEST_VALUE + 1):
        level = [x for v in level if isinstance(v, dict | list) for x in (v.values() if isinstance(v, dict) else v)]
        if not level:
            return
    raise ValueError(f"expected nesting of at most {DEEPEST_VALUE} levels")


def zstd_claim(content: bytes) -> int | None:
    """Bytes a Zstandard frame says it decodes to (RFC 8878, 3.1.1.1), None when it does not say or is no frame."""
    if content[:4] != ZSTD_MAGIC or len(content) < 6:
        return None
    descriptor = content[4]
    single_segment = bool(descriptor & 0x20)
    start = 5 + (0 if single_segment else 1) + (0, 1, 2, 4)[descriptor & 3]
    width = (1 if single_segment else 0, 2, 4, 8)[descriptor >> 6]
    field = content[start : start + width]
    if not width or len(field) < width:
        return None
    return int.from_bytes(field, "little") + (256 if width == 2 else 0)


def check_chunk(path: Path, content: bytes) -> None:
    """Refuse a chunk that would decode to more than `LARGEST_CHUNK`, or does not say to how much; `StoreError`."""
    if content[:4] != ZSTD_MAGIC:
        return  # bare numbers, or damage, which the codec finds: nothing is allocated
    claim = zstd_claim(content)
    if claim is None or claim > LARGEST_CHUNK:
        raise StoreError(
            f"{path}: expected a chunk of at most {LARGEST_CHUNK} bytes, it claims {claim or 'any number'}"
        )


def sealed(content: bytes) -> bool:
    """Whether a chunk ends in the checksum of what is before it: CRC-32C, four bytes, little-endian."""
    return len(content) > 4 and crc32c(content[:-4]) == int.from_bytes(content[-4:], "little")


def refuse_links(root: Path) -> None:
    """Raise `StoreError` when one of the folders of a two-level Zarr tree, or its metadata, is a link."""
    for folder in (root, *_entries(root)):
        for entry in _entries(folder):
            if entry.is_symlink():
                raise StoreError(f"{entry}: expected a file or a folder, found a link")
            if entry.is_dir() and (entry / "zarr.json").is_symlink():
                raise StoreError(f"{entry / 'zarr.json'}: expected a file, found a link")


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir()) if folder.is_dir() and not folder.is_symlink() else []
    except OSError as error:
        raise StoreError(f"{folder}: expected a folder that can be read ({error.strerror})") from None


class GuardedStore(LocalStore):
    """Zarr's local store, which follows no link and hands no codec a chunk that `check_chunk` refuses."""

    def get_sync(
        self, key: str, *, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """One value, None when there is none."""
        if byte_range is not None:
            raise StoreError(f"{self.root / key}: expected chunks that are read whole, found shards")
        path = self.root / key
        try:
            content = real_bytes(path, LARGEST_METADATA if path.name == "zarr.json" else LARGEST_CHUNK)
        except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
            return None
        except OSError as error:
            raise StoreError(f"{path}: expected a file that can be read ({error.strerror})") from None
        check_chunk(path, content)
        return (prototype or default_buffer_prototype()).buffer.from_bytes(content)

    async def get(
        self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """One value, None when there is none."""
        if not self._is_open:
            await self._open()
        return await asyncio.to_thread(self.get_sync, key, prototype=prototype, byte_range=byte_range)

    async def get_partial_values(
        self, prototype: BufferPrototype, key_ranges: Iterable[tuple[str, ByteRequest | None]]
    ) -> list[Buffer | None]:
        """Several values."""
        return [await self.get(key, prototype, byte_range) for key, byte_range in key_ranges]


class CubeStore(GuardedStore):
    """A `GuardedStore` of chunks that end in a CRC-32C, as all of a cube do: damage is named by its file."""

    def get_sync(
        self, key: str, *, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """One value, None when there is none."""
        value = super().get_sync(key, prototype=prototype, byte_range=byte_range)
        if value is not None and not key.endswith("zarr.json") and not sealed(value.to_bytes()):
            raise StoreError(f"{self.root / key}: checksum does not match (a changed byte or a truncated file)")
        return value
