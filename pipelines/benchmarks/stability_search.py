"""Time of the stability search at the ends of fits, and its share of a study: for the paper's model and 1 to 4 rows."""

from __future__ import annotations

import numpy as np

from mcstudy.fitting.problem import Problem
from mcstudy.fitting.solvers import fit
from mcstudy.fitting.starts import uniform
from mcstudy.stance.stability import Proof, rightmost_root
from pipelines.benchmarks import kernel_sizes
from pipelines.benchmarks.cases import cases
from pipelines.benchmarks.measure import timed
from pipelines.benchmarks.report import Result, Sizes


def problems() -> dict[str, Problem]:
    """By name: cells of the paper's study, and joints that all feed back to one another."""
    paper = {f"fmax_{case.fmax:g}": case.problem for case in cases(1, 8) if case.realization == 0}
    return paper | {f"{R}x{R}": kernel_sizes.problem(R) for R in (1, 2, 3, 4)}


def run(sizes: Sizes) -> Result:
    """For each problem: microseconds of a search and of a fit, timed alternately, and how its roots were proved."""
    result = Result("stability")
    n_starts = 16 if sizes.starts < 50 else 256
    for name, problem in problems().items():
        pool = uniform(problem.model, np.random.default_rng(1), n_starts)
        pairs = []
        for _ in range(1 + 2 * sizes.repeats):
            fits, fitted = timed(fit, problem, pool)
            found, searched = timed(rightmost_root, problem.model, fits.estimate)
            pairs.append((fitted, searched))
        fitted, searched = np.median(pairs[1:], axis=0) / n_starts * 1e6
        share = searched / (fitted + searched)
        result.table.append(
            {
                "problem": name,
                "rows": problem.model.n_rows,
                "us a search": searched,
                "us a fit": fitted,
                "share": share,
                "stable": float((found.root.real < 0).mean()),
                "first certificate": float((found.proof == Proof.SEARCH).mean()),
            }
        )
        result.keys[f"stability.search_us.{name}"] = float(searched)
        result.keys[f"stability.share.{name}"] = float(share)
    return result
