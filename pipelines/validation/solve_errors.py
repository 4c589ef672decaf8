"""Are the estimates of ``mcstudy solve`` unbiased, what do they cost, and do its intervals hold the answer?

    python pipelines/validation/solve_errors.py -o results/solve

Three tables, on the paper's experiment with 6 cycles; the complete fits are those of ``solve_against_grid.py`` and are
kept in the same folder.

1. Controls, at 5 N m. `difference`: variance of what the difference of complete and cheap fit contributes to a CV,
   relative to that of the complete fit (median over parameters). What follows for the cost of both levels, relative to
   complete fits for the same error: counted in fits, with one cheap fit as one, and in evaluations of the model.
2. Bias, at 5 N m. The realizations are cut into blocks; each block gives a plain estimate, from its complete fits, and
   a multilevel one, from these and other draws of a control. `largest` is the largest mean paired difference of 12
   parameters and two sums of stiffnesses, in standard errors over blocks; `beyond 3` counts those above 3.
3. Intervals. Searches with other seeds, for one target per Fmax; the truth is the grid's answer with its own error.
   `expected` is the coverage that correct intervals would have with that error.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest, norm
from solve_against_grid import CASES, FMAX, NOMINAL, Grid, crossing, study_of

from mcstudy.models.quantities import expression
from mcstudy.planning.fits import LINEARISED, TRUTH, Design
from mcstudy.planning.multilevel import MEASURES, Draws, difference_of, estimated, relative_cost
from mcstudy.planning.solve import solve_study
from mcstudy.planning.space import CYCLES
from mcstudy.text_tables import number, table

BLOCK = 64
DRAWS = {TRUTH: 640, LINEARISED: 128}
"""Draws of a control beside every block."""

SUMS = ("K11 + Kpas1", "K22 + Kpas2")
REPEATED = (1, 7, 17)
"""Targets of the third table: their places among the cases."""

FIRST_SEED = 100


def controls(grid: Grid, kinds: list[tuple[float, str]]) -> str:
    """Table of what a control saves."""
    rows, fitter = [], grid.fitter
    for f, kind in kinds:
        design = Design(6, NOMINAL, f)
        full = grid.estimates(design)
        control = fitter.realizations(design, kind, grid.realizations)
        ratios = [
            difference_of(Draws(full[:, k], truth, control[:, k]), MEASURES["cv"])
            for k, truth in enumerate(fitter.model.truth)
        ]
        difference = float(np.median(ratios))
        each = grid.spent([design])[1] / grid.realizations
        evaluations = relative_cost(difference, fitter.cost(kind), each)
        fits = relative_cost(difference, 1.0, grid.starts)
        rows.append([f"{f:g} Hz", kind, number(difference, 2), f"1/{1 / fits:.1f}", f"1/{1 / evaluations:.1f}"])
    return table(["Fmax", "control", "difference", "in fits", "in evaluations"], rows)


def bias(grid: Grid, kinds: list[tuple[float, str]]) -> str:
    """Table of paired differences of multilevel and plain estimates."""
    fitter, rows = grid.fitter, []
    quantities = [expression(fitter.model, name) for name in (*(p.name for p in fitter.model.parameters), *SUMS)]
    blocks = grid.realizations // BLOCK
    for f, kind in kinds:
        design = Design(6, NOMINAL, f)
        n = DRAWS[kind]
        levels = (
            grid.estimates(design),
            fitter.realizations(design, kind, grid.realizations),
            fitter.draws(design, kind, blocks * n),
        )
        largest: dict[str, list[float]] = {name: [] for name in MEASURES}
        for quantity in quantities:
            full, control, sample = (np.array([quantity.value(x) for x in level]) for level in levels)
            truth = quantity.value(fitter.model.truth)
            for name, measure in MEASURES.items():
                apart = []
                for b in range(blocks):
                    own, more = slice(b * BLOCK, (b + 1) * BLOCK), slice(b * n, (b + 1) * n)
                    both = estimated(Draws(full[own], truth, control[own], sample[more]), measure)
                    apart.append(both.value - estimated(Draws(full[own], truth), measure).value)
                spread = np.std(apart, ddof=1) / math.sqrt(blocks)
                largest[name].append(float(np.mean(apart) / spread) if spread else 0.0)
        every = np.array(list(largest.values()))
        rows.append(
            [
                f"{f:g} Hz",
                kind,
                *(f"{max(values, key=abs):+.1f}" for values in largest.values()),
                f"{np.sqrt(np.mean(every**2)):.2f}",
                f"{(np.abs(every) > 3).sum()} of {every.size}",
            ]
        )
    head = ["Fmax", "control", *(f"largest, {name}" for name in MEASURES), "rms", "beyond 3"]
    return f"{blocks} blocks of {BLOCK} realizations\n" + table(head, rows)


def searches(grid: Grid, which: int, seeds: int, precision: float, folder: Path | None) -> Iterator[dict[str, Any]]:
    """Answers of one target from other seeds."""
    case = CASES[which]
    target, _ = grid.target(case)
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        name = f"repeated{which:02d}_grid{grid.realizations}x{grid.starts}_precision{precision:g}_seed{seed}.json"
        file = None if folder is None else folder / name
        if file is not None and file.exists():
            yield json.loads(file.read_text(encoding="utf-8"))
            continue
        study = study_of(seed, grid.starts, [case.fmax])
        found = solve_study(study, [target.text], [case.over], precision=precision)
        row: dict[str, Any] = {"fits": found.spent.fits, "found": found.answer is not None}
        if found.answer is not None:
            (c,) = found.answer.crossings
            row |= {"value": c.value, "low": c.low, "high": c.high}
        if file is not None:
            file.write_text(json.dumps(row), encoding="utf-8")
        yield row


def coverage(grid: Grid, seeds: int, precision: float, folder: Path | None) -> str:
    """Table of how often the interval holds the grid's answer."""
    out = []
    for which in REPEATED:
        target, values = grid.target(CASES[which])
        at, error = crossing(CASES[which].values, values, target.limit)
        rows = [r for r in searches(grid, which, seeds, precision, folder) if r["found"]]
        holds = sum(r["low"] <= at <= r["high"] for r in rows)
        ends = binomtest(holds, seeds).proportion_ci(method="wilson")
        steps, widths = (
            np.array(x)
            for x in zip(*((np.log(r["value"] / at), np.log(r["high"] / r["low"])) for r in rows), strict=True)
        )
        width = float(np.median(widths)) / 3.92
        expected = 2 * norm.cdf(1.96 / math.hypot(1, error / width)) - 1
        mean, standard = steps.mean(), steps.std(ddof=1) / math.sqrt(len(steps))
        out.append(
            [
                target.text,
                f"{CASES[which].fmax:g} Hz",
                f"{number(at)} ± {100 * error:.1f} %",
                f"{holds} of {seeds}: {100 * holds / seeds:.0f} % [{100 * ends.low:.0f}, {100 * ends.high:.0f}]",
                f"{100 * expected:.0f} %",
                f"{100 * mean:+.1f} ± {100 * math.hypot(standard, error):.1f} %",
                f"{100 * steps.std(ddof=1):.1f}, {100 * width:.1f} %",
                f"{np.median([r['fits'] for r in rows]):.0f}",
            ]
        )
        print(" | ".join(out[-1]), flush=True)
    head = ["target", "Fmax", "grid ± SE", "holds [95 %]", "expected", "mean apart", "SD, as stated", "fits"]
    return table(head, out)


