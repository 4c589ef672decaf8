"""Compare two groups: tests; if the means differ, hypotheses about the cause, and what each closes in others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from mcstudy.group_comparison.changes import (
    NOTHING,
    PRIOR_NOTHING,
    PRIOR_OTHER,
    Fitted,
    Problem,
    hypotheses,
    inflation,
    posterior,
)
from mcstudy.group_comparison.detection import detect
from mcstudy.group_comparison.group_model import GroupModel
from mcstudy.group_comparison.result import LEVEL, Cause, ComparisonRecord
from mcstudy.group_comparison.sample import Sample, sample_of
from mcstudy.spectra.frf_groups import as_complex
from mcstudy.streams import stream

FOLDS = 5
"""Parts of the people for the share closed: each is predicted from the others."""

CLOSED_FOR = 3
"""Number of hypotheses, the most probable ones, whose share closed is computed."""

LEAST_FOR_FOLDS = 10
"""Fewest people of each group for which it is."""


def compare_groups(
    a: xr.Dataset,
    b: xr.Dataset,
    paired: bool | None = None,
    permutations: int = 999,
    seed: int = 0,
    names: tuple[str, str] = ("a", "b"),
) -> ComparisonRecord:
    """Compare group ``b`` with group ``a``; arguments and errors as `mcstudy.compare`."""
    sample = sample_of(a, b, paired)
    f = a["f"].values
    detection = detect(sample, f, stream(seed, "group_labels"), permutations)
    explained = _causes(a, sample, seed) if detection.p_mean <= LEVEL else Causes((), None, None)
    sizes = len(sample.a), len(sample.b)
    return ComparisonRecord(
        *names,
        people=sizes,
        paired=sample.paired,
        stimulus=str(a.attrs["stimulus"]),
        f=f,
        mean_a=as_complex(sample.a.mean(axis=0)),
        mean_b=as_complex(sample.b.mean(axis=0)),
        error_a=_standard_error(sample.a),
        error_b=_standard_error(sample.b),
        predicted=explained.predicted,
        inflation=explained.inflation,
        permutations=permutations,
        detection=detection,
        causes=explained.causes,
    )


class Causes(NamedTuple):
    """What explains a difference: by probability; the difference (2, N) that the best named change predicts; the factor
    of the error of the difference in the evidence."""

    causes: tuple[Cause, ...]
    predicted: np.ndarray | None
    inflation: float | None


def _causes(a: xr.Dataset, sample: Sample, seed: int) -> Causes:
    """Hypotheses about a difference that was found: no difference is none of them."""
    factor, problem, fitted = hypotheses_fitted(a, sample, seed)
    fitted = [hypothesis for hypothesis in fitted if hypothesis.name != NOTHING]
    probability = posterior(fitted, 0.0, PRIOR_OTHER / (1 - PRIOR_NOTHING))
    order = np.argsort(-probability, kind="stable")
    named = [k for k in order if fitted[k].parts]
    shares = _closed(sample, problem, [fitted[k] for k in named[:CLOSED_FOR]], stream(seed, "group_folds"))
    causes = []
    for k in order:
        change = fitted[k]
        share, error = shares.get(change.name, (None, None))
        values = tuple((name, float(x), float(y)) for name, x, y in zip(change.parts, change.a, change.b, strict=True))
        causes.append(Cause(change.name, float(probability[k]), share, error, values))
    return Causes(tuple(causes), as_complex(fitted[named[0]].difference), factor)


def hypotheses_fitted(a: xr.Dataset, sample: Sample, seed: int) -> tuple[float, Problem, list[Fitted]]:
    """Inflation of the error, the problem, and all hypotheses about ``sample``, at the points of ``a``."""
    factor = inflation(sample, a["f"].values, stream(seed, "group_inflation"))
    model = GroupModel(a)
    problem = Problem(model, sample, factor * sample.error, sample.mean_error)
    return factor, problem, problem.fits(hypotheses(model), problem.base(seed))


def _standard_error(rows: np.ndarray) -> np.ndarray:
    """Of the mean response, (2, N)."""
    variance = rows.var(axis=0, ddof=1).reshape(2, 2, -1).sum(axis=0)
    return np.asarray(np.sqrt(variance / len(rows)))


def _closed(
    sample: Sample, problem: Problem, candidates: Sequence[Fitted], rng: np.random.Generator
) -> dict[str, tuple[float, float]]:
    """Share of the difference that a hypothesis closes in people left out, with its jackknife standard error.

    With the difference d of the people left out, D of the others and the prediction p made from D, in units of the
    error: 2 p d - p p estimates what p takes off the squared difference, and D d the squared difference itself, each
    without bias, because the errors of d are independent of p and of D. The share is the ratio of their sums.
    """
    if min(len(sample.a), len(sample.b)) < LEAST_FOR_FOLDS:
        return {}
    weight = np.linalg.inv(problem.error)
    of_a = np.array_split(rng.permutation(len(sample.a)), FOLDS)
    of_b = of_a if sample.paired else np.array_split(rng.permutation(len(sample.b)), FOLDS)
    taken, whole = np.zeros((len(candidates), FOLDS)), np.zeros(FOLDS)
    for k, (out_a, out_b) in enumerate(zip(of_a, of_b, strict=True)):
        kept = sample.part(np.setdiff1d(np.arange(len(sample.a)), out_a), np.setdiff1d(np.arange(len(sample.b)), out_b))
        more = sample.people / kept.people
        others = Problem(problem.model, kept, more * problem.error, more * sample.mean_error)
        left = sample.part(out_a, out_b).difference
        whole[k] = kept.difference @ weight @ left
        again = others.fits({c.name: c.parts for c in candidates}, np.stack([c.x for c in candidates]))
        for row, p in enumerate(change.difference for change in again):
            taken[row, k] = 2 * p @ weight @ left - p @ weight @ p
    if whole.sum() <= 0:
        return {}
    out = {}
    for row, change in enumerate(candidates):
        without = (taken[row].sum() - taken[row]) / (whole.sum() - whole)
        error = np.sqrt((FOLDS - 1) / FOLDS * ((without - without.mean()) ** 2).sum())
        out[change.name] = (float(taken[row].sum() / whole.sum()), float(error))
    return out
