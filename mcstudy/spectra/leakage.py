"""Fourier coefficients of a cycle of sway without leakage, at low and high lines.

Removing the ramp between the ends of a cycle (`mcstudy.spectra.periods`) leaves a step in the velocity, whose leakage
decreases as 1/k^2. Sway decreases faster, so above about 2 Hz leakage dominates the combination of angles with the
least noise, and it has the same value at neighbouring lines. The DFT of the m-th differences divided by (1 - w)^m,
w = exp(-2 pi i k / period), removes steps in the first m - 1 derivatives. It is correct at high lines but amplifies the
leakage of fast components at the lowest lines. No order is best at all lines, and the best one depends on the colour of
the noise, which the even lines show. `best_orders` chooses the order of each line: the path of least noise, with a
penalty for every change of order. Derived, and checked against the known spectra of simulations.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

ORDERS = (0, 1, 2, 3)
"""Orders of difference that are compared; 0 is the plain DFT, 1 removes the ramp."""

FIRST_LINE = (1, 1, 20, 40)
"""Lowest harmonic at which each order is allowed; below it the even lines do not show the leakage it amplifies."""

PRICE = 4.0
"""Reduction of the summed log determinant that a change of order must bring."""


def difference_coefficients(x: np.ndarray, start: int, period: int, top: int) -> np.ndarray:
    """Coefficients 0 ... top - 1 of samples start ... start + period - 1 of a record (n, A), (orders, top, A).

    Needs max(`ORDERS`) samples before ``start``.
    """
    w = np.exp(-2j * np.pi * np.arange(1, top) / period)
    out = np.empty((len(ORDERS), top, *x.shape[1:]), dtype=complex)
    for i, order in enumerate(ORDERS):
        cycle = np.diff(x[start - order : start + period], order, axis=0) if order else x[start : start + period]
        out[i] = fft.rfft(cycle, axis=0, norm="forward")[:top]
        out[i, 1:] /= ((1 - w) ** order)[:, None]
    return out


def best_orders(cost: np.ndarray, harmonic: np.ndarray) -> np.ndarray:
    """Index into `ORDERS` per line, (N,), that minimises the summed ``cost`` (orders, N) plus `PRICE` per change.

    ``cost``: log determinant of the noise covariance per order and line; ``harmonic``: (N,) line numbers.
    """
    n_orders, n = cost.shape
    cost = np.where(harmonic >= np.array(FIRST_LINE)[:, None], cost, np.inf)
    change = PRICE * (1 - np.eye(n_orders))
    best, came = cost[:, 0].copy(), np.zeros((n, n_orders), dtype=int)
    for k in range(1, n):
        arrive = best[:, None] + change
        came[k] = arrive.argmin(axis=0)
        best = arrive.min(axis=0) + cost[:, k]
    path = np.empty(n, dtype=int)
    path[-1] = int(best.argmin())
    for k in range(n - 1, 0, -1):
        path[k - 1] = came[k, path[k]]
    return path
