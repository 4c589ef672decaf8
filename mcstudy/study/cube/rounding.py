"""What was computed in another environment: the same to within rounding, in other bytes, which is no damage.

Another processor or library rounds otherwise in the last digits, and another version of Zarr or Zstandard writes the
same values in other bytes. Nothing is gained by writing what follows from the study again; what was searched for is
compared within a tolerance.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numcodecs.zstd import Zstd

from mcstudy.files.untrusted import sealed, zstd_claim
from mcstudy.fitting.status import USABLE
from mcstudy.study.cube.checksums import OWN
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.store import Cube, GroupStore
from mcstudy.study.environment import differences
from mcstudy.study.models import earlier_provenance

Arrays = dict[str, np.ndarray]

ROUNDING = 1e-9
"""Largest relative difference of a derived number that rounding explains."""


def apart(cube: Cube, store: GroupStore, chunk: Chunk, now: dict[str, Any]) -> list[str]:
    """In what the environments of a chunk differ from ``now``, as `differences`; empty where it was made in this."""
    known = {OWN: cube.attributes["environment"], **cube.attributes.get("environments", {})}
    lines: dict[str, None] = {}
    for name in store.environments(chunk) or (OWN,):
        environment = known.get(name)
        lines |= dict.fromkeys(
            [f"environment {name}: not known"] if environment is None else differences(environment, now)
        )
    return list(lines)


def alike(cube: Cube, file: Path, expected: bytes, actual: bytes) -> bool:
    """Whether a file of metadata or of a derived array, by its path in the cube, says the same as the one made here."""
    if file.name == "zarr.json":
        older = expected.decode()
        for store in cube.groups.values():
            if file.parts[0] in (store.name, "zarr.json"):
                now, then = store.experiment.model.provenance, earlier_provenance(store.layout.group)
                older = older.replace(json.dumps(now), json.dumps(then))
        try:
            return json.loads(actual) in (json.loads(expected), json.loads(older))
        except (ValueError, RecursionError):
            return False
    group, array = file.parts[0], file.parts[1]
    if not sealed(actual) or zstd_claim(actual) != zstd_claim(expected):
        return False
    actual_values, expected_values = (bytes(Zstd().decode(content[:-4])) for content in (actual, expected))
    dtype = cube.groups[group].layout.arrays[array].dtype
    if dtype == "string":
        return actual_values == expected_values
    values, others = (np.frombuffer(content, dtype) for content in (actual_values, expected_values))
    return bool(np.allclose(values, others, rtol=ROUNDING, atol=0.0, equal_nan=True))


TOLERANCE = 1e-6
"""Largest relative difference of data and costs that another environment explains, unless the caller says otherwise."""

FLOOR = 1e-6
"""Costs below this are compared as if they were this large: those of fits without noise are rounding errors."""

DATA: dict[str, int | tuple[int, int]] = {"frf": -1, "noise_covariance": (-2, -1)}
"""Results that are computed and not searched for, so that they hardly depend on rounding; axes of one frequency."""


@dataclass
class Compared:
    """Cells that were computed in another environment and came out otherwise here; differences are relative.

    A search may take another path after the first rounding error and end elsewhere. So fits are compared in two ways:
    the stored cost with the cost, here, of the stored estimate, which rounding hardly changes, and both ends.

    Attributes
    ----------
    tolerance: largest ``data`` and ``cost_there`` of a cell that another environment explains.
    cells, fits: number of them. ends: fits that ended here at the same cost and parameters within the tolerance.
    data: largest difference of the data and their noise. cost_there: of the cost at the stored estimate.
    cost, parameter: of the ends (a parameter's relative to the width of its bounds).
    """

    tolerance: float = TOLERANCE
    cells: int = 0
    fits: int = 0
    ends: int = 0
    data: float = 0.0
    cost_there: float = 0.0
    cost: float = 0.0
    parameter: float = 0.0

    @property
    def within(self) -> bool:
        """Whether rounding explains all differences."""
        return self.data <= self.tolerance and self.cost_there <= self.tolerance

    def add(self, other: Compared) -> None:
        """Take the cells of another comparison into this one."""
        for name in ("cells", "fits", "ends"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name in ("data", "cost_there", "cost", "parameter"):
            setattr(self, name, max(getattr(self, name), getattr(other, name)))

    def text(self) -> str:
        """In words."""
        return (
            f"data differ by at most {self.data:.1e}, stored costs from those of the stored estimates by "
            f"{self.cost_there:.1e} (relative; tolerance {self.tolerance:.0e}); of {self.fits} fits repeated, "
            f"{self.ends} end at the same place; ends differ by at most {self.cost:.1e} in cost and "
            f"{self.parameter:.1e} of the width of its bounds in a parameter"
        )


def compared(
    store: GroupStore, chunk: Chunk, row: int, arrays: tuple[Arrays, Arrays], chosen: np.ndarray, tolerance: float
) -> Compared:
    """Compare one realization of a chunk as stored and as computed here.

    ``row``: of the realization in the chunk. ``arrays``: of the chunk, stored and computed. ``chosen``: the fits that
    were run again, of the shape of ``status``.
    """
    stored, here = arrays
    experiment, group = store.experiment, store.layout.group
    out = Compared(tolerance, cells=1, fits=int(chosen.sum()))
    fits = chosen & np.isin(stored["status"], USABLE)
    width = experiment.model.upper - experiment.model.lower
    for name, axes in DATA.items():
        if name in stored and not (store.older and name == "noise_covariance"):
            a, b = (x[name][0, row] for x in (stored, here))
            out.data = max(out.data, _apart(a, b, np.abs(a).max(axis=axes, keepdims=True)))
    out.data = max(out.data, _apart(stored["initial"][chosen], here["initial"][chosen], width))
    measured = experiment.measure(group.amplitude[chunk.amplitude], store.layout.realizations(chunk)[row])
    if store.older and measured.covariance is not None:  # whose estimate held rounding errors of the angle that is none
        measured = replace(measured, covariance=stored["noise_covariance"][0, row])
    for k, fmax in enumerate(group.fmax):
        problem = experiment.problem(measured, fmax)
        for place in zip(*np.nonzero(fits[:, k]), strict=True):
            at = (place[0], k, *place[1:])
            cost, again = stored["cost"][at], problem.cost(stored["estimate"][at])
            out.cost_there = max(out.cost_there, _apart(cost, again, max(cost, FLOOR)))
    pairs = [list(zip(stored[name][fits], here[name][fits], strict=True)) for name in ("cost", "estimate")]
    cost = np.array([_apart(a, b, max(a, FLOOR)) for a, b in pairs[0]])
    parameter = np.array([_apart(a, b, width) for a, b in pairs[1]])
    out.ends = int(((cost <= tolerance) & (parameter <= tolerance)).sum())
    out.cost, out.parameter = float(cost.max(initial=0.0)), float(parameter.max(initial=0.0))
    return out


def _apart(a: Any, b: Any, scale: Any) -> float:
    """Largest difference of numbers or arrays, relative to ``scale``; infinite where only one of them has a number."""
    if not np.array_equal(np.isfinite(a), np.isfinite(b)):
        return float("inf")
    difference, size = np.abs(np.nan_to_num(a) - np.nan_to_num(b)), np.nan_to_num(np.broadcast_to(scale, np.shape(a)))
    relative = np.divide(difference, size, out=np.where(difference > 0, np.inf, 0.0), where=size > 0)
    return float(np.max(relative, initial=0.0))
