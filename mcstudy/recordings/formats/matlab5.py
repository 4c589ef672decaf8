"""MATLAB files of version 5 to 7 (``save`` without ``-v7.3``): numbers in variables, structs and cells.

The format is MathWorks' "MAT-File Format" (version 5). The file is parsed here and not by SciPy's ``loadmat``, which
allocates what a file declares and follows nesting without limit: a file of 5 MB with 100,000 cells in each other ends
the process. Here sizes are checked against the bytes that are there, and nesting is limited. Text is skipped; objects
(tables, categories, ...), sparse and complex arrays are named with their class.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.formats.source import MOST_VARIABLES, Variable

LARGEST = 1 << 30
"""Most bytes of a file after decompression."""

DEEPEST = 16
"""Deepest nesting of structs and cells."""

HEADER = 128

_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Element types that hold numbers."""

_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _SPARSE, _OPAQUE = 1, 2, 3, 5, 17
_NUMERIC = range(6, 16)
"""Array classes: cell, struct, objects of old and new style, sparse, double to uint64."""

_COMPLEX = 1 << 11
"""Flag of an array."""


class _Damaged(ValueError):
    """The bytes are not what the format says."""


@dataclass(frozen=True)
class _Element:
    type: int
    data: memoryview


def is_matlab5(head: bytes) -> bool:
    """Whether a file's first bytes are those of this format."""
    return head[:10] == b"MATLAB 5.0" and head[126:128] in (b"IM", b"MI")


@dataclass
class _Found:
    """Arrays of numbers by name, and the classes of what is none."""

    variables: dict[str, Variable] = field(default_factory=dict)
    others: dict[str, str] = field(default_factory=dict)

    def refuse_more(self) -> None:
        if len(self.variables) + len(self.others) >= MOST_VARIABLES:
            raise _Damaged(f"expected at most {MOST_VARIABLES} variables")


def variables_of(content: bytes, path: Path) -> tuple[dict[str, Variable], dict[str, str]]:
    """All numeric variables of a file by name (``struct.field``, ``cell[0]``), and the class of others by name.

    Raises `RecordingError`.
    """
    order = "<" if content[126:128] == b"IM" else ">"
    found = _Found()
    room = LARGEST
    try:
        for element in _elements(memoryview(content)[HEADER:], order):
            whole = element
            if element.type == _COMPRESSED:
                inflated = _inflated(element.data, room)
                room -= len(inflated)
                (whole,) = _elements(memoryview(inflated), order)
            if whole.type == _MATRIX:
                _matrix(whole.data, order, "", found, 0)
    except (_Damaged, ValueError, zlib.error) as error:
        raise RecordingError(f"{path}: expected a MATLAB file: {error}") from None
    return found.variables, found.others


def _inflated(data: memoryview, most: int) -> bytes:
    inflate = zlib.decompressobj()
    out = inflate.decompress(data, most + 1)
    if len(out) > most:
        raise _Damaged(f"a variable holds more than {most} bytes")
    if not inflate.eof:
        raise _Damaged("a variable is cut off")
    return out


def _elements(data: memoryview, order: str) -> Iterator[_Element]:
    """The data elements one after another; a small one has type, size and data in eight bytes."""
    at = 0
    while at + 8 <= len(data):
        first, size = np.frombuffer(data[at : at + 8], f"{order}u4").tolist()
        if first >> 16:
            size, kind = first >> 16, first & 0xFFFF
            if size > 4:
                raise _Damaged("a small element holds more than four bytes")
            yield _Element(kind, data[at + 4 : at + 4 + size])
            at += 8
            continue
        if size > len(data) - at - 8:
            raise _Damaged(f"cut off: an element declares {size} bytes, {len(data) - at - 8} are left")
        yield _Element(first, data[at + 8 : at + 8 + size])
        at += 8 + size
        at += 0 if first == _COMPRESSED else -size % 8
    if at < len(data):
        raise _Damaged("cut off in the middle of an element")


