"""Evidence of one hypothesis: base model plus named effects, refitted and integrated over the sizes.

For a single effect the size is profiled. At every size of a grid the other parameters are refitted (all sizes in
parallel lanes), and Laplace's approximation integrates over them. The profile times the prior of the size is summed,
which treats bounds, skewness and one-sided priors exactly. The evidence of two effects together uses Laplace's
approximation for all parameters.

Prior of a size: a mixture of two normal distributions with equal weight. One has the larger published size as standard
deviation, the other `TYPICAL_DELTA` standard errors, a size that is well visible in these data. All but `WRONG_SIGN` of
the probability is on the sign that occurs in people. The first standard deviation is at least the second, because a
hypothesis describes a visible effect: an effect that the recording cannot detect gains nothing from fitting as well as
no effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.effect_library import library
from mcstudy.effect_library.effect import Effect, Size
from mcstudy.fitting.penalised import Fitted, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.scores import TYPICAL_DELTA, WRONG_SIGN
from mcstudy.gap.candidates.signatures import Signature
from mcstudy.lines.priors import weak_prior

SPAN = 6.0
"""Half-width of the grid of sizes in standard errors."""

POINTS = 25

ON_BOUND = 1e-3
"""Distance from a bound, relative to the range between the bounds, that counts as on it."""

CERTAINLY = 1.96
"""Standard errors by which an estimate must exceed the largest size of a body."""


@dataclass(frozen=True)
class SizeEstimate:
    """Estimate of one parameter of an effect.

    Attributes
    ----------
    name, unit
        Name and unit of the parameter.
    estimate, se
        Posterior mean and standard deviation.
    low, high
        95 % limits.
    """

    name: str
    estimate: float
    se: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects that act together, with its evidence.

    Attributes
    ----------
    effects: names, empty for the base model. log_evidence: ln evidence up to a constant of the data. fitted: the best
        fit. sizes: estimates of all parameters that the effects add.
    """

    effects: tuple[str, ...]
    log_evidence: float
    fitted: Fitted
    sizes: tuple[SizeEstimate, ...] = ()


def log_prior(size: Size, a: np.ndarray, se: float) -> np.ndarray:
    """ln density of the prior of a size at values ``a``, for data that give the standard error ``se``."""
    null = 0.0 if size.null is None else size.null
    x = np.asarray(a, dtype=float) - null

    def normal(centre: float, sd: float) -> np.ndarray:
        return np.asarray(-0.5 * ((x - centre) / sd) ** 2 - np.log(sd * np.sqrt(2 * np.pi)))

    shows = TYPICAL_DELTA * se
    out = np.logaddexp(normal(0.0, max(size.published[1], shows)), normal(0.0, shows)) + np.log(0.5)
    if not size.signed:
        out = out + np.log(2) + np.where(x >= 0, np.log(1 - WRONG_SIGN), np.log(WRONG_SIGN))
    return np.asarray(out)


def starts_for(
    base: Fitted, minima: np.ndarray, found: Sequence[Signature], residual: np.ndarray, name: str
) -> np.ndarray:
    """Start values (S, P) of a model with one effect, from its signatures at several sizes and its published sizes."""
    e = library.library_of(base.model)[name]
    rows = []
    for s in found:
        score = float(s.vector @ residual) / max(s.delta, 1e-9) ** 2
        for factor in (score, 0.4 * score, 2.5 * score):
            x = factor * s.sizes[e.size.name]
            theta = base.theta - s.shift * np.clip(factor, -4, 4)
            rows.append([*theta, *(x if k is e.size else s.sizes[k.name] for k in e.sizes)])
    middle = [sum(k.published) / 2 for k in e.sizes]
    for theta in (*minima, base.prior.mean):
        for factor in (1.0, 0.3) if not e.size.signed else (1.0, -1.0):
            rows.append([*theta, factor * middle[0], *middle[1:]])
    return np.array(rows)


def single(
    base: Fitted, minima: np.ndarray, data: Data, name: str, found: Sequence[Signature], residual: np.ndarray
) -> Hypothesis:
    """The hypothesis that one effect acts.

    Fits start from its signatures at the base fit with that fit's residual, and from its published sizes on the lowest
    ``minima`` (K, P) of the base model.
    """
    e = library.library_of(base.model)[name]
    model = library.apply(base.model, name)
    fitter = Fitter(model, weak_prior(model, base.model), data.f)
    starts = np.clip(starts_for(base, minima, found, residual, name), fitter.model.lower, fitter.model.upper)
    return profiled(fitter, data, e, fitter.pick(fitter.fits(fitter.packed(data), starts)), base.theta.size)


