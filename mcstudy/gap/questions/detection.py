"""Detection of a gap: p-value, goodness of fit, and map of standardised residuals over frequency.

The test statistic is the Bayes factor of any deviation (every effect of the library, an unknown cause, an unstructured
residual) against none. The whole squared residual V has far less power against a single effect, because it has 4 N
degrees of freedom and the gap has one. V serves as goodness of fit and detects unstructured residuals. Null
distributions come from null samples that include the uncertainty of the estimated covariance
(`mcstudy.spectra.null_draws`), either through the linearised fit or with the model refitted to every sample.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from mcstudy.fitting.arguments import PenalisedFits
from mcstudy.fitting.penalised import Fitted, Fitter, whiten
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.free_deviations import slower
from mcstudy.gap.candidates.scores import Scores
from mcstudy.gap.candidates.unstructured_residual import UnstructuredResidual
from mcstudy.lines.part_fits import PartFit, part_fits
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf

LEVEL = 0.05
"""Significance level of the test for a gap."""

EDGES_HZ = (0.0, 0.1, 0.25, 0.5, 0.8, 1.2, 2.0, 3.0, 4.5, 6.5, np.inf)
"""Edges of the bands in which the residual map is summed."""

UNSTRUCTURED_SHARE = 0.05
"""Prior share of unstructured gaps."""

REFITS_A_TASK = 125
"""Null samples that one Dask task refits; so many that the overhead of a task is negligible."""


@dataclass(frozen=True)
class Band:
    """Mean squared standardised residual of one angle in one frequency band.

    Attributes
    ----------
    angle
        Name of the angle or output.
    low_hz, high_hz
        Limits of the band, Hz.
    level
        Mean squared residual; 1 is expected without a gap.
    limit
        Level that noise alone exceeds in any band in 1 of 20 recordings.
    """

    angle: str
    low_hz: float
    high_hz: float
    level: float
    limit: float

    @property
    def beyond(self) -> bool:
        """Whether the level exceeds the limit, which noise alone exceeds in any band in 1 of 20 recordings."""
        return self.level > self.limit


@dataclass(frozen=True)
class Detection:
    """Outcome of the tests.

    Attributes
    ----------
    p_value
        p-value of the test for a gap.
    statistic
        Its statistic: ln Bayes factor of any gap against none.
    chi2, expected_chi2, fit_p_value
        Squared whole residual, its mean without a gap, and its p-value.
    z
        (N, Y) complex, standardised residuals by line and angle, corrected for leverage: mean square 1 without a gap.
    z_limit
        Limit that the largest ``|z|`` exceeds in 1 of 20 recordings without a gap.
    bands
        Mean squared z by angle and band (`Band`).
    draws
        Number of null samples.
    null_statistic, null_chi2
        (draws,), null samples of the statistic and of the squared whole residual.
    unstructured
        The test for an unstructured residual, calibrated with the latter.
    parts
        Goodness of fit of each recording of a joint set (`PartFit`); of a single recording that of the whole.
    """

    p_value: float
    statistic: float
    chi2: float
    expected_chi2: float
    fit_p_value: float
    z: np.ndarray = field(repr=False)
    z_limit: float
    bands: tuple[Band, ...] = field(repr=False)
    draws: int
    null_statistic: np.ndarray = field(repr=False)
    null_chi2: np.ndarray = field(repr=False)
    unstructured: UnstructuredResidual = field(repr=False)
    parts: tuple[PartFit, ...] = ()

    @property
    def statistic_limit(self) -> float:
        """95 % of recordings with noise alone have a smaller statistic."""
        return float(np.quantile(self.null_statistic, 0.95))

    @property
    def chi2_noise(self) -> tuple[float, float]:
        """Range of the squared whole residual in 95 % of recordings with noise alone."""
        low, high = np.quantile(self.null_chi2, (0.025, 0.975))
        return float(low), float(high)


def as_complex(r: np.ndarray, lines: int) -> np.ndarray:
    """(2 N Y, n) real whitened vectors as (N, Y, n) complex, N ``lines``."""
    half = r.shape[0] // 2
    return (r[:half] + 1j * r[half:]).reshape(lines, half // lines, -1)


def linear_null(fitted: Fitted, data: Data, noise: np.ndarray) -> np.ndarray:
    """Residuals (4 N, n) of the linearised fit to noise (4 N, n)."""
    J = fitted.jacobian(data)
    return noise - J @ (fitted.covariance @ (J.T @ noise))


def refitted_null(fitted: Fitted, fitter: Fitter, data: Data, noise: np.ndarray) -> np.ndarray:
    """Residuals (4 N, n) of the model refitted to its own response plus every column of noise.

    The refits are Dask tasks on the threads of this process. The result of a fit does not depend on its task.
    """
    from dask import compute, delayed  # imported here because the fast diagnosis does not need Dask

    errors = np.einsum("nij,njk->kni", np.linalg.inv(data.weight), as_complex(noise, data.f.size))
    y = fitted.response(data.f) + errors
    packed = np.array([fitter.packed(data.with_y(x)) for x in y])

    def refits(some: np.ndarray) -> PenalisedFits:
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
    """All tests on one fit of the base model. ``refits``: refit the model to every null sample (slower)."""
    noise = lines.noise.draw(rng, draws)
    null = refitted_null(fitted, fitter, data, noise) if refits else linear_null(fitted, data, noise)
    residual = fitted.residual(data)
    # If a refit moves far, the curvature of the model leaves a residual along the parameters of this fit. It is no
    # deviation of interest, so the statistic projects it out of data and null samples alike.
    chi2 = float(residual @ residual)
    null_chi2 = (null**2).sum(axis=0)
    unstructured = UnstructuredResidual.of(null_chi2)
    statistic = float(_any(scores(residual, linear=refits).gap, unstructured.log_factor(np.array([chi2])))[0])
    nulls = _any(scores(null, linear=refits).gap, unstructured.log_factor(null_chi2))
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
        bands(lines.f, fitted.model, z[..., 0], null_z),
        draws,
        nulls,
        null_chi2,
        unstructured,
        part_fits(lines, residual, null),
    )


def _any(smooth: np.ndarray, unstructured: np.ndarray) -> np.ndarray:
    """ln Bayes factor of a gap of either kind, smooth or unstructured."""
    return np.asarray(np.logaddexp(np.log(1 - UNSTRUCTURED_SHARE) + smooth, np.log(UNSTRUCTURED_SHARE) + unstructured))


def standardised(fitted: Fitted, data: Data, r: np.ndarray) -> np.ndarray:
    """(N, Y, n): residuals by output, divided by their standard deviation after the fit."""
    colour = np.linalg.inv(data.weight)
    J = colour @ as_complex(fitted.jacobian(data), data.f.size)  # derivative of the FRFs, (N, Y, P)
    variance = 2 * np.einsum("nij,nij->ni", colour, colour.conj()).real
    taken = np.einsum("nip,pq,niq->ni", J, fitted.covariance, J.conj()).real
    left = np.maximum(variance - taken, 0.05 * variance)
    return np.einsum("nij,njk->nik", colour, as_complex(r, data.f.size)) / np.sqrt(left)[..., None]


def bands(f: np.ndarray, model: Model, z: np.ndarray, null: np.ndarray) -> tuple[Band, ...]:
    """Bands with a family-wise limit: noise alone exceeds it in any band in 5 % of recordings.

    ``model``: what was fitted. ``z``, ``null``: `standardised` residuals (N, Y) at lines ``f`` (N,) in Hz, and null
    samples of them (N, Y, D).
    """
    rows, level, ratio = [], [], []
    for low, high in pairwise(np.array(EDGES_HZ) / slower(model, f)):
        inside = (f >= low) & (f < high)
        if not inside.any():
            continue
        for k, angle in enumerate(model.output_names):
            expected = (np.abs(null[inside, k]) ** 2).mean(axis=0)
            rows.append((angle, float(f[inside].min()), float(f[inside].max()), expected))
            level.append(float((np.abs(z[inside, k]) ** 2).mean()))
            ratio.append((expected - expected.mean()) / expected.std())
    limit = float(np.quantile(np.max(ratio, axis=0), 0.95))
    return tuple(
        Band(angle, low, high, at, float(e.mean() + limit * e.std()))
        for (angle, low, high, e), at in zip(rows, level, strict=True)
    )
