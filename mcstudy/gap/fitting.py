"""Fits of the diagnosis: maximum a posteriori, with weak priors on the body's parameters.

Units. With C = E[e e^H] the log likelihood of the lines is -sum r^H C^-1 r, so the deviance chi2 = 2 sum r^H C^-1 r
counts 4 N real degrees of freedom; every whitened vector here is real with unit variance.

Priors. Nothing is known about a new person beyond the order of magnitude of the parameters: a gain is its nominal
value (scaled to the body's weight) with a standard deviation of `GAIN_SPREAD` times it, a delay with
`DELAY_SPREAD_S`. The bounds are wider still (gains -1 to 4 times nominal, delays 5 to 250 ms): they are reached by
nobody and keep the statistics regular.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mcstudy.fit.lm import Plan
from mcstudy.gap import effects as library
from mcstudy.gap.lines import Lines
from mcstudy.gap.map_kernel import penalised_fits
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf, frf_jacobian

GAIN_SPREAD = 0.5
"""Prior standard deviation of a gain, relative to its nominal value."""

DELAY_SPREAD_S = 0.025
"""Prior standard deviation of a delay, s."""

TOLERANCE = 1e-4
"""Decrease of chi2 below which a fit has converged."""

ITERATIONS = 60


def opened(model: Model) -> Model:
    """The model with bounds so wide that nobody reaches them."""
    return model.with_bounds(
        {
            p.name: (min(0.005, p.value), max(0.25, p.value))
            if p.name in model.delays
            else (-abs(p.value), 4.0 * abs(p.value))
            for p in model.parameters
        }
    )


@dataclass(frozen=True)
class Prior:
    """Independent normal priors, (P,) each, cut at the bounds."""

    mean: np.ndarray
    scale: np.ndarray

    @classmethod
    def of(cls, model: Model, base: Model) -> Prior:
        """Weak priors on the parameters of ``base``; on what effects added, the whole range within the bounds.

        Published sizes enter the evidence (`mcstudy.gap.evidence`), not the fit: an estimate must not be pulled.
        """
        sizes = {s.name: s for e in library.LIBRARY.values() for s in e.sizes}
        mean, scale = [], []
        for p in model.parameters:
            if p.name in base.names:
                mean.append(p.value)
                scale.append(DELAY_SPREAD_S if p.name in base.delays else GAIN_SPREAD * abs(p.value))
            else:
                size = sizes[p.name]
                mean.append(size.prior[0])
                scale.append(size.prior[1] if size.companion else size.upper - size.lower)
        return cls(np.array(mean), np.array(scale))


def whiten(weight: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Whitened FRF residuals (N, 2) or derivatives (N, 2, K) as real numbers (4 N,) or (4 N, K)."""
    z = np.einsum("nij,nj...->ni...", weight, r)
    z = z.reshape(-1, *z.shape[2:])
    return np.concatenate([z.real, z.imag])


@dataclass(frozen=True)
class Data:
    """Lines in the form the fits read: f (N,), y (N, 2), weight (N, 2, 2) from `LineNoise.whitener`."""

    f: np.ndarray
    y: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, lines: Lines) -> Data:
        """From measured lines."""
        return cls(lines.f, lines.y, lines.noise.whitener)

    @property
    def packed(self) -> np.ndarray:
        """Data and weights in the kernel's order, (8 N,)."""
        y, W = self.y, self.weight
        data = [y[:, 0].real, y[:, 0].imag, y[:, 1].real, y[:, 1].imag]
        weight = [W[:, 0, 0].real, W[:, 1, 1].real, W[:, 1, 0].real, W[:, 1, 0].imag]
        return np.stack([*data, *weight], axis=1).ravel()

    def with_y(self, y: np.ndarray) -> Data:
        """The same lines with other responses."""
        return replace(self, y=y)


