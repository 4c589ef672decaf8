"""Every compiled function compiled once, for the smallest problem there is, so that nobody has to wait for it later.

A function is compiled for the types that it is called with, so the calls are those that studies and diagnoses make:
through the functions around the compiled code, not by lists of types that would have to be kept up. What is compiled
nowhere yet is compiled by processes of their own (`mcstudy.fitting.compilers`), one per core.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cache

import numpy as np

from mcstudy.compiling.addresses import apart
from mcstudy.compiling.decorators import KEPT, NotCompiledError, only_compiled
from mcstudy.fitting import kernel
from mcstudy.fitting.arguments import Bounds, Prior, Queue
from mcstudy.fitting.linearised import POOL, LinearModel
from mcstudy.fitting.lm import normal_equations
from mcstudy.fitting.plans import plan, workspace
from mcstudy.fitting.problem import small_problem
from mcstudy.fitting.solvers import OWN, USUAL_ROWS, Part, named, solvers
from mcstudy.stance.simulate_time import simulate
from mcstudy.stance.stability import growth_rate

EVERY_S = 0.01
"""Time between the samples of the record that is simulated."""


_ready: set[str] = set()


def load(part: str) -> bool:
    """Load what is compiled of a part; returns False, and compiles nothing, if something is not."""
    if part not in _ready:
        try:
            with only_compiled():
                _compile(PARTS[part])
        except NotCompiledError:
            return False
        _ready.add(part)
    return True


def compile_here(parts: Iterable[str] = ()) -> int:
    """Compile in this process what is not compiled yet of ``parts``, all unless some are named; returns how many."""
    before = _misses()
    for part in with_called(parts or PARTS):
        compile_part(part)
    return _misses() - before


def compile_part(part: str) -> None:
    """Compile in this process what is not compiled yet of one part, without the parts that it calls."""
    if part not in _ready:
        _compile(PARTS[part])
        _ready.add(part)


def _compile(part: Part) -> None:
    named(part.compile)(*([part.rows] if part.rows else []))


def of_rows(part: str, rows: int) -> str:
    """Name of a part for models of so many rows."""
    return f"{part}:{rows}" if PARTS[part].rows not in (0, rows) else part


def with_called(parts: Iterable[str]) -> list[str]:
    """These parts and those that they call, in the order of `PARTS`."""
    wanted = set(parts)
    wanted.update(*(PARTS[part].calls for part in wanted))
    return PARTS.in_order(wanted)


def missing(parts: Iterable[str]) -> list[str]:
    """What has to be compiled before ``parts`` can be called, in the order of `PARTS`; the others are loaded."""
    absent: set[str] = set()
    waiting = with_called(parts)
    while waiting:
        part = waiting.pop()
        if part not in absent and not load(part):
            absent.add(part)
            waiting += PARTS[part].after
    return PARTS.in_order(absent)


def _misses() -> int:
    return sum(sum(function.stats.cache_misses.values()) for function in KEPT)


def compile_stability() -> None:
    """Compile the growth rate of a closed loop."""
    model = small_problem().model
    growth_rate(model, model.truth)


def compile_simulation() -> None:
    """Compile the simulation in the time domain."""
    model = small_problem().model
    simulate(model, model.truth, np.zeros((64, 3)), 1 / EVERY_S)


def compile_steps() -> None:
    """Compile the bounded step, and the beginning of a fit."""
    problem = small_problem()
    table, truth = plan(problem.model, problem.f), problem.model.truth
    work, bounds = workspace(table), Bounds(problem.model.lower, problem.model.upper)
    queue = Queue(problem.packed[None], np.zeros(1, dtype=np.int64), truth[None].copy())
    kernel.begin(work, 0, queue, 0, bounds)
    kernel.bounded_step(work, bounds)


def compile_cost(rows: int) -> None:
    """Compile the cost without derivatives."""
    problem = small_problem(rows)
    table = plan(problem.model, problem.f)
    kernel.evaluate_cost(table, workspace(table))


def compile_gram(rows: int) -> None:
    """Compile the normal equations of the equation error."""
    problem = small_problem(rows)
    normal_equations(problem, problem.model.truth[None])


def compile_starts(rows: int) -> None:
    """Compile the choice of starts by linearised models."""
    problem = small_problem(rows)
    LinearModel.of(problem.model, problem.f).steps(problem, problem.model.truth[None], POOL[-1:])


def compile_diagnosis(rows: int) -> None:
    """Compile the fits and likelihood ratios of a diagnosis."""
    # Imported here: studies need none of them, and the statistics behind the first take a second to import.
    from mcstudy.fitting.penalised import Fitter
    from mcstudy.fitting.small_linear import gaussian_factor, likelihood_ratios, orthonormal

    problem = small_problem(rows)
    model = problem.model
    fitter = Fitter(model, Prior(model.truth, model.upper - model.lower), problem.f)
    data = problem.packed
    with apart():
        fitter.fits(data, model.truth)
    gaussian_factor(np.eye(2), np.ones((2, 1)), 1.0)
    orthonormal(np.eye(2, 4), np.ones((1, 4)), 1e-6)
    likelihood_ratios(np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.ones(1))


def compile_intervals(rows: int) -> None:
    """Compile the profile likelihood intervals."""
    from mcstudy.fitting.penalised import Fitter

    problem = small_problem(rows)
    model = problem.model
    fitter, P = Fitter(model, Prior(model.truth, model.upper - model.lower), problem.f), model.truth.size
    with apart():
        fitter.ends(problem.packed, model.truth[None], np.eye(1, P), np.ones(1), np.ones(1))


def _part(function: Callable[..., None], functions: int, seconds: float, *calls: str, rows: int = 0) -> Part:
    return Part(f"{__name__}:{function.__name__}", functions, seconds, calls=calls, rows=rows)


_PARTS = {
    "stability": _part(compile_stability, 33, 4.6),
    "gram": _part(compile_gram, 59, 9.0, rows=USUAL_ROWS),
    "steps": _part(compile_steps, 10, 2.4),
    "cost": _part(compile_cost, 39, 2.9, rows=USUAL_ROWS),
    "diagnosis": _part(compile_diagnosis, 37, 6.2, "gram", rows=USUAL_ROWS),
    "intervals": _part(compile_intervals, 78, 10.0, "gram", rows=USUAL_ROWS),
    "time_domain": _part(compile_simulation, 20, 2.2),
    "linearised": _part(compile_starts, 24, 5.0, rows=USUAL_ROWS),
    **{name: part for solver in OWN for name, part in solver.parts.items()},
}
"""Those of this package."""


class _Parts(Mapping[str, Part]):
    """`_PARTS`, and those of attached solvers, which are loaded when one of theirs is asked for, or all.

    A name may end with another number of rows, as ``"gram:3"`` does (`of_rows`).
    """

    def __getitem__(self, name: str) -> Part:
        plain, _, rows = name.partition(":")
        part = _PARTS[plain] if plain in _PARTS else _attached()[plain]
        if not rows:
            return part
        after, calls = (tuple(of_rows(other, int(rows)) for other in others) for others in (part.after, part.calls))
        return part._replace(rows=int(rows), after=after, calls=calls)

    def __iter__(self) -> Iterator[str]:
        yield from _PARTS
        yield from _attached()

    def __len__(self) -> int:
        return len(_PARTS) + len(_attached())

    def in_order(self, names: Collection[str]) -> list[str]:
        """These parts in order."""
        plain = [name.partition(":")[0] for name in names]
        order = list(_PARTS if _PARTS.keys() >= set(plain) else self)
        return sorted(names, key=lambda name: (order.index(name.partition(":")[0]), name))


@cache
def _attached() -> dict[str, Part]:
    parts = {name: part for solver in solvers().values() for name, part in solver.parts.items()}
    return {name: part for name, part in parts.items() if name not in _PARTS}


PARTS = _Parts()
"""What needs which functions, by the name of the simulator, solver or kind of starts in a study file, or our own."""
