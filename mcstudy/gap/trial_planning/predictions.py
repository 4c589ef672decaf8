"""What every hypothesis about the cause predicts for a trial that was not recorded.

A hypothesis is a fitted model with the posterior covariance of its parameters, given all that was recorded. To first
order its responses under another stimulus are normal: the mean follows from the fitted parameters, the covariance from
theirs. The recorded data therefore enter once, through the fits. A cause outside the library predicts the base model
and smooth torques (`mcstudy.gap.candidates.free_deviations`) as large as the gap that was found. Under a stimulus that
was recorded they are known as far as the recording shows them; under another one they are independent of these.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.effect_library.effect import Size
from mcstudy.effect_library.library import LIBRARY, apply
from mcstudy.fitting.penalised import Fitted, whiten
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.free_deviations import free_torques
from mcstudy.gap.questions.evidence import Hypothesis
from mcstudy.gap.trial_planning.trials import PlannedTrial, SwayNoise
from mcstudy.lines.priors import weak_prior
from mcstudy.spectra.line_noise import LineNoise
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import Body
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import under
from mcstudy.stance.response import frf_jacobian

UNKNOWN = ("outside the library",)
"""Cause of what no effect of the library describes."""

NOTHING = ("nothing",)
"""Cause of what the base model describes."""


def _owners() -> dict[str, str]:
    """Effect that adds each parameter."""
    return {s.name: e.name for e in LIBRARY.values() for s in e.sizes}


KNOWN_DOF = 1e9
"""Degrees of freedom of a noise covariance that is not estimated."""

JITTER = 1e-9
"""Added to the diagonal of matrices of correlations, which may be singular."""

LEAST_GAP = 4.0
"""Least squared gap that a cause outside the library is taken to leave."""

LEAST = 2e-3
"""Posterior probability from which a hypothesis is considered."""

MOST = 24
"""Most hypotheses that are considered."""

IDLE = 0.3
"""Bayes factor of a cause outside the library where none is there: it never gets smaller, because the diagnosis expects
one to be just visible in whatever was recorded. In simulated recordings (next_trial_shares.toml, both seeds) the median
was 0.24 where nothing is missing and 0.44 beside an effect."""


@dataclass(frozen=True)
class Belief:
    """Hypotheses that are still possible: their ``effects``, the ``causes`` that these mean, fits and probability (H,).

    ``variance``: of the coefficients of the torques with which a cause outside the library acts. ``beside``: (H,), odds
    of such a cause beside each hypothesis that stay after any data, if the hypothesis is true.
    """

    effects: tuple[tuple[str, ...], ...]
    causes: tuple[tuple[str, ...], ...]
    fits: tuple[Fitted, ...]
    probability: np.ndarray
    variance: float
    beside: np.ndarray

    @classmethod
    def of(
        cls,
        hypotheses: Sequence[tuple[Hypothesis, float]],
        unknown: float,
        base: Fitted,
        data: Data,
        prior: Mapping[str, float],
    ) -> Belief:
        """The most probable of all ``hypotheses``, and a cause outside the library, with their sum 1.

        ``prior``: see `mcstudy.gap.prior.prior`. Mislabelled recordings are left out, because a new trial
        would be labelled correctly.
        """
        considered = [
            (h.effects, cause_of(h.effects), h.fitted, p) for h, p in hypotheses if set(h.effects) <= set(LIBRARY)
        ]
        gap = base.chi2 + base.penalty - min(fit.chi2 + fit.penalty for _, _, fit, _ in considered)
        considered.append((UNKNOWN, UNKNOWN, base, unknown))
        considered = sorted((x for x in considered if x[3] >= LEAST), key=lambda x: -x[3])[:MOST]
        effects, causes, fits, chance = zip(*considered, strict=True)
        p = np.array(chance)
        odds = [_beside(c, prior) for c in causes]
        return cls(effects, causes, fits, p / p.sum(), _variance(base, data, max(gap, LEAST_GAP)), np.array(odds))

    @property
    def named(self) -> list[tuple[str, ...]]:
        """Distinct causes, the most probable first."""
        total: dict[tuple[str, ...], float] = {}
        for cause, p in zip(self.causes, self.probability, strict=True):
            total[cause] = total.get(cause, 0.0) + float(p)
        return sorted(total, key=lambda c: -total[c])

    @property
    def labels(self) -> list[str]:
        """Effects of the most probable hypothesis of every cause of `named`, in words."""
        first = [next(e for e, c in zip(self.effects, self.causes, strict=True) if c == cause) for cause in self.named]
        return [" and ".join(e) or "no missing effect" for e in first]

    @property
    def membership(self) -> np.ndarray:
        """(H, K), 1 where a hypothesis means a cause of `named`."""
        named = self.named
        return np.array([[float(c == n) for n in named] for c in self.causes])


def cause_of(effects: tuple[str, ...]) -> tuple[str, ...]:
    """The cause that effects mean; `NOTHING` for none of them."""
    return tuple(sorted(LIBRARY[n].cause for n in effects)) or NOTHING


def _beside(cause: tuple[str, ...], prior: Mapping[str, float]) -> float:
    """Odds of a cause outside the library beside this one, in data that hold none (see `IDLE`)."""
    if cause == NOTHING:
        return IDLE * prior["unknown"] / prior["none"]
    return IDLE * prior["beside"] / prior["single"] if cause != UNKNOWN else 0.0


@dataclass(frozen=True)
class KnownSize:
    """A size of an effect as it is known: ``value``, and (P,) ``root``, its row of the root of the covariance."""

    size: Size
    value: float
    root: np.ndarray


@dataclass(frozen=True)
class Predictions:
    """Whitened responses of a planned trial under H hypotheses, in R dimensions that hold all their differences.

    Attributes
    ----------
    mean: (H, R). root: H arrays (R, K): the covariance of a hypothesis, with noise, is 1 + root root^T.
    sizes: the sizes that every hypothesis estimates, now.
    """

    mean: np.ndarray
    root: tuple[np.ndarray, ...]
    sizes: tuple[tuple[KnownSize, ...], ...]


def predictions(plan: Sequence[PlannedTrial], noise: SwayNoise, now: Expected) -> Predictions:
    """The predictions of every hypothesis for planned trials, all of them together."""
    several = [now.under(trial, noise) for trial in plan]
    means = np.array([np.concatenate([part.mean[k] for part in several]) for k in range(len(several[0].mean))])
    shared = [np.concatenate([part.shared[k] for part in several]) for k in range(len(means))]
    roots = [
        np.concatenate([root, *_apart([part.alone[k] for part in several])], axis=1) for k, root in enumerate(shared)
    ]
    away = means - means[0]
    own_columns = np.cumsum([len(away), *(root.shape[1] for root in roots)])[:-1]
    mean, *placed = np.split(_coordinates(np.concatenate([away.T, *roots], axis=1)), own_columns, axis=1)
    return Predictions(mean.T, tuple(placed), tuple(several[0].sizes))


def _apart(columns: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Columns (M_k, K_k) of single trials as columns of all of them, (sum of M_k, K_k)."""
    ends = np.cumsum([0, *(len(c) for c in columns)])
    out = []
    for c, first in zip(columns, ends, strict=False):
        wide = np.zeros((int(ends[-1]), c.shape[1]))
        wide[first : first + len(c)] = c
        out.append(wide)
    return out


