"""The model table as ordinary differential equations with delays.

Two forms, both read from `Model.table` and from nothing else:

* `rational_rows`: each torque balance multiplied by its common denominator, a sum of real polynomials times pure
  delays (batched over parameter vectors; what the stability test works on);
* `realise`: the same divided out into a mass matrix, polynomial feedback of order 0..2 per delay, and one
  observer-canonical filter state vector per row (what the time simulator and the Chebyshev reference work on).

A row has one set of filter states: its common denominator is the least common multiple of the denominators of its
terms, so that summed signals pass through one filter, as one muscle or one integrator would do it. A filter that
enters both rows is realised once per row; where one copy would do (a resonant mass whose residue has rank one) the
other copy is a hidden mode at the filter's own poles.

Derived (polynomial division and the observer canonical form are textbook linear systems theory).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from mcstudy.errors import ModelError
from mcstudy.stance.feedback import Model, Table


@dataclass(frozen=True, slots=True)
class RationalRows:
    """Rows of A(s) over their common denominators. G distinct delays, L polynomial length, ascending powers of s.

    Row r of the closed loop is  sum_g exp(-delay_g s) * sum_c numerator[g, r, c](s) * signal_c = 0  after
    multiplication with denominator[r](s); the signals are (theta1, theta2, stimulus), the last one with the sign that
    puts it on the left.

    Attributes
    ----------
    delay: (..., G) in s; the first is the undelayed group, zero.
    denominator: (..., 2, D).
    numerator: (..., G, 2, 3, L).
    noisy: (..., G, 2, 3, L), the part of ``numerator`` that sensor noise enters.
    """

    delay: np.ndarray
    denominator: np.ndarray
    numerator: np.ndarray
    noisy: np.ndarray


def _multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of polynomials on the last axis, ascending powers, batched over the others."""
    shape = np.broadcast_shapes(a.shape[:-1], b.shape[:-1])
    out = np.zeros((*shape, a.shape[-1] + b.shape[-1] - 1))
    for j in range(b.shape[-1]):
        out[..., j : j + a.shape[-1]] += a * b[..., j, None]
    return out


