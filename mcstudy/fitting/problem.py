"""What is fitted: a model, FRF data, and weights that make the cost.

Both costs are one half-quadratic form: with Y outputs and W_n a Y x Y complex lower-triangular weight at frequency n,

    cost(theta) = sum_n || W_n (H(f_n; theta) - y_n) ||^2

- `paper_cost`: W = diag(1/|y_k|) / sqrt(Y N), so cost is the paper's J (Goodworth & Peterka 2018, Methods).
- `ml_cost`: W^H W = C^-1 with C the complex noise covariance of the FRFs, so cost is V = sum r^H C^-1 r.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Self

import numpy as np

from mcstudy.fitting.arguments import Queue
from mcstudy.fitting.pseudo_data import packed
from mcstudy.fitting.status import Status
from mcstudy.stance.feedback import Model, Parameter, Term
from mcstudy.stance.response import frf, frf_jacobian

if TYPE_CHECKING:
    from mcstudy.spectra.lines import Lines


@dataclass(frozen=True)
class Data:
    """Measured FRFs in the form that fits read.

    Attributes
    ----------
    f: frequencies, Hz, (N,).
    y: FRFs of the Y outputs, in their units per unit of stimulus, (N, Y) complex.
    weight: W_n, (N, Y, Y) complex, lower triangular with real diagonal.
    """

    f: np.ndarray
    y: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, lines: Lines) -> Data:
        """Measured lines, with `LineNoise.whitener` as their weights."""
        return Data(lines.f, lines.y, lines.noise.whitener)

    @property
    def finite(self) -> bool:
        """Whether data and weights can be fitted at all."""
        return bool(np.isfinite(self.y).all() and np.isfinite(self.weight).all())

    def with_y(self, y: np.ndarray) -> Self:
        """The same with other responses."""
        return replace(self, y=y)

    def head(self, n: int) -> Self:
        """The same on the first ``n`` frequencies (weights unchanged)."""
        return replace(self, f=self.f[:n], y=self.y[:n], weight=self.weight[:n])


@dataclass(frozen=True)
class Problem(Data):
    """One least-squares problem: data, and the model that is fitted, whose bounds are those of the fit."""

    model: Model

    @property
    def packed(self) -> np.ndarray:
        """Data and weights in the kernel's order, see `mcstudy.fitting.arguments.pack`."""
        return packed(self.model, self.f, self.y, self.weight)

    def residual(self, theta: np.ndarray) -> np.ndarray:
        """Weighted residuals as a real vector (2 Y N,), whose squared norm is the cost."""
        return _real(np.einsum("nij,nj->ni", self.weight, frf(self.model, theta, self.f) - self.y))

    def jacobian(self, theta: np.ndarray) -> np.ndarray:
        """Exact derivative of `residual`, (2 Y N, P)."""
        _, dH = frf_jacobian(self.model, theta, self.f)
        weighted = np.einsum("nij,njp->nip", self.weight, dH)
        return np.concatenate([weighted.real.reshape(-1, dH.shape[-1]), weighted.imag.reshape(-1, dH.shape[-1])])

    def cost(self, theta: np.ndarray) -> float:
        """The cost at one parameter vector."""
        r = self.residual(theta)
        return float(r @ r)


def _real(z: np.ndarray) -> np.ndarray:
    return np.concatenate([z.real.ravel(), z.imag.ravel()])


def paper_cost(model: Model, f: np.ndarray, data: np.ndarray) -> Problem:
    """The paper's J: mean squared error relative to the data's own magnitude, over the model's Y outputs."""
    data = np.asarray(data, dtype=complex)
    Y = model.n_outputs
    weight = np.zeros((*data.shape, Y), dtype=complex)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k in range(Y):
            weight[:, k, k] = 1.0 / (np.abs(data[:, k]) * np.sqrt(Y * data.shape[0]))
    return Problem(np.asarray(f, dtype=float), data, weight, model)


