"""The first sheet of a workbook (.xlsx) as rows of text: tables that people keep of whom they recorded."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from zipfile import BadZipFile, ZipFile

from mcstudy.errors import RecordingError
from mcstudy.recordings.refusals import UNREAD, first_line

LARGEST_FILE = 20_000_000
"""Bytes of a workbook."""

LARGEST_CONTENT = 200_000_000
"""Bytes that it may unpack to."""

MOST_ROWS, MOST_COLUMNS = 100_000, 1000


def sheet_rows(path: Path) -> list[list[str]]:
    """The cells of the first sheet, without empty rows; whole numbers without a point.

    Raises `RecordingError`, one line, for what is no workbook, is locked by a password, or holds nothing.
    """
    try:
        from openpyxl import load_workbook
    except ImportError:
        raise RecordingError(
            f"{path}: openpyxl, which reads workbooks, is not installed; pip install openpyxl, or save the sheet as "
            f"{path.with_suffix('.csv').name}"
        ) from None
    _require_workbook(path)
    with _read(path):
        book = load_workbook(path, read_only=True, data_only=True)
        try:
            sheet = book.worksheets[0]
            cells = sheet.iter_rows(max_row=MOST_ROWS, max_col=MOST_COLUMNS, values_only=True)
            rows = [[_text(c) for c in row] for row in cells]
        finally:
            book.close()
    rows = [row for row in rows if any(row)]
    if not rows:
        raise RecordingError(f"{path}: the first sheet is empty; expected a row of names and a row per person")
    return rows


def _text(cell: object) -> str:
    if cell is None:
        return ""
    return str(int(cell)) if isinstance(cell, float) and cell.is_integer() else str(cell).strip()


@contextmanager
def _read(path: Path) -> Iterator[None]:
    try:
        yield
    except (*UNREAD, BadZipFile, IndexError, TypeError, AttributeError) as error:
        raise RecordingError(f"{path}: cannot be read as a workbook: {first_line(error)}") from None


def _require_workbook(path: Path) -> None:
    with _read(path):
        with open(path, "rb") as file:
            begin = file.read(8)
        size = path.stat().st_size
    if begin.startswith(b"\xd0\xcf\x11\xe0"):
        raise RecordingError(
            f"{path}: is locked by a password, or an old .xls; save it as .xlsx without one, or as CSV"
        )
    if not begin.startswith(b"PK"):
        raise RecordingError(f"{path}: expected a workbook (.xlsx), found other bytes")
    with _read(path), ZipFile(path) as archive:
        unpacked = sum(entry.file_size for entry in archive.infolist())
    if size > LARGEST_FILE or unpacked > LARGEST_CONTENT:
        raise RecordingError(f"{path}: {size} bytes, {unpacked} unpacked; expected at most {LARGEST_FILE}")
