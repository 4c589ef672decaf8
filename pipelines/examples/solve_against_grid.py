"""Does ``mcstudy solve`` find what a brute-force grid finds, with how many fits, and what does a control save?

    python pipelines/examples/solve_against_grid.py --realizations 400 --starts 50

Twenty targets on the paper's experiment: several measures and parameters, amplitude or cycles as the axis, three Fmax,
some of them out of reach. Each limit is the value that the grid has at some place of the axis, to two digits, or half
of its lowest. The grid fits every design with all starts; its answer is where the measure, interpolated between designs
in logarithms, meets the limit. The search gets other noise. Distances are in standard errors of both.

The first table is about the controls: the variance of what the difference of complete and cheap fit contributes to a
CV, relative to that of the complete fit (median over parameters), and what follows for the cost of both levels; counted
in fits with one cheap fit as one, and in evaluations of the model. The last column compares multilevel estimates with
those from other realizations with all starts.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.planning.fits import FULL, LINEARISED, TRUTH, Design, Fitter
from mcstudy.planning.multilevel import MEASURES, Draws, Estimate, difference_of, estimated, relative_cost
from mcstudy.planning.solve import solve_study
from mcstudy.planning.space import AMPLITUDE, CYCLES
from mcstudy.planning.targets import Target, parse_targets
from mcstudy.study.design import Study
from mcstudy.text_tables import number, table

AMPLITUDES = tuple(float(f"{a:.3g}") for a in np.geomspace(2.0, 16.0, 7))
COUNTS = (2, 4, 6, 9, 13, 20)
OUT = -1.0
"""In place of a position: a target out of reach."""

SEED, OTHER_SEED = 2018, 4711
NOMINAL = 5.0
PILOT = 64


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
    Case("cv(B22)", AMPLITUDE, 8.0, 0.5),
    Case("cv(K21)", AMPLITUDE, 8.0, 0.5),
    Case("rmse(Td2)", AMPLITUDE, 8.0, 0.6),
    Case("sd(K11 + Kpas1)", AMPLITUDE, 8.0, 0.5),
    Case("rmse(Kpas2)", AMPLITUDE, 8.0, OUT),
    Case("cv(Td1)", CYCLES, 1.2, 0.5),
    Case("cv(K11 + Kpas1)", CYCLES, 1.2, 0.5),
    Case("sd(K12)", CYCLES, 1.2, 0.4),
    Case("rmse(B12)", CYCLES, 1.2, 0.5),
)


def study_of(seed: int, starts: int, fmax: Sequence[float]) -> Study:
    """The paper's experiment."""
    return Study("solve", seed=seed).group("a", realizations=50, starts=starts, fmax=list(fmax), amplitude=[NOMINAL])


def value_of(target: Target, x: np.ndarray) -> Estimate:
    """A measure in percent, from complete fits."""
    return estimated(Draws(target.of(x), target.truth), target.measure).times(target.factor)


def controls(fitter: Fitter, fmax: Sequence[float], realizations: int) -> str:
    """Table of the controls at the nominal amplitude."""
    rows = []
    for f in fmax:
        design = Design(6, NOMINAL, f)
        full = fitter.realizations(design, FULL, realizations)
        for kind in (LINEARISED, TRUTH):
            control = fitter.realizations(design, kind, realizations)
            sample = fitter.draws(design, kind, 10 * PILOT if kind == TRUTH else 2 * PILOT)
            apart, ratios = [], []
            for k, truth in enumerate(fitter.model.truth):
                draws = Draws(full[:, k], truth, control[:, k])
                ratios.append(difference_of(draws, MEASURES["cv"]))
                for measure in MEASURES.values():
                    cheap = estimated(Draws(full[:PILOT, k], truth, control[:PILOT, k], sample[:, k]), measure)
                    whole = estimated(Draws(full[PILOT:, k], truth), measure)
                    apart.append((cheap.value - whole.value) / np.hypot(cheap.error, whole.error))
            difference, starts = float(np.median(ratios)), fitter.group.starts
            evaluations = relative_cost(difference, fitter.cost(kind), fitter.cost(FULL))
            rows.append(
                [
                    f"{f:g} Hz",
                    kind,
                    number(difference, 2),
                    f"1/{1 / relative_cost(difference, 1.0, starts):.1f}",
                    f"1/{1 / evaluations:.1f}",
                    f"{np.sqrt(np.mean(np.square(apart))):.2f}, {np.max(np.abs(apart)):.1f}",
                ]
            )
            print(rows[-1], flush=True)
    head = ["Fmax", "control", "difference", "in fits", "in evaluations", "distance: rms, largest"]
    return table(head, rows)