def ml_cost(model: Model, f: np.ndarray, data: np.ndarray, covariance: np.ndarray) -> Problem:
    """Maximum likelihood: V = sum r^H C^-1 r, with ``covariance`` (N, Y, Y) Hermitian E[r r^H] of the FRF errors."""
    data = np.asarray(data, dtype=complex)
    known = np.isfinite(covariance).all()
    weight = np.linalg.inv(np.linalg.cholesky(covariance)) if known else np.full(covariance.shape, np.nan)
    return Problem(np.asarray(f, dtype=float), data, weight.astype(complex), model)


@cache
def small_problem(rows: int = 2) -> Problem:
    """A fit of the data of the true parameters at four frequencies: what compiled functions are compiled with."""
    model, f = _springs(rows), np.array([0.1, 0.3, 1.0, 3.0])
    return paper_cost(model, f, frf(model, model.truth, f))


def _springs(rows: int) -> Model:
    """Damped joints that do not feel each other, whose stiffness acts late."""
    names = tuple(f"joint{k}" for k in range(rows))
    passive = (Term(name, name, order=order) for name in names for order in (1, 2))
    active = (Term(name, name, ("stiffness",), delay="delay", noisy=True) for name in names)
    parameters = (Parameter("stiffness", "", 1.0, 0.0, 2.0), Parameter("delay", "s", 0.1, 0.0, 0.2))
    drive = (Term(name, "stimulus") for name in names)
    return Model("springs", parameters, (*passive, *active, *drive), rows=names, angles=names)


def queued(problems: Sequence[Problem], assignment: np.ndarray, starts: np.ndarray) -> Queue:
    """Starts (M, P) of problems that share model and frequencies; ``assignment``: the problem of each, (M,)."""
    return Queue(
        packed=np.stack([p.packed for p in problems]),
        problem=np.ascontiguousarray(assignment, dtype=np.int64),
        starts=np.ascontiguousarray(starts),
    )


@dataclass(frozen=True)
class Fits:
    """Outcomes of S starts of one problem.

    Attributes
    ----------
    estimate: (S, P) final parameters; cost: (S,); status: (S,) uint8 (`Status`); iterations: (S,) int32, the number
    of evaluations of the model with its derivatives; at_bound: (S, P) int8, -1 on the lower bound, +1 on the upper.
    """

    estimate: np.ndarray
    cost: np.ndarray
    status: np.ndarray
    iterations: np.ndarray
    at_bound: np.ndarray

    @classmethod
    def of(
        cls,
        model: Model,
        estimate: np.ndarray,
        cost: np.ndarray,
        status: np.ndarray,
        iterations: np.ndarray,
        reach: float = 0.0,
    ) -> Fits:
        """Complete raw solver output with the bounds it ended on.

        A parameter counts as on a bound within ``reach`` of it, in widths of its bounds: 0 for a solver that puts
        parameters on bounds, more for one that only comes near them.
        """
        near = reach * (model.upper - model.lower)
        at_bound = (estimate >= model.upper - near).astype(np.int8) - (estimate <= model.lower + near).astype(np.int8)
        return cls(estimate, cost, status.astype(np.uint8), iterations.astype(np.int32), at_bound)

    @classmethod
    def failed(cls, starts: np.ndarray, status: Status) -> Fits:
        """Fits that could not be attempted, all with one status."""
        n = starts.shape[0]
        return cls(
            estimate=np.full(starts.shape, np.nan),
            cost=np.full(n, np.nan),
            status=np.full(n, status, dtype=np.uint8),
            iterations=np.zeros(n, dtype=np.int32),
            at_bound=np.zeros(starts.shape, dtype=np.int8),
        )

    def put(self, where: np.ndarray, other: Fits) -> None:
        """Write the fits of ``other`` over those at indices ``where``."""
        for name in ("estimate", "cost", "status", "iterations", "at_bound"):
            getattr(self, name)[where] = getattr(other, name)

    def take(self, where: slice) -> Fits:
        """Some of the fits, as views."""
        return Fits(
            self.estimate[where], self.cost[where], self.status[where], self.iterations[where], self.at_bound[where]
        )

    @property
    def best(self) -> int:
        """Index of the lowest cost."""
        return int(np.nanargmin(self.cost))
