"""Figures that a verb writes to a file of its own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENDINGS = (".svg", ".png", ".pdf")


def check_figure(path: Path) -> None:
    """Raise `InputError` where no figure can be written, before anything is computed."""
    from mcstudy.report.style import require_matplotlib

    require_matplotlib()
    if path.suffix not in ENDINGS:
        raise InputError(f"{path}: expected a name ending in {', '.join(ENDINGS)}")
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written: {path.parent} is not a folder")


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure; raises `InputError` when the file cannot be written."""
    try:
        figure.savefig(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
