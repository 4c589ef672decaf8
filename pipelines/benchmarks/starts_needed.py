"""How many starts reach the lowest minimum with 95 % certainty: every kind of start with every solver.

For each pool (one realization, amplitude and Fmax): the fraction of starts within 1e-6 of the lowest cost that any
solver found, and the resulting number of starts needed. A linearised start itself costs about twenty fits, which the
last column includes.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.fitting.linearised import linearised
from mcstudy.fitting.problem import Problem
from mcstudy.fitting.starts import STARTS
from mcstudy.streams import stream
from pipelines.benchmarks import peers
from pipelines.benchmarks.cases import FMAX, experiment
from pipelines.benchmarks.measure import timed
from pipelines.benchmarks.report import Result, Sizes
from pipelines.benchmarks.speedup import SAME, needed

AMPLITUDES = (3.0, 5.0)
DRAWN = (1, 2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 200, 500)


def _starts(kind: str, problem: Problem, realization: int, n: int) -> np.ndarray:
    rng = stream(2018, kind, realization)
    return linearised(problem, rng, n) if kind == "linearised" else STARTS[kind](problem.model, rng, n)


SOLVERS = ("mcstudy", "scipy_trf", "scipy_trust_constr_bfgs", "pypesto_fides", "lmfit")
"""Solvers that get every kind of start."""


def _starts_of(solver: str, kind: str, sizes: Sizes) -> int:
    """Starts a pool: many for the fast, few for what takes half a second."""
    if solver == "mcstudy":
        return max(5, sizes.starts // 5) if kind == "linearised" else 10 * sizes.starts
    return sizes.of_slow(solver) if "trust_constr" in solver else max(2, sizes.starts // 5)


def _pools_of(solver: str, sizes: Sizes) -> int:
    """Realizations: all for the fast, a few for the others, one for the slowest."""
    return sizes.pools if solver == "mcstudy" else 1 if "trust_constr" in solver else max(1, sizes.pools // 25)


def run(sizes: Sizes) -> Result:
    """Table and curves of success against starts drawn."""
    result = Result("starts")
    paper = experiment(1)
    ways = [(s, kind) for s in SOLVERS if s not in peers.missing() for kind in (*STARTS, "linearised")]
    found: dict[tuple[str, str], list[tuple[float, float, np.ndarray, float]]] = {way: [] for way in ways}
    for r in range(sizes.pools):
        for amplitude in AMPLITUDES:
            data = paper.measure(amplitude, r)
            for fmax in FMAX:
                problem, costs = paper.problem(data, fmax), {}
                for solver, kind in ways:
                    if r >= _pools_of(solver, sizes):
                        continue
                    n = _starts_of(solver, kind, sizes)
                    starts, drawing = timed(_starts, kind, problem, r, n)
                    solve = peers.own if solver == "mcstudy" else peers.PEERS[solver]
                    cost, fitting = timed(solve, problem, starts)
                    costs[solver, kind] = (cost, (drawing + fitting) / n)
                best = min(float(np.nanmin(cost)) for cost, _ in costs.values())
                for way, (cost, seconds) in costs.items():
                    found[way].append((amplitude, fmax, cost <= best * (1 + SAME), seconds))
    for solver in peers.missing():
        result.notes.append(f"{solver}: package not installed, left out")
    for way in ways:
        for fmax in FMAX:
            part = [(hit, seconds) for _, f, hit, seconds in found[way] if f == fmax]
            if part:
                result.table.append(_row(*way, fmax, part))
    for row in result.table:
        result.keys |= _keys(row)
    result.figure = partial(_draw, result.table)
    return result


def _keys(row: dict[str, Any]) -> dict[str, Any]:
    """Figures of a row by key."""
    columns = {"median": "needed, median", "p90": "needed, 90 %", "hit_rate": "hit rate"}
    if row["starts"] == "linearised":
        columns |= {"first_hits": "first start hits", "first_five_hit": "first five hit"}
    stem = f"starts.{row['solver']}.{row['starts']}.fmax_{row['fmax']:g}"
    return {f"{stem}.{key}": row[column] for key, column in columns.items()}


def _draw(table: list[dict[str, Any]], file: Path) -> None:
    """One panel per Fmax: probability that the lowest minimum has been found, against the number of starts."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.5), layout="constrained")
    axes = figure.subplots(1, len(FMAX), sharey=True)
    solvers, kinds = list(dict.fromkeys(r["solver"] for r in table)), list(dict.fromkeys(r["starts"] for r in table))
    for ax, fmax in zip(axes, FMAX, strict=True):
        for row in table:
            if row["fmax"] == fmax:
                style = {
                    "color": f"C{solvers.index(row['solver'])}",
                    "ls": ("-", "--", ":", "-.")[kinds.index(row["starts"])],
                }
                ax.plot(
                    list(row["curve"]), list(row["curve"].values()), label=f"{row['solver']}, {row['starts']}", **style
                )
        ax.set(xscale="log", xlabel="number of starts", title=f"Fmax {fmax:g} Hz", ylim=(0, 1.02))
        ax.axhline(0.95, color="0.7", lw=0.8)
    axes[0].set_ylabel("lowest minimum found")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center", fontsize="x-small")
    figure.savefig(file)


def _row(solver: str, kind: str, fmax: float, part: list[tuple[np.ndarray, float]]) -> dict[str, Any]:
    rate = np.array([hit.mean() for hit, _ in part])
    wanted = np.array([needed(p) for p in rate])
    seconds = float(np.median([s for _, s in part]))
    cost = np.array([needed(p) * s for p, (_, s) in zip(rate, part, strict=True)])
    n = part[0][0].size
    return {
        "solver": solver,
        "starts": kind,
        "fmax": fmax,
        "pools": len(part),
        "starts a pool": n,
        "hit rate": float(rate.mean()),
        "first start hits": float(np.mean([hit[0] for hit, _ in part])),
        "first five hit": float(np.mean([hit[:5].any() for hit, _ in part])),
        "needed, median": float(np.median(wanted)),
        "needed, 90 %": float(np.quantile(wanted, 0.9, method="higher")),
        "ms a start": seconds * 1e3,
        "ms to 95 %, median": float(np.median(cost)) * 1e3,
        # No further than starts were drawn: a recording that was never hit may be hit by the next.
        "curve": {s: float(np.mean(1 - (1 - rate) ** s)) for s in DRAWN if s <= n},
    }
