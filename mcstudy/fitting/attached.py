"""Solvers of other packages: what attaches, and its source, without loading it or a library of numbers."""

from __future__ import annotations

import importlib
from functools import cache
from importlib.metadata import EntryPoint, entry_points

from mcstudy import program

GROUP = "mcstudy.solvers"
"""Entry points of this group name `mcstudy.fitting.solvers.Solver`s of other packages."""


def attached_sources() -> tuple[str, ...]:
    """Folders or modules of other packages that solvers come from, by their path, as `program.source` knows them."""
    return tuple(dict.fromkeys(entry.module.replace(".", "/") for entry in entries()))


@cache
def entries() -> list[EntryPoint]:
    """Entry points of those solvers, whose packages count among the sources of this process."""
    points = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    for entry in points:
        name = entry.module.partition(".")[0]
        program.attach(name, importlib.import_module(name).__path__[0])
    return points