def spread(text: str, over: str, fmax: float, seeds: int, precision: float, starts: int) -> str:
    """How much the answers of searches with other seeds scatter, and how much their intervals say; needs no grid."""
    rows = []
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        found = solve_study(study_of(seed, starts, [fmax]), [text], [over], precision=precision)
        if found.answer is not None:
            (c,) = found.answer.crossings
            discarded = found.space.discard if c.axis == CYCLES else 0  # errors follow the cycles that are used
            rows.append(np.log(np.array([c.value, c.low, c.high]) - discarded))
            print(seed, *(f"{v:.4g}" for v in np.exp(rows[-1])), found.spent.fits, flush=True)
    value, low, high = np.array(rows).T
    n, middle, sd = len(rows), float(value.mean()), float(value.std(ddof=1))
    holds = int(((low <= middle) & (middle <= high)).sum())
    return (
        f"{text} over {over}, {fmax:g} Hz: {n} answers, mean {number(math.exp(middle))} ± "
        f"{100 * sd / math.sqrt(n):.1f} %; SD {100 * sd:.1f} ± {100 * sd / math.sqrt(2 * (n - 1)):.1f} %, as stated "
        f"{100 * float(np.median(high - low)) / 3.92:.1f} %; {holds} of {n} intervals hold the mean"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, help="folder of the results; the same command resumes")
    parser.add_argument("--realizations", type=int, default=2000, help="of every design of the grid")
    parser.add_argument("--starts", type=int, default=50)
    parser.add_argument("--fmax", type=float, nargs="+", default=list(FMAX), help="of the first two tables, Hz")
    parser.add_argument("--seeds", type=int, default=60, help="searches for every target of the third table")
    parser.add_argument("--precision", type=float, default=10.0, help="of these searches, percent")
    parser.add_argument("--target", help="only repeat searches for this target over --over and at the first --fmax")
    parser.add_argument("--over", default="amplitude=1.77:14.1", help="axis of --target with its range")
    args = parser.parse_args()
    if args.target is not None:
        print(spread(args.target, args.over, args.fmax[0], args.seeds, args.precision / 100, args.starts))
        return
    grid = Grid(args.output and args.output / "grid", args.realizations, args.starts)
    kinds = [(f, kind) for f in args.fmax for kind in (LINEARISED, TRUTH)]
    print(controls(grid, kinds), flush=True)
    print(f"\n{bias(grid, kinds)}\n", flush=True)
    if args.seeds:
        print(f"\n{coverage(grid, args.seeds, args.precision / 100, args.output)}")


if __name__ == "__main__":
    main()
