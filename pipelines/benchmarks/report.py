"""Results and sizes of benchmarks, and their printing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcstudy.text_tables import table


@dataclass(frozen=True)
class Sizes:
    """Sizes of the benchmarks.

    ``realizations`` x 2 Fmax cells with ``starts`` each for the solvers; peers that take a second a start get
    ``slow_starts``, and basin hopping ``hops`` runs a realization. ``fits``: sizes of studies, ``repeats``: whole
    processes, ``tasks``: empty tasks, ``files``. ``report_fits``: sizes of cubes whose page is written.
    ``seconds``: no repeat of a latency begins later. ``wheel``: one that was built before.
    ``scale``: sizes of studies of fits that return at once, ``folder``: where their cubes are kept (None: nowhere).
    """

    realizations: int = 3
    starts: int = 50
    slow_starts: int = 10
    hops: int = 3
    repeats: int = 3
    fits: tuple[int, ...] = (1_000, 10_000, 100_000, 1_000_000)
    pools: int = 100
    tasks: int = 3000
    files: int = 400
    framework_cells: int = 40
    study: str = "goodworth2018"
    report_fits: tuple[int, ...] = (38_000, 1_000_000)
    seconds: float = 600.0
    wheel: Path | None = None
    scale: tuple[int, ...] = (100_000, 1_000_000, 10_000_000)
    folder: Path | None = None

    def of_slow(self, peer: str) -> int:
        """Starts of a peer."""
        return self.slow_starts if "trust_constr" in peer else self.starts


QUICK = Sizes(1, 10, 2, 1, 1, (1_000, 10_000), 3, 300, 50, 6, "quick", (300,), scale=(1_000, 10_000))


@dataclass
class Result:
    """Numbers by key, a table for people, remarks, and for some a figure to write to a file."""

    name: str
    keys: dict[str, float] = field(default_factory=dict)
    table: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    figure: Callable[[Path], None] | None = None

    def text(self) -> str:
        """The table and the keys that it does not hold."""
        lines = [f"== {self.name}"]
        if self.table:
            head = list(dict.fromkeys(k for row in self.table for k, v in row.items() if not isinstance(v, dict)))
            lines.append(table(head, [[_show(row.get(k, "")) for k in head] for row in self.table]))
        lines += [f"{key} = {_show(value)}" for key, value in self.keys.items()]
        return "\n".join([*lines, *self.notes])


def _show(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
