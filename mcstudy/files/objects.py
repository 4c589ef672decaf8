"""Dataclasses and named tuples of this package as bytes, and back: data alone, in which no code can hide.

Reading a pickled object executes what it says. Here a file holds a JSON list of values, one line, and behind it the
bytes of all arrays. It can name classes, but only such as these, and they are filled without calling anything.
What comes back is equal to the last bit: shared parts are shared again, arrays keep their type and order.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from functools import cache, cached_property
from typing import Any, Literal

import numpy as np

PACKAGE = __name__.partition(".")[0]

PLAIN = (str, bool, int, float, type(None))
"""Types that stand in the list as they are."""

NUMBERS = "biufcSU"
"""Kinds of arrays that are data alone (`numpy.dtype.kind`)."""

SEQUENCES: dict[str, type] = {"list": list, "tuple": tuple}


class NotData(TypeError):
    """A value that is none of these: plain, array of numbers or text, dataclass or named tuple of this package."""


def to_bytes(value: object, apart: Sequence[object] = (), only_apart: type | tuple[type, ...] = ()) -> bytes:
    """``value`` as bytes. Of each object in ``apart`` only its number is written, and `from_bytes` puts it back.

    Raises `NotData` for what cannot be written, and for objects of ``only_apart`` that are not in ``apart``.
    """
    writer = _Writer(apart, only_apart)
    root = writer.written(value)
    return json.dumps([*writer.values, root]).encode() + b"\n" + b"".join(writer.arrays)


def from_bytes(content: bytes, apart: Sequence[object] = ()) -> Any:
    """What `to_bytes` has written. Raises `NotData`, `ValueError` or `LookupError` where it has not."""
    text, _, arrays = content.partition(b"\n")
    *values, root = json.loads(text)
    reader = _Reader(arrays, apart)
    for each in values:
        reader.read.append(reader.made(*each))
    return reader.value(root)


class _Writer:
    """Numbers values in the order in which they can be read: parts first. ``[3]`` stands for the third."""

    def __init__(self, apart: Sequence[object], only_apart: type | tuple[type, ...]) -> None:
        self.values: list[list[Any]] = []
        self.arrays: list[bytes] = []
        self._end = 0
        self._only_apart = only_apart
        self._apart = {id(each): k for k, each in enumerate(apart)}
        self._numbers: dict[int, int] = {}
        self._seen: list[object] = []  # nothing that has a number may make room for another object

    def written(self, value: object) -> Any:
        if type(value) in PLAIN:
            return value
        if id(value) not in self._numbers:
            described = self._described(value)
            self._numbers[id(value)] = len(self.values)
            self._seen.append(value)
            self.values.append(described)
        return [self._numbers[id(value)]]

    def _described(self, value: object) -> list[Any]:
        if id(value) in self._apart:
            return ["apart", self._apart[id(value)]]
        if isinstance(value, self._only_apart):
            raise NotData(f"{type(value).__qualname__} that is not kept apart")
        if isinstance(value, complex) and type(value) is complex:
            return ["complex", value.real, value.imag]
        if isinstance(value, np.ndarray | np.generic):
            return self._array(value)
        kind: Any = type(value)
        for name, sequence in SEQUENCES.items():
            if kind is sequence:
                return [name, [self.written(each) for each in value]]  # type: ignore[attr-defined]
        if kind is dict and isinstance(value, dict):
            return ["dict", [[self.written(k), self.written(v)] for k, v in value.items()]]
        if _known(kind) and hasattr(kind, "__dataclass_fields__"):
            parts = {name: self.written(getattr(value, name)) for name in _names(kind) if _held(value, name)}
            return ["object", *_place(kind), parts]
        if isinstance(value, tuple) and _known(kind) and hasattr(kind, "_fields"):
            return ["named", *_place(kind), [self.written(each) for each in value]]
        raise NotData(".".join(_place(kind)))

    def _array(self, value: np.ndarray | np.generic) -> list[Any]:
        array = np.asarray(value)
        if array.dtype.kind not in NUMBERS or (isinstance(value, np.ndarray) and type(value) is not np.ndarray):
            raise NotData(f"{type(value).__qualname__} of {array.dtype}")
        order: Literal["C", "F"] = "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
        content = array.tobytes(order)
        start, self._end = self._end, self._end + len(content)
        self.arrays.append(content)
        scalar = isinstance(value, np.generic)
        return ["scalar" if scalar else "array", array.dtype.str, list(array.shape), order, start, len(content)]


class _Reader:
    """Makes values from their descriptions; ``read``: those that are made."""

    def __init__(self, arrays: bytes, apart: Sequence[object]) -> None:
        self.read: list[Any] = []
        self._arrays, self._apart = arrays, apart

    def value(self, written: Any) -> Any:
        return self.read[written[0]] if isinstance(written, list) else written

    def made(self, kind: str, *rest: Any) -> Any:
        if kind in SEQUENCES:
            return SEQUENCES[kind](map(self.value, rest[0]))
        if kind == "dict":
            return {self.value(k): self.value(v) for k, v in rest[0]}
        if kind == "object":
            return self._object(*rest)
        if kind == "named":
            return self._named(*rest)
        if kind in ("array", "scalar"):
            array = self._array(*rest)
            return array if kind == "array" else array[()]
        if kind == "complex":
            return complex(*rest)
        if kind == "apart":
            return self._apart[rest[0]]
        raise NotData(kind)

    def _array(self, dtype: str, shape: Sequence[int], order: str, start: int, length: int) -> np.ndarray:
        kind = np.dtype(dtype)
        if kind.kind not in NUMBERS:
            raise NotData(dtype)
        flat = np.frombuffer(
            self._arrays[start : start + length], kind
        ).copy()  # a copy, as the others can be written to
        return flat.reshape(shape, order="F" if order == "F" else "C")

    def _object(self, module: str, name: str, parts: dict[str, Any]) -> object:
        kind = _class(module, name)
        if not is_dataclass(kind) or not parts.keys() <= _names(kind).keys():
            raise NotData(f"{module}.{name}")
        made = object.__new__(kind)
        for part, written in parts.items():
            object.__setattr__(made, part, self.value(written))
        return made

    def _named(self, module: str, name: str, parts: list[Any]) -> object:
        kind = _class(module, name)
        if not issubclass(kind, tuple) or len(getattr(kind, "_fields", ())) != len(parts):
            raise NotData(f"{module}.{name}")
        return tuple.__new__(kind, map(self.value, parts))


@cache
def _class(module: str, name: str) -> type:
    """A class of this package. Raises `NotData` for anything else, before any module of another package is imported."""
    if module.partition(".")[0] == PACKAGE:
        found = vars(importlib.import_module(module)).get(name)
        if isinstance(found, type) and _known(found):
            return found
    raise NotData(f"{module}.{name}")


def _place(kind: type) -> tuple[str, str]:
    """Module and name of a class."""
    return kind.__module__, kind.__qualname__


def _known(kind: type) -> bool:
    """Whether a class is defined in this package, under its own name in its module."""
    return kind.__module__.partition(".")[0] == PACKAGE and "." not in kind.__qualname__


@cache
def _names(kind: Any) -> dict[str, None]:
    """Fields of a dataclass, and what it computes once and then keeps."""
    computed = [n for base in kind.__mro__ for n, v in vars(base).items() if isinstance(v, cached_property)]
    return dict.fromkeys([*(f.name for f in fields(kind)), *computed])


def _held(value: object, name: str) -> bool:
    """Whether a dataclass holds ``name``: a field does so always, a computed part once it was asked for."""
    slots = (name in vars(base).get("__slots__", ()) for base in type(value).__mro__)
    return name in getattr(value, "__dict__", ()) or any(slots)