@dataclass(frozen=True)
class _Part:
    """Whitened predictions of one trial by every hypothesis: ``mean`` H arrays (M,), ``shared`` H arrays (M, P).

    ``shared`` is the root of the covariance that all trials have in common, that of the fitted parameters; ``alone`` H
    arrays (M, K) that of what is independent between trials: sensory weights that were not fitted, and the torques of a
    cause outside the library together with the parameters beside them.
    """

    mean: list[np.ndarray]
    shared: list[np.ndarray]
    alone: list[np.ndarray]
    sizes: list[tuple[KnownSize, ...]]


class Expected:
    """What every hypothesis expects under any stimulus; every trial, and the responses of a kind, are worked out once.

    Parameters
    ----------
    belief: the hypotheses. recorded: what was recorded.
    """

    def __init__(self, belief: Belief, recorded: Recorded) -> None:
        self.belief, self.recorded = belief, recorded
        self._known: dict[tuple[str, bytes], list[tuple[Fitted, np.ndarray, np.ndarray, np.ndarray]]] = {}
        self._parts: dict[tuple[PlannedTrial, SwayNoise], _Part] = {}

    def under(self, trial: PlannedTrial, noise: SwayNoise) -> _Part:
        """The predictions for one trial."""
        if (trial, noise) not in self._parts:
            self._parts[trial, noise] = self._part(trial, noise)
        return self._parts[trial, noise]

    def _part(self, trial: PlannedTrial, noise: SwayNoise) -> _Part:
        weight = LineNoise(C := trial.covariance(noise), np.full(len(C), KNOWN_DOF)).whitener
        mean, shared, alone = [], [], []
        sizes: list[tuple[KnownSize, ...]] = []
        for h, (fitted, covariance, H, J) in enumerate(self._responses(trial)):
            m = whiten(weight, H)
            if self.belief.causes[h] == UNKNOWN:
                seen = self.recorded.of(trial.kind)
                further, free = _unknown(fitted, covariance, Data(trial.f, H, weight), seen, self.belief.variance)
                m, common = m + further, free[:, :0]
                sizes.append(())
            else:
                spread = _root(covariance)
                root = whiten(weight, J) @ spread
                of_base = np.isin(fitted.model.names, self.belief.fits[h].model.names)
                common, free = root[:, of_base], root[:, ~of_base]
                sizes.append(_sizes(fitted, spread[:, of_base]))
            mean.append(m)
            shared.append(common)
            alone.append(free)
        return _Part(mean, shared, alone, sizes)

    def responses(self, trial: PlannedTrial) -> list[np.ndarray]:
        """The mean responses (N, 2) of every hypothesis, rad per unit of the stimulus."""
        return [H for _, _, H, _ in self._responses(trial)]

    def _responses(self, trial: PlannedTrial) -> list[tuple[Fitted, np.ndarray, np.ndarray, np.ndarray]]:
        """Fit, covariance (P, P), responses (N, 2) and derivatives (N, 2, P) by hypothesis."""
        key = trial.kind, trial.f.tobytes()
        if key not in self._known:
            base = under(self.recorded.base.model, trial.kind, self.recorded.body)
            moves = [moved(fitted, base) for fitted in self.belief.fits]
            self._known[key] = [(fitted, C, *frf_jacobian(fitted.model, fitted.theta, trial.f)) for fitted, C in moves]
        return self._known[key]