@dataclass(frozen=True)
class Fitted:
    """One penalised fit.

    Attributes
    ----------
    model: what was fitted. prior: its prior. theta: (P,) estimate. chi2: deviance of the data. penalty: of the prior.
    information: (P, P) J^T J of the whitened data at the estimate.
    """

    model: Model = field(repr=False)
    prior: Prior = field(repr=False)
    theta: np.ndarray
    chi2: float
    penalty: float
    information: np.ndarray = field(repr=False)

    @property
    def covariance(self) -> np.ndarray:
        """Posterior covariance of the parameters, (P, P)."""
        return np.linalg.inv(self.information + np.diag(self.prior.scale**-2))

    @property
    def log_evidence(self) -> float:
        """Laplace approximation of ln p(data), up to a constant of the data; parameters on a bound are not special."""
        curvature = self.information * np.outer(self.prior.scale, self.prior.scale) + np.eye(self.theta.size)
        return float(-0.5 * (self.chi2 + self.penalty) - 0.5 * np.linalg.slogdet(curvature)[1])

    def response(self, f: np.ndarray) -> np.ndarray:
        """FRFs (N, 2)."""
        return frf(self.model, self.theta, f)

    def residual(self, data: Data) -> np.ndarray:
        """Whitened residual y - model, (4 N,)."""
        return whiten(data.weight, data.y - self.response(data.f))

    def free_residual(self, data: Data) -> np.ndarray:
        """Residual (4 N,) of the linearised fit without bounds: `residual` itself unless a bound holds the fit.

        Its square never exceeds ``chi2 + penalty``, so evidence computed from it stays honest at a bound.
        """
        J = self.jacobian(data)
        r = self.residual(data)
        off = (self.theta - self.prior.mean) / self.prior.scale**2
        return r - J @ (self.covariance @ (J.T @ r - off))

    def jacobian(self, data: Data) -> np.ndarray:
        """Whitened derivative of the model, (4 N, P)."""
        return whiten(data.weight, frf_jacobian(self.model, self.theta, data.f)[1])


@dataclass(frozen=True)
class Fits:
    """S penalised fits: estimate (S, P), chi2 (S,), penalty (S,), information (S, P, P)."""

    estimate: np.ndarray
    chi2: np.ndarray
    penalty: np.ndarray
    information: np.ndarray

    @property
    def objective(self) -> np.ndarray:
        """What was minimised, (S,); inf where the model was not finite."""
        total = self.chi2 + self.penalty
        return np.where(np.isfinite(total), total, np.inf)


class Fitter:
    """Penalised fits of one model at fixed frequencies; prepared once, used for many data.

    Parameters
    ----------
    model: what is fitted. base: the model without effects, which says what parameters have weak priors. f: (N,) Hz.
    """

    def __init__(self, model: Model, base: Model, f: np.ndarray) -> None:
        self.model, self.prior = model, Prior.of(model, base)
        self._plan = Plan.of(model, f)
        self._tables = self._plan.tables()

    def fits(
        self,
        packed: np.ndarray,
        starts: np.ndarray,
        problem: np.ndarray | None = None,
        lower: np.ndarray | None = None,
        upper: np.ndarray | None = None,
        tolerance: float = TOLERANCE,
    ) -> Fits:
        """Fits from starts (S, P) of the problems (S,) among ``packed`` (R, 8 N); own bounds (S, P) if given."""
        starts = np.ascontiguousarray(np.atleast_2d(starts), dtype=float)
        S, P = starts.shape
        w, layout = self._plan.workspace()
        estimate, chi2, penalty = np.empty((S, P)), np.empty(S), np.empty(S)
        information = np.empty((S, P, P))
        model = self.model
        penalised_fits(
            w,
            layout,
            np.ascontiguousarray(np.atleast_2d(packed)),
            np.zeros(S, dtype=np.int64) if problem is None else np.asarray(problem, dtype=np.int64),
            starts,
            np.ascontiguousarray(np.broadcast_to(model.lower if lower is None else lower, (S, P))),
            np.ascontiguousarray(np.broadcast_to(model.upper if upper is None else upper, (S, P))),
            self.prior.mean,
            self.prior.scale,
            tolerance,
            ITERATIONS,
            estimate,
            chi2,
            penalty,
            information,
            *self._tables,
        )
        return Fits(estimate, chi2, penalty, information)

    def best(self, data: Data, starts: np.ndarray) -> Fitted:
        """The best of several starts on one data set."""
        return self.pick(self.fits(data.packed, starts))

    def pick(self, fits: Fits) -> Fitted:
        """The best of `Fits` of one problem."""
        k = int(np.argmin(fits.objective))
        return Fitted(
            self.model,
            self.prior,
            fits.estimate[k],
            float(fits.chi2[k]),
            float(fits.penalty[k]),
            fits.information[k],
        )
