"""How often does ``starts = "until certain"`` stop before the lowest minimum is found?

    python pipelines/validation/until_certain.py --realizations 200 --starts 1000

Noise realizations at 3 N m, fitted up to 8 Hz from many starts each, where single starts succeed least often. Each pool
is then gone through in random orders, as if its starts had been drawn one after another, and every rule stops where it
is satisfied. A cell is missed if the lowest cost until then is above that of the whole pool. Intervals are those of a
bootstrap over realizations.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mcstudy.fitting.certainty import COST_FLOOR, HIT_TOLERANCE, certain, looks, missed
from mcstudy.fitting.solvers import fit_many
from mcstudy.fitting.status import WANTED
from mcstudy.streams import stream
from mcstudy.study.design import Group
from mcstudy.study.experiment import Experiment
from pipelines import measured

Rule = Callable[[np.ndarray], np.ndarray]

ORDERS, RESAMPLES = 40, 2000

FIXED = 50
"""Starts of the paper's pools."""

SEED = 2018


def pools(realizations: int, starts: int) -> np.ndarray:
    """Costs (R, S) of the fits; infinite where a fit failed."""
    group = Group(realizations=realizations, starts=starts, fmax=[8.0], amplitude=[3.0])
    experiment = Experiment(group, SEED)
    out = np.empty((realizations, starts))
    for r in range(realizations):
        problem = experiment.problem(experiment.measure(3.0, r), 8.0)
        (fits,) = fit_many([problem], experiment.starts([problem], [r]))
        out[r] = np.where(np.isfinite(fits.cost), fits.cost, np.inf)
    return out


def share_of_hits(cost: np.ndarray) -> np.ndarray:
    """Share of starts of pools (..., n) that reached the lowest cost."""
    lowest = cost.min(axis=-1, keepdims=True)
    return np.asarray((cost <= lowest * (1 + HIT_TOLERANCE) + COST_FLOOR).mean(axis=-1))


def chance(cost: np.ndarray) -> np.ndarray:
    """The estimate that `mcstudy show` prints as "missed", for pools (..., n)."""
    return np.asarray(missed(share_of_hits(cost), cost.shape[-1]))


def stopped(orders: np.ndarray, rule: Rule, at: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Starts drawn and whether the pool's minimum was missed, (R, orders) each, of a rule that looks ``at`` them."""
    drawn = np.full(orders.shape[:2], at[-1])
    for n in reversed(at[:-1]):
        drawn[rule(orders[..., :n])] = n
    lowest = np.take_along_axis(np.minimum.accumulate(orders, axis=-1), drawn[..., None] - 1, axis=-1)[..., 0]
    return drawn, lowest > orders.min(axis=-1) * (1 + HIT_TOLERANCE) + COST_FLOOR


KEYS = ("fifty", "from_10", "from_100", "certain")
"""Of the rules, in the file that a page reads."""


def missed_cells(miss: np.ndarray) -> dict[str, float]:
    """Percent of cells that are missed, with its 95 % interval."""
    each = 100 * miss.mean(axis=1)
    pick = stream(SEED, "until certain, bootstrap").integers(each.size, size=(RESAMPLES, each.size))
    low, high = np.quantile(each[pick].mean(axis=1), [0.025, 0.975])
    return {"value": float(each.mean()), "low": float(low), "high": float(high)}


def row(name: str, drawn: np.ndarray, miss: np.ndarray) -> str:
    """One line of the table: missed cells with their interval, in percent, and starts drawn."""
    share = "{value:>6.2f} [{low:.2f}, {high:.2f}]".format_map(missed_cells(miss))
    return f"{name:<58}{share}{drawn.mean():>10.0f}{np.quantile(drawn, 0.95):>8.0f}"


def main(realizations: int, starts: int, file: Path | None = None) -> None:
    """Print the table, and write it to ``file``."""
    cost, rng = pools(realizations, starts), stream(SEED, "until certain, orders")
    orders = np.stack([np.stack([rng.permutation(one) for _ in range(ORDERS)]) for one in cost])
    share = share_of_hits(cost)
    print(
        f"{realizations} realizations, pools of {starts} starts; share of starts that reach the lowest cost: median "
        f"{np.median(share):.3f}, lowest {share.min():.4f}\n"
    )
    print(f"{'rule':<58}{'missed % [95 %]':>20}{'starts':>6}{'95 % of':>8}")
    at = looks(starts)
    early = sorted({min(n, starts) for n in (10, 20, 40, 80, 160, 320, 640, starts)})
    first = orders[..., : min(FIXED, starts)]
    miss = first.min(axis=-1) > cost.min(axis=-1)[:, None] * (1 + HIT_TOLERANCE) + COST_FLOOR
    rules = {
        f"{first.shape[-1]} starts": (np.full(miss.shape, first.shape[-1]), miss),
        "estimate below 1 %, from 10 starts on": stopped(orders, lambda c: chance(c) < WANTED, early),
        f"estimate below 1 %, from {at[0]} starts on": stopped(orders, lambda c: chance(c) < WANTED, at),
        '"until certain": upper end of the estimate below 1 %': stopped(orders, certain, at),
    }
    for rule, outcome in rules.items():
        print(row(rule, *outcome))
    shares = {key: missed_cells(miss) | {"unit": "%"} for key, (_, miss) in zip(KEYS, rules.values(), strict=True)}
    measured.write(file, shares)
    stated = chance(first)
    print(f"\nPools of {first.shape[-1]} by what they state as the chance that they missed the lowest minimum:")
    for low, high in ((0.0, 1e-4), (1e-4, 0.01), (0.01, 0.1), (0.1, 1.0)):
        here = (stated >= low) & (stated < high)
        if here.any():
            print(
                f"{100 * low:g} to {100 * high:g} %: {100 * here.mean():.0f} % of pools, "
                f"{100 * stated[here].mean():.2g} % stated, {100 * miss[here].mean():.1f} % missed"
            )
    print(f"all: {100 * stated.mean():.1f} % stated, {100 * miss.mean():.1f} % missed")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="How often do starts until certain miss the lowest minimum?")
    parser.add_argument("--realizations", type=int, default=200)
    parser.add_argument("--starts", type=int, default=1000)
    measured.add_option(parser)
    given = parser.parse_args()
    main(given.realizations, given.starts, given.json)
