"""Does ``mcstudy solve`` find what a brute-force grid finds, and with how many fits?

    python pipelines/validation/solve_against_grid.py -o results/solve

Twenty targets on the paper's experiment: several measures and parameters, amplitude or cycles as the axis, three Fmax,
some of them out of reach. The grid fits every design with all starts; its answer is where the measure, interpolated
between designs by a monotone cubic in logarithms, meets the limit. Each limit is the value that the grid has at some
place of the axis, to two digits, or half of its lowest. The search gets other noise.

Targets with the same axis and Fmax share the grid's fits. `of the grid's` counts, for every target, all fits of the
grid that this target alone would need. The last lines compare the sum over all targets with one grid that serves all.
`evaluations` are those of the model with its derivatives, behind the fits and the linearised starts of both. `in SE` is
the distance in standard errors of both. `grid there` is the grid's measure at the answer of the search, relative to the
limit. `at equal error` is for a grid with as many realizations as it needs for the error of the search.

Every design of the grid and every target is a file in the output folder, so the same command resumes.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.stats import norm

from mcstudy.planning.fits import FULL, Design, Fitter
from mcstudy.planning.multilevel import Draws, Estimate, estimated
from mcstudy.planning.solve import solve_study
from mcstudy.planning.space import AMPLITUDE, CYCLES
from mcstudy.planning.targets import Target, parse_targets
from mcstudy.study.design import Study
from mcstudy.text_tables import number, table

AMPLITUDES = (1.77, 2.5, 3.54, 5.0, 7.07, 10.0, 14.1)
COUNTS = (2, 3, 4, 6)
FMAX = (0.41, 1.2, 8.0)
OUT = -1.0
"""In place of a position: a target out of reach."""

SEED, OTHER_SEED = 2018, 4711
NOMINAL = 5.0
TOLERANCE = 0.05


@dataclass(frozen=True)
class Case:
    """A target: its measure, the axis, Fmax in Hz, and where on the axis the limit is (0 to 1), or `OUT`."""

    measure: str
    axis: str
    fmax: float
    position: float

    def designs(self) -> list[Design]:
        """The grid."""
        if self.axis == AMPLITUDE:
            return [Design(6, a, self.fmax) for a in AMPLITUDES]
        return [Design(c, NOMINAL, self.fmax) for c in COUNTS]

    @property
    def values(self) -> np.ndarray:
        """The axis of the grid; used cycles in place of recorded ones."""
        return np.array(AMPLITUDES if self.axis == AMPLITUDE else [c - 1.0 for c in COUNTS])

    @property
    def over(self) -> str:
        """The axis with its range, for the search."""
        ends = AMPLITUDES if self.axis == AMPLITUDE else COUNTS
        return f"{self.axis}={ends[0]:g}:{ends[-1]:g}"


CASES = (
    Case("cv(Td1)", AMPLITUDE, 1.2, 0.5),
    Case("cv(K11 + Kpas1)", AMPLITUDE, 1.2, 0.4),
    Case("sd(K12)", AMPLITUDE, 1.2, 0.6),
    Case("rmse(K22)", AMPLITUDE, 1.2, 0.5),
    Case("sd(B11)", AMPLITUDE, 1.2, 0.4),
    Case("bias(K11)", AMPLITUDE, 1.2, 0.4),
    Case("cv(Kpas1)", AMPLITUDE, 1.2, OUT),
    Case("cv(K12)", AMPLITUDE, 0.41, 0.5),
    Case("rmse(K22 + Kpas2)", AMPLITUDE, 0.41, 0.5),
    Case("sd(K21)", AMPLITUDE, 0.41, 0.6),
    Case("sd(B21)", AMPLITUDE, 0.41, OUT),
    Case("cv(Td1)", CYCLES, 1.2, 0.5),
    Case("cv(K11 + Kpas1)", CYCLES, 1.2, 0.5),
    Case("sd(K12)", CYCLES, 1.2, 0.4),
    Case("rmse(B12)", CYCLES, 1.2, 0.5),
    Case("cv(B22)", AMPLITUDE, 8.0, 0.5),
    Case("cv(K21)", AMPLITUDE, 8.0, 0.5),
    Case("rmse(Td2)", AMPLITUDE, 8.0, 0.6),
    Case("sd(K11 + Kpas1)", AMPLITUDE, 8.0, 0.5),
    Case("rmse(Kpas2)", AMPLITUDE, 8.0, OUT),
)


def study_of(seed: int, starts: int, fmax: Sequence[float]) -> Study:
    """The paper's experiment."""
    return Study("solve", seed=seed).group("a", realizations=50, starts=starts, fmax=list(fmax), amplitude=[NOMINAL])


