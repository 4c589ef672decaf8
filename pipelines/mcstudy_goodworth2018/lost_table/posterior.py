"""The posterior of the unknowns given rows: a synthetic likelihood, and particles that follow it.

The likelihood of printed numbers is a multivariate t, with the emulator's error model plus rounding; that of a
statement that a row is above zero is the probability of it. Particles are moved from the prior to the posterior through
powers of the likelihood (sequential Monte Carlo: Del Moral, Doucet & Jasra 2006), by differences of other particles
(ter Braak 2006).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr, logsumexp

from mcstudy_goodworth2018.lost_table.bank import prior_points
from mcstudy_goodworth2018.lost_table.emulator import Emulator
from mcstudy_goodworth2018.lost_table.rows import ROWS, rounding
from mcstudy_goodworth2018.lost_table.simulate import damped

SHRINK = 0.1
"""Share of the diagonal in the error covariance: correlations of some hundred studies are not exact."""

INFLATE = 2.0
"""Factor on the emulator's error variance. Its error differs between configurations, which one covariance does not
say: with factor 1 the 90 % intervals of 24 simulated papers contained 84 +- 2 % of their true values."""

TAILS = 5.0
"""Degrees of freedom of the likelihood's t distribution: the error of the emulator differs between configurations."""

MOVES, THOROUGH = 8, 24
"""Proposals per particle at every power of the likelihood: where the next studies are sought, and for what is reported.

With 8 the points of a posterior are still too close together: their standard deviation is 8 % below that with 24."""

LAST = 6
"""Times as many at the last power, or at each power that is reported."""

REMAIN = 0.5
"""Effective share of the particles that is left by each step of the power."""

CROSSOVER = (0.1, 0.3, 0.6)
"""Shares of the unknowns that a proposal changes."""

FLIP = 0.1
"""Chance that a proposal draws a choice anew."""


@dataclass(frozen=True)
class Likelihood:
    """Log likelihood of observed rows at points of the cube.

    Attributes
    ----------
    emulator: predicts rows. observed: (R,) columns; the sign alone counts for a ranking.
    equal, above: columns used as numbers and as signs. root: Cholesky factor of the covariance of ``equal``.
    """

    emulator: Emulator
    observed: np.ndarray
    equal: np.ndarray
    above: np.ndarray
    root: np.ndarray

    @classmethod
    def of(cls, emulator: Emulator, observed: np.ndarray, leave_out: tuple[str, ...] = ()) -> Likelihood:
        """The likelihood of ``observed`` (R,), without the rows ``leave_out``."""
        used = [(k, row.kind) for k, row in enumerate(ROWS) if row.key not in leave_out and row.kind != "told"]
        equal = np.array([k for k, kind in used if kind == "equal"], dtype=int)
        above = np.array([k for k, kind in used if kind == "above"], dtype=int)
        c = emulator.covariance[np.ix_(equal, equal)]
        c = (1 - SHRINK) * c + SHRINK * np.diag(np.diag(c))
        c = INFLATE * c + np.diag(rounding()[equal] ** 2)
        return cls(emulator, observed, equal, above, np.linalg.cholesky(c))

    def __call__(self, u: np.ndarray) -> np.ndarray:
        """Log likelihood (N,) at ``u`` (N, U)."""
        return self.at(self.emulator.rows(u))

    def at(self, rows: np.ndarray) -> np.ndarray:
        """Log likelihood (N,) when the expected rows are ``rows`` (N, R)."""
        off = (rows[:, self.equal] - self.observed[self.equal]).T
        white = solve_triangular(self.root, off, lower=True) if self.equal.size else off
        sign = np.where(self.observed[self.above] >= 0, 1.0, -1.0)
        error = np.sqrt(INFLATE * np.diag(self.emulator.covariance)[self.above])
        told = log_ndtr(sign * rows[:, self.above] / error).sum(axis=1)
        tails = -0.5 * (TAILS + self.equal.size) * np.log1p((white**2).sum(axis=0) / TAILS)
        return np.asarray(tails + told)


