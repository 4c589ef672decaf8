"""The compiled bounded Levenberg-Marquardt solver, from `Problem`s to `Fits`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mcstudy.errors import ModelError
from mcstudy.fit import kernel
from mcstudy.fit.lanes import WIDTH
from mcstudy.fit.problem import Fits, Problem
from mcstudy.stance.feedback import Model

CACHE_LINE = 64
"""Bytes."""


@dataclass(frozen=True)
class Plan:
    """A model table at fixed frequencies, in the form the kernel reads.

    Terms without parameters are summed once into ``constant`` (N, 12): A(s) by rows, then b(s), re and im in turn.
    ``entry`` (E, 10): row, order, group, first gain, second gain, index into ``sensed``, whether its group carries a
    delay or filter parameter, and whether it is the first to reach the sum of its group and of its gains.
    ``sensed`` lists the distinct (row, sense) pairs. ``single``, ``both``, ``column``: see `_columns`;
    ``delay_first``, ``cleared``: see `_first`.
    """

    model: Model
    omega: np.ndarray
    constant: np.ndarray
    entry: np.ndarray
    weight: np.ndarray
    sensed: np.ndarray
    sensed_weight: np.ndarray
    filter_pair: np.ndarray
    single: np.ndarray
    both: np.ndarray
    column: np.ndarray
    delay_first: np.ndarray
    cleared: np.ndarray

    @classmethod
    def of(cls, model: Model, f: np.ndarray) -> Plan:
        """Prepare ``model`` for frequencies ``f`` in Hz."""
        table, omega = model.table, 2 * np.pi * np.asarray(f, dtype=float)
        if (table.monomial_power < 0).any() or (table.monomial[:, 3] < 0).any():
            raise ModelError(f"model {model.name}: filter coefficients may not hold negative powers of parameters")
        varies = (table.entry[:, 3] >= 0) | (table.group_delay[table.entry[:, 2]] >= 0)
        varies |= (table.group_filters[table.entry[:, 2]] >= 0).any(axis=1)
        constant = np.zeros((omega.size, 12))
        for (row, order, *_), (c, w0, w1, w2) in zip(table.entry[~varies], table.weight[~varies], strict=True):
            value = c * (1j * omega) ** order
            for slot, factor in ((4 * row, w0), (4 * row + 2, w1), (8 + 2 * row, -w2)):
                constant[:, slot] += factor * value.real
                constant[:, slot + 1] += factor * value.imag
        entry, weight = table.entry[varies], table.weight[varies]
        pairs = [(int(e[0]), *map(float, w[1:])) for e, w in zip(entry, weight, strict=True)]
        distinct = list(dict.fromkeys(pairs))
        in_group = (table.group_delay >= 0) | (table.group_filters >= 0).any(axis=1)
        columns = [
            [distinct.index(p) for p in pairs],
            in_group[entry[:, 2]],
        ]
        filter_pair = sorted({(int(m[0]), int(p)) for m in table.monomial for p in m[4:] if p >= 0})
        wide = np.column_stack([entry, *columns]).astype(np.int64).reshape(-1, 7)
        single, both, column = _columns(model, entry)
        first, delay_first, cleared = _first(model, wide, column)
        return cls(
            model=model,
            omega=omega,
            constant=constant,
            entry=np.hstack([wide, first]),
            weight=np.ascontiguousarray(weight),
            sensed=np.array([p[0] for p in distinct], dtype=np.int64),
            sensed_weight=np.array([p[1:] for p in distinct], dtype=float).reshape(-1, 3),
            filter_pair=np.array(filter_pair, dtype=np.int64).reshape(-1, 2),
            single=single,
            both=both,
            column=column,
            delay_first=delay_first,
            cleared=cleared,
        )

    def tables(self) -> tuple[np.ndarray, ...]:
        """The kernel's trailing arguments."""
        table = self.model.table
        return (
            self.omega,
            self.constant,
            self.entry,
            self.weight,
            self.sensed,
            self.sensed_weight,
            table.group_delay,
            table.group_filters,
            self.filter_pair,
            table.monomial,
            table.monomial_power,
            table.monomial_coefficient,
            table.output_filter,
            self.single,
            self.both,
            self.column,
            self.delay_first,
            self.cleared,
        )

    def workspace(self) -> tuple[np.ndarray, tuple[int, ...]]:
        """Zeroed workspace and the first slots of its parts, in the order in which the kernel unpacks its layout."""
        P, E, G = len(self.model.parameters), self.entry.shape[0], self.model.table.group_delay.size
        triangle = (P + 1) * (P + 2) // 2
        S, W, C = self.sensed.size, self.single.shape[1], self.both.size
        filters = 4 * (self.model.table.monomial.shape[0] + 1) + 4 * self.filter_pair.shape[0]
        a_frequency = 38 + 6 * G + 2 * S + 6 * W + 12 * C + filters
        scratch = kernel.BLOCK * a_frequency + W * (2 * W + 3) + E
        sizes = (P, P, triangle, triangle, P, triangle, P, 1, 8 * self.omega.size, scratch)
        first = np.concatenate([[0], np.cumsum(sizes)])
        return _aligned(int(first[-1]) * WIDTH), tuple(int(k) for k in first[:-1])