class Grid:
    """Complete fits of designs, each made once and kept in a file.

    Parameters
    ----------
    folder: of the files; None keeps them in memory. realizations, starts: of every design.
    """

    def __init__(self, folder: Path | None, realizations: int, starts: int) -> None:
        self.folder, self.realizations, self.starts = folder, realizations, starts
        self._kept: dict[Design, tuple[np.ndarray, int]] = {}
        self.fitter = Fitter(study_of(SEED, starts, FMAX).groups["a"], SEED, FMAX)
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def _of(self, design: Design) -> tuple[np.ndarray, int]:
        if design in self._kept:
            return self._kept[design]
        name = f"cycles{design.cycles}_amplitude{design.amplitude:g}_fmax{design.fmax:g}_starts{self.starts}.npz"
        file = None if self.folder is None else self.folder / name
        if file is not None and file.exists():
            with np.load(file) as saved:
                x, evaluations = saved["estimate"], int(saved["evaluations"])
            if len(x) >= self.realizations:
                share = self.realizations / len(x)
                self._kept[design] = x[: self.realizations], round(share * evaluations)
                return self._kept[design]
        print(f"grid: {design.cycles} cycles, {design.amplitude:g} N m, {design.fmax:g} Hz", flush=True)
        before = self.fitter.spent.evaluations
        x = self.fitter.realizations(design, FULL, self.realizations)
        self._kept[design] = x, self.fitter.spent.evaluations - before
        if file is not None:
            part = file.with_suffix(".part.npz")
            np.savez(part, estimate=x, evaluations=self._kept[design][1])
            part.replace(file)
        return self._kept[design]

    def estimates(self, design: Design) -> np.ndarray:
        """Best of all starts, (realizations, P)."""
        return self._of(design)[0]

    def spent(self, designs: Sequence[Design]) -> tuple[int, int]:
        """Fits and evaluations of the model behind designs."""
        fits = self.realizations * self.starts * len(designs)
        return fits, sum(self._of(d)[1] for d in designs)

    def value(self, target: Target, design: Design) -> Estimate:
        """A measure in percent."""
        x = self.estimates(design)
        return estimated(Draws(target.of(x), target.truth), target.measure).times(target.factor)

    def target(self, case: Case) -> tuple[Target, list[Estimate]]:
        """The target of a case with its limit, and the grid's values."""
        (target,) = parse_targets(self.fitter.model, [f"{case.measure} <= 1%"])
        found = [self.value(target, d) for d in case.designs()]
        limit = limit_of(found, case.position)
        return parse_targets(self.fitter.model, [f"{case.measure} <= {limit:g}%"])[0], found


def curve(axis: np.ndarray, found: Sequence[Estimate]) -> PchipInterpolator:
    """Logarithm of the measure over that of the axis: straight lines would be too high where it is convex."""
    return PchipInterpolator(np.log(axis), np.log(np.abs([e.value for e in found])))


def crossing(axis: np.ndarray, found: Sequence[Estimate], limit: float) -> tuple[float, float]:
    """Where interpolated values fall to the limit, and the relative standard error of that; NaN where they do not."""
    inside, between = curve(axis, found), np.linspace(np.log(axis[0]), np.log(axis[-1]), 4001)
    reached = np.flatnonzero(inside(between) <= math.log(limit))
    if not reached.size:
        return math.nan, math.nan
    if reached[0] == 0:
        return float(axis[0]), 0.0
    at = between[reached[0]]
    error = np.interp(at, np.log(axis), [e.error / abs(e.value) for e in found])
    return float(np.exp(at)), float(error / abs(inside(at, 1)))


