"""The variables of a laboratory's file: names, shapes, units and rates are known, values are read on demand.

Each reader (text, MATLAB, C3D) lists variables under one kind of name. A name may be followed by indices from 0, as in
numpy: ``data.angles[:,1]`` is the second column.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.refusals import UNREAD, first_line, size_text
from mcstudy.text_tables import printable, similar

MOST_VARIABLES = 10_000
"""Most variables of a file."""

SHOWN = 20
"""Most names in a message."""

_INDEX = re.compile(
    r"(?P<name>.+)\[(?P<index>\s*(?::|-?\d{1,9})(?:\s*,\s*(?::|-?\d{1,9}))*\s*)\]", re.ASCII | re.DOTALL
)

DEEPEST = 16
"""Deepest nesting of structs and cells."""

TEXTS = "texts"
"""What a column holds that is neither numbers nor time stamps."""

_TIME = re.compile(r"time(?:_(?:s|ms|us|sec))?", re.IGNORECASE)


@dataclass(frozen=True)
class Variable:
    """Numbers under a name.

    Attributes
    ----------
    name
        As it is asked for.
    shape
        Of the values.
    read
        Returns the values, float64.
    unit
        As the file states it, or None.
    rate_hz
        Samples per second as the file states it, or None.
    angle_unit
        Unit of all angles of the file, which holds if this is one; or None.
    content
        What it holds in words where that is not numbers.
    """

    name: str
    shape: tuple[int, ...]
    read: Callable[[], np.ndarray]
    unit: str | None = None
    rate_hz: float | None = None
    angle_unit: str | None = None
    content: str = ""


T = TypeVar("T")


@dataclass
class Listing(Generic[T]):
    """What a file holds: arrays of numbers by name, and the classes of what is none."""

    numbers: dict[str, T] = field(default_factory=dict)
    others: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, array: T) -> None:
        """Add an array of numbers; raises `RecordingError`, without a place, for more than a file may have."""
        self._refuse_more()
        self.numbers[name] = array

    def add_other(self, name: str, category: str) -> None:
        """Add what is no array of numbers."""
        self._refuse_more()
        self.others[name] = category

    def _refuse_more(self) -> None:
        if len(self.numbers) + len(self.others) >= MOST_VARIABLES:
            raise RecordingError(f"expected at most {MOST_VARIABLES} variables")

    @staticmethod
    def refuse_deeper(depth: int, name: str = "") -> None:
        """Raise `RecordingError`, without a place, beyond `DEEPEST`."""
        if depth > DEEPEST:
            place = f"{name[:60]}: " if name else ""
            raise RecordingError(f"{place}expected structs and cells nested at most {DEEPEST} deep")


@dataclass(frozen=True)
class Picked:
    """Values of a variable, and what the file states of them."""

    name: str
    values: np.ndarray
    unit: str | None = None
    rate_hz: float | None = None
    angle_unit: str | None = None


@dataclass(frozen=True)
class Source:
    """The variables of one file, by name.

    ``kind``: format in words. ``numbered``: names of columns by their position, which may also be asked for by it.
    ``plain``: names as the file states them, with the positions of the columns that have them. ``remarks``: what was
    left out of the file, in words. ``others``: what there is to say of variables that are no numbers, by name.
    """

    path: Path
    kind: str
    variables: Mapping[str, Variable]
    numbered: tuple[str, ...] = ()
    plain: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    others: Mapping[str, str] = field(default_factory=dict)

    def pick(self, key: str | int) -> Picked:
        """The values under a name, with or without indices, or of a column by its number; `RecordingError`.

        A number is a position, whatever the columns are called.
        """
        if isinstance(key, int) or (self.numbered and key.isascii() and key.isdecimal()):
            return self._of(self._column(int(key)))
        if len(at := self.plain.get(key, ())) > 1:
            raise RecordingError(
                f"{self.path}: column {key!r}: {len(at)} columns have this name, {', '.join(map(str, at))} from 0; "
                "give the number of one"
            )
        if at:
            return self._of(self.numbered[at[0]])
        if key in self.variables:
            return self._of(key)
        name, index = _parts(key)
        if name not in self.variables:
            raise RecordingError(self._missing(key))
        return self._indexed(self._of(name), index)

    def has(self, name: str) -> bool:
        """Whether one variable, or several, have this name."""
        return name in self.variables or name in self.plain

    def time(self) -> str | int | None:
        """The variable that is called time, ``Time`` or ``time_ms``, None where there is none or it is other text."""
        if self.has("time") and not self.numbered:
            return "time"
        alike = [k for k, name in enumerate(self.numbered) if name == "time"] or [
            k for k, name in enumerate(self.numbered) if _TIME.fullmatch(name)
        ]
        if len(self.plain.get("time", ())) > 1:
            return "time"
        numeric = [k for k in alike if self.variables[self.numbered[k]].content != TEXTS]
        return numeric[0] if len(numeric) == 1 else None

    def elements(self, key: str) -> list[Picked]:
        """The values under a name in every element of a struct array or cell array, in order; `RecordingError`.

        ``trial.torque`` means ``trial[0].torque``, ``trial[1].torque`` and so on.
        """
        bare = {name: re.sub(r"\[\d+\]", "", name) for name in self.variables}
        key, index = (key, ()) if key in bare.values() else _parts(key)
        picked = [self._of(name) for name, short in bare.items() if short == key]
        if not picked:
            raise RecordingError(self._missing(key))
        return [self._indexed(p, index) for p in picked]

    def _indexed(self, picked: Picked, index: tuple[slice | int, ...]) -> Picked:
        if not index:
            return picked
        try:
            return replace(picked, values=picked.values[index])
        except IndexError:
            shape = size_text(picked.values.shape)
            raise RecordingError(f"{self.path}: {picked.name}: expected indices from 0 within {shape}") from None

    def _of(self, name: str) -> Picked:
        variable = self.variables[name]
        try:
            values = np.asarray(variable.read(), dtype=float)
        except UNREAD as error:
            raise RecordingError(f"{self.path}: {name}: cannot be read: {first_line(error)}") from error
        return Picked(name, values, variable.unit, variable.rate_hz, variable.angle_unit)

    def _column(self, number: int) -> str:
        if not 0 <= number < len(self.numbered):
            raise RecordingError(f"{self.path}: column {number}: the file has columns 0 to {len(self.numbered) - 1}")
        return self.numbered[number]

    def _missing(self, key: str) -> str:
        for name, said in self.others.items():
            if key == name or key.startswith((f"{name}.", f"{name}[", f"{name}(")):
                return f"{self.path}: {said}"
        names = list(self.variables)
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        what = "column" if self.numbered else "variable"
        listed = printable(", ".join(names[:SHOWN])) or "none"
        bare = names == [str(k) for k in range(len(names))]
        hint = "; no line of names was found: give the number of a column" if self.numbered and bare else ""
        return f"{self.path}: {what} {key!r} is missing{similar(key, names[:1000])}; found {listed}{more}{hint}"


def _parts(key: str) -> tuple[str, tuple[slice | int, ...]]:
    """A name and the indices behind it; none where there are none."""
    match = _INDEX.fullmatch(key)
    if match is None:
        return key, ()
    return match["name"], tuple(slice(None) if i.strip() == ":" else int(i) for i in match["index"].split(","))
