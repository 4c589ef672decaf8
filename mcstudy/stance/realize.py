"""The model table as ordinary differential equations with delays, for one parameter vector.

Every term s^order * filters becomes a polynomial part, which reads the sensed angle, its rate or its acceleration,
and a strictly proper part, which drives filter states in observer canonical form. The result is a list of *links*,
each from a (delayed) signal to a torque or to a filter state; the time simulator runs it and the Chebyshev reference
of the stability test discretises it.

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
from mcstudy.stance.feedback import Model
from mcstudy.stance.rational import filter_polynomials, rational_rows

ANGLE, SENSED, STIMULUS, NOISE = 0, 1, 2, 3
"""Kinds of signal: a joint angle, an angle plus its sensor noise, the stimulus, sensor noise alone."""

PASSIVE, ACTIVE, FILTERS = 0, 2, 4
"""Destinations of a link: PASSIVE + row and ACTIVE + row are torques, FILTERS + i is filter state i."""


@dataclass(frozen=True, slots=True)
class Realisation:
    """One closed loop in the time domain. S signals, L links, Z filter states, G distinct delays.

    Row r:  sum_c mass[r, c] theta_c'' + passive_r + active_r = 0,  where a torque is the sum of its links plus the
    first state of each of its filters. Filter state i:  x_i' = (x_{i+1} unless last) - coefficient_i x_head + links.

    Attributes
    ----------
    mass: (2, 2), undelayed second-order part by (row, angle).
    delay: (G,) s, the first zero.
    signal: (S, 4) int64 - kind, delay group, angle (0 for the stimulus), derivative order.
    link: (L, 2) int64 - signal, destination.
    gain: (L,) coefficient of the link.
    drift: (L,) coefficient per unit of the entries' drift (see `realise`).
    head: (Z,) int64 - first state of the filter that a state belongs to.
    last: (Z,) bool - whether it is the last state of its filter.
    coefficient: (Z,).
    torque_of: (Z,) int64 - destination (torque) that a filter's first state adds to, -1 for other states.
    output: (2, 4) - measured angle c = output[c, k] * (k-th derivative of angle c), k = 0..2, plus the state
        ``output[c, 3]`` (-1 none).
    locks: (2,) int64 - per row the angle that a padded row holds at zero (one-segment models; the row reads
        theta'' = 0 here), -1 for an equation of motion.
    """

    mass: np.ndarray
    delay: np.ndarray
    signal: np.ndarray
    link: np.ndarray
    gain: np.ndarray
    drift: np.ndarray
    head: np.ndarray
    last: np.ndarray
    coefficient: np.ndarray
    torque_of: np.ndarray
    output: np.ndarray
    locks: np.ndarray

    @property
    def fastest_pole(self) -> float:
        """Largest magnitude of a filter's pole, 1/s."""
        poles = [0.0]
        for head in np.unique(self.head):
            poles.extend(np.abs(np.roots([1.0, *self.coefficient[self.head == head]])))
        return max(poles)


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


