"""MATLAB files of version 5 to 7 (``save`` without ``-v7.3``): numbers in variables, structs and cells.

The format is MathWorks' "MAT-File Format" (version 5). Sizes are checked against the bytes that are there, and nesting
is limited. Text is skipped; objects (tables, categories, ...), sparse and complex arrays are named with their class.

The file is parsed here and not by SciPy's ``loadmat``. Of 600 files with one to three changed bytes, most of them in
names and sizes, ``loadmat`` (1.17) ended the process 10 times, in a process of its own, too, and read 40 that this
reader refuses, half of them with other numbers; this reader read 17 that ``loadmat`` refuses. A sound file with two
tables loses the name of one, and every import takes 0.3 s longer. 200 truncated files, and 200 changed and 200
truncated compressed ones, are refused by both; sound files of 2 MB take 4 ms (compressed: 17 ms) with either.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.formats.source import MOST_VARIABLES, Listing, Variable
from mcstudy.recordings.refusals import refused, size_text

LARGEST = 1 << 30
"""Most bytes of a file after decompression."""

HEADER = 128

_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Element types that hold numbers."""

_MATRIX, _COMPRESSED = 14, 15

_CELL, _STRUCT, _OPAQUE = 1, 2, 17
_NUMERIC = range(6, 16)
"""Array classes: cell, struct, objects of new style, double to uint64."""

_OTHERS = {3: "object", 5: "sparse"}
"""Array classes that are named only."""

_COMPLEX = 1 << 11
"""Flag of an array."""


class _Element(NamedTuple):
    type: int
    data: memoryview


def is_matlab5(head: bytes) -> bool:
    """Whether a file's first bytes are those of this format."""
    return head[:10] == b"MATLAB 5.0" and head[126:128] in (b"IM", b"MI")


def variables_of(content: bytes, path: Path) -> Listing[Variable]:
    """All numeric variables of a file by name (``struct.field``, ``cell[0]``), and the class of others by name.

    Raises `RecordingError`.
    """
    reader = _Reader("<" if content[126:128] == b"IM" else ">")
    with refused(ValueError, RecordingError, zlib.error, where=f"{path}: expected a MATLAB file"):
        reader.file(memoryview(content)[HEADER:])
    return reader.listing


def _inflated(data: memoryview, most: int) -> bytes:
    inflate = zlib.decompressobj()
    content = inflate.decompress(data, most + 1)
    if len(content) > most:
        raise ValueError(f"a variable holds more than {most} bytes")
    if not inflate.eof:
        raise ValueError("a variable is cut off")
    return content


def _next(elements: Iterator[_Element]) -> _Element:
    element = next(elements, None)
    if element is None:
        raise ValueError("an array is cut off")
    return element


def _label(element: _Element) -> str:
    return bytes(element.data).decode("utf-8", "replace")


