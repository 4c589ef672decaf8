"""Which parameters changed between two groups, by evidence, and what a change closes of the difference.

Under every hypothesis one model holds for both groups; only the named parameters differ between them. The data are the
mean of both groups and their difference. Parameters have the prior of `GroupModel`; a change of the logarithm of a
gain has SD `GAIN`, of a delay `DELAY`, of the logit of a weight `WEIGHT`. The model is not exact: the mean may be off
by `MISFIT` of the response, a predicted difference by `DISCREPANCY` and a difference without a named cause has the size
`ELSE`, all of them alike at neighbouring points. Evidence is the marginal likelihood by Laplace's approximation at the
best stable fit. Few people determine a covariance badly; the error of the difference is therefore inflated until the
differences of relabelled groups, which have no cause, do not speak for one (`inflation`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from mcstudy.errors import InputError
from mcstudy.group_comparison.base import GroupModel
from mcstudy.group_comparison.sample import Sample
from mcstudy.spectra.frf_groups import as_real
from mcstudy.streams import stream

GAIN, DELAY, WEIGHT = 0.3, 0.2, 1.0
"""SD of changes: logarithm of a gain and of a delay, logit of a weight."""

MISFIT, DISCREPANCY, ELSE = 0.1, 0.05, 0.3
"""SD relative to the response: error of the model, of a predicted difference, and a difference without a cause."""

OCTAVES = 0.7
"""SD of the distance over which such errors are alike."""

STARTS, CANDIDATES = 5, 200
"""Starts of the fit to both groups together: the first stable ones of so many near the median of the prior."""

START_SD = 0.4
"""Of starts, in standard normal numbers."""

INFLATIONS = np.geomspace(1.0, 16.0, 25)
"""Factors tried for the error of the difference."""

NOTHING, OTHER = "no difference", "something else"

PRIOR_NOTHING, PRIOR_OTHER = 0.5, 0.1
"""Prior probabilities; the named changes share the rest."""


@dataclass(frozen=True)
class Fitted:
    """One hypothesis, fitted.

    Attributes
    ----------
    name: of the hypothesis. parts: parameters that differ. log_evidence: up to a constant of all hypotheses.
    difference: (D,), predicted. a, b: (K,), values of the parts in both groups. z: where the fit ended.
    """

    name: str
    parts: tuple[str, ...]
    log_evidence: float
    difference: np.ndarray
    a: np.ndarray
    b: np.ndarray
    z: np.ndarray


def hypotheses(model: GroupModel) -> dict[str, tuple[str, ...]]:
    """Names of the hypotheses and the parameters that differ in each, without those that name no parameter."""
    names = model.model.names
    weights = tuple(n for n, of in zip(names, model.is_weight, strict=True) if of)
    active = tuple(n for n in names if n[0] in "KB" and "pas" not in n)
    sets = {
        "active gains": active,
        "ankle gains": tuple(n for n in active if n.endswith("1")),
        "hip gains": tuple(n for n in active if n.endswith("2")),
        "delays": tuple(n for n in names if n.startswith("Td")),
        "passive stiffness": tuple(n for n in names if "pas" in n),
    }
    if weights:
        sets["weight and active gains"] = (*weights, *active)
    return {**{n: (n,) for n in names}, **sets}


def smooth(mean: np.ndarray, f: np.ndarray, relative: float) -> np.ndarray:
    """Covariance (4 N, 4 N) of complex deviations with SD ``relative`` |mean| that change smoothly with frequency."""
    alike = np.exp(-0.5 * (np.subtract.outer(np.log2(f), np.log2(f)) / OCTAVES) ** 2)
    n, size = f.size, relative * np.abs(mean) / np.sqrt(2)
    C = np.zeros((4 * n, 4 * n))
    for block in range(4):
        at = slice(block * n, (block + 1) * n)
        C[at, at] = np.outer(size[block % 2], size[block % 2]) * alike
    return C


def inflation(sample: Sample, f: np.ndarray, rng: np.random.Generator, n: int = 500) -> float:
    """Factor of the error of the difference at which relabelled groups do not speak for a difference.

    The likelihood ratio of a difference of the size `ELSE` to none has a mean of one over data without a difference if
    their error is right. Means of the groups are taken off first.
    """
    centred = Sample(sample.a - sample.a.mean(axis=0), sample.b - sample.b.mean(axis=0), sample.paired)
    difference = centred.statistics(centred.relabelled(rng, n)[1:])[0]
    spread = smooth(sample.mean, f, ELSE)
    for factor in INFLATIONS:
        log = _gauss(difference, factor * sample.error + spread) - _gauss(difference, factor * sample.error)
        if np.exp(np.minimum(log, 50.0)).mean() <= 1:
            return float(factor)
    return float(INFLATIONS[-1])


def _gauss(rows: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    root = np.linalg.cholesky(covariance)
    return np.asarray(-0.5 * (np.linalg.solve(root, rows.T) ** 2).sum(axis=0) - np.log(np.diag(root)).sum())


class Problem:
    """Mean and difference of two groups, with their errors, to be explained by a model."""

    def __init__(self, model: GroupModel, sample: Sample, error: np.ndarray, mean_error: np.ndarray) -> None:
        """``error``, ``mean_error``: (D, D), covariances of the difference and of the mean."""
        f = model.group["f"].values
        self.model, self.mean, self.difference, self.error = model, as_real(sample.mean), sample.difference, error
        self.of_mean = np.linalg.inv(np.linalg.cholesky(mean_error + smooth(sample.mean, f, MISFIT)))
        self._size, self._f = sample.mean, f

    def _whitener(self, relative: float) -> np.ndarray:
        spread = smooth(self._size, self._f, relative) if relative else 0.0
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.error + spread)))

    def base(self, seed: int) -> np.ndarray:
        """Standard normal numbers (P,) of the best stable fit without a difference; raises `InputError` if none is."""
        candidates = stream(seed, "group_base").normal(0.0, START_SD, (CANDIDATES, self.model.median.size))
        starts = [z for z in candidates if self.model.stable(z)][:STARTS]
        found = [self._solve(z, (), np.zeros(0), 0.0) for z in starts]
        stable = [r for r in found if self.model.stable(r.x)]
        if not stable:
            raise InputError("groups: no stable model was found for their mean response")
        return np.asarray(min(stable, key=lambda r: r.cost).x)

    def fit(self, name: str, parts: Sequence[str], z: np.ndarray, relative: float = DISCREPANCY) -> Fitted:
        """The hypothesis that ``parts`` differ, from the base ``z`` or the end of an earlier fit of it."""
        P = self.model.median.size
        at = [self.model.model.names.index(part) for part in parts]
        scale = self._scale(at)
        start = z if z.size == P + len(at) else np.concatenate([z, np.zeros(len(at))])
        r = self._solve(start, at, scale, relative)
        low, high = self._ends(r.x, at, scale)
        whiten = self._whitener(relative)
        _, half = np.linalg.slogdet(r.jac.T @ r.jac)
        stable = self.model.stable(low) and self.model.stable(high)
        evidence = -r.cost - 0.5 * half + np.log(np.diag(whiten)).sum() if stable else -np.inf
        predicted = self.model.response(high) - self.model.response(low)
        a, b = (self.model.theta(end)[0][at] for end in (low, high))
        return Fitted(name, tuple(parts), float(evidence), predicted, a, b, r.x)

    def _scale(self, at: Sequence[int]) -> np.ndarray:
        """SD of changes in standard normal numbers."""
        of_unit = {"s": DELAY, "": WEIGHT}
        change = np.array([of_unit.get(p.unit, GAIN) for p in self.model.model.parameters])
        return np.asarray((change / self.model.sd)[list(at)])

    def _ends(self, x: np.ndarray, at: Sequence[int], scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of both groups: half of the change each way."""
        P = self.model.median.size
        low, high = x[:P].copy(), x[:P].copy()
        low[list(at)] -= 0.5 * scale * x[P:]
        high[list(at)] += 0.5 * scale * x[P:]
        return low, high

    def _solve(self, start: np.ndarray, at: Sequence[int], scale: np.ndarray, relative: float) -> OptimizeResult:
        """The best fit from a start; where it is unstable, the best with a barrier against instability."""
        found = self._minimum(start, at, scale, relative, barrier=False)
        if all(self.model.instability(end) == 0 for end in self._ends(found.x, at, scale)):
            return found
        return self._minimum(start, at, scale, relative, barrier=True)

    def _minimum(
        self, start: np.ndarray, at: Sequence[int], scale: np.ndarray, relative: float, *, barrier: bool
    ) -> OptimizeResult:
        P, whiten = self.model.median.size, self._whitener(relative)

        def residual(x: np.ndarray) -> np.ndarray:
            low, high = self.model.response(np.stack(self._ends(x, at, scale)))
            mean = self.of_mean @ ((low + high) / 2 - self.mean)
            apart = whiten @ (high - low - self.difference)
            unstable = [self.model.instability(end) for end in self._ends(x, at, scale)] if barrier else []
            return np.concatenate([mean, apart, x, unstable])

        def slope(x: np.ndarray) -> np.ndarray:
            low, high = self.model.slope(np.stack(self._ends(x, at, scale)))
            mean, apart = (low + high) / 2, high - low
            if len(at):
                step = 0.5 * scale * low[:, list(at)], 0.5 * scale * high[:, list(at)]
                mean = np.concatenate([mean, (step[1] - step[0]) / 2], axis=1)
                apart = np.concatenate([apart, step[1] + step[0]], axis=1)
            rows = []
            for sign, end in zip((-0.5, 0.5), self._ends(x, at, scale), strict=True) if barrier else ():
                of_end = self.model.instability_slope(end)
                rows.append(np.concatenate([of_end, sign * scale * of_end[list(at)]])[None])
            return np.concatenate([self.of_mean @ mean, whiten @ apart, np.eye(P + len(at)), *rows])

        return least_squares(residual, start, jac=slope, x_scale="jac", max_nfev=60)


def posterior(fitted: Sequence[Fitted]) -> np.ndarray:
    """Probabilities of fitted hypotheses, among them `NOTHING` and `OTHER`."""
    named = [f for f in fitted if f.name not in (NOTHING, OTHER)]
    prior = {NOTHING: PRIOR_NOTHING, OTHER: PRIOR_OTHER}
    each = (1 - PRIOR_NOTHING - PRIOR_OTHER) / max(len(named), 1)
    log = np.array([f.log_evidence + np.log(prior.get(f.name, each)) for f in fitted])
    weight = np.exp(log - log.max())
    return np.asarray(weight / weight.sum())
