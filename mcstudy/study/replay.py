"""Repeat one stored fit, iteration by iteration, and compare the result with the stored one bit for bit.

Where the fit was computed in another environment, which rounds otherwise, it is compared within a tolerance.

The path comes from the solver itself: the fit is run with an iteration limit of 1, 2, 3 ..., and each run ends at the
next point of the path.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mcstudy.errors import InputError
from mcstudy.fitting.problem import Problem
from mcstudy.fitting.solvers import fit
from mcstudy.fitting.status import Status
from mcstudy.stance.feedback import Model
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.replacement import settled
from mcstudy.study.cube.rounding import TOLERANCE, Compared, apart, compared
from mcstudy.study.cube.store import Cube, GroupStore
from mcstudy.study.environment import environment
from mcstudy.study.execution.tasks import again


@dataclass(frozen=True)
class Point:
    """A point on the path of a fit: iteration, cost, parameters (P,), and the step (P,) from the previous point."""

    iteration: int
    cost: float
    theta: np.ndarray
    step: np.ndarray


@dataclass(frozen=True)
class Replay:
    """A repeated fit.

    Attributes
    ----------
    model: the fitted model.
    path: the start (iteration 0) and every iteration.
    status: status of the repeated fit; stored_status: status of the stored fit.
    differ: names of arrays whose recomputed values differ from the stored ones in any bit.
    environment: in what the environment in which the stored fit was computed differs from this one.
    elsewhere: how far apart the two are, where they differ and the environments do.
    """

    model: Model
    path: tuple[Point, ...]
    status: Status
    stored_status: Status
    differ: tuple[str, ...]
    environment: tuple[str, ...] = ()
    elsewhere: Compared | None = None

    @property
    def reproduced(self) -> bool:
        """Whether both are equal, or differ by no more than rounding in another environment explains."""
        return not self.differ or (self.elsewhere is not None and self.elsewhere.within)


@dataclass(frozen=True)
class _Place:
    store: GroupStore
    chunk: Chunk
    fmax: int
    row: int
    start: int


def replay(
    out: str | Path,
    *,
    realization: int,
    start: int,
    group: str | None = None,
    amplitude: float | None = None,
    fmax: float | None = None,
) -> Replay:
    """Repeat one stored fit, iteration by iteration, and compare the result with the stored one bit for bit.

    Parameters
    ----------
    out
        Path of a results cube.
    realization, start
        Which fit of the cell, both from 0.
    group, amplitude, fmax
        The cell: name of a group, amplitude of the stimulus (N m or m, as in the study), highest frequency (Hz). None
        where there is only one.

    Returns
    -------
    Replay
        ``path`` (every iteration), ``status``, ``differ`` (arrays that differ from the stored ones), ``reproduced``.

    Raises
    ------
    InputError
        The cell does not exist or has not been run.
    StoreError
        The cube cannot be used.
    """
    return settled([out], lambda: _replay(out, group, amplitude, fmax, realization, start))


def _replay(
    out: str | Path, group: str | None, amplitude: float | None, fmax: float | None, realization: int, start: int
) -> Replay:
    cube = Cube.open(out)
    at = _place(cube, group, amplitude, fmax, realization, start)
    store, chunk = at.store, at.chunk
    stored = store.held(chunk)
    cell = (0, at.fmax, at.row, at.start)
    before = Status(int(stored["status"][cell]))
    if before is Status.PENDING:
        raise InputError(f"{out}: expected a finished fit, but this one has not been run yet")
    if before is Status.NOT_NEEDED:
        raise InputError(f"{out}: expected a finished fit, but this one was {before.text}")
    chosen = np.zeros(stored["status"].shape, dtype=bool)
    chosen[cell] = True
    repeated = again(store, chunk, stored, chosen)
    differ = tuple(n for n in store.layout.results if stored[n].tobytes() != repeated[n].tobytes())
    others, elsewhere = tuple(apart(cube, store, chunk, environment())), None
    if differ and others:
        elsewhere = compared(store, chunk, at.row, (stored, repeated), chosen, TOLERANCE)
    experiment = store.experiment
    data = experiment.measure(experiment.group.amplitude[chunk.amplitude], realization)
    problem = experiment.problem(data, experiment.group.fmax[at.fmax])
    theta = experiment.starts([problem], [realization])[0, at.start]
    status = Status(int(repeated["status"][cell]))
    path = _path(problem, theta, int(repeated["iterations"][cell]), store) if status.usable else ()
    return Replay(experiment.model, path, status, before, differ, others, elsewhere)


def _path(problem: Problem, theta: np.ndarray, iterations: int, store: GroupStore) -> tuple[Point, ...]:
    settings = store.layout.group.fit
    points = [Point(0, problem.cost(theta), theta, np.zeros_like(theta))]
    for k in range(1, iterations + 1):
        # As far as the last one nothing holds the loop stable.
        free = settings.options()._replace(max_iterations=k, margin=None)
        prefix = fit(problem, theta[None], settings.solver, free if k < iterations else settings.options())
        x = prefix.estimate[0]
        points.append(Point(k, float(prefix.cost[0]), x, x - points[-1].theta))
    return tuple(points)


def _place(
    cube: Cube, group: str | None, amplitude: float | None, fmax: float | None, realization: int, start: int
) -> _Place:
    if group is not None and group not in cube.groups:
        raise InputError(f"group: expected one of {', '.join(cube.groups)}, got {group}")
    possible = [group] if group is not None else list(cube.groups)
    axes = {name: cube.groups[name].layout.group for name in possible}
    name, only = possible[0], axes[possible[0]]
    if amplitude is None and len(only.amplitude) == 1:
        amplitude = only.amplitude[0]
    if fmax is None and len(only.fmax) == 1:
        fmax = only.fmax[0]
    if len(possible) > 1 or amplitude is None or fmax is None:
        given = {"group": group, "amplitude": amplitude, "fmax": fmax}
        wanted = ", ".join(name for name, value in given.items() if value is None)
        choices = "; ".join(
            f"group {name}: amplitude {_listed(g.amplitude)}, fmax {_listed(g.fmax)}" for name, g in axes.items()
        )
        raise InputError(f"{wanted}: needed to choose one fit ({choices})")
    store = cube.groups[name]
    design, depth = store.layout.group, store.layout.realizations_a_chunk
    for name, value, size in (("realization", realization, design.realizations), ("start", start, design.starts)):
        if not 0 <= value < size:
            raise InputError(f"{name}: expected 0 to {size - 1}, got {value}")
    chunk = Chunk(_index("amplitude", design.amplitude, amplitude), realization // depth)
    return _Place(store, chunk, _index("fmax", design.fmax, fmax), realization % depth, start)


def _index(name: str, axis: tuple[float, ...], value: float) -> int:
    for k, x in enumerate(axis):
        if math.isclose(x, value, rel_tol=1e-9):
            return k
    raise InputError(f"{name}: expected one of {_listed(axis)}, got {value:g}")


def _listed(axis: tuple[float, ...]) -> str:
    return ", ".join(f"{x:g}" for x in axis)
