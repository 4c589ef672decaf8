"""Active gains that vary with amplitude or time: how far those of the model lie from a fit of all trials.

An effect that varies the gains says where they are those of the model (`Effect.unvaried`): at large amplitudes (a
threshold), at small ones (a saturation), or at the middle of amplitudes or times. Both sets of lines that a contrast
compares (`mcstudy.gap.questions.contrasts`) are fitted together, to first order, with shared parameters and a change of
each active gain of its own, because a threshold of rates changes other gains than one of angles. The change is
extrapolated as a power of the amplitude; whether it is the first or the second is not known.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mcstudy.effect_library.effect import Effect
from mcstudy.fitting.penalised import Fitted, whiten
from mcstudy.gap.questions.contrasts import Contrast
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import members
from mcstudy.stance.response import frf, frf_jacobian

POWERS = (1.0, 2.0)
"""Powers of the amplitude by which a change may grow or vanish."""

UNEVEN = 0.3
"""Standard deviation of where the middle of a change lies, relative to that between both sets."""

CHANGE = 0.3
"""Standard deviation of the prior on the relative change of a gain."""


def varied(
    effects: Sequence[Effect], contrasts: Sequence[Contrast], lines: Lines, fitted: Fitted, free: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Mean (P,) and covariance (P, P) of the parameters of the model minus those of a fit of all trials.

    None where no effect varies the gains. ``free``: (P,), parameters of the fit that no bound holds; the others stay.
    """
    for contrast in contrasts:
        own = next((e for e in effects for c in contrast.changes if c.effect == e.name), None)
        part = lines.parts[contrast.part]
        sets = part.halves() if contrast.kind == "time" else part.by_amplitude()
        if own is None or sets is None:
            continue
        first, second = (one if isinstance(one, Lines) else one[1] for one in (sets[0], sets[-1]))
        mean, covariance = _fitted(members(fitted.model)[contrast.part], fitted.theta, free, (first, second))
        at, spread = _reach(own, contrast)
        P = fitted.theta.size
        to = np.concatenate([np.eye(P), at * np.eye(P)], axis=1)
        change = mean[P:]
        extrapolated = spread**2 * (np.outer(change, change) + covariance[P:, P:])
        return to @ mean, to @ covariance @ to.T + extrapolated
    return None


def _fitted(
    model: Model, theta: np.ndarray, free: np.ndarray, sets: tuple[Lines, Lines]
) -> tuple[np.ndarray, np.ndarray]:
    """Mean (2 P,) and covariance of the shift of all parameters and of the change of each, from first to second set."""
    active = np.isin(model.names, [n for t in model.terms if t.noisy for n in t.gain[:1]]) & free
    kept = np.concatenate([free, active])
    precision = np.zeros((2 * theta.size, 2 * theta.size))
    precision[np.diag_indices(2 * theta.size)] = np.concatenate([np.zeros_like(theta), _weak(theta)])
    score = np.zeros(2 * theta.size)
    for half, lines in zip((-0.5, 0.5), sets, strict=True):
        weight = lines.noise.whitener
        J = whiten(weight, frf_jacobian(model, theta, lines.f)[1])
        J = np.concatenate([J, half * J], axis=1)
        precision += J.T @ J
        score += J.T @ whiten(weight, lines.y - frf(model, theta, lines.f))
    covariance = np.zeros_like(precision)
    covariance[np.ix_(kept, kept)] = np.linalg.pinv(precision[np.ix_(kept, kept)], hermitian=True)
    return covariance @ score, covariance


def _weak(theta: np.ndarray) -> np.ndarray:
    return np.asarray((CHANGE * np.maximum(np.abs(theta), 1e-9)) ** -2.0)


def _reach(own: Effect, contrast: Contrast) -> tuple[float, float]:
    """From the middle of both sets, in units of the change between them: mean and standard deviation."""
    where, (low, high) = own.unvaried, contrast.between
    if where == "middle":
        return 0.0, UNEVEN
    n = np.array(POWERS) * (-1.0 if where == "large" else 1.0)
    reach = -(low**n + high**n) / 2 / (high**n - low**n)
    return float(reach.mean()), float(np.ptp(reach) / 2)
