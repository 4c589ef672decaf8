"""What the compiled fits are handed: every array under its name, so that no two can change places unseen.

numba reads a NamedTuple of numbers and arrays like the numbers and arrays themselves. The compiled modules import
this one, and it imports none, so that the code they keep is as old as these fields and no older.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Filters(NamedTuple):
    """Filters of a model: M monomials, Q (filter, parameter) pairs.

    pair: (Q, 2) int64, every parameter that a filter holds. monomial (M, 6), power (M,), coefficient (M,) and output
    (R,): ``monomial``, ``monomial_power``, ``monomial_coefficient`` and ``output_filter`` of
    `mcstudy.stance.feedback.Table`.
    """

    pair: np.ndarray
    monomial: np.ndarray
    power: np.ndarray
    coefficient: np.ndarray
    output: np.ndarray


class Plan(NamedTuple):
    """A table of R rows at N fixed frequencies, in the form `mcstudy.fitting.kernel.evaluate` reads; see `plans.plan`.

    Attributes
    ----------
    rows: 0 to R - 1, a tuple, so that R is part of its type and each R has compiled code of its own.
    omega: (N,) rad/s.
    constant: (N, 2 R (R + 1)), the terms without parameters, summed: A(s) by rows, then b(s), re and im in turn.
    entry: (E, 10) int64, the other terms: row, order, group, first gain, second gain, index into ``sensed``, whether
        its group carries a delay or filter parameter, and whether it is the first to reach the sum of its group and
        of its gains.
    weight: (E, 1 + R + J), coefficient, then weights on the angles and on each of J stimuli.
    sensed, sensed_weight: (S,) int64 and (S, R + J), row and weights of the distinct (row, sense) pairs.
    stimulus: (N,) int64, which of the J stimuli evokes a line.
    group_delay, group_filters, group_only: (G, 2), (G, 4) and (G,) int64, as in `mcstudy.stance.feedback.Table`.
    filters: of the model.
    single: (R, W) int64, the parameters that act on one row of the equations of motion alone, by row, filled up with
        -1 to whole tiles. both: (C,) int64, the others, among them all that act on the measured angles.
    column: (P, R) int64, where the torques of a (parameter, row) are kept.
    delay_first: (G, 2, R) int64, whether a delay of a group is the first to write to its place in a row: 1 yes, 0 no,
        -1 nothing to add.
    cleared: (K,) int64, the places that nobody writes to first.
    """

    rows: tuple[int, ...]
    omega: np.ndarray
    constant: np.ndarray
    entry: np.ndarray
    weight: np.ndarray
    sensed: np.ndarray
    sensed_weight: np.ndarray
    stimulus: np.ndarray
    group_delay: np.ndarray
    group_filters: np.ndarray
    group_only: np.ndarray
    filters: Filters
    single: np.ndarray
    both: np.ndarray
    column: np.ndarray
    delay_first: np.ndarray
    cleared: np.ndarray


class Scratch(NamedTuple):
    """Slots at which parts of an evaluation begin: F frequencies at a time, of complex numbers first all real parts.

    matrix: A and b by rows (2 R (R + 1) F). group: delays times filters of each group (2 G F). direction: columns of B
    by row (2 R^2 F). rho: products of two of them (R (R - 1) F). projection: of the residual on them (2 R F). response:
    H (2 R F). length: of the columns of B (R F). residual: (2 R F). sensed: what each (row, sense) passes on (2 S F).
    product: of a term (2 F). group_sum: of the terms of a group by row (2 R G F). torque: of the parameters (2 R (W +
    C) F). cross: those of a row times rho, for each lower row (R (R - 1) W F). column: whole columns of the Jacobian,
    and their products with those of B (4 R C F). tiles: of the Gram matrix. gain: of each term (E). filter, slope:
    values of the filters and their logarithmic derivatives, which repeat after ``filter_stride`` slots at the next
    frequency.
    """

    matrix: int
    group: int
    direction: int
    rho: int
    projection: int
    response: int
    length: int
    residual: int
    sensed: int
    product: int
    group_sum: int
    torque: int
    cross: int
    column: int
    tiles: int
    gain: int
    filter: int
    slope: int
    filter_stride: int


class Workspace(NamedTuple):
    """Lanes ``w``, and the slots at which the parts begin, in their order.

    x, gram: parameters (P slots) of the fits, and lower triangle of [J r]^T [J r] there, (P + 1) (P + 2) / 2 slots.
    trial, gram_trial: the same of the step that is tried. held, step: (P). matrix: as ``gram``. damping: one slot.
    data: R (R + 2) N + 2, see `pack`. at: of the evaluation.
    """

    w: np.ndarray
    x: int
    trial: int
    gram: int
    gram_trial: int
    held: int
    matrix: int
    step: int
    damping: int
    data: int
    at: Scratch


class Queue(NamedTuple):
    """M starts of K problems that share model and frequencies.

    packed: (K, R (R + 2) N + 2), data and weights, see `pack`. problem: (M,) int64, problem of each start. starts:
    (M, P).
    """

    packed: np.ndarray
    problem: np.ndarray
    starts: np.ndarray


class Lanes(NamedTuple):
    """Which start of a queue is in each of W lanes, and which is the next.

    fit: (W,) int64, start of the queue; -1 none. problem: (W,) int64, whose data the lane holds; -1 none. next: (1,).
    """

    fit: np.ndarray
    problem: np.ndarray
    next: np.ndarray


class LaneStates(NamedTuple):
    """State of the fit in each of W lanes, (W,) each; made here, since to compile what makes arrays takes a second.

    lanes: see `Lanes`. fresh: bool, whether nothing is known of the start yet. evaluations: int64,
    so far. outcome: int64, status with which it ends; 0 not yet. growth: factor of the damping at the next rejection.
    floor: cost below which only rounding is left. predicted: decrease of the cost.
    """

    lanes: Lanes
    fresh: np.ndarray
    evaluations: np.ndarray
    outcome: np.ndarray
    growth: np.ndarray
    floor: np.ndarray
    predicted: np.ndarray

    @classmethod
    def idle(cls, W: int) -> LaneStates:
        """Of lanes without a fit."""
        lanes = Lanes(np.full(W, -1, dtype=np.int64), np.full(W, -1, dtype=np.int64), np.zeros(1, np.int64))
        whole, numbers = [np.zeros(W, np.int64) for _ in range(2)], [np.zeros(W) for _ in range(3)]
        return cls(lanes, np.zeros(W, np.bool_), *whole, *numbers)


class Bounds(NamedTuple):
    """Bounds of the parameters: (P,) for all starts alike, or (M, P)."""

    lower: np.ndarray
    upper: np.ndarray


class StopRules(NamedTuple):
    """When a fit ends.

    tolerance: predicted decrease of the cost below which a fit has converged, relative to the cost (in a penalised
    fit, of the deviance itself). max_iterations: most evaluations of the model with its derivatives.
    """

    tolerance: float
    max_iterations: int


class Outcomes(NamedTuple):
    """What M fits came to: estimate (M, P), cost (M,), status (M,) int64, iterations (M,) int64."""

    estimate: np.ndarray
    cost: np.ndarray
    status: np.ndarray
    iterations: np.ndarray

    @classmethod
    def empty(cls, M: int, P: int) -> Outcomes:
        """To be filled."""
        return cls(np.full((M, P), np.nan), np.full(M, np.nan), np.zeros(M, np.int64), np.zeros(M, np.int64))


class Prior(NamedTuple):
    """Independent normal priors of the parameters, cut at their bounds: mean (P,), scale (P,) standard deviation.

    ``weight``: 1, or 0 for a fit without a prior, whose steps are still scaled with ``scale``.
    """

    mean: np.ndarray
    scale: np.ndarray
    weight: float = 1.0


class Restraint(NamedTuple):
    """Added to the deviance of each of M fits: weight (direction . x - target)^2; none for arrays of length 0.

    direction: (M, P). target, weight: (M,).
    """

    direction: np.ndarray
    target: np.ndarray
    weight: np.ndarray

    @classmethod
    def none(cls, P: int) -> Restraint:
        """No restraint on any fit of P parameters."""
        return cls(np.zeros((0, P)), np.zeros(0), np.zeros(0))


class PenalisedFits(NamedTuple):
    """M penalised fits: estimate (M, P), chi2 (M,), penalty (M,), information (M, P, P)."""

    estimate: np.ndarray
    chi2: np.ndarray
    penalty: np.ndarray
    information: np.ndarray

    @classmethod
    def empty(cls, M: int, P: int) -> PenalisedFits:
        """To be filled."""
        return cls(np.empty((M, P)), np.empty(M), np.empty(M), np.empty((M, P, P)))

    @property
    def objective(self) -> np.ndarray:
        """What was minimised, (M,); inf where the model was not finite."""
        total = self.chi2 + self.penalty
        return np.where(np.isfinite(total), total, np.inf)


class Goal(NamedTuple):
    """What each of M searches for the end of an interval maximises, and how far it may go.

    direction: (M, P), of the quantity, pointing outwards. ceiling: (M,), highest deviance. height: (M,), of the ceiling
    above the lowest minimum. scale: (P,), typical sizes of the parameters.
    """

    direction: np.ndarray
    ceiling: np.ndarray
    height: np.ndarray
    scale: np.ndarray


class Ends(NamedTuple):
    """M ends of intervals: estimate (M, P), chi2 (M,), status (M,) int64 and iterations (M,) int64.

    ``status``: `DATA`, `BOUND` or `GAVE_UP` of `mcstudy.fitting.outermost_kernel`.
    """

    estimate: np.ndarray
    chi2: np.ndarray
    status: np.ndarray
    iterations: np.ndarray

    @classmethod
    def empty(cls, M: int, P: int) -> Ends:
        """To be filled."""
        return cls(np.empty((M, P)), np.empty(M), np.empty(M, dtype=np.int64), np.empty(M, dtype=np.int64))


def pack(y: np.ndarray, weight: np.ndarray, constant: float = 0.0) -> np.ndarray:
    """Data and weights of R angles in the kernel's order, (R (R + 2) N + 2,).

    Per frequency: the angles (re, im), the diagonal of the weights, and what lies below it by rows (re, im). Then
    ``constant``, a part of the cost that no parameter changes, and the cost of responses that are zero.

    ``y``: (N, R) complex. ``weight``: (N, R, R) complex, lower triangular with real diagonal.
    """
    N, R = y.shape
    packed = np.empty((N, R * (R + 2)))
    packed[:, 0 : 2 * R : 2], packed[:, 1 : 2 * R : 2] = y.real, y.imag
    packed[:, 2 * R : 3 * R] = np.einsum("nii->ni", weight).real
    below = weight[:, *np.tril_indices(R, -1)]
    packed[:, 3 * R :: 2], packed[:, 3 * R + 1 :: 2] = below.real, below.imag
    whole = constant + (np.abs(np.einsum("nij,nj->ni", weight, y)) ** 2).sum()
    return np.concatenate([packed.ravel(), [constant, whole]])
