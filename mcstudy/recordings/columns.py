"""Columns of text files: CSV with a header, or bare numbers separated by blanks."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mcstudy.errors import RecordingError, StoreError
from mcstudy.files.untrusted import real_bytes

LARGEST_FILE = 1 << 30
"""Largest text file, bytes."""

LARGEST_NUMBER = 1e15
"""Largest accepted number. No sensible unit gives more (milliseconds since 1970 are 2e12); more could overflow."""

NUMBER = re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?|nan)", re.ASCII | re.IGNORECASE)
"""Pattern of a number in a text file. Python's ``float`` would also accept 1_000 and digits of other scripts."""


def content(path: Path, most: int) -> bytes:
    """Bytes of a file of at most ``most``; raises `RecordingError` for anything else."""
    try:
        return real_bytes(path, most, follow=True)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    except StoreError as error:
        raise RecordingError(str(error)) from error


class TextTable:
    """One text file of numbers, read whole.

    Attributes: path; names, the header's column names (empty without a header); values (rows, columns) float64.
    Raises `RecordingError` with the line of a value that is not a number.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = path = Path(path)
        try:
            lines = content(path, LARGEST_FILE).decode("utf-8-sig").splitlines()
        except UnicodeDecodeError as error:
            raise RecordingError(f"{path}: expected a text file: {error}") from error
        numbered = [(k, line) for k, line in enumerate(lines, start=1) if line.strip() and line.lstrip()[0] != "#"]
        if not numbered:
            raise RecordingError(f"{path}: expected rows of numbers, found none")
        delimiter = next((d for d in (",", ";", "\t") if d in numbered[0][1]), None)
        first = [c.strip() for c in numbered[0][1].split(delimiter)]
        self.names: tuple[str, ...] = () if _is_number(first[0]) else tuple(first)
        if self.names:
            del numbered[0]
        self.values = self._parse(numbered, delimiter)

    def _parse(self, numbered: list[tuple[int, str]], delimiter: str | None) -> np.ndarray:
        if not numbered:
            raise RecordingError(f"{self.path}: expected rows of numbers under the header, found none")
        try:
            values = np.loadtxt([line for _, line in numbered], delimiter=delimiter, ndmin=2)
        except ValueError as problem:
            width = len(self.names) or len(numbered[0][1].split(delimiter))
            for k, line in numbered:
                cells = line.split(delimiter)
                if len(cells) != width:
                    raise RecordingError(f"{self.path}: line {k}: expected {width} columns, got {len(cells)}") from None
                for c, cell in enumerate(cells):
                    if not _is_number(cell):
                        label = self.names[c] if self.names else str(c)
                        raise RecordingError(
                            f"{self.path}: line {k}, column {label!r}: expected a number, got {cell.strip()!r}"
                        ) from None
            reason = " ".join(str(problem).split())
            raise RecordingError(f"{self.path}: expected rows of numbers: {reason}") from None
        large = np.argwhere(np.isfinite(values) & (np.abs(values) > LARGEST_NUMBER))
        if large.size:
            row, column = large[0]
            label = self.names[column] if column < len(self.names) else str(column)
            raise RecordingError(
                f"{self.path}: line {numbered[row][0]}, column {label!r}: expected numbers up to {LARGEST_NUMBER:g}, "
                f"got {values[row, column]:g}"
            )
        return values

    def column(self, key: str | int) -> np.ndarray:
        """One column by its header name or its number from 0, (rows,)."""
        if isinstance(key, str):
            if key not in self.names:
                have = ", ".join(self.names) if self.names else "no header"
                raise RecordingError(f"{self.path}: column {key!r} is missing; found {have}")
            key = self.names.index(key)
        if not 0 <= key < self.values.shape[1]:
            raise RecordingError(f"{self.path}: column {key}: the file has columns 0 to {self.values.shape[1] - 1}")
        return self.values[:, key]


def _is_number(text: str) -> bool:
    return NUMBER.fullmatch(text.strip()) is not None
