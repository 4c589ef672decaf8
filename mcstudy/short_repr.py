"""Short display of a record at a prompt and in a notebook: a few facts instead of its arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod

from mcstudy.text_tables import Table


class Summary(ABC):
    """A short ``repr`` and a notebook table from `facts`; for dataclasses that are declared with ``repr=False``."""

    @abstractmethod
    def facts(self) -> list[tuple[str, str]]:
        """Pairs (name, value) in display order; few and short."""

    def __repr__(self) -> str:
        facts = self.facts()
        width = max(len(name) for name, _ in facts)
        return "\n".join([type(self).__name__, *(f"  {name:{width}}  {value}" for name, value in facts)])

    def _repr_html_(self) -> str:
        return Table(type(self).__name__, (), self.facts()).html()


def shortened(text: str, most: int = 200) -> str:
    """A text on one line, cut when it is long."""
    line = " ".join(text.split())
    return line if len(line) <= most else line[: most - 1] + "…"
