"""The model table as rational functions: every torque balance over its common denominator.

The step between the table and everything that needs polynomials: the stability test works on `RationalRows` directly,
`mcstudy.stance.realize` divides them out into differential equations.

Derived (least common multiples of the filters' denominators).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import reduce

import numpy as np

from mcstudy.errors import ModelError
from mcstudy.stance.feedback import Model


@dataclass(frozen=True, slots=True)
class RationalRows:
    """Rows of A(s) over their common denominators. R rows, G distinct delays, polynomials in ascending powers of s.

    Row r of the closed loop is

        sum_g exp(-delay_g s) sum_c sum_k  numerator[g, r, c, k](s) / denominator[r](s)  *  s^k signal_c  =  0

    with the R angles and the stimulus as signals, the last one with the sign that puts it on the left. k is the order
    of the term, 0..2, so that a sensed rate can be told from the derivative of a sensed angle; an integral is k = 0
    with a factor s in the denominator.

    Attributes
    ----------
    delay: (..., G) in s; the first is the undelayed group, zero.
    denominator: (..., R, D).
    numerator: (..., G, R, R + 1, 3, L).
    """

    delay: np.ndarray
    denominator: np.ndarray
    numerator: np.ndarray

    def folded(self) -> np.ndarray:
        """Numerators with the powers s^k multiplied in and summed over k, (..., G, R, R + 1, L + 2)."""
        length = self.numerator.shape[-1]
        out = np.zeros((*self.numerator.shape[:-2], length + 2))
        for k in range(3):
            out[..., k : k + length] += self.numerator[..., k, :]
        return out


def rational_rows(
    model: Model, theta: np.ndarray, entries: np.ndarray | None = None, scale: np.ndarray | None = None
) -> RationalRows:
    """Rows of A(s) over their common denominators for parameter vectors ``theta`` (..., P).

    Parameters
    ----------
    entries: (E,) bool, which entries of the table to include; all by default. Leaving out the stimulus keeps a
        filter on the stimulus from adding its poles to the loop.
    scale: (E,) factors on the entries; ones by default.

    An integral term whose gain is exactly zero is absent: it does not add a root at s = 0.

    Raises
    ------
    ModelError: a filter's monomial has a negative order, or a delay is negative.
    """
    table, theta = model.table, np.asarray(theta, dtype=float)
    batch, n_rows = theta.shape[:-1], table.output_filter.size
    chosen = [int(e) for e in np.flatnonzero(np.ones(len(table.entry), dtype=bool) if entries is None else entries)]
    filters = _filter_polynomials(model, theta)
    delay, group = _delays(model, theta, chosen)
    gains = table.gains(theta)
    chain = {e: Counter(int(k) for k in table.group_filters[table.entry[e, 2]] if k >= 0) for e in chosen}
    common: list[Counter[int]] = [Counter() for _ in range(n_rows)]
    integrates = [False] * n_rows
    for e in chosen:
        row = int(table.entry[e, 0])
        common[row] |= chain[e]
        integrates[row] |= bool(table.entry[e, 1] == -1)
    pieces: list[tuple[int, np.ndarray]] = []
    for e in chosen:
        row, order = int(table.entry[e, 0]), int(table.entry[e, 1])
        polynomial = gains[..., e, None] * (1.0 if scale is None else scale[e])
        for k in chain[e].elements():
            polynomial = _multiply(polynomial, filters[k][0])
        for k in (common[row] - chain[e]).elements():
            polynomial = _multiply(polynomial, filters[k][1])
        if integrates[row] and order >= 0:
            polynomial = _times_s(polynomial)
        pieces.append((e, polynomial))
    longest = max((p.shape[-1] for _, p in pieces), default=1)
    numerator = np.zeros((*batch, delay.shape[-1], n_rows, n_rows + 1, 3, longest))
    for e, polynomial in pieces:
        row, order = int(table.entry[e, 0]), max(int(table.entry[e, 1]), 0)
        for c in np.flatnonzero(table.weight[e, 1:]):
            numerator[..., group[e], row, c, order, : polynomial.shape[-1]] += table.weight[e, 1 + c] * polynomial
    bottoms = [
        _bottom(batch, [filters[k][1] for k in common[row].elements()], integrates[row]) for row in range(n_rows)
    ]
    denominator = np.zeros((*batch, n_rows, max(b.shape[-1] for b in bottoms)))
    for row in range(n_rows):
        denominator[..., row, : bottoms[row].shape[-1]] = bottoms[row]
        if integrates[row]:
            mine = [e for e in chosen if table.entry[e, 0] == row and table.entry[e, 1] == -1]
            absent = np.all(gains[..., mine] == 0.0, axis=-1)
            for array in (numerator[..., row, :, :, :], denominator[..., row, :]):
                array[absent] = _divided_by_s(array[absent])
    return RationalRows(delay, denominator, numerator)


def _bottom(batch: tuple[int, ...], factors: list[np.ndarray], integrates: bool) -> np.ndarray:
    """Common denominator of a row, (..., L): a product of filters' denominators, and s if a term integrates."""
    product = reduce(_multiply, factors, np.ones((*batch, 1)))
    return _times_s(product) if integrates else product


