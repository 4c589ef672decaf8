"""How a fit ended, as a number in the cube and a sentence for people."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Outcome of one fit. 0 is the fill value of the cube: the fit has not been run."""

    PENDING = 0
    CONVERGED = 1
    STALLED = 2
    ITERATION_LIMIT = 3
    NON_FINITE_MODEL = 4
    NON_FINITE_DATA = 5
    SOLVER_ERROR = 6

    @property
    def text(self) -> str:
        """One sentence for a reader of a table."""
        return _TEXTS[self]

    @property
    def usable(self) -> bool:
        """Whether cost and estimate mean something (the fit ran on finite data and returned a finite cost)."""
        return self in (Status.CONVERGED, Status.STALLED, Status.ITERATION_LIMIT)


_TEXTS = {
    Status.PENDING: "not run yet",
    Status.CONVERGED: "converged: no step within the bounds is predicted to lower the cost by more than the tolerance",
    Status.STALLED: "stalled: no smaller step lowers the cost although one is predicted to (rounding)",
    Status.ITERATION_LIMIT: "stopped at the limit of iterations or evaluations before convergence",
    Status.NON_FINITE_MODEL: "the model is not finite at the start: nothing was fitted",
    Status.NON_FINITE_DATA: "the data or weights are not finite: nothing was fitted",
    Status.SOLVER_ERROR: "the solver raised an error: nothing was fitted",
}

USABLE = tuple(int(s) for s in Status if s.usable)
"""Statuses, as a cube holds them, of fits whose cost and estimate mean something."""
