"""Penalised fits: maximum a posteriori, with a normal prior on every parameter.

Units. With C = E[e e^H] the log likelihood of the lines is -sum r^H C^-1 r, so the deviance chi2 = 2 sum r^H C^-1 r
of Y outputs counts 2 Y N real degrees of freedom; every whitened vector here is real with unit variance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mcstudy.fitting.arguments import Bounds, Ends, Goal, PenalisedFits, Prior, Queue, Restraint, StopRules
from mcstudy.fitting.outermost_kernel import outermost
from mcstudy.fitting.penalised_kernel import penalised_fits
from mcstudy.fitting.plans import kept_plan, workspace
from mcstudy.fitting.problem import Data
from mcstudy.fitting.pseudo_data import packed
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf, frf_jacobian

TOLERANCE = 1e-4
"""Decrease of chi2 below which a fit has converged."""

ITERATIONS = 60

ENDED = 1e-9
"""Predicted change of the end of an interval, in half-widths, below which it is found."""


def whiten(weight: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Whitened FRF residuals (N, Y) or derivatives (N, Y, K) as real numbers (2 Y N,) or (2 Y N, K)."""
    z = np.einsum("nij,nj...->ni...", weight, r)
    z = z.reshape(-1, *z.shape[2:])
    return np.concatenate([z.real, z.imag])


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
        return np.linalg.inv(self.information + self.prior.weight * np.diag(self.prior.scale**-2))

    @property
    def log_evidence(self) -> float:
        """Laplace approximation of ln p(data), up to a constant of the data; parameters on a bound are not special."""
        curvature = self.information * np.outer(self.prior.scale, self.prior.scale) + np.eye(self.theta.size)
        return float(-0.5 * (self.chi2 + self.penalty) - 0.5 * np.linalg.slogdet(curvature)[1])

    def response(self, f: np.ndarray) -> np.ndarray:
        """FRFs (N, Y), kept for the next question at the same frequencies: nobody may write to them."""
        return self._kept("_response", f, lambda: self._responses(f))

    def _responses(self, f: np.ndarray) -> np.ndarray:
        return frf(self.model, self.theta, f)

    def residual(self, data: Data) -> np.ndarray:
        """Whitened residual y - model, (2 Y N,)."""
        return whiten(data.weight, data.y - self.response(data.f))

    def free_residual(self, data: Data) -> np.ndarray:
        """Residual (2 Y N,) of the linearised fit without bounds: `residual` itself unless a bound holds the fit.

        Its square never exceeds ``chi2 + penalty``, so evidence computed from it stays honest at a bound.
        """
        J = self.jacobian(data)
        r = self.residual(data)
        off = (self.theta - self.prior.mean) / self.prior.scale**2
        return r - J @ (self.covariance @ (J.T @ r - off))

    def jacobian(self, data: Data) -> np.ndarray:
        """Whitened derivative of the model, (2 Y N, P), kept for the next question about the same data, read-only."""
        return self._kept("_jacobian", data, lambda: self._derivative(data))

    def _derivative(self, data: Data) -> np.ndarray:
        return whiten(data.weight, frf_jacobian(self.model, self.theta, data.f)[1])

    def _kept(self, name: str, subject: object, compute: Callable[[], np.ndarray]) -> np.ndarray:
        """What was computed last under a name, if it was of the same object."""
        kept: tuple[object, np.ndarray] | None = self.__dict__.get(name)
        if kept is None or kept[0] is not subject:
            kept = (subject, compute())
            kept[1].flags.writeable = False
            self.__dict__[name] = kept  # as `cached_property` does
        return kept[1]

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in self.__dict__.items() if not name.startswith("_")}


