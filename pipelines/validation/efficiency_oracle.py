"""How far is maximum likelihood from the Cramér-Rao bound? Usage: python pipelines/validation/efficiency_oracle.py [N]

N is the number of realizations. The `ml` group of pipelines/efficiency.toml is fitted twice: weighted by the covariance
estimated from each record (spectra.covariance = "through_loop", as in a real study), and weighted by the true
covariance, known from other realizations of the noise (impossible in a real study). The Cramér-Rao bound is for the
true covariance. The distance of the second fit from the bound is due to the curvature of the model, which no weighting
can remove. The additional distance of the first fit is the cost of estimating the covariance.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from mcstudy.fitting.problem import ml_cost
from mcstudy.fitting.solvers import fit_many
from mcstudy.fitting.standard_errors import joint_covariance
from mcstudy.stance.information import cramer_rao
from mcstudy.study.experiment import Experiment
from mcstudy.study.study_file import read_study

STUDY = Path(__file__).parents[1] / "efficiency.toml"
ON_BOUND = 0.01
"""Fraction of fits on a bound above which the Cramér-Rao bound does not apply."""


def spread(model, f, data, covariances, n):
    """Best fits (R, P) on the first ``n`` lines: their standard deviations, the errors of these, shares on a bound."""
    # from the truth: the minimum next to it, not the lowest of many starts
    problems = [ml_cost(model, f[:n], y[:n], C[:n]) for y, C in zip(data, covariances, strict=True)]
    starts = np.repeat(model.truth[None, None], len(problems), axis=0)
    best = np.concatenate([fits.estimate for fits in fit_many(problems, starts)])
    sd = best.std(axis=0, ddof=1)
    kurtosis = ((best - best.mean(axis=0)) ** 4).mean(axis=0) / sd**4
    error = sd * np.sqrt(np.maximum(kurtosis - 1, 0.0) / len(best)) / 2
    return sd, error, ((best <= model.lower) | (best >= model.upper)).mean(axis=0)


def main(realizations: int) -> None:
    """Print both ratios for every parameter that hardly ever ends on a bound."""
    study = read_study(STUDY)
    paper = Experiment(study.groups["ml"], study.study.seed)
    model, amplitude = paper.model, paper.group.amplitude[0]
    cells = [paper.measure(amplitude, r) for r in range(realizations)]
    plain = Experiment(study.groups["ml_even_lines"], study.study.seed)  # the same data, no first fit
    others = [plain.measure(amplitude, r).frf - paper.true_frf for r in range(realizations, 3 * realizations)]
    true = np.einsum("rla,rlb->lab", np.stack(others), np.conj(others)) / len(others)
    print(f"{'Fmax':>5} {'':5} {'on a bound':>10} {'SD / bound, estimated covariance':>34} {'true covariance':>17}")
    for fmax in paper.group.fmax:
        n = len(paper.bands.below(fmax))
        bound = np.sqrt(np.diag(cramer_rao(model, model.truth, paper.f[:n], joint_covariance(true[:n]))))
        data = [cell.frf for cell in cells]
        sd, error, on = spread(model, paper.f, data, [cell.covariance for cell in cells], n)
        best, best_error, _ = spread(model, paper.f, data, [true] * realizations, n)
        for p, name in enumerate(model.names):
            if on[p] < ON_BOUND:
                own = f"{sd[p] / bound[p]:.3f} ± {error[p] / bound[p]:.3f}"
                oracle = f"{best[p] / bound[p]:.3f} ± {best_error[p] / bound[p]:.3f}"
                print(f"{fmax:5g} {name:5} {100 * on[p]:9.1f}% {own:>34} {oracle:>17}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2400)
