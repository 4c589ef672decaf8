"""From a model to what the compiled fits read: its table at fixed frequencies, and room to work in."""

from __future__ import annotations

from functools import lru_cache
from itertools import accumulate

import numpy as np

from mcstudy.errors import ModelError
from mcstudy.fitting import kernel
from mcstudy.fitting.arguments import Filters, Plan, Scratch, Workspace
from mcstudy.fitting.lanes import WIDTH
from mcstudy.stance.feedback import Model, Table
from mcstudy.stance.response import present, sensed_stimulus

CACHE_LINE = 64
"""Bytes."""


def plan(model: Model, f: np.ndarray) -> Plan:
    """Prepare ``model`` for frequencies ``f`` in Hz, (N,); of a joint model those of its blocks.

    Raises `ModelError` when a filter's coefficient holds a negative power of a parameter.
    """
    table, omega = model.table, 2 * np.pi * np.asarray(f, dtype=float)
    if (table.monomial_power < 0).any() or (table.monomial[:, 3] < 0).any():
        raise ModelError(f"model {model.name}: filter coefficients may not hold negative powers of parameters")
    varies = (table.entry[:, 3] >= 0) | (table.group_delay[table.entry[:, 2], 0] >= 0)
    varies |= (table.group_filters[table.entry[:, 2]] >= 0).any(axis=1)
    R = table.n_rows
    constant = np.zeros((omega.size, 2 * R * (R + 1)))
    at, sensed_drive = model.stimulus_at(omega.size), sensed_stimulus(model, omega.size)
    there = present(model, omega.size)
    for e in np.flatnonzero(~varies):
        (row, order, group, *_), (c, *shares, stimulus) = table.entry[e], table.weight[e]
        value = c * (1j * omega) ** order * (1.0 if there is None else there[group])
        slots = [*range(2 * R * row, 2 * R * (row + 1), 2), 2 * (R * R + row)]
        drive = -stimulus if sensed_drive is None else -stimulus * sensed_drive[e]
        for slot, factor in zip(slots, (*shares, drive), strict=True):
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
        rows=tuple(range(R)),
        omega=omega,
        constant=constant,
        entry=np.hstack([wide, first]),
        weight=np.ascontiguousarray(weight),
        sensed=np.array([p[0] for p in distinct], dtype=np.int64),
        sensed_weight=np.array([p[1:] for p in distinct], dtype=float).reshape(-1, weight.shape[1] - 1),
        stimulus=np.zeros(omega.size, dtype=np.int64) if at is None else at,
        group_delay=table.group_delay,
        group_filters=table.group_filters,
        group_only=table.group_only,
        filters=filters,
        single=single,
        both=both,
        column=column,
        delay_first=delay_first,
        cleared=cleared,
    )


def _by_stimulus(table: Table, stimuli: int) -> np.ndarray:
    """Coefficient of every term, and its weights on the R angles and on each of J ``stimuli``, (E, 1 + R + J)."""
    E, first = len(table.weight), table.weight.shape[1] - 1
    weight = np.zeros((E, first + stimuli))
    weight[:, :first] = table.weight[:, :first]
    weight[np.arange(E), first + table.stimulus] = table.weight[:, first]
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
    S, W, C, F, R = plan.sensed.size, plan.single.shape[1], plan.both.size, kernel.BLOCK, len(plan.rows)
    triangle, filters, pairs = (P + 1) * (P + 2) // 2, 4 * (len(plan.filters.monomial) + 1), R * (R - 1) // 2
    tiles, data = R * W * (R * W + kernel.TILE) // 2, R * (R + 2) * plan.omega.size + 2
    shared = (P, P, triangle, triangle, P, triangle, P, 1, data)  # in the order of `Workspace`
    scratch = (  # in the order of `Scratch`; filters and their slopes take turns, frequency by frequency
        *(2 * R * (R + 1) * F, 2 * G * F, 2 * R * R * F, 2 * pairs * F, 2 * R * F, 2 * R * F, R * F, 2 * R * F),
        *(2 * S * F, 2 * F, 2 * R * G * F, 2 * R * (W + C) * F, 2 * pairs * W * F, 4 * R * C * F),
        *(tiles, E, filters, F * (filters + 4 * Q) - filters),
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

    Returns ``single`` (R, W), those of each row, filled up with -1 to a multiple of the kernel's tiles; ``both``, the
    others, among them all that act on the measured angles; ``column`` (P, R), the place of (parameter, row).
    """
    table, P = model.table, len(model.parameters)
    R = table.n_rows
    inside: dict[int, set[int]] = {k: set() for k in range(table.n_filters)}
    for m in table.monomial:
        inside[int(m[0])] |= {int(p) for p in m[4:] if p >= 0}
    rows: list[set[int]] = [set() for _ in range(P)]
    for e in entry:
        acting = {int(p) for p in (*e[3:5], *table.group_delay[e[2]]) if p >= 0}
        for p in acting.union(*(inside[int(k)] for k in table.group_filters[e[2]] if k >= 0)):
            rows[p].add(int(e[0]))
    outside = set().union(*(inside[int(k)] for k in table.output_filter if k >= 0))
    lists = [[p for p in range(P) if rows[p] == {row} and p not in outside] for row in range(R)]
    both = [p for p in range(P) if not any(p in members for members in lists)]
    width = kernel.TILE * max(1, -(-max(map(len, lists)) // kernel.TILE))
    single, column = np.full((R, width), -1, dtype=np.int64), np.full((P, R), -1, dtype=np.int64)
    for row, members in enumerate(lists):
        single[row, : len(members)] = members
        column[members, row] = row * width + np.arange(len(members))
    column[both] = R * width + np.arange(R * len(both)).reshape(-1, R)
    return single, np.array(both, dtype=np.int64), column


def _first(model: Model, entry: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Who writes first to each of the kernel's sums, in the order in which it runs through the table.

    Returns flags (E, 3) of the terms - sum of their group, first gain, second gain; flags (G, 2, R) of the delays by
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
    delays = np.full((*model.table.group_delay.shape, column.shape[1]), -1, dtype=np.int64)
    for g, members in enumerate(model.table.group_delay):
        for row in range(column.shape[1]):
            if (g, row) in groups:
                for k, p in enumerate(members):
                    delays[g, k, row] = p >= 0 and column[p, row] not in places
                    if p >= 0:
                        places.add(column[p, row])
    rest = sorted(set(column[column >= 0].tolist()) - {int(k) for k in places})
    return flags, delays, np.array(rest, dtype=np.int64)