def _sizes(fitted: Fitted, root: np.ndarray) -> tuple[KnownSize, ...]:
    """The sizes of its effects, without shape parameters; ``root`` (P, K) of the covariance."""
    sizes = {s.name: s for e in LIBRARY.values() for s in e.sizes if not s.is_shape}
    return tuple(
        KnownSize(sizes[n], float(x), row)
        for n, x, row in zip(fitted.model.names, fitted.theta, root, strict=True)
        if n in sizes
    )


def _coordinates(columns: np.ndarray) -> np.ndarray:
    """Columns (M, K) as (K, K) in an orthonormal basis of their space: the root of their products."""
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    unit = columns / size
    gram = unit.T @ unit + JITTER * np.eye(len(size))
    return np.asarray(np.linalg.cholesky(gram).T * size)


@dataclass(frozen=True)
class Recorded:
    """What was recorded: the base fit to all ``lines``, of a person with this ``body``; ``kinds`` of their parts."""

    base: Fitted
    lines: Lines
    body: Body
    kinds: tuple[str, ...]

    def of(self, kind: str) -> Lines | None:
        """The lines under one stimulus (of its first recording), None if it was not recorded."""
        return self.lines.parts[self.kinds.index(kind)] if kind in self.kinds else None


def _torques(fitted: Fitted, data: Data) -> np.ndarray:
    """(4 N, K) smooth torques at both joints, of all lengths, together of unit variance."""
    both = [f.columns for f in free_torques(fitted, data) if f.locations == ("ankle", "hip")]
    return np.concatenate(both, axis=1) / np.sqrt(len(both))


