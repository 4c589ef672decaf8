"""The model table as ordinary differential equations with delays, for one parameter vector.

Every term s^order * filters becomes a polynomial part, which reads the sensed angle, its rate or its acceleration,
and a strictly proper part, which drives filter states in observer canonical form. The result is a list of *links*,
each from a (delayed) signal to a torque or to a filter state; the time simulator runs it and the Chebyshev reference
of the stability test discretises it.

Each unknown has an order, that of its highest undelayed derivative: 2 for an angle whose joint has inertia, less for
auxiliary unknowns, 0 for one that an equation without derivatives defines. The rows together are solved for these
derivatives, so the matrix of their coefficients, of inertias if all orders are 2, must be regular.

There is one set of filter states per row for the passive (noise-free) part and one for the active (noisy) part, so
that the active torque of a row is known by itself. Each set realises the least common multiple of the denominators
of its terms: summed signals pass through one filter, as one muscle or one integrator would do it. A filter that
enters both rows is realised once per row; where one copy would do (a resonant mass) the other is a hidden mode at
the filter's own poles.

Derived (polynomial division and the observer canonical form are textbook linear systems theory).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.errors import ModelError
from mcstudy.stance.feedback import ORDERS, Model
from mcstudy.stance.rational import RationalRows, filter_polynomials, rational_rows

ANGLE, SENSED, STIMULUS, NOISE = 0, 1, 2, 3
"""Kinds of signal: an unknown, an unknown plus its sensor noise, the stimulus, sensor noise alone."""


@dataclass(frozen=True, slots=True)
class Reading:
    """A part of an output: ``coefficient`` times a derivative (``order`` 0 to 2) of an unknown, of the stimulus
    (``unknown`` R), or a filter state (``order`` -1, ``unknown`` its number).
    """

    output: int
    unknown: int
    order: int
    coefficient: float


@dataclass(frozen=True, slots=True)
class Realisation:
    """One closed loop in the time domain. R rows, S signals, L links, Z filter states, G distinct delays.

    Row r:  sum_c leading[r, c] D^order_c x_c + passive_r + active_r = 0,  where a torque is the sum of its links plus
    the first state of each of its filters. Filter state i:
    z_i' = (z_{i+1} unless last) - coefficient_i z_head + links.

    Attributes
    ----------
    order: (R,) int64, order of each unknown, 0 to 2.
    leading: (R, R), undelayed part of the highest order by (row, unknown).
    delay: (G,) s, the first zero.
    signal: (S, 4) int64 - kind, delay group, unknown (0 for the stimulus), derivative order.
    link: (L, 2) int64 - signal, destination: r and R + r are the passive and the active torque of row r, 2R + i is
        filter state i. Those to torques come first.
    gain: (L,) coefficient of the link.
    drift: (L,) coefficient per unit of the entries' drift (see `realise`).
    head: (Z,) int64 - first state of the filter that a state belongs to.
    last: (Z,) bool - whether it is the last state of its filter.
    coefficient: (Z,).
    torque_of: (Z,) int64 - destination (torque) that a filter's first state adds to, -1 for other states.
    readings: parts of the outputs (`Reading`).
    """

    order: np.ndarray
    leading: np.ndarray
    delay: np.ndarray
    signal: np.ndarray
    link: np.ndarray
    gain: np.ndarray
    drift: np.ndarray
    head: np.ndarray
    last: np.ndarray
    coefficient: np.ndarray
    torque_of: np.ndarray
    readings: tuple[Reading, ...]

    @property
    def fastest_pole(self) -> float:
        """Largest magnitude of a filter's pole, and of a pole of the undelayed rows without filters, 1/s."""
        poles = [0.0, *np.abs(np.linalg.eigvals(self._undelayed_rows()))]
        for head in np.unique(self.head):
            poles.extend(np.abs(np.roots([1.0, *self.coefficient[self.head == head]])))
        return float(max(poles))

    def _undelayed_rows(self) -> np.ndarray:
        """Matrix (n, n) of x' = matrix x for the n values and rates that are states, without delays and filters."""
        n = self.order.size
        torque = np.zeros((n, 2 * n))
        for (signal, to), gain in zip(self.link, self.gain, strict=True):
            kind, group, unknown, order = self.signal[signal]
            if kind in (ANGLE, SENSED) and group == 0 and to < 2 * n:
                torque[to % n, unknown + n * order] += gain
        highest = -np.linalg.solve(self.leading, torque)
        matrix = np.zeros((2 * n, 2 * n))
        matrix[:n, n:] = np.eye(n)
        for unknown, order in enumerate(self.order):
            if order:
                matrix[unknown + n * (order - 1)] = highest[unknown]
        states = np.concatenate([self.order >= 1, self.order == 2])
        return np.asarray(matrix[np.ix_(states, states)])


def _monic(polynomial: np.ndarray, where: str) -> tuple[np.ndarray, float]:
    """Ascending coefficients below the leading one, divided by it, and the leading one."""
    used = np.flatnonzero(polynomial)
    if not used.size:
        raise ModelError(f"{where}: a filter's denominator is zero")
    return polynomial[: used[-1]] / polynomial[used[-1]], float(polynomial[used[-1]])


