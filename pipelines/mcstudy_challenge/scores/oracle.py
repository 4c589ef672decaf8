"""Oracle bound of a case: the performance of the Bayes classifier in the linear Gaussian space of its lines.

The classifier knows more than any real method: the covariance of the noise, the linear geometry of the body, the
direction of every effect, the distribution of sizes in the benchmark, and that the case has no or one effect. It uses
the projection z of the whitened data on every signature (`mcstudy_challenge.bodies.geometry`), z ~ N(delta g, G), where
G holds the cosines between signatures and g is its column for the true one. A signature with delta d has the likelihood
ratio exp(d z - d^2 / 2) against no effect, averaged over the sizes drawn. On average over cases, no method that does
not know the key can be better. Derived.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np
from scipy import stats
from scipy.special import logsumexp

from mcstudy_challenge.design import Stratum

LEVEL = 0.05
"""Nominal rate of false alarms."""

SET = 0.95
"""Required probability of a credible set."""

FLOOR = 1e-4
"""Smallest probability used in the log loss, so that a single confident error does not dominate a mean."""


@dataclass(frozen=True)
class Ceiling:
    """Expected figures of the ideal method on one case.

    Attributes
    ----------
    known_direction: power at `LEVEL` of the test that knows the effect's direction.
    detected: power at `LEVEL` of the likelihood ratio averaged over every effect and size (the best on average).
    top: probability that the true group (or "none") is the most probable; probability: its mean probability.
    covered, set_size: for the smallest set with probability `SET`. log_loss, brier: proper scores.
    """

    known_direction: float
    detected: float
    top: float
    probability: float
    covered: float
    set_size: float
    log_loss: float
    brier: float

    @staticmethod
    def power(delta: float) -> float:
        """Power at `LEVEL` of the one-sided test that knows direction and covariance: the normal distribution."""
        return float(stats.norm.sf(stats.norm.isf(LEVEL) - delta))

    @staticmethod
    def omnibus(delta: float, dof: int) -> float:
        """Power at `LEVEL` of the chi-squared test that knows the covariance and ``dof`` dimensions, no direction."""
        return float(stats.ncx2.sf(stats.chi2.isf(LEVEL, dof), dof, max(delta, 1e-6) ** 2))

    def rounded(self) -> dict[str, float]:
        """As plain numbers for the key."""
        return {k: round(float(v), 4) for k, v in asdict(self).items()}


def size_grid(strata: Sequence[Stratum], points: int = 24) -> tuple[np.ndarray, np.ndarray]:
    """Deltas and their probabilities as the benchmark draws them."""
    delta = np.concatenate([np.linspace(s.low, s.high, points) for s in strata])
    weight = np.concatenate([np.full(points, s.share / points) for s in strata])
    return delta, weight


def log_evidence(z: np.ndarray, delta: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Logarithm of the mean of exp(d z - d^2 / 2) over sizes, for projections of any shape."""
    with np.errstate(divide="ignore"):
        exponent = z[..., None] * delta - delta**2 / 2 + np.log(weight)
    return np.asarray(logsumexp(exponent, axis=-1))


@dataclass(frozen=True)
class Classifier:
    """Bayes classifier between no effect and the groups of effects.

    Attributes
    ----------
    cosine: (m, m) between the signatures. group: (m,) index of each signature's group.
    prior: (g + 1,) probability of no effect, then of every group. share: (m,) weight of each signature in its group.
    delta, weight: sizes and their probabilities, (s,) for all signatures or (m, s).
    """

    cosine: np.ndarray
    group: np.ndarray
    prior: np.ndarray
    share: np.ndarray
    delta: np.ndarray
    weight: np.ndarray

    @cached_property
    def _root(self) -> np.ndarray:
        value, vector = np.linalg.eigh(self.cosine)
        return np.asarray(vector * np.sqrt(np.maximum(value, 0.0)))

    def draws(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Projections of pure noise, (n, m)."""
        return np.asarray(rng.standard_normal((n, self.group.size)) @ self._root.T)

    def ratio(self, z: np.ndarray) -> np.ndarray:
        """Log likelihood ratio of every group against no effect, (n, m) -> (n, g)."""
        single = log_evidence(z, self.delta, self.weight) + np.log(self.share)
        return np.stack(
            [np.logaddexp.reduce(single[:, self.group == g], axis=1) for g in range(self.prior.size - 1)], axis=1
        )

    def _statistic(self, ratio: np.ndarray) -> np.ndarray:
        """Log likelihood ratio of any effect against none, (n, g) -> (n,)."""
        prior = np.log(self.prior[1:]) - np.log(self.prior[1:].sum())
        return np.asarray(np.logaddexp.reduce(ratio + prior, axis=1))

    def threshold(self, rng: np.random.Generator, n: int) -> float:
        """Value that the statistic of a test at `LEVEL` exceeds, from ``n`` draws."""
        return float(np.quantile(self._statistic(self.ratio(self.draws(rng, n))), 1 - LEVEL))

    def ceiling(
        self,
        rng: np.random.Generator,
        column: int | None,
        delta: float,
        similar: Sequence[int] = (),
        n: int = 400,
        threshold: float | None = None,
    ) -> Ceiling:
        """Expected figures when signature ``column`` has the given delta (no effect when None), from ``n`` draws.

        ``similar``: similar groups that also count as the true one, because an answer may name them together with it.
        ``threshold``: of the test, if it is known already.
        """
        if threshold is None:
            threshold = self.threshold(rng, 4 * n)
        z, truth = self.draws(rng, n), 0
        if column is not None:
            z = z + delta * self.cosine[column]
            truth = 1 + int(self.group[column])
        ratio = self.ratio(z)
        detected = self._statistic(ratio) > threshold
        log_p = np.column_stack([np.zeros(n), ratio]) + np.log(self.prior)
        p = np.exp(log_p - np.logaddexp.reduce(log_p, axis=1)[:, None])
        others = [1 + g for g in similar if 1 + g != truth]
        p[:, truth] += p[:, others].sum(axis=1)
        p[:, others] = 0.0
        order = np.argsort(-p, axis=1)
        before = np.cumsum(np.take_along_axis(p, order, axis=1), axis=1)
        size = 1 + (before < SET).sum(axis=1)
        rank = np.argmax(order == truth, axis=1)
        own = p[:, truth]
        return Ceiling(
            known_direction=Ceiling.power(delta if column is not None else 0.0),
            detected=float(detected.mean()),
            top=float((rank == 0).mean()),
            probability=float(own.mean()),
            covered=float((rank < size).mean()),
            set_size=float(np.minimum(size, p.shape[1]).mean()),
            log_loss=float(-np.log(np.maximum(own, FLOOR)).mean()),
            brier=float(((p**2).sum(axis=1) - 2 * own + 1).mean()),
        )
