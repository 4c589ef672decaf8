"""Figures that a verb writes to a file of its own."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENDINGS = (".svg",)
"""Names of figures that are written as SVG documents."""

DRAWN = (".svg", ".png", ".pdf")
"""Names of figures that matplotlib draws."""


def check_figure(path: Path | None, endings: tuple[str, ...] = ENDINGS, page: Path | None = None) -> None:
    """Raise `InputError` where no figure or page can be written, before anything is computed; None is none."""
    if page is not None or (path is not None and endings == DRAWN):
        from mcstudy.report.style import require_matplotlib

        require_matplotlib()
    if path is None:
        return
    if path.suffix not in endings:
        raise InputError(f"{path}: expected a name ending in {', '.join(endings)}")
    there = next(folder for folder in path.absolute().parents if folder.exists())
    if not there.is_dir():
        raise InputError(f"{path}: cannot be written: {there} is not a folder")


def write_figure(figure: Figure | str, path: Path) -> None:
    """Write a figure or an SVG document; raises `StoreError` when the file cannot be written."""
    from mcstudy.files.output import write_file

    def content() -> bytes:
        if isinstance(figure, str):
            return f"{figure}\n".encode()
        drawn = io.BytesIO()
        figure.savefig(drawn, format=path.suffix.removeprefix("."))
        return drawn.getvalue()

    write_file(path, content)
