"""How much a planned trial is expected to tell of the cause.

Before the trial causes have posterior probabilities p. Under every hypothesis the new responses are normal
(`mcstudy.gap.planned.predictions`), so the data of the trial come from a mixture of normal distributions, and its
expected information about the cause is the mutual information of cause and data (Lindley 1956; Box & Hill 1967). It has
no closed form for a mixture: responses are drawn from every hypothesis, and Bayes' rule is applied to each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from mcstudy.gap.planned.predictions import NOTHING, Belief, Predictions

DRAWS = 40
"""Drawn responses per hypothesis and trial."""

CREDIBLE = 0.95


@dataclass(frozen=True)
class Told:
    """What is expected after a trial.

    Attributes
    ----------
    bits
        Expected reduction of the entropy over the causes.
    entropy
        That entropy before the trial, bits.
    probability
        Expected posterior probability of the true cause.
    probability_if_missing
        The same if an effect is missing, or a cause outside the library; 1 where nothing else is possible.
    set_size
        Expected number of causes in the smallest set of 95 %.
    separated
        (K, K), for each two of the K possible causes, the chance that the data name the right one, by Bayes' rule with
        equal odds.
    """

    bits: float
    entropy: float
    probability: float
    probability_if_missing: float
    set_size: float
    separated: np.ndarray


def told(found: Predictions, belief: Belief, rng: np.random.Generator, draws: int = DRAWS) -> Told:
    """What a trial with these predictions is expected to tell."""
    R = found.mean.shape[1]
    p, member = belief.probability, belief.membership
    y = np.concatenate(
        [
            m + rng.standard_normal((draws, R)) + rng.standard_normal((draws, root.shape[1])) @ root.T
            for m, root in zip(found.mean, found.root, strict=True)
        ]
    )
    log = _log_densities(y, found)  # (H, H D)
    joint = log + np.log(p)[:, None]
    posterior = member.T @ np.exp(joint - logsumexp(joint, axis=0))  # (K, H D)
    weight = np.repeat(p / draws, draws)
    true = np.repeat(member, draws, axis=0)  # (H D, K)
    prior = member.T @ p
    right = (posterior.T * true).sum(axis=1)
    missing = np.repeat([float(c != NOTHING) for c in belief.causes], draws) * weight
    ordered = -np.sort(-posterior, axis=0)
    sizes = 1 + (np.cumsum(ordered, axis=0) < CREDIBLE).sum(axis=0)
    return Told(
        bits=_entropy(prior[:, None])[0] - float(weight @ _entropy(posterior)),
        entropy=float(_entropy(prior[:, None])[0]),
        probability=float(weight @ right),
        probability_if_missing=float(missing @ right / missing.sum()) if missing.any() else 1.0,
        set_size=float(weight @ sizes),
        separated=_separated(log, p, member),
    )


def _log_densities(y: np.ndarray, found: Predictions) -> np.ndarray:
    """ln of the density (H, D) that every hypothesis gives data ``y`` (D, R), up to a constant.

    With covariance 1 + root root^T; the products with the data are matrix products (Woodbury identity).
    """
    lower = [np.linalg.cholesky(np.eye(root.shape[1]) + root.T @ root) for root in found.root]
    across = [root @ np.linalg.inv(low).T for root, low in zip(found.root, lower, strict=True)]
    ends = np.cumsum([x.shape[1] for x in across])[:-1]
    parts = np.split(y @ np.concatenate(across, axis=1), ends, axis=1)  # one product for all hypotheses
    away = (y**2).sum(axis=1) - 2 * (found.mean @ y.T) + (found.mean**2).sum(axis=1)[:, None]
    for k, (m, x, part) in enumerate(zip(found.mean, across, parts, strict=True)):
        away[k] -= ((part - m @ x) ** 2).sum(axis=1)
    return -0.5 * away - np.array([np.log(np.diag(low)).sum() for low in lower])[:, None]


def _entropy(p: np.ndarray) -> np.ndarray:
    """Entropy over the first axis, bits."""
    return np.asarray(-(p * np.log2(np.maximum(p, 1e-300))).sum(axis=0))


def _separated(log: np.ndarray, p: np.ndarray, member: np.ndarray) -> np.ndarray:
    """See `Told.separated`."""
    share = p[:, None] * member / np.maximum(p @ member, 1e-300)  # of each hypothesis in its cause, (H, K)
    with np.errstate(divide="ignore"):
        of = logsumexp(log[:, None, :], axis=0, b=share[:, :, None])  # (K, H D)
    draws = log.shape[1] // len(log)
    true = np.repeat(share, draws, axis=0).T / draws  # (K, H D), weights of the draws of each cause
    K = member.shape[1]
    out = np.ones((K, K))
    for i in range(K):
        for j in range(i):
            right = of[i] > of[j]
            out[i, j] = out[j, i] = 0.5 * float(true[i] @ right + true[j] @ ~right)
    return out
