"""From a model to what the compiled fits read: its table at fixed frequencies, and room to work in."""

from __future__ import annotations

from functools import lru_cache
from itertools import accumulate

import numpy as np

from mcstudy.errors import ModelError
from mcstudy.fitting import kernel
from mcstudy.fitting.arguments import Filters, Plan, Scratch, Workspace
from mcstudy.fitting.lanes import WIDTH
from mcstudy.stance.feedback import Model, Table, require_plain
from mcstudy.stance.response import sensed_stimulus

CACHE_LINE = 64
"""Bytes."""


def plan(model: Model, f: np.ndarray) -> Plan:
    """Prepare ``model`` for frequencies ``f`` in Hz, (N,); of a joint model those of its blocks.

    Raises `ModelError` when a filter's coefficient holds a negative power of a parameter.
    """
    require_plain(model, "a fit")
    table, omega = model.table, 2 * np.pi * np.asarray(f, dtype=float)
    if (table.monomial_power < 0).any() or (table.monomial[:, 3] < 0).any():
        raise ModelError(f"model {model.name}: filter coefficients may not hold negative powers of parameters")
    varies = (table.entry[:, 3] >= 0) | (table.group_delay[table.entry[:, 2], 0] >= 0)
    varies |= (table.group_filters[table.entry[:, 2]] >= 0).any(axis=1)
    constant = np.zeros((omega.size, 12))
    at, sensed_drive = model.stimulus_at(omega.size), sensed_stimulus(model, omega.size)
    for e in np.flatnonzero(~varies):
        (row, order, *_), (c, w0, w1, w2) = table.entry[e], table.weight[e]
        value = c * (1j * omega) ** order
        for slot, factor in (
            (4 * row, w0),
            (4 * row + 2, w1),
            (8 + 2 * row, -w2 if sensed_drive is None else -w2 * sensed_drive[e]),
        ):
            constant[:, slot] += factor * value.real
            constant[:, slot + 1] += factor * value.imag
    entry, weight = table.entry[varies], _by_stimulus(table, max(1, len(model.blocks)))[varies]
    pairs = [(int(e[0]), *map(float, w[1:])) for e, w in zip(entry, weight, strict=True)]
    distinct = list(dict.fromkeys(pairs))
    in_group = (table.group_delay[:, 0] >= 0) | (table.group_filters >= 0).any(axis=1)
    columns = [
        [distinct.index(p) for p in pairs],
        in_group[entry[:, 2]],
    ]
    filter_pair = sorted({(int(m[0]), int(p)) for m in table.monomial for p in m[4:] if p >= 0})
    wide = np.column_stack([entry, *columns]).astype(np.int64).reshape(-1, 7)
    single, both, column = _columns(model, entry)
    first, delay_first, cleared = _first(model, wide, column)
    filters = Filters(
        pair=np.array(filter_pair, dtype=np.int64).reshape(-1, 2),
        monomial=table.monomial,
        power=table.monomial_power,
        coefficient=table.monomial_coefficient,
        output=table.output_filter,
    )
    return Plan(
        omega=omega,
        constant=constant,
        entry=np.hstack([wide, first]),
        weight=np.ascontiguousarray(weight),
        sensed=np.array([p[0] for p in distinct], dtype=np.int64),
        sensed_weight=np.array([p[1:] for p in distinct], dtype=float).reshape(-1, weight.shape[1] - 1),
        stimulus=np.zeros(omega.size, dtype=np.int64) if at is None else at,
        group_delay=table.group_delay,
        group_filters=table.group_filters,
        filters=filters,
        single=single,
        both=both,
        column=column,
        delay_first=delay_first,
        cleared=cleared,
    )


def _by_stimulus(table: Table, stimuli: int) -> np.ndarray:
    """Coefficient of every term, and its weights on (theta1, theta2) and on each of J ``stimuli``, (E, 3 + J)."""
    weight = np.zeros((len(table.weight), 3 + stimuli))
    weight[:, :3] = table.weight[:, :3]
    weight[np.arange(len(weight)), 3 + table.stimulus] = table.weight[:, 3]
    return weight


@lru_cache(maxsize=256)
def kept_plan(model: Model, f: bytes) -> Plan:
    """`plan` for the frequencies in ``f`` (float64, Hz).

    A study fits few models at few sets of frequencies, a diagnosis some eighty models at one.
    """
    return plan(model, np.frombuffer(f))


def workspace(plan: Plan) -> Workspace:
    """Zeroed lanes for eight fits, and where in them the kernel keeps what."""
    P, E, G, Q = len(plan.column), len(plan.entry), len(plan.group_delay), len(plan.filters.pair)
    S, W, C, F = plan.sensed.size, plan.single.shape[1], plan.both.size, kernel.BLOCK
    triangle, filters = (P + 1) * (P + 2) // 2, 4 * (len(plan.filters.monomial) + 1)
    tiles = W * (2 * W + 3)
    shared = (P, P, triangle, triangle, P, triangle, P, 1, 8 * plan.omega.size)  # in the order of `Workspace`
    scratch = (  # in the order of `Scratch`; filters and their slopes take turns, frequency by frequency
        *(12 * F, 2 * G * F, 8 * F, 2 * F, 4 * F, 4 * F, 2 * F, 4 * F, 2 * S * F, 2 * F, 4 * G * F),
        *(4 * (W + C) * F, 2 * W * F, 8 * C * F, tiles, E, filters, F * (filters + 4 * Q) - filters),
    )
    *begins, end = accumulate((*shared, *scratch), initial=0)
    n = len(shared)
    at = Scratch._make((*begins[n:], filters + 4 * Q))
    return Workspace._make((_aligned(end * WIDTH), *begins[:n], at))


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
        acting = {int(p) for p in (*e[3:5], *table.group_delay[e[2]]) if p >= 0}
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

    Returns flags (E, 3) of the terms - sum of their group, first gain, second gain; flags (G, 2, 2) of the delays by
    row - 1 first, 0 not, -1 nothing to add on this row; and the places that nobody writes to first.
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
    delays = np.full((*model.table.group_delay.shape, 2), -1, dtype=np.int64)
    for g, of_group in enumerate(model.table.group_delay):
        for row in range(2):
            if (g, row) in groups:
                for k, p in enumerate(of_group):
                    delays[g, k, row] = p >= 0 and column[p, row] not in places
                    if p >= 0:
                        places.add(column[p, row])
    rest = sorted(set(column[column >= 0].tolist()) - {int(k) for k in places})
    return flags, delays, np.array(rest, dtype=np.int64)
