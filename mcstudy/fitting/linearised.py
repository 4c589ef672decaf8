"""Starts from the linear structure of the equations of motion.

With delays and sensory weights fixed, each row of A(s; theta) H = b is linear in its gains, so measured FRFs in place
of H give the gains by bounded linear least squares (`mcstudy.fitting.equation_error` states the equation and its
re-weighting). One such step from anywhere between the bounds lands, more often than not, where the compiled solver then
finds the lowest minimum. What remains are data so noisy that the cost has several deep minima - models with a pole pair
on the other side of the imaginary axis, or the same gains with another delay of the hip - and no single linear problem
can tell them apart. A start is therefore the winner of a race:

1. *pool*: `POOL` points spread over the bounds, most moved by one or two linear steps (weights and delays from the
   point itself, so the pool holds many different linearisations of the same data);
2. *race*: a few iterations of the compiled solver on the true cost, keeping the better half, near-copies dropped;
3. *delays and weights*: each delay and each sensory weight of the leaders is set to the points `GRID` of its bounds,
   one at a time, the gains are solved again with these fixed, and the solver gets a few more iterations;
4. the lowest cost wins.

A start costs some 450 evaluations of the model with its derivatives, at most ten complete fits, and looks at nothing
but data, weights and bounds. The first start of a problem is deterministic; the others ("jittered") race pools of
random points. A start depends neither on the other problems of a call nor on the number of starts asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.errors import ModelError
from mcstudy.fitting.arguments import Bounds
from mcstudy.fitting.equation_error import LinearTable, propose
from mcstudy.fitting.problem import Problem
from mcstudy.fitting.pseudo_data import folded
from mcstudy.fitting.solvers import Options, fit_many
from mcstudy.fitting.starts import sobol, uniform
from mcstudy.stance.feedback import Model, Table
from mcstudy.stance.joint import members
from mcstudy.stance.response import output_matrices, present, sensed_stimulus

STOP = np.nan
POOL = np.array([[STOP, STOP]] * 4 + [[0.5, 0.5]] * 6 + [[1.0, STOP]] * 6)
"""Mix of data and model in the regressors, per pool point and linear step; `STOP`: no further step."""

RACE = ((8, 8), (12, 4))
"""Rounds of the race: iterations of the solver for every point left, and how many points stay."""

LEADERS = 2
GRID = (0.0, 1 / 3, 2 / 3, 1.0)
"""Positions between the bounds of a delay or a weight that are tried from the `LEADERS` best points."""

AGAIN = 1
"""Linear steps on the gains after a delay or a weight was moved."""

LAST = 16
"""Iterations of the solver after that."""

APART = 0.02
"""Points closer than this in every parameter, in widths of the bounds, are copies of each other."""

SEED = 20180215
"""Of the scrambled Sobol points of the deterministic pool; an arbitrary constant."""


@dataclass(frozen=True)
class LinearModel:
    """A model whose gains enter linearly with delays and sensory weights fixed, for `equation_error`.

    Frequencies are fixed. ``output`` (N, R) are the output filters, which are divided out of the data and multiplied
    into the weights of the cost. Declared outputs must tell all angles: the data are then the pseudo-data of
    `mcstudy.fitting.pseudo_data`.
    """

    model: Model
    table: LinearTable
    output: np.ndarray

    @classmethod
    def of(cls, model: Model, f: np.ndarray) -> LinearModel:
        """Prepare ``model`` for frequencies ``f`` in Hz, (N,); raises `ModelError` when a gain enters nonlinearly."""
        table, R = model.table, model.n_rows
        require_linear(model)
        s = 2j * np.pi * np.asarray(f, dtype=float)
        filters = _constant_filters(table, s)
        fixed = np.zeros((s.size, R, R + 1), dtype=complex)
        entry, sense, factor = [], [], []
        sensed, there = sensed_stimulus(model, s.size), present(model, s.size)
        for e, ((row, order, group, gain, weight), (c, *shares)) in enumerate(
            zip(table.entry, table.weight, strict=True)
        ):
            value = c * s**order
            if there is not None:
                value = value * there[group]
            if shares[R] and sensed is not None:
                value = value * sensed[e]
            for k in table.group_filters[group]:
                if k >= 0:
                    value = value * filters[k]
            delay = table.group_delay[group, 0]
            if gain < 0 and delay < 0:
                for column, share in enumerate((*shares[:R], -shares[R])):
                    fixed[:, row, column] += share * value
            else:
                entry.append((row, gain, delay, weight))
                sense.append(shares)
                factor.append(value)
        output = np.ones((s.size, R), dtype=complex)
        for angle, k in enumerate(table.output_filter):
            if k >= 0:
                output[:, angle] = filters[k]
        linear = LinearTable(
            rows=tuple(range(R)),
            omega=s.imag.copy(),
            fixed=fixed,
            entry=np.array(entry, dtype=np.int64).reshape(-1, 4),
            sense=np.array(sense, dtype=float).reshape(-1, R + 1),
            factor=np.array(factor, dtype=complex).reshape(-1, s.size),
        )
        return cls(model, linear, output)

    def steps(
        self, problem: Problem, points: np.ndarray, mixes: np.ndarray, movable: np.ndarray | None = None
    ) -> np.ndarray:
        """Points (M, P) after their linear least-squares steps within the bounds.

        Parameters
        ----------
        problem: data and weights at this object's frequencies.
        points: (M, P) where the weights are taken from and the delays linearised.
        mixes: (M, K) share of the data in the regressors of each step, `STOP` ends a row.
        movable: (P,) bool, which parameters may move; all by default.
        """
        out = np.array(points, dtype=float, order="C")
        with np.errstate(invalid="ignore"):  # data that are not finite stop the steps, silently here: the fit reports
            data, weight = self._of_angles(problem)
            data, weight = data / self.output, weight * self.output[:, None, :]
        movable = np.ones(out.shape[1], dtype=bool) if movable is None else movable
        bounds, mixes = Bounds(self.model.lower, self.model.upper), np.ascontiguousarray(mixes, dtype=float)
        propose(self.table, bounds, data, weight, movable, mixes, out)
        return out

    def _of_angles(self, problem: Problem) -> tuple[np.ndarray, np.ndarray]:
        """Data (N, R) and weights (N, R, R) of the angles."""
        if not self.model.outputs:
            return problem.y, problem.weight
        data, weight, _ = folded(self.model, problem.f, problem.y, problem.weight)
        return data, weight


def linearised(problem: Problem, rng: np.random.Generator, n: int) -> np.ndarray:
    """``n`` starts of one problem, (n, P); the first does not depend on ``rng``.

    Raises `ModelError` when the model is not linear in its gains. A longer draw from the same stream begins with a
    shorter one. Data or weights that are not finite leave points of the pool.
    """
    return linearised_many([problem], [rng], n)[0]


def linearised_many(problems: Sequence[Problem], rngs: Sequence[np.random.Generator], n: int) -> np.ndarray:
    """Starts of R problems that share model and frequencies, (R, n, P): those of `linearised`, faster together."""
    model = problems[0].model
    linear = LinearModel.of(model, problems[0].f)
    P, width = len(model.parameters), model.upper - model.lower
    M = len(POOL)
    pools, first = np.empty((len(problems), n, M, P)), sobol(model, np.random.default_rng(SEED), M)
    for pool, rng in zip(pools, rngs, strict=True):
        pool[:1] = first
        pool[1:] = uniform(model, rng, pool[1:].size // P).reshape(pool[1:].shape)
    runners = [p for p in problems for _ in range(n)]
    if not runners:
        return np.empty((len(problems), n, P))
    points = np.stack([linear.steps(p, x, POOL) for p, x in zip(runners, pools.reshape(-1, M, P), strict=True)])
    for iterations, keep in RACE:
        points, cost = _ahead(*_descend(runners, points, iterations), keep, width)
    moving = np.array([model.names.index(name) for name in (*model.delays, *model.weights)], dtype=np.int64)
    if moving.size:
        movable = np.ones(P, dtype=bool)
        movable[moving] = False
        moved = _moved(points[:, :LEADERS], moving, model)
        again = np.zeros((moved.shape[1], AGAIN))
        moved = np.stack([linear.steps(p, x, again, movable) for p, x in zip(runners, moved, strict=True)])
        moved, cost_moved = _descend(runners, moved, LAST)
        points, cost = np.concatenate([points, moved], axis=1), np.concatenate([cost, cost_moved], axis=1)
    best = cost.argmin(axis=1)
    return points[np.arange(len(runners)), best].reshape(len(problems), n, P)


def _descend(problems: Sequence[Problem], points: np.ndarray, iterations: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (R, M, P) after some iterations of the compiled solver, and their costs; infinite where it failed."""
    fits = fit_many(problems, points, "lm", Options(max_iterations=iterations))
    cost = np.stack([fit.cost for fit in fits])
    estimate = np.stack([fit.estimate for fit in fits])
    usable = np.isfinite(cost) & np.isfinite(estimate).all(axis=2)
    return np.where(usable[..., None], estimate, points), np.where(usable, cost, np.inf)