def _delays(model: Model, theta: np.ndarray, chosen: list[int]) -> tuple[np.ndarray, dict[int, int]]:
    """Distinct delays (..., G), zero first, and the delay group of each chosen entry."""
    table = model.table
    parameters = {e: tuple(int(p) for p in table.group_delay[table.entry[e, 2]] if p >= 0) for e in chosen}
    used = [(), *dict.fromkeys(delays for delays in parameters.values() if delays)]
    delay = np.stack([theta[..., list(delays)].sum(axis=-1) for delays in used], axis=-1)
    if (delay < 0).any():
        at = used[int(np.argmax((delay < 0).reshape(-1, len(used)).any(axis=0)))]
        raise ModelError(f"model {model.name}: delay {' + '.join(model.names[p] for p in at)} is negative")
    return delay, {e: used.index(delays) for e, delays in parameters.items()}


def filter_polynomials(model: Model, theta: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of one filter, (..., length) each in ascending powers of s."""
    return _filter_polynomials(model, np.asarray(theta, dtype=float))[[f.name for f in model.filters].index(name)]


def _filter_polynomials(model: Model, theta: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    table = model.table
    if table.monomial.size and table.monomial[:, 2].min() < 0:
        raise ModelError(f"model {model.name}: a filter's monomials need orders >= 0")
    filters: list[tuple[np.ndarray, np.ndarray]] = []
    for f in range(table.n_filters):
        sides = []
        for side in (0, 1):
            mine = np.flatnonzero((table.monomial[:, 0] == f) & (table.monomial[:, 1] == side))
            polynomial = np.zeros((*theta.shape[:-1], 1 + int(table.monomial[mine, 2].max(initial=0))))
            for m in mine:
                _, _, order, power2, p1, p2 = table.monomial[m]
                value = np.full(theta.shape[:-1], table.monomial_coefficient[m])
                if p1 >= 0:
                    value = value * theta[..., p1] ** int(table.monomial_power[m])
                if p2 >= 0:
                    value = value * theta[..., p2] ** int(power2)
                polynomial[..., order] += value
            sides.append(polynomial)
        filters.append((sides[0], sides[1]))
    return filters


def _multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of polynomials on the last axis, ascending powers, batched over the others."""
    shape = np.broadcast_shapes(a.shape[:-1], b.shape[:-1])
    out = np.zeros((*shape, a.shape[-1] + b.shape[-1] - 1))
    for j in range(b.shape[-1]):
        out[..., j : j + a.shape[-1]] += a * b[..., j, None]
    return out


def _times_s(polynomial: np.ndarray) -> np.ndarray:
    return np.concatenate([np.zeros((*polynomial.shape[:-1], 1)), polynomial], axis=-1)


def _divided_by_s(polynomial: np.ndarray) -> np.ndarray:
    return np.concatenate([polynomial[..., 1:], np.zeros((*polynomial.shape[:-1], 1))], axis=-1)
