"""The front of a C3D file: its header and its parameters, with numbers of Intel, DEC and MIPS processors.

The header is one block of 512 bytes. The parameters follow as records, each with the number of its group: text
(``char``), bytes, 16-bit integers or 32-bit floats, in arrays whose first index runs fastest. Source: The C3D file
format, user guide (c3d.org), chapters on the header and the parameter section.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

BLOCK = 512
"""Bytes of a block; sections begin at blocks, which are counted from 1."""

_KEY = 0x50

_PROCESSORS = {84: "intel", 85: "dec", 86: "mips"}

_TYPES = {-1: "S1", 1: "u1", 2: "i2", 4: "f4"}
"""Element types of a parameter by their code, which is the size of an element but for text."""


class Damaged(ValueError):
    """The bytes are not what the format says."""


@dataclass(frozen=True)
class Numbers:
    """How a processor stores numbers."""

    processor: str

    @property
    def order(self) -> str:
        """Byte order as in NumPy's type strings."""
        return ">" if self.processor == "mips" else "<"

    def read(self, data: bytes | memoryview, kind: str) -> np.ndarray:
        """Numbers of a type (``i2``, ``u2``, ``f4``, ...) from bytes, as this machine has them."""
        if kind != "f4" or self.processor != "dec":
            return np.frombuffer(data, f"{self.order}{kind}")
        words = np.frombuffer(data, "<u2").reshape(-1, 2)  # the word with sign and exponent comes first
        return np.ascontiguousarray(words[:, ::-1]).view("<f4").ravel() / np.float32(4)  # another bias of the exponent


@dataclass(frozen=True)
class Parameters:
    """Header words and parameters of a file.

    Attributes
    ----------
    numbers
        How its processor stores numbers.
    header
        The 256 words of the header, unsigned.
    scale, rate_hz
        Of points, as the header states them.
    start
        Byte at which the parameters begin.
    values
        Arrays by ``GROUP:NAME``; text is an array of strings.
    """

    numbers: Numbers
    header: np.ndarray
    scale: float
    rate_hz: float
    start: int
    values: dict[str, np.ndarray]

    def texts(self, key: str) -> list[str]:
        """Text under a key, one or many; those of ``KEY2``, ``KEY3``, ... follow, as there are more than 255."""
        return [str(text) for value in self._chain(key) if value.dtype.kind == "U" for text in value]

    def floats(self, key: str) -> np.ndarray:
        """Numbers under a key in one row, those of ``KEY2``, ``KEY3``, ... included; empty where there are none."""
        return np.concatenate([np.empty(0), *(v.astype(float) for v in self._chain(key) if v.dtype.kind != "U")])

    def _chain(self, key: str) -> list[np.ndarray]:
        names = itertools.takewhile(self.values.__contains__, (f"{key}{k}" for k in itertools.count(2)))
        return [self.values[name] for name in (key, *names) if name in self.values]

    def count(self, key: str) -> int | None:
        """A whole number that is not negative; 16 bits count to 65,535, floats further. None where there is none."""
        value = self.values.get(key)
        if value is None or value.dtype.kind == "U" or not value.size:
            return None
        first = value.view("u2")[0] if value.dtype == np.int16 else value[0]
        return int(first) if math.isfinite(first) and first >= 0 else None

    def long(self, key: str) -> int | None:
        """A whole number of 32 bits in two words, the lower one first, or of one float."""
        value = self.values.get(key)
        if value is None or value.dtype != np.int16 or value.size < 2:
            return self.count(key)
        low, high = value.view("u2")[:2].tolist()
        return int(low) + (int(high) << 16)


def parameters_of(content: bytes) -> Parameters:
    """Header and parameters of a file; raises `Damaged`."""
    if len(content) < 2 * BLOCK or content[1] != _KEY or content[0] < 2:
        raise Damaged("no header of this format")
    start = (content[0] - 1) * BLOCK
    if start + 4 > len(content):
        raise Damaged("cut off before its parameters")
    if content[start + 3] not in _PROCESSORS:
        raise Damaged(f"a processor of type {content[start + 3]}; known are 84 (Intel), 85 (DEC) and 86 (MIPS)")
    numbers = Numbers(_PROCESSORS[content[start + 3]])
    scale, rate = (float(numbers.read(content[at : at + 4], "f4")[0]) for at in (12, 20))
    header = numbers.read(content[:BLOCK], "u2")
    return Parameters(numbers, header, scale, rate, start, _values(content, start + 4, numbers))


def _values(content: bytes, at: int, numbers: Numbers) -> dict[str, np.ndarray]:
    groups: dict[int, str] = {}
    records: list[tuple[int, str, np.ndarray]] = []
    while True:
        length, group = np.frombuffer(_part(content, at, 2), "i1").tolist()
        if not length:
            break
        name = _text(_part(content, at + 2, abs(length))).upper()
        at += 2 + abs(length)
        step = int(numbers.read(_part(content, at, 2), "u2")[0])
        if group < 0:
            groups[-group] = name
        else:
            records.append((group, name, _array(content, at + 2, numbers, name)))
        if not step:
            break
        at += step
    return {f"{groups.get(group, group)}:{name}": value for group, name, value in records}


def _array(content: bytes, at: int, numbers: Numbers, name: str) -> np.ndarray:
    code, rank = int(np.frombuffer(_part(content, at, 1), "i1")[0]), _part(content, at + 1, 1)[0]
    if code not in _TYPES:
        raise Damaged(f"{name[:60]}: a parameter of type {code}")
    shape = tuple(_part(content, at + 2, rank))
    data = _part(content, at + 2 + rank, abs(code) * math.prod(shape))
    if code > 0:
        return numbers.read(data, _TYPES[code]).astype(_TYPES[code])
    width = shape[0] if shape else 1
    return np.array([_text(data[k : k + width]) for k in range(0, len(data), max(width, 1))], dtype=np.str_)


def _part(content: bytes, at: int, size: int) -> bytes:
    if at + size > len(content):
        raise Damaged("cut off in its parameters")
    return content[at : at + size]


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8").strip("\0 ")
    except UnicodeDecodeError:
        return data.decode("latin-1").strip("\0 ")
