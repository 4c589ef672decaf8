"""The best any method can do on a case: the Bayes classifier in the linear Gaussian space of its lines.

It is told more than any real method: the covariance of the noise, the body's linear geometry, the direction of every
effect, the distribution of sizes the benchmark draws from, and that the case holds nothing or one effect. What it
sees is the projection z of the whitened data on every signature (`mcstudy.gap.challenge.geometry`), z ~ N(delta g, G)
with G the cosines between signatures and g its column of the true one. A signature of delta d has evidence
exp(d z - d^2 / 2) against nothing, averaged over the sizes drawn. Its figures bound, on average over cases, those of
every method that does not know the key. Derived.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from scipy import stats

from mcstudy.gap.challenge.design import Stratum

LEVEL = 0.05
"""Nominal rate of false alarms."""

SET = 0.95
"""Probability a credible set must hold."""

FLOOR = 1e-4
"""Probabilities below this count as this in the log loss, so that one confident error does not decide a mean."""


@dataclass(frozen=True)
class Ceiling:
    """Expected figures of the ideal method on one case.

    Attributes
    ----------
    known_direction: power at `LEVEL` of the test that knows the effect's direction.
    detected: power at `LEVEL` of the likelihood ratio averaged over every effect and size (the best on average).
    top: probability that the true group (or "none") is the most probable; probability: its mean probability.
    covered, set_size: of the smallest set that holds `SET`. log_loss, brier: proper scores.
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
    top = exponent.max(axis=-1)
    return np.asarray(top + np.log(np.exp(exponent - top[..., None]).sum(axis=-1)))


@dataclass(frozen=True)
class Classifier:
    """Bayes classifier between nothing and groups.

    Attributes
    ----------
    cosine: (m, m) between the signatures. group: (m,) index of each signature's group.
    prior: (g + 1,) probability of nothing, then of every group. share: (m,) of each signature in its group, sums to 1.
    delta, weight: sizes.
    """

    cosine: np.ndarray
    group: np.ndarray
    prior: np.ndarray
    share: np.ndarray
    delta: np.ndarray
    weight: np.ndarray

    def draws(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Projections of noise alone, (n, m)."""
        value, vector = np.linalg.eigh(self.cosine)
        root = vector * np.sqrt(np.maximum(value, 0.0))
        return np.asarray(rng.standard_normal((n, value.size)) @ root.T)

    def ratio(self, z: np.ndarray) -> np.ndarray:
        """Log evidence of every group against nothing, (n, m) -> (n, g)."""
        single = log_evidence(z, self.delta, self.weight) + np.log(self.share)
        return np.stack(
            [np.logaddexp.reduce(single[:, self.group == g], axis=1) for g in range(self.prior.size - 1)], axis=1
        )

    def ceiling(
        self, rng: np.random.Generator, column: int | None, delta: float, kin: Sequence[int] = (), n: int = 400
    ) -> Ceiling:
        """Expected figures when signature ``column`` has the given delta (nothing when None), from ``n`` draws.

        ``kin``: other groups that count as the true one, because an answer may name them together with it.
        """
        null = self.ratio(self.draws(rng, 4 * n))
        prior = np.log(self.prior[1:]) - np.log(self.prior[1:].sum())
        threshold = np.quantile(np.logaddexp.reduce(null + prior, axis=1), 1 - LEVEL)
        z, truth = self.draws(rng, n), 0
        if column is not None:
            z = z + delta * self.cosine[column]
            truth = 1 + int(self.group[column])
        ratio = self.ratio(z)
        detected = np.logaddexp.reduce(ratio + prior, axis=1) > threshold
        log_p = np.column_stack([np.zeros(n), ratio]) + np.log(self.prior)
        p = np.exp(log_p - np.logaddexp.reduce(log_p, axis=1)[:, None])
        others = [1 + g for g in kin if 1 + g != truth]
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
