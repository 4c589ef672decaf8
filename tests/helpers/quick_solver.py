"""The compiled solver with other sizes of chunks and calls, so that a small study has many of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from mcstudy.fitting.solvers import Solver, solvers


def lm(**changes: Any) -> tuple[dict[str, Solver], str, Solver]:
    """What ``monkeypatch.setitem`` is handed; ``changes``: of fields of `Solver`."""
    return solvers(), "lm", replace(solvers()["lm"], **changes)
