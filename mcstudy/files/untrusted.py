"""Reading of untrusted files: regular files only, no links, and limits on every size.

A Zarr store defines its own codecs, shapes and sizes. Links could lead out of it, and the header of a compressed chunk
may declare any size, which the decoder would allocate. Here every file is checked before a codec reads it.
"""

from __future__ import annotations

import json
import math
import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any, BinaryIO

from google_crc32c import value as crc32c

from mcstudy.errors import StoreError

LARGEST_CHUNK = 1 << 29
"""Largest decoded size of one stored chunk, bytes; study files that need larger chunks are refused."""

LARGEST_METADATA = 20_000_000
"""Largest size of one metadata document, bytes; a thousand groups need less."""

DEEPEST_KEY = 16

DEEPEST_VALUE = 64
"""Deepest nesting of a JSON document; ours have at most ten levels."""

LONGEST_WHOLE = 20
"""Largest number of digits of a whole number in a JSON document; 64-bit integers have no more."""

_PART = r"""(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')"""

DEEP_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{DEEPEST_KEY}}}")
"""A dotted key of more than `DEEPEST_KEY` parts."""

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


def real_bytes(path: Path, limit: int = LARGEST_CHUNK, follow: bool = False) -> bytes:
    """Content of a regular file of at most ``limit`` bytes; `StoreError` for anything else, `OSError` like `open`.

    ``follow``: whether ``path`` may be a link; true for files that the user names.
    """
    with _regular(path, follow) as file:
        size = os.fstat(file.fileno()).st_size
        if size > limit:
            raise StoreError(f"{path}: expected at most {limit} bytes, found {size}")
        return file.read(size)  # of the limit, Python would take all memory first


def real_end(path: Path, n: int) -> bytes:
    """The last ``n`` bytes of a regular file, fewer of a shorter one; errors as `real_bytes`."""
    with _regular(path) as file:
        file.seek(max(os.fstat(file.fileno()).st_size - n, 0))
        return file.read(n)


def _regular(path: Path, follow: bool = False) -> BinaryIO:
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | (0 if follow else os.O_NOFOLLOW))
    status = os.fstat(handle)
    if not stat.S_ISREG(status.st_mode):
        os.close(handle)
        what = "a folder" if stat.S_ISDIR(status.st_mode) else "something else"
        raise StoreError(f"{path}: expected a regular file, found {what}")
    return os.fdopen(handle, "rb")


def toml(text: str) -> dict[str, Any]:
    """Parse a TOML document; `ValueError`, one line, if it is invalid or nested too deeply.

    A byte order mark, which editors of Windows write, is left out.
    """
    text = text.removeprefix("\ufeff")
    # The parser keeps every prefix of a dotted key: 200 kB of "a.a.a..." would take 40 GB.
    if DEEP_KEY.search(text):
        raise ValueError(f"expected keys of at most {DEEPEST_KEY} parts")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(" ".join(str(error).split())) from None


def json_document(content: bytes) -> Any:
    """Parse a JSON document in UTF-8; `ValueError`, one line, if it is invalid.

    Python's parser accepts more than valid or usable JSON: NaN and infinities, numbers that overflow, repeated keys
    (the last one wins), unpaired surrogates, and nesting that exceeds the stack. All of these are errors here.
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
    """Decoded size declared by a Zstandard frame (RFC 8878, 3.1.1.1); None if it declares none or is no frame."""
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
    """Raise `StoreError` for a chunk that declares no decoded size, or one above `LARGEST_CHUNK`."""
    if content[:4] != ZSTD_MAGIC:
        return  # uncompressed numbers, or damage that the codec detects: nothing is allocated
    claim = zstd_claim(content)
    if claim is None or claim > LARGEST_CHUNK:
        raise StoreError(f"{path}: expected a chunk of at most {LARGEST_CHUNK} bytes, it declares {claim or 'no size'}")


def sealed(content: bytes) -> bool:
    """Whether a chunk ends in the checksum of the bytes before it: CRC-32C, four bytes, little-endian."""
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
        raise StoreError(f"{folder}: expected a readable folder ({error.strerror})") from None


def stored_bytes(root: Path, key: str) -> bytes | None:
    """One value of a Zarr store, None if there is none; links and what `check_chunk` refuses are errors."""
    path = root / key
    try:
        content = real_bytes(path, LARGEST_METADATA if path.name == "zarr.json" else LARGEST_CHUNK)
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        return None
    except OSError as error:
        raise StoreError(f"{path}: expected a readable file ({error.strerror})") from None
    check_chunk(path, content)
    return content


def cube_bytes(root: Path, key: str) -> bytes | None:
    """The same for a cube, whose chunks end in a CRC-32C; an error names the damaged file."""
    content = stored_bytes(root, key)
    if content is not None and not key.endswith("zarr.json") and not sealed(content):
        raise StoreError(f"{root / key}: checksum does not match (a changed byte or a truncated file)")
    return content
