"""A part of the tables: some groups, conditions and parameters."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from mcstudy.errors import InputError
from mcstudy.text_tables import similar

Entry = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Selection:
    """What is wanted; where a field is empty, everything is.

    Attributes
    ----------
    groups, parameters: names. fmax: Hz. amplitude: in the unit of the stimulus.
    """

    groups: Sequence[str] = ()
    fmax: Sequence[float] = ()
    amplitude: Sequence[float] = ()
    parameters: Sequence[str] = ()

    def __bool__(self) -> bool:
        return any([self.groups, self.fmax, self.amplitude, self.parameters])


def selected(data: Entry, wanted: Selection) -> Entry:
    """The tables of what is wanted; raises `InputError` when something wanted is in none of them."""
    sweeps = {name: group.get("cell", {}).get("sweep", name) for name, group in data["groups"].items()}
    _check("group", wanted.groups, [*sweeps.values(), *sweeps])
    groups = {n: g for n, g in data["groups"].items() if not wanted.groups or {n, sweeps[n]} & set(wanted.groups)}
    for key in ("fmax", "amplitude"):
        values = sorted(cell[key] for group in groups.values() for cell in group["cells"])
        _check(key, getattr(wanted, key), values)
    names = [p["name"] for group in groups.values() for cell in group["cells"] for p in cell["parameters"]]
    _check("parameter", wanted.parameters, names)
    parts = {name: _part(group, wanted) for name, group in groups.items()}
    return {**data, "groups": {name: group for name, group in parts.items() if group["cells"]}}


def _part(group: Entry, wanted: Selection) -> Entry:
    """A group with the wanted cells, each with the wanted parameters; a cell that has none of these is left out."""
    design = {key: [x for x in group["design"][key] if _is(x, getattr(wanted, key))] for key in ("fmax", "amplitude")}
    cells = [
        {**cell, "parameters": [p for p in cell["parameters"] if _is(p["name"], wanted.parameters)]}
        for cell in group["cells"]
        if all(_is(cell[key], getattr(wanted, key)) for key in ("fmax", "amplitude"))
    ]
    return {**group, "design": {**group["design"], **design}, "cells": [cell for cell in cells if cell["parameters"]]}


def _is(value: Any, wanted: Sequence[Any]) -> bool:
    return not wanted or value in wanted


def _check(what: str, wanted: Sequence[Any], values: Iterable[Any]) -> None:
    known = list(dict.fromkeys(values))
    for value in wanted:
        if value not in known:
            near = similar(value, known) if isinstance(value, str) else ""
            raise InputError(f"--{what} {_text(value)}: expected one of {', '.join(map(_text, known))}{near}")


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"
