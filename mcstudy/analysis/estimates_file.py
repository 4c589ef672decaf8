"""The table of estimates in a CSV file: every row has as many fields as the header, and names stay text.

A parameter may be called ``1``, ``TRUE`` or ``NA``; only the columns of numbers have missing values.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pandas as pd

from mcstudy.errors import InputError, StoreError
from mcstudy.files.untrusted import real_bytes

LARGEST = 1 << 30
"""Bytes of a file."""

SEPARATORS = ("\t", ";", ",")

MISSING = frozenset(("", ".", "-", "na", "nan", "n/a", "#n/a", "<na>", "null", "none"))
"""Fields that stand for no number, in small letters."""

_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?inf(?:inity)?", re.IGNORECASE)


def read_estimates(
    path: Path, names: tuple[str, ...], numbers: tuple[str, ...], required: tuple[str, ...]
) -> pd.DataFrame:
    """Columns of a CSV file with a header; its fields are separated by commas, semicolons or tabs.

    ``names``: columns of text; each field must hold one. ``numbers``: columns of numbers, NaN where they are missing,
    with decimal commas where something else separates fields. Columns that are not ``required`` may be missing; others
    are not read. Raises `InputError` with the line and the column; the message does not repeat the file's name.
    """
    lines = _text(path).splitlines(keepends=True)
    if not "".join(lines[:1]).strip():
        raise InputError("expected a CSV file with a header, found an empty first line")
    declared = re.fullmatch(r"sep=(.)\s*", lines[0])
    wanted = {*names, *numbers}
    skipped = 1 if declared else 0

    def parsed(separator: str) -> list[str]:
        return [h.strip() for h in next(csv.reader(lines[skipped : skipped + 1], delimiter=separator), [])]

    likely = max(SEPARATORS, key=lambda s: (len(wanted & set(parsed(s))), s in lines[0]))
    separator = declared[1] if declared else likely
    header = parsed(separator)
    for name in header:
        if name in wanted and header.count(name) > 1:
            raise InputError(f"{name}: expected one column of this name, got {header.count(name)}")
    for name in required:
        if name not in header:
            near = [h for h in header if h.casefold() == name]
            hint = f" (similar: {near[0]})" if near else ""
            raise InputError(f"{name}: expected a column of this name, got {', '.join(header) or 'none'}{hint}")
    kept = {name: header.index(name) for name in (*names, *numbers) if name in header}
    columns: dict[str, list[str]] = {name: [] for name in kept}
    at: list[int] = []
    reader = csv.reader(lines[skipped + 1 :], delimiter=separator, strict=True)
    try:
        for fields in reader:
            if not any(f.strip() for f in fields):
                continue
            line = reader.line_num + skipped + 1
            if len(fields) != len(header):
                raise InputError(f"line {line}: {_miscounted(fields, header, separator)}")
            at.append(line)
            for name, k in kept.items():
                columns[name].append(fields[k].strip())
    except csv.Error as error:
        raise InputError(f"line {reader.line_num + skipped + 1}: expected fields of a CSV file ({error})") from None
    for name in set(names) & set(kept):
        if "" in columns[name]:
            raise InputError(f"line {at[columns[name].index('')]}: {name}: expected a name, got an empty field")
    return pd.DataFrame(
        {n: _floats(n, c, at, separator) if n in numbers else np.array(c, dtype=object) for n, c in columns.items()}
    )


def _text(path: Path) -> str:
    try:
        return real_bytes(path, LARGEST, follow=True).decode("utf-8-sig")
    except (OSError, StoreError) as error:
        why = getattr(error, "strerror", None) or str(error).removeprefix(f"{path}: ")
        raise InputError(f"cannot be read: {why}") from None
    except UnicodeDecodeError:
        raise InputError("expected UTF-8 text; save the table as CSV UTF-8") from None


def _miscounted(fields: list[str], header: list[str], separator: str) -> str:
    words = f"expected {len(header)} fields as in the header, got {len(fields)}"
    if len(fields) == len(header) + 1:
        if not fields[-1].strip():
            return f"{words}; remove the separator at its end"
        return f"{words}; row names need a column name too (in R: row.names = FALSE)"
    if separator == "," and len(fields) > len(header):
        return f"{words}; separate fields by semicolons where numbers have decimal commas"
    return words


def _floats(name: str, texts: list[str], at: list[int], separator: str) -> np.ndarray:
    """Numbers of a column; an error names the first field that is none."""
    plain = ["" if t.lower() in MISSING else t for t in texts]
    with_comma = [separator != "," and _DECIMAL_COMMA.fullmatch(t) is not None for t in plain]
    if any(with_comma):
        mixed = next((k for k, t in enumerate(plain) if "." in t), None)
        if mixed is not None:
            raise InputError(
                f"line {at[mixed]}: {name}: expected decimal commas as in line {at[with_comma.index(True)]}, "
                f"got {texts[mixed]!r}"
            )
        plain = [t.replace(",", ".") if c else t for t, c in zip(plain, with_comma, strict=True)]
    wrong = next((k for k, t in enumerate(plain) if t and not (t.isascii() and _NUMBER.fullmatch(t))), None)
    if wrong is not None:
        raise InputError(f"line {at[wrong]}: {name}: expected a number, got {texts[wrong][:40]!r}")
    return np.array([float(t) if t else np.nan for t in plain])