class _Builder:
    """Collects signals, links and filter states while the rows are divided out."""

    def __init__(self) -> None:
        self.mass = np.zeros((2, 2))
        self.delays = [0.0]
        self.parts: dict[tuple[tuple[int, float, int, int], int], list[float]] = {}
        self.head: list[int] = []
        self.last: list[bool] = []
        self.coefficient: list[float] = []
        self.torque_of: list[int] = []

    def states(self, denominator: np.ndarray, torque: int, where: str) -> int:
        """Add the states of one filter; returns the first, or -1 when the denominator is a constant."""
        d, _ = _monic(denominator, where)
        first = len(self.head)
        self.head += [first] * d.size
        self.last += [i == d.size - 1 for i in range(d.size)]
        self.coefficient += d[::-1].tolist()
        self.torque_of += [torque if i == 0 else -1 for i in range(d.size)]
        return first if d.size else -1

    def link(self, signal: tuple[int, float, int, int], destination: int, value: float, weight_index: int) -> None:
        """Add to a link's gain (``weight_index`` 0) or drift (1). Undelayed acceleration goes to the mass."""
        kind, delay, angle, order = signal
        if value == 0.0:
            return
        if order > 2:
            raise ModelError("a term grows faster than s^2; give it a filter of higher order")
        if order == 2 and delay == 0.0 and kind in (ANGLE, SENSED):
            if weight_index == 1:
                raise ModelError("the gain of an undelayed acceleration term cannot drift")
            self.mass[destination % 2, angle] += value
            if kind == ANGLE:
                return
            signal = (NOISE, delay, angle, order)
        self.parts.setdefault((signal, destination), [0.0, 0.0])[weight_index] += value


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
    ModelError: wrong parameters, a term improper beyond order 2, a negative delay, or a singular mass matrix.
    """
    theta = np.asarray(theta, dtype=float)
    if theta.shape != (len(model.parameters),) or not np.isfinite(theta).all():
        raise ModelError(f"model {model.name}: expected {len(model.parameters)} finite parameters")
    chosen = np.ones(len(model.table.entry), dtype=bool) if entries is None else entries
    scales = [np.ones(chosen.size) if scale is None else scale]
    if drift is not None and drift.any():
        scales.append(drift)
    build = _Builder()
    for kind, part in ((PASSIVE, chosen & ~model.table.noisy), (ACTIVE, chosen & model.table.noisy)):
        if part.any():
            _add_part(build, model, theta, kind, part, scales)
    locks = _lock_padding(build)
    output = _output(build, model, theta)
    mass = build.mass
    if abs(np.linalg.det(mass)) <= 1e-12 * np.abs(mass).max(axis=1).prod():
        raise ModelError(
            f"model {model.name}: the mass matrix (undelayed second-order terms) is singular: {mass.tolist()}; "
            "expected an inertia in every row, a term of order 2 on the row's angle"
        )
    parts = {key: value for key, value in build.parts.items() if value != [0.0, 0.0]}
    signals = list(dict.fromkeys(signal for signal, _ in parts))
    delays = list(dict.fromkeys([0.0, *(delay for _, delay, _, _ in signals)]))
    return Realisation(
        mass=mass,
        delay=np.array(delays),
        signal=np.array([(k, delays.index(d), c, o) for k, d, c, o in signals], dtype=np.int64).reshape(-1, 4),
        link=np.array([(signals.index(s), to) for s, to in parts], dtype=np.int64).reshape(-1, 2),
        gain=np.array([value[0] for value in parts.values()]),
        drift=np.array([value[1] for value in parts.values()]),
        head=np.array(build.head, dtype=np.int64),
        last=np.array(build.last, dtype=bool),
        coefficient=np.array(build.coefficient),
        torque_of=np.array(build.torque_of, dtype=np.int64),
        output=output,
        locks=locks,
    )


def _add_part(
    build: _Builder, model: Model, theta: np.ndarray, kind: int, part: np.ndarray, scales: list[np.ndarray]
) -> None:
    """Divide out the passive or the active part of both rows."""
    for stimulus, scale in enumerate(scales):
        rows = rational_rows(model, theta, part, scale)
        if stimulus == 0:
            first = [
                build.states(rows.denominator[r], kind + r, f"model {model.name}: {model.rows[r]} row") for r in (0, 1)
            ]
        for g, r, c in np.ndindex(rows.delay.size, 2, 3):
            where = f"model {model.name}: {model.rows[r]} row"
            delay, source = float(rows.delay[g]), ANGLE if kind == PASSIVE else SENSED
            for k in range(3):
                polynomial, order = rows.numerator[g, r, c, k], k
                if not polynomial.any():
                    continue
                if source == ANGLE or c == 2 or delay == 0.0:
                    # Nothing tells a rate from a differentiated angle here, and reading the angle needs no
                    # acceleration of the current instant.
                    polynomial, order = np.concatenate([np.zeros(k), polynomial]), 0
                quotient, remainder = _divide(polynomial, rows.denominator[r], where)
                at = (STIMULUS, delay, 0) if c == 2 else (source, delay, c)
                try:
                    for j, value in enumerate(quotient):
                        build.link((*at, order + j), kind + r, float(value), stimulus)
                    for i, value in enumerate(remainder[::-1]):
                        build.link((*at, order), FILTERS + first[r] + i, float(value), stimulus)
                except ModelError as error:
                    raise ModelError(f"{where}: {error}") from None


def _lock_padding(build: _Builder) -> np.ndarray:
    """Turn a first row that is only ``constant * angle = 0`` (the padding of one-segment models) into theta'' = 0."""
    locks = np.full(2, -1, dtype=np.int64)
    mine = [signal for signal, to in build.parts if to in (PASSIVE, ACTIVE)]
    static = len(mine) == 1 and mine[0][::3] == (ANGLE, 0) and mine[0][1] == 0.0
    if static and not build.mass[0].any() and not {PASSIVE, ACTIVE} & set(build.torque_of):
        locks[0] = mine[0][2]
        build.mass[0, locks[0]] = 1.0
        del build.parts[mine[0], PASSIVE]
    return locks


def _output(build: _Builder, model: Model, theta: np.ndarray) -> np.ndarray:
    """Measured angles: polynomial parts of the output filters and the states that realise the rest."""
    output = np.array([[1.0, 0.0, 0.0, -1.0]] * 2)
    for c, name in enumerate(model.output_filters):
        if name is not None:
            where = f"model {model.name}: output filter {name}"
            numerator, denominator = filter_polynomials(model, theta, name)
            quotient, remainder = _divide(numerator.copy(), denominator, where)
            if quotient.size > 3:
                raise ModelError(f"{where}: grows faster than s^2")
            output[c, :3] = 0.0
            output[c, : quotient.size] = quotient
            output[c, 3] = build.states(denominator, -1, where)
            for i, value in enumerate(remainder[::-1]):
                build.link((ANGLE, 0.0, c, 0), FILTERS + int(output[c, 3]) + i, float(value), 0)
    return output