def profiled(fitter: Fitter, data: Data, e: Effect, mode: Fitted, P: int) -> Hypothesis:
    """The hypothesis that one effect acts, from its best fit, whose parameter ``P`` is the size of the effect."""
    covariance = mode.covariance
    se = float(np.sqrt(covariance[P, P]))
    grid = mode.theta[P] + se * np.linspace(-SPAN, SPAN, POINTS)
    grid = np.unique(np.clip(grid, e.size.lower, e.size.upper))
    if grid.size < 3:
        grid = np.linspace(e.size.lower, e.size.upper, 5)
    x = mode.theta + np.outer(grid - mode.theta[P], covariance[:, P] / covariance[P, P])
    x[:, P] = grid
    lower, upper = np.tile(fitter.model.lower, (grid.size, 1)), np.tile(fitter.model.upper, (grid.size, 1))
    lower[:, P] = upper[:, P] = grid
    fits = fitter.fits(fitter.packed(data), np.clip(x, lower, upper), lower=lower, upper=upper)
    prior = fitter.prior
    others = np.delete(np.arange(mode.theta.size), P)
    scale = prior.scale[others]
    penalty = fits.penalty - ((grid - prior.mean[P]) / prior.scale[P]) ** 2
    curvature = fits.information[:, others[:, None], others] * np.outer(scale, scale) + np.eye(others.size)
    log_p = -0.5 * (fits.chi2 + penalty) - 0.5 * np.linalg.slogdet(curvature)[1]
    log_p = np.where(np.isfinite(log_p), log_p, -np.inf) + log_prior(e.size, grid, se)
    width = np.gradient(grid)
    width[[0, -1]] /= 2
    log_p = log_p + np.log(width)
    log_evidence = float(np.logaddexp.reduce(log_p))
    weight = np.exp(log_p - log_evidence)
    sizes = [_summary(e.size, grid, weight)]
    for k, p in enumerate(mode.model.parameters[P + 1 :], start=P + 1):  # shape parameters and open constants
        sd = float(np.sqrt(covariance[k, k]))
        at = float(mode.theta[k])
        sizes.append(SizeEstimate(p.name, at, sd, at - 1.96 * sd, at + 1.96 * sd, p.unit))
    best = int(np.argmin(np.where(np.isfinite(fits.chi2), fits.chi2 + penalty, np.inf)))
    if fits.chi2[best] + penalty[best] < mode.chi2 + mode.penalty - 1.0:
        mode = fitter.best(data, fits.estimate[best])
    return Hypothesis((e.name,), log_evidence, mode, tuple(sizes))


def _summary(size: Size, grid: np.ndarray, weight: np.ndarray) -> SizeEstimate:
    mean = float(weight @ grid)
    sd = float(np.sqrt(weight @ (grid - mean) ** 2))
    share = np.cumsum(weight) - weight / 2
    low, high = np.interp((0.025, 0.975), share, grid)
    return SizeEstimate(size.name, mean, sd, float(low), float(high), size.unit)


def together(base: Fitted, data: Data, names: tuple[str, str], starts: np.ndarray) -> Hypothesis:
    """The hypothesis that two effects act together, from starts (S, P) in the order of ``apply(base, *names)``."""
    model = library.apply(base.model, *names)
    fitter = Fitter(model, weak_prior(model, base.model), data.f)
    fits = fitter.fits(fitter.packed(data), np.clip(starts, fitter.model.lower, fitter.model.upper))
    mode = fitter.pick(fits)
    known = library.library_of(base.model)
    sizes = {s.name: s for n in names for s in known[n].sizes}
    covariance = mode.covariance
    prior, log_p, estimates = mode.prior, -0.5 * mode.chi2, []
    scale = prior.scale.copy()
    for k, name in enumerate(mode.model.names):
        size = sizes.get(name)
        if size is None or size.is_shape:
            log_p -= 0.5 * ((mode.theta[k] - prior.mean[k]) / prior.scale[k]) ** 2
        else:
            se = float(np.sqrt(covariance[k, k]))
            log_p += float(log_prior(size, mode.theta[k], se)) + 0.5 * np.log(2 * np.pi) + np.log(scale[k])
        if size is not None:
            at, se = float(mode.theta[k]), float(np.sqrt(covariance[k, k]))
            estimates.append(SizeEstimate(name, at, se, at - 1.96 * se, at + 1.96 * se, size.unit))
    curvature = mode.information * np.outer(scale, scale) + np.eye(scale.size)
    log_p -= 0.5 * float(np.linalg.slogdet(curvature)[1])
    return Hypothesis(tuple(names), float(log_p), mode, tuple(estimates))


def possible(hypothesis: Hypothesis, base: Fitted) -> bool:
    """Whether a body can have the sizes of the effects; ``base``: the fit without effects.

    A size on a bound of the fit is where the search ended, not an estimate: the effect would explain the data only with
    a size that was excluded. Bounds are two or more times the usual sizes. A bound at the null of an effect is
    different: there the effect vanishes. The largest size of a body (`Size.most`) is stated with its source in the
    library.
    """
    fitted = hypothesis.fitted
    sizes = library.library_of(base.model).sizes
    for p, x in zip(fitted.model.parameters, fitted.theta, strict=True):
        if p.name in base.model.names or p.name not in sizes:
            continue
        margin = ON_BOUND * (p.upper - p.lower)
        if any(abs(x - b) <= margin and b != sizes[p.name].null for b in (p.lower, p.upper)):
            return False
    for estimate in hypothesis.sizes:
        most = sizes[estimate.name].most if estimate.name in sizes else None
        if most is not None and abs(estimate.estimate) - CERTAINLY * estimate.se > most:
            return False
    return True
