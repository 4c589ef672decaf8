"""The program that this process runs: the source that was there when it started, and versions of libraries.

Whatever is kept says by which program it was made, and is used again by the same program only. Modules are loaded when
they are first needed and data files when they are read. A process that is open while these files change (an update, an
edit) therefore runs the old ones, or some old and some new, and what it computes belongs to neither. So the state of
every file is noted when the package is imported: its inode, its size and the time of its last change, which no program
can set back. From then on the digest of the source is known only as long as no file has changed.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # this module is loaded first of all, see the package
if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from typing import Any

PACKAGE = os.path.dirname(os.path.realpath(__file__))

SCHEMAS = "results_schema"
"""Folder of schemas: beside the package, or in it where it was installed from a wheel."""

SUFFIXES = (".py", ".css", ".csv", ".html", ".js", ".json")
"""Files that numbers, tables and pages depend on."""

APART = ("docs", "pipelines", SCHEMAS)
"""Folders of a wheel that lie beside the package in the source tree: what a study file holds has a fingerprint."""

WORDS = ("api", "cli", "report")
"""Folders that print and draw numbers and compute none."""

LIBRARIES = ("numpy", "scipy", "numba", "llvmlite")
"""Libraries that numbers depend on."""

State = dict[str, tuple[int, int, int]]

_attached: dict[str, str] = {}
"""Folders of other packages whose source numbers depend on, by the name of the package."""


def _state() -> State:
    """Inode, time of the last change and size of every file, by name relative to the package; empty if unreadable."""
    state: State = {}
    try:
        _look(PACKAGE, "", state, APART)
        _look(_place(SCHEMAS), f"{SCHEMAS}/", state)
        for package, folder in _attached.items():
            _look(folder, f"{package}/", state)
    except OSError:
        return {}
    return state


def _place(name: str) -> str:
    """Where a file or folder is: in the package, or beside it in the source tree."""
    package, _, rest = name.partition("/")
    if package in _attached:
        return os.path.join(_attached[package], rest)
    inside = os.path.join(PACKAGE, name)
    return inside if os.path.exists(inside) else os.path.join(os.path.dirname(PACKAGE), name)


def _look(folder: str, prefix: str, state: State, apart: Sequence[str] = ()) -> None:
    with os.scandir(folder) as entries:
        for entry in entries:
            name = entry.name
            if name.startswith(".") or name == "__pycache__" or name in apart:
                continue
            if name.endswith(SUFFIXES):
                about = entry.stat()
                state[prefix + name] = about.st_ino, about.st_ctime_ns, about.st_size
            elif not name.startswith("_") and entry.is_dir():  # "_compiled" follows from the source
                _look(entry.path, f"{prefix}{name}/", state)


STARTED = _state()
"""State of the files when the package was imported."""

_digests: dict[tuple[str, ...], str] = {}


def attach(package: str, folder: str) -> None:
    """Note the files of another package that computes numbers, when it is imported."""
    if package not in _attached:
        _attached[package] = folder
        state: State = {}
        _look(folder, f"{package}/", state)
        STARTED.update(state)


def unchanged() -> bool:
    """Whether all files are those that were there when the package was imported."""
    return bool(STARTED) and _state() == STARTED


def source(parts: Sequence[str] | None = None) -> str | None:
    """SHA-256 of the files of some folders and modules of the package, by default of all; None if files have changed.

    Unlike a version number, it detects an edited copy.
    """
    key = ("",) if parts is None else tuple(parts)
    if not unchanged():
        return None
    if key not in _digests:
        digest = _digest(None if parts is None else key)
        if not unchanged():
            return None
        _digests[key] = digest
    return _digests[key]


def _digest(parts: tuple[str, ...] | None) -> str:
    from hashlib import sha256

    digest = sha256()
    for name in _files(parts):
        with open(_place(name), "rb") as file:
            content = file.read()
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def _files(parts: tuple[str, ...] | None) -> Iterator[str]:
    for name in sorted(STARTED):
        if parts is None:
            if name.partition("/")[0] not in _attached:
                yield name
        elif any(name.startswith(f"{part}/") or name in (part, f"{part}.py") for part in parts):
            yield name


def attached(work: Any) -> tuple[str, ...]:
    """Name of the attached package that a function, or the function of a partial, comes from; none for others."""
    package = getattr(getattr(work, "func", work), "__module__", "").partition(".")[0]
    return (package,) if package in _attached else ()


def computing(*packages: str) -> tuple[str, ...]:
    """Folders and modules of the package, and the attached packages named, that compute numbers."""
    return tuple(sorted({name.partition("/")[0] for name in STARTED} - {*WORDS, SCHEMAS, *_attached} | {*packages}))


MIXED = os.urandom(32).hex()
"""What stands for the SHA-256 of the source of a process whose files have changed: that of no other process."""


def versions(packages: Sequence[str]) -> dict[str, str]:
    """Versions of libraries as they are loaded, or installed where they are not loaded yet; "" where they are not."""
    return {name: _loaded(name) or _installed(name) for name in packages}


def _loaded(package: str) -> str:
    return str(getattr(sys.modules.get(package), "__version__", ""))


def _installed(package: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def maker(*packages: str) -> dict[str, Any]:
    """What makes numbers in this process, as a JSON value: source and versions. Equal for work that may be joined.

    ``packages`` names the packages beside this one (`attach`) whose source also counts.
    """
    import platform

    return {
        "source": source(computing(*packages)) or MIXED,
        "versions": {"python": platform.python_version(), **versions(LIBRARIES)},
    }


def other_maker(made_by: Any, own: dict[str, Any]) -> str:
    """In what another maker differs from this one, in words; "" where it does not."""
    if not isinstance(made_by, dict) or not isinstance(made_by.get("versions"), dict):
        return "it does not say by which program it was made"
    was, now = made_by["versions"], own["versions"]
    lines = [f"{name} {was.get(name, '?')}, here {v}" for name, v in now.items() if was.get(name) != v]
    if made_by.get("source") != own["source"]:
        lines.insert(0, f"source {str(made_by.get('source'))[:12]}, here {own['source'][:12]}")
    return f"made by another program: {'; '.join(lines)}" if lines else ""