def _aligned(size: int) -> np.ndarray:
    """Zeros that begin on a cache line: lanes that straddle two lines cost the kernel a third of its speed."""
    spare = np.zeros(size + WIDTH)
    begin = -spare.ctypes.data % CACHE_LINE // spare.itemsize
    return spare[begin : begin + size]


def _columns(model: Model, entry: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which parameters act on one row of the equations of motion alone, and where the kernel keeps their torques.

    Returns ``single`` (2, W), those of each row, filled up with -1 to a multiple of the kernel's tiles; ``both``, the
    others, among them all that act on the measured angles; ``column`` (P, 2), the place of (parameter, row).
    """
    table, P = model.table, len(model.parameters)
    inside: dict[int, set[int]] = {k: set() for k in range(table.n_filters)}
    for m in table.monomial:
        inside[int(m[0])] |= {int(p) for p in m[4:] if p >= 0}
    rows: list[set[int]] = [set() for _ in range(P)]
    for e in entry:
        acting = {int(p) for p in (*e[3:5], table.group_delay[e[2]]) if p >= 0}
        for p in acting.union(*(inside[int(k)] for k in table.group_filters[e[2]] if k >= 0)):
            rows[p].add(int(e[0]))
    outside = set().union(*(inside[int(k)] for k in table.output_filter if k >= 0))
    lists = [[p for p in range(P) if rows[p] == {row} and p not in outside] for row in range(2)]
    both = [p for p in range(P) if p not in lists[0] and p not in lists[1]]
    width = kernel.TILE * max(1, -(-max(map(len, lists)) // kernel.TILE))
    single, column = np.full((2, width), -1, dtype=np.int64), np.full((P, 2), -1, dtype=np.int64)
    for row, members in enumerate(lists):
        single[row, : len(members)] = members
        column[members, row] = row * width + np.arange(len(members))
    column[both] = 2 * width + np.arange(2 * len(both)).reshape(-1, 2)
    return single, np.array(both, dtype=np.int64), column


def _first(model: Model, entry: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Who writes first to each of the kernel's sums, in the order in which it runs through the table.

    Returns flags (E, 3) of the terms - sum of their group, first gain, second gain; flags (G, 2) of the delays - 1
    first, 0 not, -1 nothing to add on this row; and the places that nobody writes to first.
    """
    groups, places = set(), set()
    flags = np.zeros((len(entry), 3), dtype=np.int64)
    for flag, e in zip(flags, entry, strict=True):
        if e[6]:
            flag[0] = (e[2], e[0]) not in groups
            groups.add((e[2], e[0]))
        for k, p in enumerate(e[3:5]):
            if p >= 0:
                flag[1 + k] = column[p, e[0]] not in places
                places.add(column[p, e[0]])
    delays = np.full((model.table.group_delay.size, 2), -1, dtype=np.int64)
    for g, p in enumerate(model.table.group_delay):
        for row in range(2):
            if (g, row) in groups:
                delays[g, row] = p >= 0 and column[p, row] not in places
                if p >= 0:
                    places.add(column[p, row])
    rest = sorted(set(column[column >= 0].tolist()) - {int(k) for k in places})
    return flags, delays, np.array(rest, dtype=np.int64)


def _pack(problem: Problem) -> np.ndarray:
    """Data and weights of one problem in the kernel's order, (8 N,)."""
    y, W = problem.data, problem.weight
    data = (y[:, 0].real, y[:, 0].imag, y[:, 1].real, y[:, 1].imag)
    weights = (W[:, 0, 0].real, W[:, 1, 1].real, W[:, 1, 0].real, W[:, 1, 0].imag)
    return np.stack((*data, *weights), axis=1).ravel()


@lru_cache(maxsize=64)
def _kept_plan(model: Model, f: bytes) -> Plan:
    """`Plan.of` for the frequencies in ``f`` (float64): a study fits few models at few sets of frequencies."""
    return Plan.of(model, np.frombuffer(f))


def lm_queue(
    problems: Sequence[Problem], which: np.ndarray, starts: np.ndarray, tolerance: float, max_iterations: int
) -> Fits:
    """Fit M starts of R problems that share model and frequencies, in one queue that keeps the lanes full.

    Parameters
    ----------
    problems: R problems; their model and ``f`` must be the same.
    which: problem of each start, (M,) int.
    starts: (M, P).
    tolerance: predicted relative decrease of the cost at which a fit has converged.
    max_iterations: most evaluations of model and derivatives a fit may take.
    """
    M, P = starts.shape
    model = problems[0].model
    plan = _kept_plan(model, np.asarray(problems[0].f, dtype=float).tobytes())
    w, layout = plan.workspace()
    estimate, cost = np.full((M, P), np.nan), np.full(M, np.nan)
    status, iterations = np.zeros(M, dtype=np.int64), np.zeros(M, dtype=np.int64)
    if M:
        kernel.levenberg_marquardt(
            w,
            layout,
            np.stack([_pack(p) for p in problems]),
            np.ascontiguousarray(starts),
            np.ascontiguousarray(which, dtype=np.int64),
            model.lower,
            model.upper,
            tolerance,
            max_iterations,
            estimate,
            cost,
            status,
            iterations,
            *plan.tables(),
        )
    return Fits.of(model, estimate, cost, status, iterations)


def lm(problem: Problem, starts: np.ndarray, tolerance: float, max_iterations: int) -> Fits:
    """Fit one problem from S starts (S, P) with the compiled kernel."""
    return lm_queue([problem], np.zeros(len(starts), dtype=np.int64), starts, tolerance, max_iterations)


def normal_equations(problem: Problem, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the kernel computes at parameter vectors ``theta`` (S, P): cost (S,), J^T r (S, P), J^T J (S, P, P)."""
    plan = Plan.of(problem.model, problem.f)
    w, (at_x, _, at_gram, *_, at_data, at_scratch) = plan.workspace()
    slots, packed = w.reshape(-1, WIDTH), _pack(problem)
    S, P = theta.shape
    lower = np.tril_indices(P)
    cost, gradient, gram = np.empty(S), np.empty((S, P)), np.empty((S, P, P))
    slots[at_data : at_data + packed.size] = packed[:, None]
    for first in range(0, S, WIDTH):
        batch = theta[first : first + WIDTH]
        slots[at_x : at_x + P] = batch[-1][:, None]
        slots[at_x : at_x + P, : len(batch)] = batch.T
        kernel.evaluate(w, at_x, at_gram, at_data, at_scratch, P, *plan.tables())
        done = slice(first, first + len(batch))
        triangle = slots[at_gram : at_gram + P * (P + 1) // 2, : len(batch)].T
        gram[done][:, lower[0], lower[1]] = triangle
        gram[done][:, lower[1], lower[0]] = triangle
        gradient[done] = slots[at_gram + P * (P + 1) // 2 :][:P, : len(batch)].T
        cost[done] = slots[at_gram + (P + 1) * (P + 2) // 2 - 1, : len(batch)]
    return cost, gradient, gram
