"""Figures that a verb writes to a file of its own."""

from __future__ import annotations

import io
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNDATED: dict[str, dict[str, None]] = {".svg": {"Date": None}, ".png": {}, ".pdf": {"CreationDate": None}}
"""Endings of figures, and what matplotlib leaves out, so that the same figure has the same bytes."""


def check_figure(path: Path | None, page: Path | None = None) -> None:
    """Raise `InputError` where no figure or page can be written, before anything is computed; None is none."""
    if path is not None or page is not None:
        from mcstudy.report.style import require_matplotlib

        require_matplotlib()
    check_name(path, UNDATED)


def check_name(path: Path | None, endings: Collection[str]) -> None:
    """Raise `InputError` where the name has none of these endings, or is in no folder; None is none."""
    if path is None:
        return
    if path.suffix not in endings:
        raise InputError(f"{path}: expected a name ending in {', '.join(endings)}")
    there = next(folder for folder in path.absolute().parents if folder.exists())
    if not there.is_dir():
        raise InputError(f"{path}: cannot be written: {there} is not a folder")


def write_figure(figure: Figure, path: Path, dpi: float = 100.0) -> None:
    """Write a figure, with ``dpi`` where it has dots; raises `StoreError` when the file cannot be written."""
    from mcstudy.files.output import write_file
    from mcstudy.report.axes import styled

    def content() -> bytes:
        drawn = io.BytesIO()
        with styled():
            figure.savefig(drawn, format=path.suffix.removeprefix("."), metadata=UNDATED[path.suffix], dpi=dpi)
        return drawn.getvalue()

    write_file(path, content)
