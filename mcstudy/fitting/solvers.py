"""Solvers of study files, each one declaration; those of other packages attach by an entry point.

Nothing is compiled or loaded until a solver is used, so that to read a study file takes no time.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mcstudy.fitting.attached import entries
from mcstudy.fitting.problem import Fits, Problem
from mcstudy.fitting.status import Status

if TYPE_CHECKING:
    from mcstudy.files.sections import Section  # whose library a diagnosis does not need


USUAL_ROWS = 2
"""Number of rows of the models that functions are compiled for ahead."""


class Part(NamedTuple):
    """Functions that are compiled together.

    Attributes
    ----------
    compile: ``module:function`` that has them compiled, by a call without arguments; of a part with ``rows`` with these
        as its argument.
    functions: number of functions compiled for them by a new process that has those of ``after`` on disk.
    seconds: CPU time this takes (2.3 GHz Xeon, busy with other work).
    after: parts whose functions become part of these.
    calls: parts whose functions these call at their address (`mcstudy.compiling.addresses`): needed to run, not to
        compile.
    rows: number of rows of the models that they are compiled for; 0: they are the same for all.
    """

    compile: str
    functions: int
    seconds: float
    after: tuple[str, ...] = ()
    calls: tuple[str, ...] = ()
    rows: int = 0


class Options(NamedTuple):
    """Stop rules, and the choices of one solver.

    tolerance: predicted decrease of the cost below which a fit has converged, relative to the cost.
    max_iterations: most evaluations of the model with its derivatives.
    settings: of the solver, an instance of its ``settings``; None for their defaults, or where it has none.
    margin: how far left of the imaginary axis all characteristic roots must lie, 1/s (`mcstudy.fitting.stable`); None:
        a fit may end at an unstable loop.
    """

    tolerance: float = 1e-12
    max_iterations: int = 1000
    settings: Any = None
    margin: float | None = None


Solve = Callable[[Sequence[Problem], np.ndarray, np.ndarray, Options], Fits]
"""Fits M starts (M, P), start m on problem ``assignment[m]`` of R problems that share model and frequencies."""


@dataclass(frozen=True, kw_only=True)
class Solver:
    """A solver that a study file may name. The defaults are those of a slow one, which compiles nothing.

    Attributes
    ----------
    name
        In a study file, and of the table ``[fit.NAME]`` of its settings.
    solve
        ``module:function`` of the `Solve` that does the work; finite data and weights only.
    parts
        Its compiled functions, by name; the one of its own name is compiled, with all it needs, before a study runs.
    settings
        Section of its settings in a study file, or None.
    fits_a_chunk
        Smallest and largest target number of fits per chunk of a cube.
    starts_a_call
        Starts per call: few for a slow solver, because stop requests are checked between calls.
    fits_a_block
        Fits that take about half a second; 0: one chunk per block.
    pilot_fits
        Fits that `mcstudy plan` times per group; 0: two starts per Fmax.
    """

    name: str
    solve: str
    parts: Mapping[str, Part] = field(default_factory=dict)
    settings: type[Section] | None = None
    fits_a_chunk: tuple[int, int] = (20, 500)
    starts_a_call: int = 1
    fits_a_block: int = 0
    pilot_fits: int = 0


OWN = (
    Solver(
        name="lm",
        solve="mcstudy.fitting.lm:solve",
        parts={"lm": Part("mcstudy.fitting.lm:compile_kernel", 10, 2.7, ("steps",), ("gram",), USUAL_ROWS)},
        # The smallest keeps its vector lanes full and makes the few milliseconds of writing negligible; the largest
        # takes some seconds and 5 MB.
        fits_a_chunk=(1500, 50_000),
        starts_a_call=1024,
        fits_a_block=2000,
        pilot_fits=1500,
    ),
    Solver(name="trf", solve="mcstudy.fitting.scipy_solvers:trf"),
    Solver(name="trust-constr", solve="mcstudy.fitting.scipy_solvers:trust_constr"),
)
"""Solvers of this package."""


@cache
def solvers() -> dict[str, Solver]:
    """Every solver by name, those of this package first. The source of the others belongs to the program."""
    attached = [entry.load() for entry in entries()]
    return {solver.name: solver for solver in (*OWN, *attached)}


def solver_named(name: str) -> Solver:
    """The solver of a name; those of other packages are loaded only if it is none of this package."""
    return next((solver for solver in OWN if solver.name == name), None) or solvers()[name]


def named(place: str) -> Any:
    """What ``module:function`` names, imported now."""
    module, _, function = place.partition(":")
    return getattr(importlib.import_module(module), function)


def fit(problem: Problem, starts: np.ndarray, solver: str = "lm", options: Options | None = None) -> Fits:
    """Fit ``problem`` from every start.

    Parameters
    ----------
    problem: see `Problem`.
    starts: (S, P), inside the model's bounds.
    solver: name of one of `solvers`.
    """
    return fit_queue([problem], np.zeros(len(starts), dtype=np.int64), starts, solver, options)


def fit_queue(
    problems: Sequence[Problem],
    assignment: np.ndarray,
    starts: np.ndarray,
    solver: str = "lm",
    options: Options | None = None,
) -> Fits:
    """Fit M starts (M, P), start m on problem ``assignment[m]`` of R problems that share model and frequencies.

    The same results as `fit` start by start; the compiled solvers keep their lanes full across problems.
    """
    starts, assignment = np.ascontiguousarray(starts, dtype=float), np.asarray(assignment)
    out = Fits.failed(starts, Status.NON_FINITE_DATA)
    finite = np.flatnonzero(np.array([p.finite for p in problems])[assignment])
    if finite.size:
        used, index = np.unique(assignment[finite], return_inverse=True)
        solve: Solve = named(solver_named(solver).solve)
        options, mine = options or Options(), [problems[r] for r in used]
        fits = solve(mine, index, starts[finite], options)
        if options.margin is not None:
            from mcstudy.fitting.stable import stable_ends  # compiled functions, which few who read a study need

            fits = stable_ends(mine, index, fits, options.margin)
        out.put(finite, fits)
    return out


def fit_many(
    problems: Sequence[Problem], starts: np.ndarray, solver: str = "lm", options: Options | None = None
) -> list[Fits]:
    """Fit R problems that share model and frequencies, each from its own S starts (R, S, P), through `fit_queue`."""
    R, S, P = starts.shape
    fits = fit_queue(problems, np.repeat(np.arange(R), S), starts.reshape(R * S, P), solver, options)
    return [fits.take(slice(r * S, (r + 1) * S)) for r in range(R)]
