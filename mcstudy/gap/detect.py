"""Is there a gap, and where in the lines: p-value, goodness of fit, map of standardised residuals.

The statistic of detection is the Bayes factor of any deviation - every effect of the library, the unknown, and what is
smooth in nothing - against none. V, the whole residual, has far less power against one effect (it spreads 4 N degrees
of freedom over a gap of one); it serves as goodness of fit, and for what is not smooth. Null distributions come from
draws with the estimated covariance's own uncertainty (`mcstudy.gap.draws`), either through the linearised fit or with
the model refitted to every draw.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from mcstudy.gap.fitting import Data, Fits, Fitted, Fitter, whiten
from mcstudy.gap.lines import Lines
from mcstudy.gap.rough import Rough
from mcstudy.gap.scores import Scores
from mcstudy.stance.response import frf

EDGES_HZ = (0.0, 0.1, 0.25, 0.5, 0.8, 1.2, 2.0, 3.0, 4.5, 6.5, np.inf)
"""Edges of the bands in which the residual map is summed."""

ROUGH = 0.05
"""Share of the gaps looked for that are smooth in nothing."""

REFITS_A_TASK = 125
"""Draws of the null that one Dask task refits; large enough that a task costs nothing beside them."""


@dataclass(frozen=True)
class Band:
    """One angle in one band: mean squared standardised residual, and whether it is beyond the family-wise 5 % limit."""

    angle: str
    low_hz: float
    high_hz: float
    level: float
    limit: float

    @property
    def beyond(self) -> bool:
        """Whether noise alone would not do this in any band, 19 times of 20."""
        return self.level > self.limit


@dataclass(frozen=True)
class Detection:
    """Outcome of the tests.

    Attributes
    ----------
    p_value: of the statistic of detection. statistic: ln Bayes factor of any gap against none.
    chi2, expected_chi2, fit_p_value: the whole residual, its mean under the null, and its p-value.
    z: (N, 2) standardised residuals, leverage removed, E|z|^2 = 1 under the null. z_limit: 95 % limit of max |z|.
    bands: sums of |z|^2. refits: whether the null was refitted draw by draw. draws: their number. null_chi2: (draws,)
    the whole residual under the null. rough: what that makes of larger ones.
    """

    p_value: float
    statistic: float
    chi2: float
    expected_chi2: float
    fit_p_value: float
    z: np.ndarray = field(repr=False)
    z_limit: float
    bands: tuple[Band, ...] = field(repr=False)
    refits: bool
    draws: int
    null_chi2: np.ndarray = field(repr=False)
    rough: Rough = field(repr=False)


def _complex(r: np.ndarray) -> np.ndarray:
    """(4 N, n) real whitened vectors as (N, 2, n) complex."""
    half = r.shape[0] // 2
    return (r[:half] + 1j * r[half:]).reshape(half // 2, 2, -1)


def linear_null(fitted: Fitted, data: Data, noise: np.ndarray) -> np.ndarray:
    """Residuals (4 N, n) of the linearised fit to noise (4 N, n)."""
    J = fitted.jacobian(data)
    return noise - J @ (fitted.covariance @ (J.T @ noise))


def refitted_null(fitted: Fitted, fitter: Fitter, data: Data, noise: np.ndarray) -> np.ndarray:
    """Residuals (4 N, n) of the model refitted to its own response plus every column of noise.

    The refits are Dask tasks on the threads of this process; a fit's bits do not depend on its task.
    """
    from dask import compute, delayed  # only here: the fast diagnosis does without

    errors = np.einsum("nij,njk->kni", np.linalg.inv(data.weight), _complex(noise))
    y = fitted.response(data.f) + errors
    packed = np.array([data.with_y(x).packed for x in y])

    def refits(some: np.ndarray) -> Fits:
        n = some.shape[0]
        return fitter.fits(some, np.tile(fitted.theta, (n, 1)), np.arange(n))

    tasks = [delayed(refits)(packed[i : i + REFITS_A_TASK]) for i in range(0, len(packed), REFITS_A_TASK)]
    estimate = np.concatenate([fits.estimate for fits in compute(*tasks, scheduler="threads")])
    r = y - frf(fitted.model, estimate, data.f)
    return whiten(data.weight, np.moveaxis(r, 0, -1))


def detect(
    fitted: Fitted,
    fitter: Fitter,
    data: Data,
    lines: Lines,
    scores: Scores,
    rng: np.random.Generator,
    draws: int,
    refits: bool,
) -> Detection:
    """All tests on one fit of the base model. ``refits``: refit the model to every draw (slower)."""
    noise = lines.noise.draw(rng, draws)
    null = refitted_null(fitted, fitter, data, noise) if refits else linear_null(fitted, data, noise)
    residual = fitted.residual(data)
    # A refit that went far leaves, through the curvature of the model, what the parameters could take at this fit:
    # a deviation nobody would look for. Both sides are judged without it.
    chi2 = float(residual @ residual)
    null_chi2 = (null**2).sum(axis=0)
    rough = Rough.of(null_chi2)
    statistic = float(_any(scores(residual, linear=refits).gap, rough.log_factor(np.array([chi2])))[0])
    nulls = _any(scores(null, linear=refits).gap, rough.log_factor(null_chi2))
    p_value = (1 + int((nulls >= statistic).sum())) / (1 + draws)
    z, null_z = standardised(fitted, data, residual[:, None]), standardised(fitted, data, null)
    return Detection(
        p_value,
        statistic,
        chi2,
        float(null_chi2.mean()),
        (1 + int((null_chi2 >= chi2).sum())) / (1 + draws),
        z[..., 0],
        float(np.quantile(np.abs(null_z).max(axis=(0, 1)), 0.95)),
        _bands(lines.f, fitted.model.angles, z[..., 0], null_z),
        refits,
        draws,
        null_chi2,
        rough,
    )


def _any(smooth: np.ndarray, rough: np.ndarray) -> np.ndarray:
    """ln Bayes factor of a gap of either kind."""
    return np.asarray(np.logaddexp(np.log(1 - ROUGH) + smooth, np.log(ROUGH) + rough))


def standardised(fitted: Fitted, data: Data, r: np.ndarray) -> np.ndarray:
    """(N, 2, n): residuals by angle over their standard deviation after the fit."""
    colour = np.linalg.inv(data.weight)
    J = colour @ _complex(fitted.jacobian(data))  # derivative of the FRFs, (N, 2, P)
    variance = 2 * np.einsum("nij,nij->ni", colour, colour.conj()).real
    taken = np.einsum("nip,pq,niq->ni", J, fitted.covariance, J.conj()).real
    left = np.maximum(variance - taken, 0.05 * variance)
    return np.einsum("nij,njk->nik", colour, _complex(r)) / np.sqrt(left)[..., None]


def _bands(f: np.ndarray, angles: tuple[str, str], z: np.ndarray, null: np.ndarray) -> tuple[Band, ...]:
    """Bands with a limit that noise passes in any of them 5 times of 100."""
    rows, level, ratio = [], [], []
    for low, high in pairwise(EDGES_HZ):
        inside = (f >= low) & (f < high)
        if not inside.any():
            continue
        for k, angle in enumerate(angles):
            expected = (np.abs(null[inside, k]) ** 2).mean(axis=0)
            rows.append((angle, float(f[inside][0]), float(f[inside][-1]), expected))
            level.append(float((np.abs(z[inside, k]) ** 2).mean()))
            ratio.append((expected - expected.mean()) / expected.std())
    limit = float(np.quantile(np.max(ratio, axis=0), 0.95))
    return tuple(
        Band(angle, low, high, at, float(e.mean() + limit * e.std()))
        for (angle, low, high, e), at in zip(rows, level, strict=True)
    )
