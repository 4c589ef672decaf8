"""How much a planned trial is expected to tell of the cause.

Before the trial causes have posterior probabilities p. Under every hypothesis the new responses are normal
(`mcstudy.gap.trial_planning.predictions`), so the data of the trial come from a mixture of normal distributions, and
its expected information about the cause is the mutual information of cause and data (Lindley 1956; Box & Hill 1967). It
has no closed form for a mixture: responses are drawn from every hypothesis, and Bayes' rule is applied to each.

The diagnosis of old and new data together is not quite Bayes' rule with the present probabilities as the prior. Its
prior of a size is as wide as the size that these data would show well (`mcstudy.gap.questions.evidence.log_prior`), and
a cause outside the library is expected to be as visible. More data make both priors narrower, so that what is not there
never becomes as improbable as fixed priors would make it: of nothing missing it stays about as sure as after the first
recording. Bits are those of Bayes' rule, by which trials are ranked; probabilities and the number of causes are those
that the diagnosis will state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from mcstudy.effect_library.effect import Size
from mcstudy.gap.candidates.scores import TYPICAL_DELTA, log_factor
from mcstudy.gap.trial_planning.predictions import NOTHING, UNKNOWN, Belief, Predictions

DRAWS = 40
"""Drawn responses per hypothesis and trial."""

CREDIBLE = 0.95

SHORT, SHORT_IF_MISSING = (0.16, 0.14), (0.16, 0.40)
"""Share by which the true cause had less probability than expected in simulated recordings of all kinds: where
something is certainly missing now, and where nothing is. Causes outside the library, which often look like an effect or
like nothing, make most of it. Fitted by `pipelines/validation/next_trial.py` to next_trial_shares.toml."""


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
        Expected posterior probability of the true cause, if it acts as one of the hypotheses.
    probability_if_missing
        The same if an effect is missing, or a cause outside the library; 1 where nothing else is possible.
    probability_low, probability_if_missing_low
        The same less what was missing in simulated recordings (`SHORT`), whose causes do not all act so.
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
    probability_low: float
    probability_if_missing_low: float
    set_size: float
    separated: np.ndarray


def told(predicted: Predictions, belief: Belief, rng: np.random.Generator, draws: int = DRAWS) -> Told:
    """What a trial with these predictions is expected to tell."""
    R = predicted.mean.shape[1]
    p, member = belief.probability, belief.membership
    y = np.concatenate(
        [
            m + rng.standard_normal((draws, R)) + rng.standard_normal((draws, root.shape[1])) @ root.T
            for m, root in zip(predicted.mean, predicted.root, strict=True)
        ]
    )
    log, renewal = _log_densities(y, predicted)  # (H, H D)
    joint = log + np.log(p)[:, None]
    coherent = member.T @ np.exp(joint - logsumexp(joint, axis=0))  # (K, H D)
    posterior = _stated(joint + renewal, belief)
    weight = np.repeat(p / draws, draws)
    true = np.repeat(member, draws, axis=0)  # (H D, K)
    prior = member.T @ p
    right = (posterior.T * true).sum(axis=1)
    missing = np.repeat([float(c != NOTHING) for c in belief.causes], draws) * weight
    expected = float(weight @ right)
    if_missing = float(missing @ right / missing.sum()) if missing.any() else 1.0
    nothing = float(sum(q for c, q in zip(belief.causes, p, strict=True) if c == NOTHING))
    ordered = -np.sort(-posterior, axis=0)
    sizes = 1 + (np.cumsum(ordered, axis=0) < CREDIBLE).sum(axis=0)
    return Told(
        bits=_entropy(prior[:, None])[0] - float(weight @ _entropy(coherent)),
        entropy=float(_entropy(prior[:, None])[0]),
        probability=expected,
        probability_if_missing=if_missing,
        probability_low=expected * _reached(SHORT, nothing),
        probability_if_missing_low=if_missing * _reached(SHORT_IF_MISSING, nothing),
        set_size=float(weight @ sizes),
        separated=_separated(log, p, member),
    )


def _reached(short: tuple[float, float], nothing: float) -> float:
    """Share of an expected probability that was reached, where nothing is missing with the probability ``nothing``."""
    return 1 - short[0] * (1 - nothing) - short[1] * nothing


def _stated(joint: np.ndarray, belief: Belief) -> np.ndarray:
    """Probabilities (K, D) that a diagnosis states, from ln joint densities (H, D) of hypotheses and data.

    A cause outside the library keeps the odds ``belief.beside`` to every hypothesis; the least probable that is left.
    """
    p = np.exp(joint - logsumexp(joint, axis=0))
    causes = belief.membership.T @ p
    left = belief.beside @ p
    if UNKNOWN in belief.named:
        k = belief.named.index(UNKNOWN)
        left = np.maximum(left - causes[k], 0.0)
        causes[k] += left
    return np.asarray(causes / (1 + left))


def _log_densities(y: np.ndarray, predicted: Predictions) -> tuple[np.ndarray, np.ndarray]:
    """ln of the density (H, D) that every hypothesis gives data ``y`` (D, R), up to a constant, and of its renewal.

    With covariance 1 + root root^T; the products with the data are matrix products (Woodbury identity). The renewal
    (H, D) is the change of the prior of its sizes, from that of the recorded data to that of these and ``y``.
    """
    lower = [np.linalg.cholesky(np.eye(root.shape[1]) + root.T @ root) for root in predicted.root]
    across = [root @ np.linalg.inv(low).T for root, low in zip(predicted.root, lower, strict=True)]
    ends = np.cumsum([x.shape[1] for x in across])[:-1]
    parts = np.split(y @ np.concatenate(across, axis=1), ends, axis=1)  # one product for all hypotheses
    away = (y**2).sum(axis=1) - 2 * (predicted.mean @ y.T) + (predicted.mean**2).sum(axis=1)[:, None]
    renewal = np.zeros_like(away)
    for k, (m, x, part, low) in enumerate(zip(predicted.mean, across, parts, lower, strict=True)):
        away[k] -= ((part - m @ x) ** 2).sum(axis=1)
        for s in predicted.sizes[k]:
            row = solve_triangular(low, np.pad(s.root, (0, len(low) - s.root.size)), lower=True)
            after = s.value + (part - m @ x) @ row
            renewal[k] += _log_mean_prior(s.size, after, np.sqrt(row @ row))
            renewal[k] -= _log_mean_prior(s.size, np.array(s.value), np.sqrt(s.root @ s.root))
    return -0.5 * away - np.array([np.log(np.diag(low)).sum() for low in lower])[:, None], renewal


def _log_mean_prior(size: Size, a: np.ndarray, se: float) -> np.ndarray:
    """ln of the mean of `mcstudy.gap.questions.evidence.log_prior` over a normal distribution of a size."""
    z = (a - (size.null or 0.0)) / se
    scales = max(size.published[1] / se, TYPICAL_DELTA), TYPICAL_DELTA
    both = np.logaddexp(*(log_factor(z, scale, not size.signed) for scale in scales))
    return np.asarray(both - 0.5 * z**2 - np.log(se))


def _entropy(p: np.ndarray) -> np.ndarray:
    """Entropy over the first axis, bits."""
    return np.asarray(-(p * np.log2(np.maximum(p, 1e-300))).sum(axis=0))


def _separated(log: np.ndarray, p: np.ndarray, member: np.ndarray) -> np.ndarray:
    """See `Told.separated`."""
    share = p[:, None] * member / np.maximum(p @ member, 1e-300)  # of each hypothesis in its cause, (H, K)
    with np.errstate(divide="ignore"):
        likelihood = logsumexp(log[:, None, :], axis=0, b=share[:, :, None])  # (K, H D)
    draws = log.shape[1] // len(log)
    true = np.repeat(share, draws, axis=0).T / draws  # (K, H D), weights of the draws of each cause
    K = member.shape[1]
    out = np.ones((K, K))
    for i in range(K):
        for j in range(i):
            right = likelihood[i] > likelihood[j]
            out[i, j] = out[j, i] = 0.5 * float(true[i] @ right + true[j] @ ~right)
    return out