def _variance(base: Fitted, data: Data, gap: float) -> float:
    """Variance of torques that leave on average a squared ``gap`` in ``data`` after the base model is fitted."""
    columns, Q = _torques(base, data), np.linalg.qr(base.jacobian(data))[0]
    return gap / float((columns**2).sum() - ((Q.T @ columns) ** 2).sum())


def _unknown(
    fitted: Fitted, covariance: np.ndarray, data: Data, seen: Lines | None, variance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Whitened change (4 N,) of the mean and root (4 N, K) of the covariance, for a cause outside the library.

    ``seen``: what was recorded under the same stimulus; errors of the parameters and torques are estimated from it
    together (normal, to first order).
    """
    if seen is None:
        torques = _torques(fitted, data) * np.sqrt(variance)
        return np.zeros(len(torques)), np.concatenate([fitted.jacobian(data) @ _root(covariance), torques], axis=1)
    f, n = np.concatenate([seen.f, data.f]), len(seen)
    both = Data(f, fitted.response(f), np.concatenate([seen.noise.whitener, data.weight]))
    X = np.concatenate([fitted.jacobian(both), _torques(fitted, both)], axis=1)
    first, second = (x.reshape(-1, X.shape[1]) for x in np.split(X.reshape(2, len(f), -1, X.shape[1]), [n], axis=1))
    residual = whiten(seen.noise.whitener, seen.y - fitted.response(seen.f))
    P = len(covariance)
    precision = np.zeros((X.shape[1], X.shape[1]))
    precision[:P, :P] = np.linalg.inv(covariance) - first[:, :P].T @ first[:, :P]  # priors, and other recordings
    precision[range(P, len(precision)), range(P, len(precision))] = 1 / variance
    posterior = np.linalg.inv(precision + first.T @ first)
    return second @ (posterior @ (first.T @ residual)), second @ _root(posterior)


def moved(fitted: Fitted, base: Model) -> tuple[Fitted, np.ndarray]:
    """A fit as the model with its effects on ``base``, the model under another stimulus, and its covariance (P, P).

    Parameters that the fit did not have (the sensory weight of a tilt) have their prior.
    """
    owner = _owners()
    sizes = [p.name for p in fitted.model.parameters if p.name in owner]
    model = apply(base, *dict.fromkeys(owner[n] for n in sizes))
    prior = weak_prior(model, base)
    theta, covariance = prior.mean.copy(), np.diag(prior.scale**2)
    there = [k for k, n in enumerate(model.names) if n in fitted.model.names]
    here = [fitted.model.names.index(model.names[k]) for k in there]
    theta[there] = fitted.theta[here]
    covariance[np.ix_(there, there)] = fitted.covariance[np.ix_(here, here)]
    P = theta.size
    return Fitted(model, prior, theta, fitted.chi2, fitted.penalty, np.zeros((P, P))), covariance


def _root(covariance: np.ndarray) -> np.ndarray:
    """R with R R^T the covariance, whose parameters have different units."""
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(scale, scale) + JITTER * np.eye(len(scale))
    return np.asarray(scale[:, None] * np.linalg.cholesky(correlation))
