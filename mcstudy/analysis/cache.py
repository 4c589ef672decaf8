"""Statistics and the page of a cube that are kept, so that the next look at the same cube need not compute them again.

They lie in ``OUT.log/statistics/``, next to the cube and not part of it; whoever deletes them loses nothing but time.
The name of a file is a hash of everything that the numbers depend on: the content of the cube and of its run log, the
source of this package, versions, CPU and settings. So a changed or damaged cube, another program and another machine
do not find it, and what is found under a name was computed from this content, which was checked then. A process whose
own source has changed since it started (`mcstudy.program`) keeps nothing and takes nothing.

The numbers of a chunk are not read again, because in a large cube that takes longer than all else. A chunk is
represented by the file's size, the time of its last change, and its last four bytes, which are the CRC-32C of the
others. A chunk that was written again has another time and, with other numbers, another checksum. Only bytes that
changed without any writing (a failing disk) stay unnoticed here; `mcstudy verify` finds them, and what is kept was
computed before. All other files are read whole: metadata, and the stored checksums of every chunk.

A file is written whole or not at all and starts with its checksum. A file that is damaged, or that cannot be read or
written (a read-only folder), is as if it were not there.
"""

from __future__ import annotations

import contextlib
import json
import os
import stat
from collections.abc import Callable, Iterator, Sequence
from hashlib import file_digest, sha256
from pathlib import Path
from typing import Any

from mcstudy import program
from mcstudy.errors import StoreError
from mcstudy.files import schema
from mcstudy.files.durable import log_folder, write
from mcstudy.files.untrusted import json_document, real_bytes
from mcstudy.study.environment import platform

MOST = 8
"""Files that are kept per cube; the oldest are removed."""

LARGEST = 1 << 28
"""Bytes of a file that is read at most."""

CHECKSUM_BYTES = 4
"""Bytes of the CRC-32C at the end of a chunk."""

PACKAGES = ("xarray", "pandas", "matplotlib")
"""Libraries of statistics and figures whose versions a cube's environment does not hold."""


def folder(cube: Path) -> Path:
    """Where the statistics of a cube are kept."""
    return log_folder(cube) / "statistics"


def kept(
    kind: str, cubes: Sequence[Path], words: Sequence[str], compute: Callable[[], dict[str, Any]]
) -> dict[str, Any]:
    """`Look.kept` of one look."""
    with looking(*cubes) as look:
        return look.kept(kind, words, compute)


@contextlib.contextmanager
def looking(*cubes: Path) -> Iterator[Look]:
    """A look at cubes; what was computed in it is kept at its end, unless the cubes have changed meanwhile.

    The cubes are read once, and once more where something was computed.
    """
    look = Look(cubes)
    yield look
    look.keep()


class Look:
    """What is kept of the present content of cubes, beside the first of them; `looking` makes one."""

    def __init__(self, cubes: Sequence[Path]) -> None:
        self._cubes, self._content, self._maker = cubes, _contents(cubes), maker()
        self._new: dict[Path, dict[str, Any]] = {}

    def kept(self, kind: str, words: Sequence[str], compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """What ``compute`` returns, a JSON value that conforms to the schema ``kind`` if there is one of this name.

        It is computed only if it is not kept. ``words``: what it depends on besides the cubes.
        """
        if self._content is None or self._maker is None:
            return compute()
        parts = [kind, self._content, list(words), self._maker]
        file = folder(self._cubes[0]) / sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
        value = self._new.get(file) or _read(file, kind)
        if value is None:
            value = self._new[file] = compute()
        return value

    def keep(self) -> None:
        """Write what was computed, unless a run has changed the cubes meanwhile, or an update the program."""
        if self._new and _contents(self._cubes) == self._content and maker() == self._maker:
            for file, value in self._new.items():
                _write(file, value)
        self._new.clear()


def maker() -> list[Any] | None:
    """What computes and draws: source, versions, CPU and settings, as a JSON value; None if files have changed."""
    source = program.source()
    return None if source is None else [source, platform(), program.versions(PACKAGES)]


def _contents(cubes: Sequence[Path]) -> list[str] | None:
    """`_content` of each; None where one cannot be read."""
    try:
        return [_content(cube) for cube in cubes]
    except OSError:
        return None


def _content(cube: Path) -> str:
    """SHA-256 of everything in a cube's folder, and of its run log; see the module for what stands for a chunk.

    `OSError` for more than plain files and folders.
    """
    digest = sha256()

    def add(path: str) -> None:
        about = os.lstat(path)
        digest.update(os.fsencode(os.path.relpath(path, cube)) + b"\0")
        if stat.S_ISREG(about.st_mode):
            with open(path, "rb") as file:
                if _is_chunk(os.path.basename(path)):
                    file.seek(max(about.st_size - CHECKSUM_BYTES, 0))
                    digest.update(b"%d %d " % (about.st_size, about.st_mtime_ns) + file.read(CHECKSUM_BYTES))
                else:
                    digest.update(file_digest(file, "sha256").digest())
        elif not stat.S_ISDIR(about.st_mode):
            raise OSError(f"{path}: expected a file or a folder")

    def fail(error: OSError) -> None:
        raise error

    for place, folders, files in os.walk(cube, onerror=fail):
        folders.sort()
        for name in sorted([*folders, *files]):
            add(os.path.join(place, name))
    log = log_folder(cube) / "runs.jsonl"  # it tells which chunks must be there
    if os.path.lexists(log):
        add(str(log))
    return digest.hexdigest()


def _is_chunk(name: str) -> bool:
    """Whether a file of a cube holds numbers and ends in their checksum (`mcstudy.study.cube.layout`)."""
    return name.startswith("c.") and not name.endswith(".checksums")


def _read(file: Path, kind: str) -> dict[str, Any] | None:
    with contextlib.suppress(OSError, ValueError, StoreError):
        seal, _, content = real_bytes(file, LARGEST).partition(b"\n")
        if seal == _seal(file.name, content):
            value = json_document(content)
            if kind in schema.names():
                schema.validate(kind, value, str(file))
            return dict(value)
    return None


def _write(file: Path, value: dict[str, Any]) -> None:
    """Write a file whole or not at all, and remove all but the newest `MOST` of its folder."""
    with contextlib.suppress(OSError, ValueError):  # a read-only or full disk, or numbers that JSON cannot hold
        content = json.dumps(value, ensure_ascii=False, allow_nan=False).encode()
        file.parent.mkdir(parents=True, exist_ok=True)
        write(file, _seal(file.name, content) + b"\n" + content)
        for old in sorted(file.parent.iterdir(), key=lambda f: f.stat().st_mtime_ns, reverse=True)[MOST:]:
            old.unlink(missing_ok=True)


def _seal(name: str, content: bytes) -> bytes:
    """Checksum of a file's content and name, so that a file under another name is not taken for its own."""
    return sha256(name.encode() + b"\n" + content).hexdigest().encode()