def _filter_polynomials(model: Model, theta: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """(numerator, denominator) of every filter, each (..., length) in ascending powers."""
    table = model.table
    if table.monomial.size and table.monomial[:, 2].min() < 0:
        raise ModelError(f"model {model.name}: a filter's monomials need orders >= 0")
    sides: list[tuple[np.ndarray, np.ndarray]] = []
    for f in range(table.n_filters):
        pair = []
        for side in (0, 1):
            mine = np.flatnonzero((table.monomial[:, 0] == f) & (table.monomial[:, 1] == side))
            length = 1 + int(table.monomial[mine, 2].max(initial=0))
            polynomial = np.zeros((*theta.shape[:-1], length))
            for m in mine:
                _, _, order, power2, p1, p2 = table.monomial[m]
                value = np.full(theta.shape[:-1], table.monomial_coefficient[m])
                if p1 >= 0:
                    value = value * theta[..., p1] ** int(table.monomial_power[m])
                if p2 >= 0:
                    value = value * theta[..., p2] ** int(power2)
                polynomial[..., order] += value
            pair.append(polynomial)
        sides.append((pair[0], pair[1]))
    return sides


def _gain(table: Table, theta: np.ndarray, e: int) -> np.ndarray:
    gain = np.full(theta.shape[:-1], table.weight[e, 0])
    for p in table.entry[e, 3:]:
        if p >= 0:
            gain = gain * theta[..., p]
    return gain


def rational_rows(model: Model, theta: np.ndarray, entries: np.ndarray | None = None) -> RationalRows:
    """Rows of A(s) over their common denominators for parameter vectors ``theta`` (..., P).

    Parameters
    ----------
    entries: (E,) bool, which entries of the table to include; all by default. Leaving out the stimulus keeps a
        filter on the stimulus from adding its poles to the loop.

    An integral term whose gain is exactly zero is absent: it does not add a root at s = 0.

    Raises
    ------
    ModelError: a filter's monomial has a negative order, or a delay is negative.
    """
    table, theta = model.table, np.asarray(theta, dtype=float)
    batch = theta.shape[:-1]
    chosen = np.flatnonzero(np.ones(len(table.entry), dtype=bool) if entries is None else entries)
    filters = _filter_polynomials(model, theta)
    chain = {int(e): Counter(int(k) for k in table.group_filters[table.entry[e, 2]] if k >= 0) for e in chosen}
    used = [int(p) for p in dict.fromkeys(table.group_delay[table.entry[chosen, 2]]) if p >= 0]
    delay = np.stack([np.zeros(batch), *(theta[..., p] for p in used)], axis=-1)
    if (delay < 0).any():
        raise ModelError(f"model {model.name}: a delay is negative")
    common: list[Counter[int]] = [Counter(), Counter()]
    integral = [np.zeros(batch, dtype=bool), np.zeros(batch, dtype=bool)]
    integrates = [False, False]
    for e in chain:
        row = int(table.entry[e, 0])
        common[row] |= chain[e]
        if table.entry[e, 1] == -1:
            integrates[row] = True
            integral[row] |= _gain(table, theta, e) != 0.0
    pieces: list[tuple[int, int, int, np.ndarray]] = []
    for e in chain:
        row, order, group = (int(v) for v in table.entry[e, :3])
        polynomial = _gain(table, theta, e)[..., None]
        for k in chain[e].elements():
            polynomial = _multiply(polynomial, filters[k][0])
        for k in (common[row] - chain[e]).elements():
            polynomial = _multiply(polynomial, filters[k][1])
        shift = order + int(integrates[row])
        polynomial = np.concatenate([np.zeros((*batch, shift)), polynomial], axis=-1)
        p = int(table.group_delay[group])
        pieces.append((e, row, 0 if p < 0 else 1 + used.index(p), polynomial))
    denominators = []
    for row in (0, 1):
        polynomial = np.ones((*batch, 1))
        for k in common[row].elements():
            polynomial = _multiply(polynomial, filters[k][1])
        if integrates[row]:
            polynomial = np.concatenate([np.zeros((*batch, 1)), polynomial], axis=-1)
        denominators.append(polynomial)
    length = max(p.shape[-1] for *_, p in pieces)
    numerator = np.zeros((*batch, delay.shape[-1], 2, 3, length))
    noisy = np.zeros_like(numerator)
    for e, row, g, polynomial in pieces:
        for c in range(3):
            weight = table.weight[e, 1 + c]
            if weight != 0.0:
                numerator[..., g, row, c, : polynomial.shape[-1]] += weight * polynomial
                if table.noisy[e]:
                    noisy[..., g, row, c, : polynomial.shape[-1]] += weight * polynomial
    denominator = np.zeros((*batch, 2, max(d.shape[-1] for d in denominators)))
    for row in (0, 1):
        denominator[..., row, : denominators[row].shape[-1]] = denominators[row]
        if integrates[row]:
            absent = ~integral[row]
            for array in (numerator[..., :, row, :, :], noisy[..., :, row, :, :], denominator[..., row, :]):
                array[absent] = _divided_by_s(array[absent])
    return RationalRows(delay, denominator, numerator, noisy)


def _divided_by_s(polynomial: np.ndarray) -> np.ndarray:
    return np.concatenate([polynomial[..., 1:], np.zeros((*polynomial.shape[:-1], 1))], axis=-1)


@dataclass(frozen=True, slots=True)
class Realisation:
    """One parameter vector's closed loop in the time domain. G distinct delays, n_r filter states in row r.

    Row r:  sum_g sum_c sum_k direct[g, r, c, k] * d^k signal_c(t - delay_g) / dt^k  +  (first filter state of r) = 0
    Filter: x_r' = companion_r x_r + sum_g sum_c filtered[g, r, c, :n_r] * signal_c(t - delay_g)

    with companion_r the observer canonical form of ``denominator[r]`` (monic, so x_1' = x_2 - d_{n-1} x_1, ...,
    x_n' = -d_0 x_1). Signals are (theta1, theta2, stimulus).

    Attributes
    ----------
    delay: (G,) s, the first zero.
    direct: (G, 2, 3, 3).
    filtered: (G, 2, 3, S), S the larger of n_r; input of state i (from the highest power down).
    direct_noisy, filtered_noisy: the same for the part that sensor noise enters.
    denominator: two arrays of n_r coefficients d_0..d_{n-1} (the leading one is 1 and left out).
    locks: (2,) int64, per row the angle that a padded row holds at zero (one-segment models; the row reads
        theta'' = 0 here), -1 for a row that is an equation of motion.
    """

    delay: np.ndarray
    direct: np.ndarray
    filtered: np.ndarray
    direct_noisy: np.ndarray
    filtered_noisy: np.ndarray
    denominator: tuple[np.ndarray, np.ndarray]
    locks: np.ndarray

    @property
    def mass(self) -> np.ndarray:
        """Mass matrix (2, 2), the undelayed second-order part."""
        return self.direct[0, :, :2, 2]


def monic(polynomial: np.ndarray) -> np.ndarray:
    """Ascending coefficients without the leading zeros and divided by the leading one, which is left out."""
    used = np.flatnonzero(polynomial)
    if not used.size:
        raise ModelError("a filter's denominator is zero")
    return polynomial[: used[-1]] / polynomial[used[-1]]


def divide(numerator: np.ndarray, denominator: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Polynomial part (3,) and strictly proper remainder (n,) of numerator / denominator, both ascending.

    ``denominator`` holds all its coefficients, leading zeros allowed. Raises `ModelError` if the polynomial part has
    a power above 2.
    """
    d = monic(denominator)
    n, lead = d.size, denominator[d.size]
    rest, quotient = numerator / lead, np.zeros(3)
    for k in range(rest.size - 1 - n, -1, -1):
        q = rest[n + k]
        if q == 0.0:
            continue
        if k > 2:
            raise ModelError(f"{where}: the term grows faster than s^2; give it a filter of higher order")
        quotient[k] = q
        rest = rest.copy()
        rest[k : k + n] -= q * d
        rest[n + k] = 0.0
    remainder = np.zeros(n)
    remainder[: min(n, rest.size)] = rest[:n]
    return quotient, remainder


def realise(model: Model, theta: np.ndarray, entries: np.ndarray | None = None) -> Realisation:
    """Time-domain form of one parameter vector ``theta`` (P,); ``entries`` as in `rational_rows`.

    Raises
    ------
    ModelError: wrong shape, a term that is improper beyond order 2, or a mass matrix that is not invertible.
    """
    theta = np.asarray(theta, dtype=float)
    if theta.shape != (len(model.parameters),) or not np.isfinite(theta).all():
        raise ModelError(f"model {model.name}: expected {len(model.parameters)} finite parameters, got {theta.shape}")
    rows = rational_rows(model, theta, entries)
    groups = rows.delay.size
    denominator = (monic(rows.denominator[0]), monic(rows.denominator[1]))
    states = max(denominator[0].size, denominator[1].size)
    direct, filtered = np.zeros((2, groups, 2, 3, 3)), np.zeros((2, groups, 2, 3, states))
    for kind, array in enumerate((rows.numerator, rows.noisy)):
        for g, r, c in np.ndindex(groups, 2, 3):
            if array[g, r, c].any():
                where = f"model {model.name}: {model.rows[r]} row"
                quotient, remainder = divide(array[g, r, c], rows.denominator[r], where)
                direct[kind, g, r, c] = quotient
                # Observer form: state 1 integrates the highest power of the remainder.
                filtered[kind, g, r, c, : remainder.size] = remainder[::-1]
    locks = np.full(2, -1, dtype=np.int64)
    for r in (0, 1):
        static = direct[0, 0, r, :2, 0] != 0.0
        everything = np.count_nonzero(direct[0, :, r]) + np.count_nonzero(filtered[0, :, r])
        if static.sum() == 1 and everything == 1:
            c = int(np.flatnonzero(static)[0])
            locks[r] = c
            direct[:, :, r] = 0.0
            direct[0, 0, r, c, 2] = 1.0
    mass = direct[0, 0, :, :2, 2]
    scale = np.abs(mass).max(axis=1).prod()
    if scale == 0.0 or abs(np.linalg.det(mass)) < 1e-12 * scale:
        raise ModelError(
            f"model {model.name}: the mass matrix (undelayed second-order terms) is singular: {mass.tolist()}"
        )
    return Realisation(rows.delay, direct[0], filtered[0], direct[1], filtered[1], denominator, locks)