def limit_of(found: Sequence[Estimate], position: float) -> float:
    """Two digits of the grid's value at a place of the axis; half of the lowest for a target out of reach."""
    value = np.abs([e.value for e in found])
    if position == OUT:
        return float(f"{value.min() / 2:.2g}")
    inside = np.exp(np.interp(position * (value.size - 1), np.arange(value.size), np.log(value)))
    return float(f"{inside:.2g}")


def searched(case: Case, grid: Grid, precision: float) -> dict[str, Any]:
    """What the search finds for one target."""
    target, _ = grid.target(case)
    before = time.process_time()
    answer = solve_study(
        study_of(OTHER_SEED, grid.starts, [case.fmax]), [target.text], [case.over], precision=precision
    )
    row: dict[str, Any] = {
        "target": target.text,
        "cpu_s": time.process_time() - before,
        "fits": answer.spent.fits,
        "evaluations": answer.spent.evaluations,
        "decided": answer.decided,
        "out": answer.answer is None,
        "flat": answer.flat,
    }
    if answer.answer is not None:
        (c,) = answer.answer.crossings
        ours, low, high = (v - (case.axis == CYCLES) for v in (c.value, c.low, c.high))
        row |= {"search": ours, "interval": [low, high]}
    return row


def compared(case: Case, grid: Grid, search: dict[str, Any]) -> dict[str, Any]:
    """Grid and search for one target."""
    target, found = grid.target(case)
    at, error = crossing(case.values, found, target.limit)
    fits, evaluations = grid.spent(case.designs())
    row = {
        **search,
        "over": f"{case.axis}, {case.fmax:g} Hz",
        "grid": at,
        "grid_error": error,
        "grid_fits": fits,
        "grid_evaluations": evaluations,
    }
    if not search["out"] and not math.isnan(at):
        ours, (low, high) = search["search"], search["interval"]
        width = float(np.log(high / low) / 3.92)
        row |= {
            "error": width,
            "apart": ours / at - 1,
            "measure_apart": float(np.exp(curve(case.values, found)(np.log(ours))) / target.limit - 1),
            "distance": float(np.log(ours / at) / np.hypot(width, error)) if width or error else 0.0,
            "equal": fits * (error / width) ** 2 / search["fits"] if width else math.nan,
        }
    return row


def words(row: dict[str, Any]) -> list[str]:
    """A row of the table."""
    cheaper = [f"1/{row['grid_fits'] / row['fits']:.0f}", f"1/{row['grid_evaluations'] / row['evaluations']:.0f}"]
    first = [row["target"], row["over"]]
    spent = [str(row["fits"]), *cheaper]
    seconds = f"{row['cpu_s']:.1f}"
    if "apart" not in row:
        grid = "out of reach" if math.isnan(row["grid"]) else number(row["grid"])
        return [*first, grid, "out of reach" if row["out"] else "found", "", "", "", *spent, "", seconds]
    low, high = row["interval"]
    return [
        *first,
        f"{number(row['grid'])} ± {100 * row['grid_error']:.1f} %",
        f"{number(row['search'])} [{number(low)}, {number(high)}]{' flat' if row['flat'] else ''}",
        f"{100 * row['apart']:+.1f} %",
        f"{row['distance']:+.1f}",
        f"{100 * row['measure_apart']:+.1f} %",
        *spent,
        f"1/{row['equal']:.0f}",
        seconds,
    ]


HEAD = ["target", "over", "grid ± SE", "search [95 %]", "apart", "in SE", "grid there"]
HEAD += ["fits", "of the grid's", "evaluations", "at equal error", "CPU s"]


