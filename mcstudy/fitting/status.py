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
    NOT_NEEDED = 7
    UNSTABLE = 8

    @property
    def text(self) -> str:
        """One sentence for a reader of a table."""
        return _TEXTS[self]

    @property
    def usable(self) -> bool:
        """Whether cost and estimate mean something (the fit ran on finite data and returned a finite cost)."""
        return self in (Status.CONVERGED, Status.STALLED, Status.ITERATION_LIMIT)

    @property
    def ran(self) -> bool:
        """Whether the fit was attempted."""
        return self not in (Status.PENDING, Status.NOT_NEEDED)

    @property
    def failed(self) -> bool:
        """Whether the fit was attempted and gave nothing usable, although nothing was wrong with asking for it."""
        return self.ran and not self.usable and self is not Status.UNSTABLE


_TEXTS = {
    Status.PENDING: "not run yet",
    Status.CONVERGED: "converged: no step within the bounds is predicted to lower the cost by more than the tolerance",
    Status.STALLED: "stalled: no smaller step lowers the cost although one is predicted to (rounding)",
    Status.ITERATION_LIMIT: "stopped at the limit of iterations or evaluations before convergence",
    Status.NON_FINITE_MODEL: "the model is not finite at the start: nothing was fitted",
    Status.NON_FINITE_DATA: "the data or weights are not finite: nothing was fitted",
    Status.SOLVER_ERROR: "the solver raised an error: nothing was fitted",
    Status.NOT_NEEDED: "not needed: the starts before it had found the lowest minimum with the wanted certainty",
    Status.UNSTABLE: "left out: the search ended at an unstable loop, and found no stable one from there",
}

USABLE = tuple(int(s) for s in Status if s.usable)
"""Statuses, as a cube holds them, of fits whose cost and estimate mean something."""

NOT_RUN = tuple(int(s) for s in Status if not s.ran)
"""Statuses, as a cube holds them, of fits that were not attempted: not yet, or never because others sufficed."""

WANTED = 0.01
"""Chance of a missed minimum below which no more starts are drawn."""
