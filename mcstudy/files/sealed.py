"""Files that begin with a checksum of their content and name: kept for a later look, and worth nothing when damaged."""

from __future__ import annotations

import contextlib
from hashlib import sha256
from pathlib import Path

from mcstudy.errors import StoreError
from mcstudy.files.durable import write
from mcstudy.files.untrusted import real_bytes

LARGEST = 1 << 28
"""Bytes of a file that is read at most."""


def read_sealed(file: Path) -> bytes | None:
    """Content of a file; None where it is missing, damaged, renamed or cannot be read."""
    with contextlib.suppress(OSError, StoreError):
        seal, _, content = real_bytes(file, LARGEST).partition(b"\n")
        if seal == _seal(file.name, content):
            return content
    return None


def write_sealed(file: Path, content: bytes, most: int) -> None:
    """Write a file whole or not at all, and remove all but the newest ``most`` of its folder. Raises `OSError`."""
    write(file, _seal(file.name, content) + b"\n" + content)
    newest = sorted(file.parent.iterdir(), key=lambda f: f.stat().st_mtime_ns, reverse=True)
    for old in newest[most:]:
        old.unlink(missing_ok=True)


def _seal(name: str, content: bytes) -> bytes:
    """Checksum of a file's content and name, so that a file under another name is not taken for its own."""
    return sha256(name.encode() + b"\n" + content).hexdigest().encode()
