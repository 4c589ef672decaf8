"""Fits per second of CPU time compared with other packages, and the quality of the fits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pipelines.benchmarks import peers
from pipelines.benchmarks.cases import FMAX, Case, cases
from pipelines.benchmarks.measure import timed
from pipelines.benchmarks.report import Result, Sizes

SAME = 1e-6
"""Relative excess over the best cost of a cell that still counts as the same minimum."""

CERTAINTY = 0.95


def run(sizes: Sizes) -> Result:
    """Every peer on the same cells and starts, alternating with this program's solver."""
    result = Result("speedup")
    problems = cases(sizes.realizations, sizes.starts)
    cost = {name: {} for name in ("mcstudy", *peers.PEERS) if name not in peers.missing()}
    seconds: dict[str, list[tuple[Case, float, float]]] = {name: [] for name in cost}
    for case in problems:
        own = peers.own(case.problem, case.starts)
        cost["mcstudy"][case.fmax, case.realization] = own
        for name in cost:
            if name == "mcstudy":
                continue
            solve, starts = peers.PEERS[name], case.starts[: sizes.of_slow(name)]
            if case is problems[0]:
                solve(case.problem, starts[:1])  # imports and compiles
            before = _own_seconds(case)
            costs, took = timed(solve, case.problem, starts)
            mine = (before + _own_seconds(case)) / 2
            cost[name][case.fmax, case.realization] = costs
            seconds[name].append((case, took / len(starts), mine))
    best = {
        key: min(float(np.nanmin(found[key])) for found in cost.values() if key in found) for key in cost["mcstudy"]
    }
    own_times = [mine for each in seconds.values() for _, _, mine in each]
    rows = [_row("mcstudy", 1.0, float(np.median(own_times)), cost["mcstudy"], cost["mcstudy"], best)]
    for name, each in seconds.items():
        if name == "mcstudy":
            continue
        ratio = float(np.median([took / mine for _, took, mine in each]))
        result.keys[f"speedup.{name}"] = ratio
        for fmax in FMAX:
            part = [took / mine for case, took, mine in each if case.fmax == fmax]
            result.keys[f"speedup.{name}.fmax_{fmax:g}"] = float(np.median(part))
        rows.append(
            _row(name, ratio, float(np.median([took for _, took, _ in each])), cost[name], cost["mcstudy"], best)
        )
        last = rows[-1]
        result.keys[f"speedup_to_certainty.{name}"] = ratio * _starts_ratio(last)
        result.keys[f"hit_rate_difference.{name}"] = last["own less its"]
        result.keys[f"hit_rate_difference_se.{name}"] = last["±"]
        result.keys[f"cost_excess.{name}"] = last["minimum of mcstudy above its"]
    result.keys["fit.microseconds"] = rows[0]["ms a start"] * 1e3
    result.keys["fit.hit_rate"] = rows[0]["hit rate"]
    result.table = rows
    result.notes.append(
        f"medians over {len(problems)} cells; hit: cost within {SAME:g} of the lowest that any solver found; "
        "own hit rate: that of mcstudy from the same starts as the other package"
    )
    for name in peers.missing():
        result.notes.append(f"{name}: package not installed, left out")
    return result


def _own_seconds(case: Case) -> float:
    """CPU seconds a start of this program, on all starts of the cell as a study hands them over."""
    return min(timed(peers.own, case.problem, case.starts)[1] for _ in range(3)) / len(case.starts)


def _starts_ratio(row: dict[str, Any]) -> float:
    """Starts the peer needs for `CERTAINTY` over those mcstudy needs."""
    return needed(row["hit rate"]) / needed(row["own hit rate"])


def needed(rate: float) -> float:
    """Starts until one of them has hit with probability `CERTAINTY`, when each hits with probability ``rate``."""
    if rate <= 0.0:
        return math.inf
    return 1.0 if rate >= CERTAINTY else math.log(1 - CERTAINTY) / math.log(1 - rate)


def _row(name: str, ratio: float, took: float, found: dict, own: dict, best: dict) -> dict[str, Any]:
    hits = [np.mean(c <= best[key] * (1 + SAME)) for key, c in found.items()]
    own_hits = [np.mean(own[key][: len(c)] <= best[key] * (1 + SAME)) for key, c in found.items()]
    excess, apart, more = [], [], []
    for key, c in found.items():
        mine = own[key][: len(c)]
        if np.nanmin(c) <= best[key] * (1 + SAME) and mine.min() <= best[key] * (1 + SAME):
            excess.append(mine.min() / np.nanmin(c) - 1)
        more.extend((mine <= best[key] * (1 + SAME)).astype(float) - (c <= best[key] * (1 + SAME)))
        same = (c <= best[key] * (1 + SAME)) & (mine <= best[key] * (1 + SAME))
        apart.extend(mine[same] / c[same] - 1)
    rate, own_rate = float(np.mean(hits)), float(np.mean(own_hits))
    return {
        "solver": name,
        "speedup": ratio,
        "ms a start": took * 1e3,
        "hit rate": rate,
        "own hit rate": own_rate,
        "own less its": float(np.mean(more)),
        "±": float(np.std(more) / np.sqrt(len(more))),
        "ms to 95 %": took * 1e3 * needed(rate),
        "minimum of mcstudy above its": float(max(excess, default=math.nan)),
        "same start, same basin: mcstudy above": float(max(apart, default=math.nan)),
    }