class Fitter:
    """Penalised fits of one model at fixed frequencies; prepared once, used for many data.

    Parameters
    ----------
    model: what is fitted, inside its bounds. prior: of its parameters, (P,). f: frequencies, Hz, (N,).
    """

    def __init__(self, model: Model, prior: Prior, f: np.ndarray) -> None:
        self.model, self.prior = model, prior
        self._plan = kept_plan(model, np.asarray(f, dtype=float).tobytes())

    def packed(self, data: Data) -> np.ndarray:
        """Data at this object's frequencies in the order that fits read, see `mcstudy.fitting.arguments.pack`."""
        return packed(self.model, data.f, data.y, data.weight)

    def fits(
        self,
        packed: np.ndarray,
        starts: np.ndarray,
        problem: np.ndarray | None = None,
        lower: np.ndarray | None = None,
        upper: np.ndarray | None = None,
        tolerance: float = TOLERANCE,
        max_iterations: int = ITERATIONS,
        restraint: Restraint | None = None,
    ) -> PenalisedFits:
        """Fits from starts (S, P) of the problems (S,) among ``packed`` (K, ...); own bounds (S, P) if given."""
        starts = np.ascontiguousarray(np.atleast_2d(starts), dtype=float)
        shape, model = starts.shape, self.model
        queue = Queue(
            packed=np.ascontiguousarray(np.atleast_2d(packed)),
            problem=np.zeros(len(starts), dtype=np.int64) if problem is None else np.asarray(problem, dtype=np.int64),
            starts=starts,
        )
        # Copies: a view that cannot be written to is another type, for which all would be compiled once more.
        bounds = Bounds(
            *(
                np.array(np.broadcast_to(model_bound if given is None else given, shape), dtype=float, order="C")
                for model_bound, given in ((model.lower, lower), (model.upper, upper))
            )
        )
        out, rules = PenalisedFits.empty(*shape), StopRules(tolerance, max_iterations)
        held = Restraint.none(shape[1]) if restraint is None else restraint
        penalised_fits(self._plan, workspace(self._plan), queue, bounds, self.prior, held, rules, out)
        return out

    def ends(
        self,
        packed: np.ndarray,
        starts: np.ndarray,
        direction: np.ndarray,
        ceiling: np.ndarray,
        height: np.ndarray,
        problem: np.ndarray | None = None,
        tolerance: float = ENDED,
        max_iterations: int = 3 * ITERATIONS,
    ) -> Ends:
        """Ends of intervals: the largest ``direction`` (M, P) . x with a deviance of at most ``ceiling`` (M,).

        ``starts``: (M, P), of the problems (M,) among ``packed`` (K, ...). ``height``: (M,) of the ceiling above the
        lowest minimum.
        """
        starts = np.ascontiguousarray(starts, dtype=float)
        M, P = starts.shape
        queue = Queue(
            packed=np.ascontiguousarray(np.atleast_2d(packed)),
            problem=np.zeros(M, dtype=np.int64) if problem is None else np.asarray(problem, dtype=np.int64),
            starts=starts,
        )
        bounds = Bounds(np.array(self.model.lower, dtype=float), np.array(self.model.upper, dtype=float))
        goal = Goal(
            np.array(direction, dtype=float, order="C"),
            np.array(ceiling, dtype=float),
            np.array(height, dtype=float),
            np.array(self.prior.scale, dtype=float),
        )
        out = Ends.empty(M, P)
        if M:
            rules = StopRules(tolerance, max_iterations)
            outermost(self._plan, workspace(self._plan), queue, bounds, goal, rules, out)
        return out

    def best(self, data: Data, starts: np.ndarray) -> Fitted:
        """The best of several starts on one data set."""
        return self.pick(self.fits(self.packed(data), starts))

    def pick(self, fits: PenalisedFits, among: slice = slice(None)) -> Fitted:
        """The best of several fits of one problem, which are ``among`` all."""
        k = int(np.arange(len(fits.objective))[among][np.argmin(fits.objective[among])])
        return Fitted(
            self.model,
            self.prior,
            fits.estimate[k],
            float(fits.chi2[k]),
            float(fits.penalty[k]),
            fits.information[k],
        )