def summary(rows: Sequence[dict[str, Any]], grid: Grid, cases: Sequence[Case]) -> str:
    """What the table says as a whole."""
    n = len(rows)
    inside = [r for r in rows if "apart" in r]
    lines = []
    same = sum(("apart" in r) or (r["out"] and math.isnan(r["grid"])) for r in rows)
    lines.append(f"{same} of {n} targets: grid and search agree whether the target can be reached")
    if inside:
        m = len(inside)
        apart, steps = (np.array([r[key] for r in inside]) for key in ("apart", "distance"))
        near = int((np.abs(apart) <= TOLERANCE).sum())
        measure = int((np.abs([r["measure_apart"] for r in inside]) <= TOLERANCE).sum())
        surely = int((np.abs(apart) - 2 * np.hypot(*error_pairs(inside)) > TOLERANCE).sum())
        lines.append(
            f"axis within 5 %: {near} of {m} found; surely (2 SE) not: {surely}; measure within 5 %: {measure}"
        )
        own = int((np.abs(apart) <= TOLERANCE + 1.96 * error_pairs(inside)[1]).sum())
        both = int((np.abs(steps) <= 1.96).sum())
        lines.append(
            f"axis within 5 % plus the grid's own 95 % error: {own} of {m}; within the 95 % interval of the "
            f"difference: {both} of {m}"
        )
        middle, spread = float(np.mean(steps)), float(np.sqrt(np.mean(steps**2)))
        lines.append(
            f"distances in SE: mean {middle:+.2f} ± {1 / math.sqrt(m):.2f}, rms {spread:.2f} (1 if errors are right)"
        )
        holds = sum(r["interval"][0] <= r["grid"] <= r["interval"][1] for r in inside)
        ours, theirs = error_pairs(inside)
        chance = 2 * norm.cdf(1.96 / np.hypot(1, theirs / ours)) - 1
        overlap = sum(
            r["interval"][0] <= r["grid"] * math.exp(1.96 * r["grid_error"])
            and r["grid"] * math.exp(-1.96 * r["grid_error"]) <= r["interval"][1]
            for r in inside
        )
        lines.append(
            f"95 % interval holds the grid's answer: {holds} of {m}; expected, with the grid's error: "
            f"{chance.sum():.1f} ± {np.sqrt(np.sum(chance * (1 - chance))):.1f}, "
            f"and {overlap} overlap its interval"
        )
    for name, key in (("fits", "fits"), ("evaluations", "evaluations")):
        ratio = np.array([r[f"grid_{key}"] / r[key] for r in rows])
        enough = int((ratio >= 20).sum())
        lines.append(
            f"{name}: at most 1/20 of the grid's for {enough} of {n} targets; median 1/{np.median(ratio):.0f}, "
            f"from 1/{ratio.max():.0f} to 1/{ratio.min():.1f}"
        )
    every = list(dict.fromkeys(d for case in cases for d in case.designs()))
    fits, evaluations = grid.spent(every)
    ours, theirs = sum(r["fits"] for r in rows), sum(r["evaluations"] for r in rows)
    lines.append(
        f"all {n} searches together, of the {fits} fits of one grid that serves all: "
        f"1/{fits / ours:.1f} of the fits, 1/{evaluations / theirs:.1f} of the evaluations"
    )
    seconds = np.array([r["cpu_s"] for r in rows])
    lines.append(f"CPU time of a search: median {np.median(seconds):.1f} s, longest {seconds.max():.1f} s")
    return "\n".join(lines)


def error_pairs(rows: Sequence[dict[str, Any]]) -> tuple[np.ndarray, np.ndarray]:
    """Relative standard errors of the search and of the grid."""
    return np.array([r["error"] for r in rows]), np.array([r["grid_error"] for r in rows])


def main() -> None:
    """Print the table and what it says as a whole."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, help="folder of the results; the same command resumes")
    parser.add_argument("--realizations", type=int, default=2000, help="of every design of the grid")
    parser.add_argument("--starts", type=int, default=50)
    parser.add_argument("--cases", type=int, default=len(CASES), help="how many of the targets")
    parser.add_argument("--precision", type=float, default=5.0, help="of the search, percent")
    args = parser.parse_args()
    folder = args.output
    grid = Grid(folder and folder / "grid", args.realizations, args.starts)
    rows = []
    for k, case in enumerate(CASES[: args.cases]):
        name = f"target{k:02d}_grid{args.realizations}x{args.starts}_precision{args.precision:g}.json"
        file = None if folder is None else folder / name
        if file is not None and file.exists():
            found = json.loads(file.read_text(encoding="utf-8"))
        else:
            found = searched(case, grid, args.precision / 100)
            if file is not None:
                file.write_text(json.dumps(found), encoding="utf-8")
        rows.append(compared(case, grid, found))
        print(" | ".join(words(rows[-1])), flush=True)
    print(f"\n{table(HEAD, [words(r) for r in rows])}\n\n{summary(rows, grid, CASES[: args.cases])}")


if __name__ == "__main__":
    main()
