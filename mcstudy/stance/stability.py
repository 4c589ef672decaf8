"""Stability of the closed loop: the rightmost characteristic root of the delay system.

`growth_rate` is what a study calls for every fit: a compiled root search that proves its answer with the argument
principle (`mcstudy.stance.stability_kernel`). The few vectors whose proof fails are restarted from the eigenvalues of
`roots_chebyshev`, which is also the independent reference: the Chebyshev collocation of the infinitesimal generator
of the delay equation (Breda, Maset & Vermiglio 2005, SIAM J Sci Comput 27:482-495), built from the same realisation
as the time simulator.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from mcstudy.errors import ModelError
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import members
from mcstudy.stance.rational import rational_rows
from mcstudy.stance.realize import ANGLE, SENSED, Realisation, realise
from mcstudy.stance.stability_kernel import ADVANCED, CERTIFIED, CHAIN, FAILED, SINGULAR, STATIC, Room, rightmost

FALLBACK_ORDER = 32
"""Chebyshev order of the fallback: 1e-8 and better for every root inside 60 rad/s at the delays of balance."""


class Proof(IntEnum):
    """How a rightmost root was established."""

    SEARCH = 0
    """Found by the compiled search; no root lies right of it (argument principle)."""
    RESTART = 1
    """The same, after more starts taken from a first certificate that found roots missing."""
    CHEBYSHEV = 2
    """Found from the Chebyshev eigenvalues, then polished and certified."""
    CHAIN = 3
    """Neutral system (delayed acceleration): the abscissa of its root chain, or a root within 0.1 1/s of it."""
    UNCERTAIN = 4
    """Polished Chebyshev eigenvalue without a certificate (for example a nearly double root)."""
    NONE = 5
    """No answer: parameters not finite, or a determinant that is zero or not finite."""
    STATIC = 6
    """A loop without dynamics has no root: -infinity."""
    ADVANCED = 7
    """A delayed term of higher order than all undelayed ones: roots with arbitrarily large real parts, +infinity."""


@dataclass(frozen=True, slots=True)
class Rightmost:
    """Rightmost characteristic roots.

    Attributes
    ----------
    root: (...) complex, 1/s, imaginary part >= 0 (NaN where only the chain's abscissa is known); see `rightmost_root`.
    proof: (...) int8, values of `Proof`.
    """

    root: np.ndarray
    proof: np.ndarray


def rightmost_root(model: Model, theta: np.ndarray, fallback: bool = True) -> Rightmost:
    """Rightmost characteristic root of the closed loop for every parameter vector ``theta`` (..., P).

    Poles of filters inside the loop and integrators count as roots (an integral term with zero gain does not); filters
    on the stimulus or on measured angles do not. Rows need no inertia; a loop without dynamics has no root and gives
    -infinity, one with a delayed term of higher order than all undelayed ones +infinity. NaN or infinite parameters and
    a singular loop give NaN. Where loops differ between recordings (`Model.loops_differ`) the root is that of the loop
    that decays most slowly. Without ``fallback`` what the compiled search does not certify stays uncertain, and cheap.

    Raises
    ------
    ModelError: the number of parameters is wrong, or a delay is negative.
    """
    theta = np.asarray(theta, dtype=float)
    if theta.shape[-1:] != (len(model.parameters),):
        raise ModelError(f"model {model.name}: expected {len(model.parameters)} parameters, got {theta.shape}")
    if model.loops_differ:
        return _of_the_least_stable([rightmost_root(m, theta, fallback) for m in members(model)])
    flat = np.ascontiguousarray(theta.reshape(-1, theta.shape[-1]))
    root = np.full(len(flat), np.nan + 1j * np.nan)
    proof = np.full(len(flat), Proof.NONE, dtype=np.int8)
    finite = np.isfinite(flat).all(axis=1)
    if finite.any():
        root[finite], proof[finite] = _search(model, flat[finite], fallback)
    return Rightmost(root.reshape(theta.shape[:-1]), proof.reshape(theta.shape[:-1]))


def _of_the_least_stable(loops: list[Rightmost]) -> Rightmost:
    """Of several loops the one that decays most slowly, for every parameter vector; NaN where one has no answer."""
    roots, proofs = (np.stack([getattr(r, name) for r in loops]) for name in ("root", "proof"))
    worst = np.argmax(np.where(np.isnan(roots.real), np.inf, roots.real), axis=0)[None]
    return Rightmost(*(np.take_along_axis(x, worst, axis=0)[0] for x in (roots, proofs)))


def growth_rate(model: Model, theta: np.ndarray) -> np.ndarray:
    """Growth rate of the closed loop: real part of its rightmost characteristic root, 1/s; negative is stable.

    Parameters
    ----------
    model
        The table.
    theta
        (..., P), parameter values.

    Returns
    -------
    numpy.ndarray
        (...), 1/s; NaN where a parameter is not finite. `rightmost_root` says what counts as a root, and which loops
        give an infinite rate.

    Raises
    ------
    ModelError
        The number of parameters is wrong, or a delay is negative.
    """
    return rightmost_root(model, theta).root.real


_PROOFS = {
    CERTIFIED: Proof.SEARCH,
    CHAIN: Proof.CHAIN,
    STATIC: Proof.STATIC,
    ADVANCED: Proof.ADVANCED,
    SINGULAR: Proof.NONE,
    FAILED: Proof.UNCERTAIN,
}


def _search(model: Model, theta: np.ndarray, fallback: bool) -> tuple[np.ndarray, np.ndarray]:
    rows = rational_rows(model, theta, _in_loop(model))
    # One memory layout, so that numba compiles once.
    numerator, delay = np.ascontiguousarray(rows.folded()[..., :-1, :]), np.ascontiguousarray(rows.delay)
    root = np.empty(len(theta), dtype=complex)
    outcome, rounds = np.empty(len(theta), dtype=np.int8), np.empty(len(theta), dtype=np.int8)
    room = Room.of(numerator)
    rightmost(numerator, delay, np.empty((len(theta), 0), dtype=complex), room, root, outcome, rounds)
    proof = np.array([_PROOFS[k] for k in range(len(_PROOFS))], dtype=np.int8)[outcome]
    proof[(outcome == CERTIFIED) & (rounds > 1)] = Proof.RESTART
    root[outcome == STATIC], root[outcome == ADVANCED] = -np.inf, np.inf
    for b in np.flatnonzero(outcome == FAILED) if fallback else ():
        try:
            eigenvalues = roots_chebyshev(model, theta[b], FALLBACK_ORDER)
        except ModelError:  # not to be realised in time: what the search has found remains, uncertain
            continue
        hints = eigenvalues[eigenvalues.imag >= 0][None, :12].copy()
        row = slice(b, b + 1)
        rightmost(numerator[row], delay[row], hints, room, root[row], outcome[row], rounds[row])
        proof[b] = Proof.CHEBYSHEV if outcome[b] == CERTIFIED else _PROOFS[int(outcome[b])]
        if proof[b] == Proof.UNCERTAIN and not root[b].real >= hints[0, 0].real - 1e-6:
            root[b] = hints[0, 0]
    return root, proof


def _in_loop(model: Model) -> np.ndarray:
    """Entries of the table that sense an angle."""
    return (model.table.weight[:, 1:-1] != 0.0).any(axis=1)


def roots_chebyshev(model: Model, theta: np.ndarray, order: int = 40) -> np.ndarray:
    """Approximate characteristic roots of one parameter vector ``theta`` (P,), rightmost first.

    Collocates the generator of the delay equation on ``order`` + 1 Chebyshev points over the longest delay: the
    derivative along the history, and the closed loop itself at the present. Delayed acceleration (neutral equations)
    enters as a delayed mass. Converges spectrally for roots with |s| * delay well below ``order``; the others,
    mostly far left, are artefacts.

    Raises
    ------
    ModelError: as `mcstudy.stance.realize.realise`.
    """
    loop = realise(model, theta, _in_loop(model))
    mass, state = _first_order(loop)
    delay = loop.delay
    size = mass.shape[1]
    if delay.max() == 0.0:
        left, right = mass.sum(axis=0), state.sum(axis=0)
    else:
        unit = np.cos(np.pi * np.arange(order + 1) / order)  # 1 (present) ... -1 (longest delay)
        differentiate = _differentiation(unit) * (2.0 / delay.max())
        left, right = np.eye((order + 1) * size), np.kron(differentiate, np.eye(size))
        left[:size] = right[:size] = 0.0
        for g, d in enumerate(delay):
            weights = _lagrange(unit, 1.0 - 2.0 * d / delay.max())
            left[:size] += np.kron(weights, mass[g])
            right[:size] += np.kron(weights, state[g])
    if loop.order.all():
        roots = np.linalg.eigvals(np.linalg.solve(left, right))
    else:  # an equation without derivatives has an infinite root, which is zero in 1 / (s - shift)
        shift = 1.3 / delay.max() if delay.max() else 1.3 * (loop.fastest_pole or 1.0)
        inverse = np.linalg.eigvals(np.linalg.solve(right - shift * left, left))
        roots = shift + 1.0 / inverse[np.abs(inverse) > 1e-10 * np.abs(inverse).max(initial=0.0)]
    return roots[np.argsort(-roots.real, kind="stable")]


def _first_order(loop: Realisation) -> tuple[np.ndarray, np.ndarray]:
    """The closed loop as sum_g mass_g x'(t - delay_g) = sum_g state_g x(t - delay_g), each (G, n, n).

    x holds the unknowns, the rates of those of order 2 and the filter states; filters outside the loop are left out.
    """
    R = loop.order.size
    n, groups = 2 * R + loop.head.size, loop.delay.size
    mass, state = np.zeros((groups, n, n)), np.zeros((groups, n, n))
    mass[0] = np.eye(n)
    mass[0, R : 2 * R, R : 2 * R] = 0.0
    state[0, :R, R : 2 * R] = np.eye(R)

    def add(row: int, g: int, unknown: int, order: int, value: float) -> None:
        """A derivative of an unknown, on the right-hand side of an equation."""
        if order and order == loop.order[unknown]:
            mass[g, row, unknown + R * (order - 1)] -= value
        else:
            state[g, row, unknown + R * order] += value

    for r, c in np.ndindex(R, R):
        add(R + r, 0, c, int(loop.order[c]), -float(loop.leading[r, c]))
    for (signal, to), gain in zip(loop.link, loop.gain, strict=True):
        kind, g, unknown, order = loop.signal[signal]
        if kind in (ANGLE, SENSED):
            add(R + to % R if to < 2 * R else to, g, unknown, order, -gain if to < 2 * R else gain)
    for i, (head, last, torque) in enumerate(zip(loop.head, loop.last, loop.torque_of, strict=True)):
        state[0, 2 * R + i, 2 * R + head] -= loop.coefficient[i]
        if not last:
            state[0, 2 * R + i, 2 * R + i + 1] += 1.0
        if torque >= 0:
            state[0, R + torque % R, 2 * R + i] -= 1.0
    inside = loop.torque_of[loop.head] >= 0
    equations = np.concatenate([loop.order == 2, np.ones(R, dtype=bool), inside])
    states = np.concatenate([np.ones(R, dtype=bool), loop.order == 2, inside])
    return mass[:, equations][:, :, states], state[:, equations][:, :, states]


def _differentiation(x: np.ndarray) -> np.ndarray:
    """Differentiation matrix on Chebyshev extreme points (negative row sums on the diagonal)."""
    n = x.size - 1
    weight = np.where((np.arange(n + 1) == 0) | (np.arange(n + 1) == n), 2.0, 1.0) * (-1.0) ** np.arange(n + 1)
    gap = x[:, None] - x[None, :] + np.eye(n + 1)
    matrix = np.outer(weight, 1.0 / weight) / gap
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return matrix


def _lagrange(x: np.ndarray, at: float) -> np.ndarray:
    """Barycentric interpolation weights from Chebyshev extreme points ``x`` to one point, shape (1, n + 1)."""
    n = x.size - 1
    gap = at - x
    hit = np.abs(gap) < 1e-14
    if hit.any():
        return hit[None, :].astype(float)
    weight = np.where((np.arange(n + 1) == 0) | (np.arange(n + 1) == n), 0.5, 1.0) * (-1.0) ** np.arange(n + 1) / gap
    return (weight / weight.sum())[None, :]