def _ahead(points: np.ndarray, cost: np.ndarray, keep: int, width: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ``keep`` best points of each row, (R, keep, P) and (R, keep); copies only when nothing else is left."""
    rows, M = np.arange(len(points)), points.shape[1]
    turn = cost.argsort(axis=1, kind="stable").argsort(axis=1)
    chosen = np.empty((len(points), keep), dtype=np.int64)
    for k in range(keep):
        chosen[:, k] = best = turn.argmin(axis=1)
        copies = (np.abs(points - points[rows, best][:, None]) <= APART * width).all(axis=2)
        turn[copies & (turn < M)] += M
        turn[rows, best] = 3 * M
    return np.take_along_axis(points, chosen[..., None], axis=1), np.take_along_axis(cost, chosen, axis=1)


def _moved(points: np.ndarray, moving: np.ndarray, model: Model) -> np.ndarray:
    """Each point (R, L, P) with each of D delays and weights in turn at each position, (R, L * D * grid, P)."""
    copies = np.repeat(points[:, :, None, None], moving.size, axis=2)
    copies = np.repeat(copies, len(GRID), axis=3)
    for k, p in enumerate(moving):
        copies[:, :, k, :, p] = model.lower[p] + (model.upper[p] - model.lower[p]) * np.array(GRID)
    return copies.reshape(len(points), -1, points.shape[2])


def _constant_filters(table: Table, s: np.ndarray) -> np.ndarray:
    """Values of filters without parameters, (F, N)."""
    sides = np.zeros((table.n_filters, 2, s.size), dtype=complex)
    for (k, side, order, *_), c in zip(table.monomial, table.monomial_coefficient, strict=True):
        sides[k, side] += c * s**order
    return sides[:, 0] / sides[:, 1]


def linear(model: Model) -> bool:
    """Whether gains and delays of a model enter as these starts need."""
    try:
        require_linear(model)
    except ModelError:
        return False
    return True


def require_linear(model: Model) -> None:
    """Raise `ModelError` for a model whose gains and delays do not enter as these starts need."""
    if model.outputs:
        C, _ = output_matrices(members(model)[0], np.array([1j]))
        if np.linalg.matrix_rank(C[0]) < model.n_rows:
            raise ModelError(
                f"model {model.name}: linearised starts need outputs that tell all of {', '.join(model.angles)}, got "
                f"{', '.join(model.output_names)}; random starts (uniform, sobol) need none"
            )
    gains = {name for term in model.terms for name in term.gain}
    weights = set(model.weights) - {term.gain[0] for term in model.terms if term.gain}
    for term in model.terms:
        if len(term.gain) > 1 and term.gain[1] not in weights:
            raise ModelError(
                f"model {model.name}: linearised starts need single gains, term {term.row} <- {term.sense} holds "
                f"the product {' * '.join(term.gain)}"
            )
        if term.late is not None:
            raise ModelError(
                f"model {model.name}: linearised starts need single delays, term {term.row} <- {term.sense} holds "
                f"{' + '.join(term.all_delays)}"
            )
    for filt in model.filters:
        for monomial in (*filt.numerator, *filt.denominator):
            for name, _ in monomial.powers:
                raise ModelError(
                    f"model {model.name}: linearised starts need filters without parameters, filter {filt.name} "
                    f"holds {name}"
                )
    for name in gains.intersection(model.delays):
        raise ModelError(f"model {model.name}: linearised starts need {name} to be a gain or a delay, not both")