def _numbers(element: _Element, order: str) -> np.ndarray:
    if element.type not in _NUMBERS:
        raise _Damaged(f"expected numbers, found an element of type {element.type}")
    kind = np.dtype(f"{order}{_NUMBERS[element.type]}")
    if len(element.data) % kind.itemsize:
        raise _Damaged("an element ends inside a number")
    return np.frombuffer(element.data, kind)


def _matrix(data: memoryview, order: str, name: str, found: _Found, depth: int) -> None:
    """Add the numeric arrays of one array, and of those inside it, under ``name`` or the name it states."""
    if depth > DEEPEST:
        raise _Damaged(f"expected structs and cells nested at most {DEEPEST} deep")
    parts = _elements(data, order)
    head = next(parts, None)
    if head is None:
        return  # an empty cell
    flags = _numbers(head, order)
    if flags.size < 1:
        raise _Damaged("an array without a class")
    kind = int(flags[0]) & 0xFF
    if kind == _OPAQUE:  # name, "MCOS" and class, and nothing of its size
        label, _, category = (_label(_next(parts)) for _ in range(3))
        found.refuse_more()
        found.others[name or label] = category
        return
    if kind not in (_CELL, _STRUCT, _OBJECT, _SPARSE, *_NUMERIC):
        return
    shape = tuple(int(n) for n in _numbers(_next(parts), order))
    if not shape or min(shape) < 0:
        raise _Damaged("an array of negative size")
    label = _label(_next(parts))
    name, count = name or label, math.prod(shape)
    if not name:
        return  # where MATLAB keeps the contents of objects
    if kind in (_OBJECT, _SPARSE) or (kind in _NUMERIC and flags[0] & _COMPLEX):
        found.refuse_more()
        found.others[name] = {_OBJECT: "object", _SPARSE: "sparse"}.get(kind, "complex")
    elif kind == _CELL:
        _inner(parts, count, [""], name, order, found, depth)
    elif kind == _STRUCT:
        _inner(parts, count, _fields(parts, order), name, order, found, depth)
    elif count:
        values = _numbers(_next(parts), order)
        if values.size != count:
            raise _Damaged(f"{name[:60]}: {values.size} numbers for an array of {' x '.join(map(str, shape))}")
        found.refuse_more()
        if name and name in found.variables:
            raise _Damaged(f"{name[:60]}: two variables have this name")
        found.variables[name] = Variable(name, shape, partial(_shaped, values, shape))


def _shaped(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return values.astype(float).reshape(shape, order="F")


def _label(element: _Element) -> str:
    return bytes(element.data).decode("utf-8", "replace")


def _next(parts: Iterator[_Element]) -> _Element:
    part = next(parts, None)
    if part is None:
        raise _Damaged("an array is cut off")
    return part


def _fields(parts: Iterator[_Element], order: str) -> list[str]:
    length = _numbers(_next(parts), order)
    names = bytes(_next(parts).data)
    width = int(length[0]) if length.size else 0
    if width < 1 or len(names) % width or len(names) // width > MOST_VARIABLES:
        raise _Damaged("a struct whose field names have no common length")
    cut = (names[k : k + width].split(b"\0")[0] for k in range(0, len(names), width))
    return ["." + one.decode("utf-8", "replace") for one in cut]


def _inner(
    parts: Iterator[_Element],
    count: int,
    fields: list[str],
    name: str,
    order: str,
    found: _Found,
    depth: int,
) -> None:
    """The arrays inside a cell array (one field without a name) or a struct (array); ends where the bytes end."""
    single = count == 1 and fields != [""]
    for k in range(count if fields else 0):
        for ending in fields:
            inner = _next(parts)
            if inner.type != _MATRIX:
                raise _Damaged(f"{name[:60]}: expected an array inside, found an element of type {inner.type}")
            _matrix(inner.data, order, f"{name}{'' if single else f'[{k}]'}{ending}", found, depth + 1)
