"""Paths that a user gives: names of the local file system, never addresses.

`pathlib` takes ``s3://bucket/q.zarr`` for a folder ``s3:`` in the working directory.
"""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path
from urllib.parse import unquote, urlsplit

from mcstudy.errors import InputError, StoreError

ADDRESS = re.compile(r"\s*(?:[A-Za-z][A-Za-z0-9+.-]+::?)+//")
"""A scheme of at least two letters, or several (``simplecache::s3://``), before two slashes."""

SCHEMES = (
    *("file", "s3", "s3a", "s3n", "gs", "gcs", "gdrive", "az", "abfs", "abfss", "adl", "wasb", "wasbs", "oss", "cos"),
    *(
        "hdfs",
        "webhdfs",
        "http",
        "https",
        "webdav",
        "dav",
        "davs",
        "ftp",
        "ftps",
        "sftp",
        "ssh",
        "scp",
        "smb",
        "memory",
    ),
)
"""Schemes that are known even where `pathlib` has made one slash of two."""


def local_path(given: str | os.PathLike[str]) -> Path:
    """The path that ``given`` names; ``file:///a`` is ``/a``. Raises `InputError` for any other address."""
    try:
        text = os.fsdecode(given)
    except TypeError:
        kind = type(given).__name__
        root = ", as its attribute root is" if hasattr(given, "root") else ""
        raise InputError(f"expected a path of this machine{root}, got {kind}") from None
    if "\0" in text:
        raise InputError(f"{text!r}: expected a path without null characters")
    if re.match(r"\s*file://", text, re.IGNORECASE):
        address = urlsplit(text)
        if address.netloc not in ("", "localhost") or not address.path:
            raise InputError(f"{text}: expected file:///PATH, a file of this machine")
        return local_path(Path(unquote(address.path)))
    path = Path(text)
    scheme, colon, _ = path.parts[0].strip().partition(":") if path.parts else ("", "", "")
    flat = colon and scheme.lower() in SCHEMES and isinstance(given, Path) and not Path(path.parts[0]).exists()
    if ADDRESS.match(text) or flat:
        why = "file:// as text only, not as a Path" if scheme.lower() == "file" else f"{scheme}:// is not supported"
        raise InputError(f"{text}: expected a path of this machine, found an address ({why})")
    return path


def resolved(given: str | os.PathLike[str]) -> Path:
    """`local_path`, absolute and without links; `StoreError` for links in a loop and names that are too long."""
    path = local_path(given)
    try:
        place = path.resolve()
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            place.stat()
    except (OSError, RuntimeError, ValueError) as error:  # RuntimeError: a loop of links, before Python 3.13
        why = getattr(error, "strerror", None) or ("links in a loop" if "loop" in str(error) else str(error))
        raise StoreError(f"{path}: expected a path that can be used ({why})") from None
    return place