def _divide(numerator: np.ndarray, denominator: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Polynomial part (ascending) and strictly proper remainder (n,) of numerator / denominator, both ascending."""
    d, lead = _monic(denominator, where)
    n, rest = d.size, numerator / lead
    quotient = np.zeros(max(rest.size - n, 1))
    for k in range(rest.size - 1 - n, -1, -1):
        quotient[k] = rest[n + k]
        rest[k : k + n] -= quotient[k] * d
    remainder = np.zeros(n)
    remainder[: min(n, rest.size)] = rest[:n]
    return quotient, remainder


def _orders(model: Model, parts: list[RationalRows]) -> np.ndarray:
    """Order of each unknown, (R,): of its highest undelayed derivative in any row."""
    order = np.zeros(model.n_rows, dtype=np.int64)
    for rows in parts:
        undelayed = rows.folded()[rows.delay == 0.0].any(axis=0)
        below = [np.flatnonzero(denominator).max(initial=0) for denominator in rows.denominator]
        for r, c in np.ndindex(model.n_rows, model.n_rows):
            above = np.flatnonzero(undelayed[r, c])
            order[c] = max(order[c], above.max(initial=0) - below[r])
    if order.max() > 2:
        raise ModelError(f"model {model.name}: a term grows faster than s^2; give it a filter of higher order")
    return order


class _Builder:
    """Collects signals, links and filter states while the rows are divided out."""

    def __init__(self, order: np.ndarray) -> None:
        self.order = order
        self.rows = order.size
        self.leading = np.zeros((self.rows, self.rows))
        self.parts: dict[tuple[tuple[int, float, int, int], int], list[float]] = {}
        self.head: list[int] = []
        self.last: list[bool] = []
        self.coefficient: list[float] = []
        self.torque_of: list[int] = []
        self.readings: list[Reading] = []

    def states(self, denominator: np.ndarray, torque: int, where: str) -> int:
        """Add the states of one filter; returns the first, or -1 when the denominator is a constant."""
        d, _ = _monic(denominator, where)
        first = len(self.head)
        self.head += [first] * d.size
        self.last += [i == d.size - 1 for i in range(d.size)]
        self.coefficient += d[::-1].tolist()
        self.torque_of += [torque if i == 0 else -1 for i in range(d.size)]
        return first if d.size else -1

    def link(self, signal: tuple[int, float, int, int], destination: int, value: float, scale: int = 0) -> None:
        """Add to a link's gain (``scale`` 0) or drift (1). Undelayed parts of the highest order go to ``leading``."""
        kind, delay, unknown, order = signal
        if value == 0.0:
            return
        most = 2 if kind == STIMULUS else int(self.order[unknown])
        if order > most:
            limit = "s^2" if kind == STIMULUS else f"s^{most}, as the undelayed ones do"
            raise ModelError(f"a term grows faster than {limit}; give it a filter of higher order")
        if order == most and delay == 0.0 and kind in (ANGLE, SENSED) and destination < 2 * self.rows:
            if scale == 1:
                raise ModelError("the gain of an undelayed term of the highest order cannot drift")
            self.leading[destination % self.rows, unknown] += value
            if kind == ANGLE:
                return
            signal = (NOISE, delay, unknown, order)
        self.parts.setdefault((signal, destination), [0.0, 0.0])[scale] += value

    def drive(self, signal: tuple[int, float, int, int], first: int, remainder: np.ndarray, scale: int = 0) -> None:
        """Link a signal to the states of the filter that begins with ``first``."""
        for i, value in enumerate(remainder[::-1]):
            self.link(signal, 2 * self.rows + first + i, float(value), scale)


def realise(
    model: Model,
    theta: np.ndarray,
    entries: np.ndarray | None = None,
    scale: np.ndarray | None = None,
    drift: np.ndarray | None = None,
) -> Realisation:
    """Time-domain form of one parameter vector ``theta`` (P,).

    Parameters
    ----------
    entries: (E,) bool, entries of the table to include; all by default.
    scale: (E,) factors on the entries; ones by default.
    drift: (E,) further factors that the simulator multiplies with its clock (-1/2 to 1/2) and adds; zeros by default.

    Raises
    ------
    ModelError: wrong parameters, a term improper beyond order 2, a delayed term of higher order than the undelayed
        ones, a negative delay, or rows that do not determine the highest derivatives.
    """
    theta = np.asarray(theta, dtype=float)
    if theta.shape != (len(model.parameters),) or not np.isfinite(theta).all():
        raise ModelError(f"model {model.name}: expected {len(model.parameters)} finite parameters")
    chosen = np.ones(len(model.table.entry), dtype=bool) if entries is None else entries
    scales = [np.ones(chosen.size) if scale is None else scale]
    if drift is not None and drift.any():
        scales.append(drift)
    kinds = [(active, chosen & (model.table.noisy == active)) for active in (False, True)]
    divided = [(a, [rational_rows(model, theta, part, x) for x in scales]) for a, part in kinds if part.any()]
    build = _Builder(_orders(model, [rows[0] for _, rows in divided]))
    for active, rows in divided:
        _add_part(build, model, active, rows)
    _add_outputs(build, model, theta)
    _require_regular(model, build)
    parts = {key: value for key, value in build.parts.items() if value != [0.0, 0.0]}
    signals = list(dict.fromkeys(signal for signal, _ in parts))
    delays = list(dict.fromkeys([0.0, *(delay for _, delay, _, _ in signals)]))
    parts = dict(sorted(parts.items(), key=lambda part: part[0][1] >= 2 * build.rows))
    return Realisation(
        order=build.order,
        leading=build.leading,
        delay=np.array(delays),
        signal=np.array([(k, delays.index(d), c, o) for k, d, c, o in signals], dtype=np.int64).reshape(-1, 4),
        link=np.array([(signals.index(s), to) for s, to in parts], dtype=np.int64).reshape(-1, 2),
        gain=np.array([value[0] for value in parts.values()]),
        drift=np.array([value[1] for value in parts.values()]),
        head=np.array(build.head, dtype=np.int64),
        last=np.array(build.last, dtype=bool),
        coefficient=np.array(build.coefficient),
        torque_of=np.array(build.torque_of, dtype=np.int64),
        readings=tuple(build.readings),
    )


def _require_regular(model: Model, build: _Builder) -> None:
    """Raise `ModelError` unless the rows determine the highest derivatives."""
    relative = build.leading
    for axis in (1, 0):
        largest = np.abs(relative).max(axis=axis, keepdims=True)
        relative = relative / np.where(largest > 0, largest, 1.0)
    if abs(np.linalg.det(relative)) <= 1e-12:
        highest = [f"{name}{chr(39) * int(k)}" for name, k in zip(model.angles, build.order, strict=True)]
        raise ModelError(
            f"model {model.name}: the undelayed terms do not determine {', '.join(highest)}, the highest derivatives: "
            f"their matrix {build.leading.tolist()} is singular; expected an inertia, a damping or a coefficient of "
            "its own for each"
        )


def _add_part(build: _Builder, model: Model, active: bool, scaled: list[RationalRows]) -> None:
    """Divide out the passive or the active part of the rows; ``scaled``: with gains, then with their drifts."""
    n = build.rows
    torque = [r + n * active for r in range(n)]
    where = [f"model {model.name}: {row} row" for row in model.rows]
    first = [build.states(scaled[0].denominator[r], torque[r], where[r]) for r in range(n)]
    for scale, rows in enumerate(scaled):
        for g, r, c in np.ndindex(rows.delay.size, n, n + 1):
            delay, source = float(rows.delay[g]), SENSED if active else ANGLE
            for k in range(3):
                polynomial, order = rows.numerator[g, r, c, k], k
                if not polynomial.any():
                    continue
                if source == ANGLE or c == n or delay == 0.0 or k > build.order[c]:
                    # Nothing tells a rate from a differentiated angle here, and reading the angle needs no
                    # acceleration of the current instant.
                    polynomial, order = np.concatenate([np.zeros(k), polynomial]), 0
                quotient, remainder = _divide(polynomial, rows.denominator[r], where[r])
                at = (STIMULUS, delay, 0) if c == n else (source, delay, c)
                try:
                    for j, value in enumerate(quotient):
                        build.link((*at, order + j), torque[r], float(value), scale)
                    build.drive((*at, order), first[r], remainder, scale)
                except ModelError as error:
                    raise ModelError(f"{where[r]}: {error}") from None


def _add_outputs(build: _Builder, model: Model, theta: np.ndarray) -> None:
    """What the outputs read: sensors' filters and powers of s divided into derivatives and filter states."""
    one, n = np.ones(1), build.rows
    weights = model.table.output_weight
    weights = np.concatenate([weights[:, :n], weights[:, n:].sum(axis=1, keepdims=True)], axis=1)
    for y, c in np.ndindex(*weights.shape[:2]):
        if not weights[y, c].any():
            continue
        name = model.output_filters[c] if c < n else None
        where = f"model {model.name}: output {model.output_names[y]}"
        above, below = (one, one) if name is None else filter_polynomials(model, theta, name)
        above = np.convolve(weights[y, c], above)
        if weights[y, c, 0]:
            below = np.concatenate([np.zeros(-ORDERS[0]), below])
        else:
            above = above[-ORDERS[0] :]
        quotient, remainder = _divide(above, below, where)
        order = int(build.order[c]) if c < n else 2
        if quotient[order + 1 :].any():
            raise ModelError(f"{where}: reads a derivative beyond order {order}, which the simulation does not have")
        build.readings += [Reading(y, c, k, float(x)) for k, x in enumerate(quotient) if x]
        if remainder.any():
            first = build.states(below, -1, where)
            build.readings.append(Reading(y, first, -1, 1.0))
            build.drive((ANGLE, 0.0, c, 0) if c < n else (STIMULUS, 0.0, 0, 0), first, remainder)