def _shaped(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return values.astype(float).reshape(shape, order="F")


class _Reader:
    """The arrays of a file whose numbers are in one byte ``order``; what is wrong with it raises `ValueError`."""

    def __init__(self, order: str) -> None:
        self._order = order
        self.listing: Listing[Variable] = Listing()

    def file(self, data: memoryview) -> None:
        """Add all arrays behind the header."""
        room = LARGEST
        for element in self._elements(data):
            array = element
            if element.type == _COMPRESSED:
                content = _inflated(element.data, room)
                room -= len(content)
                (array,) = self._elements(memoryview(content))
            if array.type == _MATRIX:
                self._array(array.data, "", 0)

    def _elements(self, data: memoryview) -> Iterator[_Element]:
        """The data elements one after another; a small one has type, size and data in eight bytes."""
        at = 0
        while at + 8 <= len(data):
            first, size = np.frombuffer(data[at : at + 8], f"{self._order}u4").tolist()
            if first >> 16:
                size, kind = first >> 16, first & 0xFFFF
                if size > 4:
                    raise ValueError("a small element holds more than four bytes")
                yield _Element(kind, data[at + 4 : at + 4 + size])
                at += 8
                continue
            if size > len(data) - at - 8:
                raise ValueError(f"cut off: an element declares {size} bytes, {len(data) - at - 8} are left")
            yield _Element(first, data[at + 8 : at + 8 + size])
            at += 8 + size
            at += 0 if first == _COMPRESSED else -size % 8
        if at < len(data):
            raise ValueError("cut off in the middle of an element")

    def _numbers(self, element: _Element) -> np.ndarray:
        if element.type not in _NUMBERS:
            raise ValueError(f"expected numbers, found an element of type {element.type}")
        kind = np.dtype(f"{self._order}{_NUMBERS[element.type]}")
        if len(element.data) % kind.itemsize:
            raise ValueError("an element ends inside a number")
        return np.frombuffer(element.data, kind)

    def _array(self, data: memoryview, name: str, depth: int) -> None:
        """Add the numeric arrays of one array, and of those inside it, under ``name`` or the name it states."""
        self.listing.refuse_deeper(depth)
        elements = self._elements(data)
        head = next(elements, None)
        if head is None:
            return  # an empty cell
        flags = self._numbers(head)
        if flags.size < 1:
            raise ValueError("an array without a class")
        kind = int(flags[0]) & 0xFF
        if kind == _OPAQUE:  # name, "MCOS" and class, and nothing of its size
            label, _, category = (_label(_next(elements)) for _ in range(3))
            self.listing.add_other(name or label, category)
        elif kind in (_CELL, _STRUCT, *_OTHERS, *_NUMERIC):
            category = _OTHERS.get(kind, "complex" if kind in _NUMERIC and flags[0] & _COMPLEX else "")
            self._sized(elements, kind, category, name, depth)

    def _sized(self, elements: Iterator[_Element], kind: int, category: str, name: str, depth: int) -> None:
        """Add what is in an array that states its size; a ``category`` is named only."""
        shape = tuple(int(n) for n in self._numbers(_next(elements)))
        if not shape or min(shape) < 0:
            raise ValueError("an array of negative size")
        label, count = _label(_next(elements)), math.prod(shape)
        name = name or label
        if not name:
            return  # where MATLAB keeps the contents of objects
        if category:
            self.listing.add_other(name, category)
        elif kind in (_CELL, _STRUCT):
            fields = [""] if kind == _CELL else self._fields(elements)
            self._inside(elements, count, fields, name, depth)
        elif count:
            values = self._numbers(_next(elements))
            if values.size != count:
                raise ValueError(f"{name[:60]}: {values.size} numbers for an array of {size_text(shape)}")
            if name in self.listing.numbers:
                raise ValueError(f"{name[:60]}: two variables have this name")
            self.listing.add(name, Variable(name, shape, partial(_shaped, values, shape)))

    def _fields(self, elements: Iterator[_Element]) -> list[str]:
        length = self._numbers(_next(elements))
        names = bytes(_next(elements).data)
        width = int(length[0]) if length.size else 0
        if width < 1 or len(names) % width or len(names) // width > MOST_VARIABLES:
            raise ValueError("a struct whose field names have no common length")
        cells = (names[k : k + width].split(b"\0")[0] for k in range(0, len(names), width))
        return ["." + cell.decode("utf-8", "replace") for cell in cells]

    def _inside(self, elements: Iterator[_Element], count: int, fields: list[str], name: str, depth: int) -> None:
        """The arrays in a cell array (one field without a name) or a struct (array); ends where the bytes end."""
        single = count == 1 and fields != [""]
        for k in range(count if fields else 0):
            for field in fields:
                element = _next(elements)
                if element.type != _MATRIX:
                    raise ValueError(f"{name[:60]}: expected an array inside, found an element of type {element.type}")
                self._array(element.data, f"{name}{'' if single else f'[{k}]'}{field}", depth + 1)
