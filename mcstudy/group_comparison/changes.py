"""Which parameters changed between two groups, by evidence, and what a change closes of the difference.

Under every hypothesis one model holds for both groups; only the named parameters differ between them. The data are the
mean of both groups and their difference. Parameters have the prior of `GroupModel`; a change of the logarithm of a
gain has SD `GAIN`, of a delay `DELAY`, of the logit of a weight `WEIGHT`. The model is not exact: the mean may be off
by `MISFIT` of the response, a predicted difference by `DISCREPANCY` and a difference without a named cause has the size
`ELSE`, all of them alike at neighbouring points. Evidence is the marginal likelihood by Laplace's approximation at the
best stable fit. Few people determine a covariance badly; the error of the difference is therefore inflated until the
differences of relabelled groups, which have no cause, do not speak for one (`inflation`).

Probabilities come from a power of the evidence (`POWER`), as is usual where the likelihood is known to be too sure
(Holmes & Walker 2017, Biometrika 104:497). Here it does not know that few people determine the covariance badly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mcstudy.errors import InputError
from mcstudy.fitting.batch_least_squares import minimised
from mcstudy.group_comparison.group_model import GroupModel
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
"""SD of the starts, in standard normal numbers."""

ITERATIONS = 60
"""Steps of a fit at most."""

INFLATIONS = np.geomspace(1.0, 16.0, 25)
"""Factors tried for the error of the difference."""

RELABELLINGS = 500
"""By which the factor is chosen."""

NOTHING, OTHER = "no difference", "something else"

PRIOR_NOTHING, PRIOR_OTHER = 0.5, 0.1
"""Prior probabilities; the named changes share the rest."""

POWER = 0.6
"""Of the evidence. Chosen on 220 simulated pairs of groups (1000 to 1059, 2000 to 2079 and 3000 to 3079 of
`pipelines/validation/group_calibration.py`), so that the stated probability of the first cause is that with which it is
right."""


@dataclass(frozen=True)
class Fitted:
    """One hypothesis, fitted.

    Attributes
    ----------
    name: of the hypothesis. parts: parameters that differ. log_evidence: up to a constant of all hypotheses.
    difference: (D,), predicted. a, b: (K,), values of the parts in both groups. x: (2 P,), where the fit ended.
    """

    name: str
    parts: tuple[str, ...]
    log_evidence: float
    difference: np.ndarray
    a: np.ndarray
    b: np.ndarray
    x: np.ndarray


def hypotheses(model: GroupModel) -> dict[str, tuple[str, ...]]:
    """Names of the hypotheses and the parameters that differ in each."""
    body = model.model

    def gains(delayed: bool, rows: Sequence[str] = body.rows) -> tuple[str, ...]:
        terms = [term for term in body.terms if term.row in rows and bool(term.all_delays) == delayed]
        used = {gain for term in terms for gain in term.gain} - set(body.weights)
        return tuple(name for name in body.names if name in used)

    sets = {
        "active gains": gains(delayed=True),
        "ankle gains": gains(delayed=True, rows=["ankle"]),
        "hip gains": gains(delayed=True, rows=["hip"]),
        "delays": body.delays,
        "passive stiffness": gains(delayed=False),
    }
    if body.weights:
        sets["weight and active gains"] = (*body.weights, *sets["active gains"])
    return {NOTHING: (), OTHER: (), **{name: (name,) for name in body.names}, **sets}


def smooth(mean: np.ndarray, f: np.ndarray, relative: float) -> np.ndarray:
    """Covariance (4 N, 4 N) of complex deviations with SD ``relative`` |mean| that change smoothly with frequency."""
    alike = np.exp(-0.5 * (np.subtract.outer(np.log2(f), np.log2(f)) / OCTAVES) ** 2)
    n, size = f.size, relative * np.abs(mean) / np.sqrt(2)
    C = np.zeros((4 * n, 4 * n))
    for block in range(4):
        at = slice(block * n, (block + 1) * n)
        C[at, at] = np.outer(size[block % 2], size[block % 2]) * alike
    return C


def inflation(sample: Sample, f: np.ndarray, rng: np.random.Generator) -> float:
    """Factor of the error of the difference at which relabelled groups do not speak for a difference.

    The likelihood ratio of a difference of the size `ELSE` to none has a mean of one over data without a difference if
    their error is right. Means of the groups are taken off first, and every difference has the size that it would have
    with the scatter of the observed groups.
    """
    centred = Sample(sample.a - sample.a.mean(axis=0), sample.b - sample.b.mean(axis=0), sample.paired)
    relabelled = centred.differences(centred.relabelled(rng, RELABELLINGS))
    size = np.sqrt((relabelled.variance / relabelled.scale).mean(axis=1))
    difference = relabelled.difference[1:] * (size[0] / size[1:])[:, None]
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
    """Mean and difference of two groups, with their errors, to be explained by a model.

    Unknowns of a hypothesis are the standard normal numbers of the mean parameters and, of every parameter, the change
    between the groups in units of its prior's SD, (2 P,); changes of parameters that do not differ stay zero.
    """

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
        """Unknowns (2 P,) of the best stable fit without a difference; raises `InputError` if none is found."""
        P = self.model.median.size
        candidates = stream(seed, "group_base").normal(0.0, START_SD, (CANDIDATES, P))
        starts = candidates[self.model.stable(candidates)][:STARTS]
        x, cost = self._minima(np.hstack([starts, np.zeros_like(starts)]), np.zeros(starts.shape), [0.0] * len(starts))
        stable = self.model.stable(x[:, :P])
        if not stable.any():
            raise InputError("groups: no stable model was found for their mean response")
        return np.asarray(x[np.where(stable, cost, np.inf).argmin()])

    def fits(self, hypotheses: Mapping[str, Sequence[str]], starts: np.ndarray) -> list[Fitted]:
        """All hypotheses, names and parts, from ``starts`` (2 P,) or one for each, (H, 2 P)."""
        H, P = len(hypotheses), self.model.median.size
        differs = np.array([[n in parts for n in self.model.model.names] for parts in hypotheses.values()], dtype=float)
        relative = [{NOTHING: 0.0, OTHER: ELSE}.get(name, DISCREPANCY) for name in hypotheses]
        x, cost = self._minima(np.broadcast_to(starts, (H, 2 * P)), differs, relative)
        ends = self._ends(x, differs)
        whiten = np.stack([self._whitener(r) for r in relative])
        J = self._slopes(x, differs, whiten)
        _, half = np.linalg.slogdet(np.swapaxes(J, 1, 2) @ J)
        size = np.log(np.einsum("hdd->hd", whiten)).sum(axis=1)
        stable = self.model.stable(ends.reshape(-1, P)).reshape(H, 2).all(axis=1)
        evidence = np.where(stable, -0.5 * cost - 0.5 * half + size, -np.inf)
        low, high = np.moveaxis(self.model.response(ends), 1, 0)
        theta = self.model.theta(ends)[0]
        out = []
        for k, (name, parts) in enumerate(hypotheses.items()):
            at = [self.model.model.names.index(part) for part in parts]
            a, b = theta[k][:, at]
            out.append(Fitted(name, tuple(parts), float(evidence[k]), high[k] - low[k], a, b, x[k]))
        return out

    @cached_property
    def _scale(self) -> np.ndarray:
        """SD of changes in standard normal numbers, (P,)."""
        of_unit = {"s": DELAY, "": WEIGHT}
        change = np.array([of_unit.get(p.unit, GAIN) for p in self.model.model.parameters])
        return np.asarray(change / self.model.sd)

    def _ends(self, x: np.ndarray, differs: np.ndarray) -> np.ndarray:
        """Numbers of both groups, half of the change each way, (H, 2, P) of unknowns (H, 2 P)."""
        P = self._scale.size
        half = 0.5 * self._scale * differs * x[:, P:]
        return np.stack([x[:, :P] - half, x[:, :P] + half], axis=1)

    def _minima(
        self, starts: np.ndarray, differs: np.ndarray, relative: Sequence[float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Unknowns (H, 2 P) and squared residuals (H,); a barrier keeps both groups stable."""
        whiten = np.stack([self._whitener(r) for r in relative])
        wide = np.full(starts.shape[1], np.inf)

        def residual(x: np.ndarray, at: np.ndarray) -> np.ndarray:
            return self._residuals(x, differs[at], whiten[at])

        def linearised(x: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return residual(x, at), self._slopes(x, differs[at], whiten[at])

        return minimised(residual, linearised, starts, -wide, wide, ITERATIONS)

    def _residuals(self, x: np.ndarray, differs: np.ndarray, whiten: np.ndarray) -> np.ndarray:
        """Of the mean, of the difference, of the prior, and of the instability of both groups, (H, 2 D + 2 P + 2)."""
        ends = self._ends(x, differs)
        low, high = np.moveaxis(self.model.response(ends), 1, 0)
        mean = ((low + high) / 2 - self.mean) @ self.of_mean.T
        apart = np.einsum("hde,he->hd", whiten, high - low - self.difference)
        falls = self.model.instability(ends.reshape(-1, ends.shape[-1])).reshape(-1, 2)
        return np.concatenate([mean, apart, x, falls], axis=1)

    def _slopes(self, x: np.ndarray, differs: np.ndarray, whiten: np.ndarray) -> np.ndarray:
        """Derivatives of `_residuals`, (H, 2 D + 2 P + 2, 2 P)."""
        ends, step = self._ends(x, differs), (0.5 * self._scale * differs)[:, None]
        low, high = np.moveaxis(self.model.slope(ends), 1, 0)
        mean = np.concatenate([(low + high) / 2, (high - low) / 2 * step], axis=2)
        apart = np.concatenate([high - low, (low + high) * step], axis=2)
        falls = self.model.instability_slope(ends.reshape(-1, ends.shape[-1])).reshape(ends.shape)
        sides = np.concatenate([falls, falls * step * np.array([-1.0, 1.0])[:, None]], axis=2)
        prior = np.broadcast_to(np.eye(x.shape[1]), (len(x), x.shape[1], x.shape[1]))
        return np.concatenate([self.of_mean @ mean, whiten @ apart, prior, sides], axis=1)


def posterior(
    fitted: Sequence[Fitted], nothing: float = PRIOR_NOTHING, other: float = PRIOR_OTHER, power: float = POWER
) -> np.ndarray:
    """Probabilities of fitted hypotheses, among them `NOTHING` and `OTHER`, whose prior probabilities are given."""
    named = [f for f in fitted if f.name not in (NOTHING, OTHER)]
    prior = {NOTHING: nothing, OTHER: other}
    each = (1 - nothing - other) / max(len(named), 1)
    log = np.array([power * f.log_evidence + np.log(prior.get(f.name, each)) for f in fitted])
    weight = np.exp(log - log.max())
    return np.asarray(weight / weight.sum())
