"""Directed search: studies where most of the printed numbers are nearly met at once.

The posterior says where the numbers are probable under an error model that includes the emulator's. This search asks
another question: how many numbers can one configuration meet? It starts from the studies of the bank that come
nearest, proposes differences of them (differential evolution: Storn & Price 1997), predicts the rows of each proposal
by the emulator, corrected by half of what it misses at the study the proposal comes from, and gives those that promise
most.
Rows that follow from the model alone are computed as they are.
"""

from __future__ import annotations

import numpy as np

from mcstudy_goodworth2018.lost_table.bank import Bank
from mcstudy_goodworth2018.lost_table.checks import misfit, penalty, rows_of
from mcstudy_goodworth2018.lost_table.emulator import Emulator
from mcstudy_goodworth2018.lost_table.simulate import damped
from mcstudy_goodworth2018.lost_table.unknowns import Prior

PARENTS = 24
"""Studies from which a round starts."""

PROPOSALS = 6000
LOOKED_AT = 60
"""Proposals, and those of them whose model rows are computed."""

CHILDREN = 4
"""Most studies that one parent gives in a round."""

LASTING = 0.5
"""Share of the emulator's error at the parent that is expected at its children; the rest is chance."""

JITTER, FLIP = 0.03, 0.1


def promising(
    prior: Prior,
    bank: Bank,
    emulator: Emulator,
    error: np.ndarray,
    rng: np.random.Generator,
    n: int,
    aim: int | None = None,
) -> np.ndarray:
    """The ``n`` configurations to simulate next, (n, U).

    ``error``: Monte Carlo error of a row of one study, (R,). ``aim``: a row that is to be met first.
    """
    rows = rows_of(prior, bank)
    parents = np.argsort(misfit(rows, error, aim), kind="stable")[:PARENTS]
    first, second, third = (parents[rng.integers(len(parents), size=PROPOSALS)] for _ in range(3))
    moved = rng.random((PROPOSALS, len(prior))) < rng.choice([0.2, 0.5, 0.9], size=(PROPOSALS, 1))
    step = rng.uniform(0.2, 1.0, (PROPOSALS, 1)) * (bank.u[second] - bank.u[third])
    u = bank.u[first] + np.where(moved, step, 0.0) + JITTER * rng.standard_normal((PROPOSALS, len(prior)))
    choice = np.array([bool(x.choices) for x in prior.unknowns])
    flipped = rng.random((PROPOSALS, len(prior))) < FLIP
    u[:, choice] = np.where(flipped, bank.u[second], bank.u[first])[:, choice]
    inside = np.flatnonzero(((u > 0) & (u < 1)).all(axis=1))
    inside = inside[damped(prior.values(u[inside]))]
    u, first = u[inside], first[inside]
    missed = rows - emulator.rows(bank.u)
    promise = misfit(emulator.rows(u) + LASTING * missed[first], error, aim)
    order = np.argsort(promise, kind="stable")
    several = np.concatenate([order[first[order] == parent][:CHILDREN] for parent in parents])
    near = several[np.argsort(promise[several], kind="stable")][:LOOKED_AT]
    total = promise[near] + penalty(prior.values(u[near]))
    return np.asarray(u[near[np.argsort(total, kind="stable")][:n]])
