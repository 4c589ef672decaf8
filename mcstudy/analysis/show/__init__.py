"""The tables of `mcstudy show`, as data and as text."""

from __future__ import annotations

from typing import Any

SCHEMA = "show"
"""Name of the schema of the tables."""

FIRST = ("Warning", "The simulated body", "The fitted model")
"""Beginnings of the notes of a group that change what all of its numbers mean."""


def first_notes(group: dict[str, Any]) -> list[str]:
    """The notes that stand above the numbers."""
    return [note for note in group["notes"] if note.startswith(FIRST)]