def crossing(axis: np.ndarray, found: Sequence[Estimate], limit: float) -> tuple[float, float]:
    """Where interpolated values fall to the limit, and the relative standard error of that; NaN where they do not."""
    value = np.abs([e.value for e in found])
    if value[0] <= limit:
        return float(axis[0]), 0.0
    for k in range(1, value.size):
        if value[k] <= limit < value[k - 1]:
            slope = np.log(value[k] / value[k - 1]) / np.log(axis[k] / axis[k - 1])
            at = axis[k - 1] * (limit / value[k - 1]) ** (1 / slope)
            return float(at), float(found[k].error / value[k] / abs(slope))
    return math.nan, math.nan


def limit_of(found: Sequence[Estimate], position: float) -> float:
    """Two digits of the grid's value at a place of the axis; half of the lowest for a target out of reach."""
    value = np.abs([e.value for e in found])
    if position == OUT:
        return float(f"{value.min() / 2:.2g}")
    inside = np.exp(np.interp(position * (value.size - 1), np.arange(value.size), np.log(value)))
    return float(f"{inside:.2g}")


def compared(case: Case, fitter: Fitter, realizations: int, starts: int, precision: float) -> list[str]:
    """A row of the table: grid and search."""
    (target,) = parse_targets(fitter.model, [f"{case.measure} <= 1%"])
    designs = case.designs()
    found = [value_of(target, fitter.realizations(d, FULL, realizations)) for d in designs]
    limit = limit_of(found, case.position)
    axis = np.array(AMPLITUDES if case.axis == AMPLITUDE else [c - 1.0 for c in COUNTS])
    at, error = crossing(axis, found, limit)
    grid = realizations * starts * len(designs)
    text = f"{case.measure} <= {limit:g}%"
    ends = (AMPLITUDES[0], AMPLITUDES[-1]) if case.axis == AMPLITUDE else (COUNTS[0], COUNTS[-1])
    over = f"{case.axis}={ends[0]:g}:{ends[-1]:g}"
    study = study_of(OTHER_SEED, starts, [case.fmax])
    answer = solve_study(study, [text], [over], precision=precision)
    row = [text, f"{case.axis}, {case.fmax:g} Hz"]
    cheaper = f"1/{grid / answer.spent.fits:.1f}"
    if answer.answer is None or math.isnan(at):
        words = ("out of reach" if math.isnan(at) else number(at), "out of reach" if answer.answer is None else "found")
        return [*row, *words, "", "", "", cheaper, ""]
    (c,) = answer.answer.crossings
    ours, low, high = (v - (case.axis == CYCLES) for v in (c.value, c.low, c.high))
    width = np.log(high / low) / 3.92
    distance = np.log(ours / at) / np.hypot(width, error) if width or error else 0.0
    equal = grid * (error / width) ** 2 / answer.spent.fits if width else math.nan
    return [
        *row,
        f"{number(at)} ± {100 * error:.1f} %",
        f"{number(ours)} [{number(low)}, {number(high)}]",
        f"{100 * (ours / at - 1):+.1f} %",
        f"{distance:+.1f}",
        str(answer.spent.fits),
        cheaper,
        f"1/{equal:.0f}",
    ]


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--realizations", type=int, default=400, help="of every design of the grid")
    parser.add_argument("--starts", type=int, default=50)
    parser.add_argument("--cases", type=int, default=len(CASES), help="how many of the targets")
    parser.add_argument("--precision", type=float, default=10.0, help="of the search, percent")
    args = parser.parse_args()
    cases = CASES[: args.cases]
    fmax = sorted({case.fmax for case in cases})
    fitter = Fitter(study_of(SEED, args.starts, fmax).groups["a"], SEED, fmax)
    first = controls(fitter, fmax, args.realizations)
    rows = []
    for case in cases:
        rows.append(compared(case, fitter, args.realizations, args.starts, args.precision / 100))
        print(rows[-1], flush=True)
    head = ["target", "over", "grid ± SE", "search [95 %]", "apart", "in SE", "fits", "of grid", "at equal error"]
    print(f"\n{first}\n\n{table(head, rows)}")


if __name__ == "__main__":
    main()