@dataclass(frozen=True)
class Posterior:
    """Equally weighted points ``u`` (N, U) of a posterior, their log likelihoods (N,), and the log evidence."""

    u: np.ndarray
    log_likelihood: np.ndarray
    log_evidence: float


def sample(
    likelihood: Likelihood,
    rng: np.random.Generator,
    particles: int,
    power: float = 1.0,
    start: np.ndarray | None = None,
) -> Posterior:
    """Points of the posterior under the likelihood to the power ``power``; see `tempered`."""
    return next(tempered(likelihood, rng, particles, (power,), start))


def tempered(
    likelihood: Likelihood,
    rng: np.random.Generator,
    particles: int,
    powers: Sequence[float],
    start: np.ndarray | None = None,
    moves: int = MOVES,
) -> Iterator[Posterior]:
    """Points of the posterior under the likelihood to each of the increasing ``powers``.

    ``start``: points of the prior to begin with; drawn when None. ``moves``: proposals per particle.
    """
    prior = likelihood.emulator.prior
    u = prior_points(prior, rng, particles) if start is None else start[:particles].copy()
    value = likelihood(u)
    choice = np.array([bool(x.choices) for x in prior.unknowns])
    at, evidence = 0.0, 0.0
    for power in powers:
        while at < power:
            step = _step(value, power - at)
            weight = step * value
            evidence += float(logsumexp(weight) - np.log(len(u)))
            at += step
            picked = _resampled(np.exp(weight - logsumexp(weight)), rng)
            u, value = u[picked], value[picked]
            for _ in range(moves if at < power else LAST * moves):
                u, value = _moved(likelihood, u, value, at, choice, rng)
        yield Posterior(u, value, evidence)


def _step(value: np.ndarray, rest: float) -> float:
    """Largest increase of the power that leaves `REMAIN` of the particles effective."""

    def effective(step: float) -> float:
        w = step * value
        return float(np.exp(2 * logsumexp(w) - logsumexp(2 * w)) / len(value))

    if effective(rest) >= REMAIN:
        return rest
    low, high = 0.0, rest
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if effective(middle) >= REMAIN else (low, middle)
    return max(low, 1e-6 * rest)


def _resampled(weight: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Systematic resampling."""
    n = len(weight)
    at = np.cumsum(weight)
    return np.minimum(np.searchsorted(at / at[-1], (np.arange(n) + rng.random()) / n), n - 1)


def _moved(
    likelihood: Likelihood,
    u: np.ndarray,
    value: np.ndarray,
    power: float,
    choice: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Every particle after one Metropolis proposal."""
    n, dims = u.shape
    first, second = (rng.integers(n, size=n) for _ in range(2))
    # in some directions at a time (crossover of ter Braak 2006), or few proposals of so many unknowns are accepted
    moves = rng.random((n, dims)) < rng.choice(CROSSOVER, size=(n, 1))
    size = 2.38 / np.sqrt(2 * np.maximum(moves[:, ~choice].sum(axis=1, keepdims=True), 1))
    jump = size * (u[first] - u[second]) + 0.02 * rng.standard_normal((n, dims))
    proposal = u + np.where(moves, jump, 0.0)
    flip = rng.random((n, dims)) < FLIP
    proposal[:, choice] = np.where(flip[:, choice], rng.random((n, int(choice.sum()))), u[:, choice])
    inside = ((proposal > 0) & (proposal < 1)).all(axis=1)
    draw = np.log(rng.random(n))
    new = np.full(n, -np.inf)
    if inside.any():
        new[inside] = likelihood(proposal[inside])
    taken = np.flatnonzero(power * (new - value) > draw)
    taken = taken[damped(likelihood.emulator.prior.values(proposal[taken]))]
    u, value = u.copy(), value.copy()
    u[taken], value[taken] = proposal[taken], new[taken]
    return u, value
