"""The closed loop as a table of terms.

The R equations of motion are linear in the R joint angles, so the whole model is the R x R matrix

    A(s) = sum over terms of  coefficient * gain * e_row * sense^T * s^order * exp(-delay s) * filters(s)
    A(s) q(s) = b(s) u(s)

with q the joint angles and u the stimulus. An unknown may also be auxiliary, such as a torque that is fed back: its
row is then no balance of torques but the equation that defines it, and needs no inertia. Inertia, gravity, passive
stiffness, every neural controller and the stimulus itself are rows of one table (terms that sense ``"stimulus"`` make
b(s)). The closed form, its exact derivatives, the compiled fit kernel, the stability test and the time-domain
simulator all read this table; no equation of the model is written anywhere else.

What is measured is the Y *outputs*: the angles themselves, or declared sums of angles, their derivatives and the
stimulus, with known numbers,

    y(s) = C(s) diag(F(s)) q(s) + d(s) u(s)

with F the sensors' filters (`Model.output_filters`).

Source of the model: Goodworth & Peterka 2018, Appendix and Fig. 1B (the instances are in `mcstudy.stance.body`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mcstudy.errors import InputError, ModelError
from mcstudy.expressions import expression
from mcstudy.stance.polynomials import pieces
from mcstudy.stance.provenance import with_replaced

MOST_ROWS = 4
"""Most rows of a model."""

ORDERS = (-1, 0, 1, 2)
"""Powers of s that terms and outputs may have."""

ROWS = ("hip", "ankle")
"""Names of the two torque balances of the standing body, in the order of the rows of A(s)."""

ANGLES = ("theta1", "theta2")
"""Names of its two joint angles, in the order of the columns of A(s)."""

SENSES: dict[str, tuple[float, float, float]] = {
    "theta1": (1.0, 0.0, 0.0),
    "theta2": (0.0, 1.0, 0.0),
    "theta2s": (1.0, 1.0, 0.0),
    "stimulus": (0.0, 0.0, -1.0),
}
"""What a term of a standing body may sense, as weights on (theta1, theta2, stimulus). theta2s is the upper body in
space."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One unknown of the model.

    Attributes
    ----------
    name
        Name, e.g. ``"K11"``.
    unit
        Unit as it is written to the cube, e.g. ``"N m/rad"``.
    value
        Nominal ("true") value in that unit.
    lower, upper
        Bounds of the fit and of the uniform starts, in that unit.
    meaning
        Description in one line.

    Raises
    ------
    ModelError
        Bounds are not finite or not in order, or the value is outside them.
    """

    name: str
    unit: str
    value: float
    lower: float
    upper: float
    meaning: str = ""

    def __post_init__(self) -> None:
        if not (np.isfinite([self.value, self.lower, self.upper]).all() and self.lower < self.upper):
            raise ModelError(
                f"parameter {self.name}: bounds must be finite with lower < upper, got [{self.lower}, {self.upper}]"
            )
        if not self.lower <= self.value <= self.upper:
            raise ModelError(
                f"parameter {self.name}: value {self.value} lies outside its bounds [{self.lower}, {self.upper}]"
            )


@dataclass(frozen=True, slots=True)
class Monomial:
    """``coefficient * s**order * product(parameter**power)``: one piece of a filter's numerator or denominator."""

    coefficient: float
    order: int
    powers: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True, slots=True)
class Filter:
    """A rational filter ``sum(numerator) / sum(denominator)`` whose coefficients are monomials of parameters.

    Both may be given as text, ``Filter("lag", "1", "1 + tau*s")``.
    """

    name: str
    numerator: tuple[Monomial, ...]
    denominator: tuple[Monomial, ...]

    def __post_init__(self) -> None:
        for side in ("numerator", "denominator"):
            given = getattr(self, side)
            if isinstance(given, str | int | float):
                object.__setattr__(self, side, tuple(Monomial(*piece) for piece in pieces(given)))


@dataclass(frozen=True, slots=True)
class Term:
    """One row of the model's table: ``coefficient * product(gain) * s^order * e^(-delay s) * filters`` times a signal.

    Attributes
    ----------
    row
        Torque balance it enters, one of the model's ``rows``.
    sense
        The signal: ``"stimulus"``, a name of the model's ``angles`` (``"theta1"``, ``"theta2"``), or a sum of them such
        as ``"theta1 + theta2"``, for which ``"theta2s"`` stands too (the upper body in space).
    gain
        Names of parameters whose product multiplies the term (none, one or two); a single one may be text.
    order
        Power of s: -1 integral, 0 angle, 1 rate, 2 acceleration.
    delay
        Name of the parameter that holds its delay in s, or None.
    filters
        Names of filters it passes through.
    coefficient
        Constant factor.
    noisy
        Whether sensor noise enters the loop here (the active feedback).
    stimulus
        Position of the stimulus that a term with ``sense="stimulus"`` senses among the model's ``blocks``.
    late
        Name of the parameter that holds a further delay in s, added to ``delay`` (of a stimulus that arrives late), or
        None.
    only
        Position of the block in whose lines alone the term is there, because the loop differs between recordings; None
        for a term that is there in all.
    """

    row: str
    sense: str
    gain: tuple[str, ...] = ()
    order: int = 0
    delay: str | None = None
    filters: tuple[str, ...] = ()
    coefficient: float = 1.0
    noisy: bool = False
    stimulus: int = 0
    late: str | None = None
    only: int | None = None

    def __post_init__(self) -> None:
        for names in ("gain", "filters"):
            if isinstance(given := getattr(self, names), str):
                object.__setattr__(self, names, (given,))

    @property
    def all_delays(self) -> tuple[str, ...]:
        """Names of its delays, whose sum delays it; none, one or two."""
        first = () if self.delay is None else (self.delay,)
        return first if self.late is None else (*first, self.late)


@dataclass(frozen=True, slots=True)
class Derived:
    """A quantity that follows from the parameters, ``Derived("sqrt(K/J)/(2*pi)", "Hz", "fn")``.

    Attributes
    ----------
    value
        Arithmetic of parameters, numbers and ``pi``, with sqrt, exp and log (`mcstudy.expressions`).
    unit
        Its unit.
    name
        What it is called; its ``value`` by default.
    meaning
        Description in one line.
    """

    value: str
    unit: str
    name: str = ""
    meaning: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.name or self.value)


def _weights(text: str, angles: tuple[str, ...]) -> tuple[float, ...] | None:
    """Weights of a sum of angles on them and the stimulus, (R + 1,); None for what is no such sum."""
    try:
        total = expression(text, angles, "sense", " + ".join(angles))
    except InputError:
        return None

    def at(values: Iterable[float]) -> float:
        return float(total(dict(zip(angles, values, strict=True))))

    weights = [at(unit) for unit in np.eye(len(angles)).tolist()]
    odd = np.arange(2.0, 2.0 + len(angles))
    linear = at(np.zeros(len(angles))) == 0 and np.isclose(at(odd), odd @ weights)
    return (*weights, 0.0) if linear and any(weights) else None


@dataclass(frozen=True, slots=True)
class OutputTerm:
    """``coefficient * s^order`` times a measured angle, a sum of them, or the stimulus.

    Attributes
    ----------
    sense
        As in `Term`: ``"stimulus"``, one of the model's ``angles``, or a sum of them.
    coefficient
        Constant factor.
    order
        Power of s: -1 integral, 0 the signal itself, 1 rate, 2 acceleration.
    stimulus
        Position of the stimulus among the model's ``blocks``, where ``sense="stimulus"``.
    """

    sense: str
    coefficient: float = 1.0
    order: int = 0
    stimulus: int = 0


@dataclass(frozen=True, slots=True)
class Output:
    """What is measured: the sum of its ``terms`` (`OutputTerm`), under its ``name``, in its ``unit``.

    Numbers only; an output that depends on parameters is an auxiliary unknown with a row of its own.
    """

    name: str
    terms: tuple[OutputTerm, ...]
    unit: str = "rad"

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple(self.terms))


@dataclass(frozen=True, slots=True)
class Block:
    """One of several stimuli: its ``unit``, and the ``lines`` that it evokes.

    ``lines``: their number, one block after the other; or None in all blocks, where every frequency is measured under
    each stimulus in turn. ``name``: what the stimulus is called.
    """

    unit: str
    lines: int | None
    name: str = ""


def any_unit(units: Iterable[str]) -> str:
    """Units of several stimuli in one text, ``"N m or rad"``; empty for none."""
    return " or ".join(dict.fromkeys(units))


@dataclass(frozen=True)
class Model:
    """A closed loop as a table: the sum of the terms of each row is zero.

    Attributes
    ----------
    name
        Name of the model.
    parameters
        The unknowns (`Parameter`); their order is that of every parameter axis.
    terms
        The table (`Term`).
    filters
        Rational filters that terms may pass through.
    output_filters
        Per angle, the name of a filter between the true and the measured angle (a sensor lag), or None; (R,).
    rows
        Names of the R = 1 to 4 torque balances, that of the lowest joint last; those of ``angles`` by default, and
        ``("hip", "ankle")`` for two linked segments.
    angles
        Names of the R joint angles (and auxiliary unknowns), that of the lowest joint first; ``("theta1", "theta2")``
        by default.
    stimulus_unit
        Unit of the stimulus, such as ``"N m"``, ``"m"`` or ``"rad"``.
    provenance
        Origin of the true values, text for people.
    blocks
        Which stimulus evokes which of the frequencies at which responses are asked for (`Block`), one block after the
        other (`mcstudy.stance.joint`) or each frequency under every stimulus in turn; empty for a single stimulus,
        whose responses may be asked for at any frequencies.
    unit
        Unit of the angles.
    outputs
        What is measured (`Output`); the angles themselves when empty.
    derived
        Quantities that follow from the parameters and are reported with them (`Derived`).

    Raises
    ------
    ModelError
        A name is unknown or declared twice, or a term has an order or a number of gains that is not supported.
    """

    name: str
    parameters: tuple[Parameter, ...]
    terms: tuple[Term, ...]
    filters: tuple[Filter, ...] = ()
    output_filters: tuple[str | None, ...] = ()
    rows: tuple[str, ...] = ()
    angles: tuple[str, ...] = ANGLES
    stimulus_unit: str = "N m"
    provenance: str = field(default="", compare=False)
    blocks: tuple[Block, ...] = ()
    unit: str = "rad"
    outputs: tuple[Output, ...] = ()
    derived: tuple[Derived, ...] = ()

    def __post_init__(self) -> None:
        for what in ("parameters", "terms", "filters", "outputs", "derived"):
            object.__setattr__(self, what, tuple(getattr(self, what)))
        if not self.rows:
            object.__setattr__(self, "rows", ROWS if self.angles == ANGLES else tuple(reversed(self.angles)))
        if not any(self.output_filters) and len(self.output_filters) < len(self.angles):
            object.__setattr__(self, "output_filters", (None,) * len(self.angles))
        self._check_axes()
        known, filters = set(self.names), {f.name for f in self.filters}
        for duplicate in {n for n in self.names if self.names.count(n) > 1}:
            raise ModelError(f"model {self.name}: parameter {duplicate} is declared twice")
        for term in self.terms:
            self._check_term(term, known, filters)
        for row in self.rows:
            if not any(t.row == row for t in self.terms):
                raise ModelError(
                    f"model {self.name}: rows: expected a term in each, got none in {row}; a model of one joint has "
                    "one row and one angle"
                )
        for name in self.output_filters:
            if name is not None and name not in filters:
                raise ModelError(f"model {self.name}: unknown output filter {name!r}")
        powers = ((f, p) for f in self.filters for m in (*f.numerator, *f.denominator) for p, _ in m.powers)
        for filt, parameter in powers:
            if parameter not in known:
                raise ModelError(f"model {self.name}: filter {filt.name}: unknown parameter {parameter!r}")

    def _check_axes(self) -> None:
        for what in ("rows", "angles"):
            given = getattr(self, what)
            if not 1 <= len(given) <= MOST_ROWS or len(set(given)) < len(given):
                raise ModelError(
                    f"model {self.name}: {what}: expected one to {MOST_ROWS} different ones, got {given}; a model has "
                    f"at most {MOST_ROWS} joints and auxiliary unknowns"
                )
        for what in ("rows", "output_filters"):
            if len(given := getattr(self, what)) != len(self.angles):
                raise ModelError(
                    f"model {self.name}: {what}: expected {len(self.angles)}, one for each angle, got {given}"
                )
        for name in {o.name for o in self.outputs if [other.name for other in self.outputs].count(o.name) > 1}:
            raise ModelError(f"model {self.name}: output {name} is declared twice")
        for output in self.outputs:
            where = f"model {self.name}: output {output.name}"
            for term in output.terms:
                self._check_signal(term, where)
                if not np.isfinite(term.coefficient):
                    raise ModelError(f"{where}: expected a finite coefficient, got {term.coefficient}")

    def _check_signal(self, term: Term | OutputTerm, where: str) -> None:
        if term.sense not in self.senses:
            raise ModelError(f"{where}: sense must be one of {sorted(self.senses)}, or a sum of {self.angles}")
        if term.order not in ORDERS:
            raise ModelError(f"{where}: order must be -1, 0, 1 or 2, got {term.order}")
        if not 0 <= term.stimulus < max(1, len(self.blocks)):
            raise ModelError(f"{where}: unknown stimulus {term.stimulus}")

    def _check_term(self, term: Term, known: set[str], filters: set[str]) -> None:
        where = f"model {self.name}: term {term.row} <- {term.sense}"
        if term.row not in self.rows:
            raise ModelError(f"{where}: row must be one of {self.rows}")
        self._check_signal(term, where)
        if term.only is not None and not 0 <= term.only < len(self.blocks):
            raise ModelError(f"{where}: unknown block {term.only}")
        if len(term.gain) > 2:
            raise ModelError(f"{where}: at most two gains may multiply, got {term.gain}")
        for unknown in {*term.gain, *term.all_delays} - known:
            raise ModelError(f"{where}: unknown parameter {unknown!r}")
        for unknown in set(term.filters) - filters:
            raise ModelError(f"{where}: unknown filter {unknown!r}")

    @cached_property
    def senses(self) -> dict[str, tuple[float, ...]]:
        """Weights on the R angles and the stimulus, (R + 1,), by name: angles, and the sums of them that are sensed.

        The weight of the stimulus is -1, because its terms belong to the other side, b(s).
        """
        known: dict[str, tuple[float, ...]] = dict(SENSES) if self.n_rows == len(ANGLES) else {}
        known |= {a: (*(float(a == b) for b in self.angles), 0.0) for a in self.angles}
        known["stimulus"] = (*(0.0 for _ in self.angles), -1.0)
        for sense in (*(t.sense for t in self.terms), *(t.sense for o in self.outputs for t in o.terms)):
            if sense not in known and (weights := _weights(sense, self.angles)):
                known[sense] = weights
        return known

    @property
    def stimulus_names(self) -> tuple[str, ...]:
        """Names of the J stimuli; ``"stimulus"`` alone where there is one without a name."""
        return tuple(b.name or f"stimulus {k + 1}" for k, b in enumerate(self.blocks)) or ("stimulus",)

    @property
    def n_rows(self) -> int:
        """R, rows of A(s): joints and auxiliary unknowns."""
        return len(self.rows)

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of what is measured, (Y,): the label of every array of responses."""
        return tuple(o.name for o in self.outputs) or self.angles

    @property
    def output_units(self) -> tuple[str, ...]:
        """Units of the outputs, (Y,)."""
        return tuple(o.unit for o in self.outputs) or (self.unit,) * len(self.angles)

    @property
    def n_outputs(self) -> int:
        """Y, what is measured."""
        return len(self.outputs) or len(self.angles)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameter names, in the order of every parameter axis."""
        return tuple(p.name for p in self.parameters)

    @property
    def truth(self) -> np.ndarray:
        """Nominal parameter values, shape (P,)."""
        return np.array([p.value for p in self.parameters])

    @property
    def lower(self) -> np.ndarray:
        """Lower bounds, shape (P,)."""
        return np.array([p.lower for p in self.parameters])

    @property
    def upper(self) -> np.ndarray:
        """Upper bounds, shape (P,)."""
        return np.array([p.upper for p in self.parameters])

    def stimulus_at(self, n: int) -> np.ndarray | None:
        """(n,) int64, the stimulus that evokes each of ``n`` frequencies; None for a model with a single stimulus.

        Raises `ModelError` unless the blocks hold as many lines.
        """
        if not self.blocks:
            return None
        lines = [b.lines for b in self.blocks if b.lines is not None]
        if not lines:
            if n % len(self.blocks):
                raise ModelError(
                    f"model {self.name}: expected every frequency under each of {len(self.blocks)} stimuli in turn, "
                    f"got {n} frequencies"
                )
            return np.tile(np.arange(len(self.blocks)), n // len(self.blocks))
        if sum(lines) != n:
            raise ModelError(f"model {self.name}: expected the {sum(lines)} lines of its stimuli, got {n} frequencies")
        return np.repeat(np.arange(len(lines)), lines)

    @cached_property
    def loops_differ(self) -> bool:
        """Whether the loop, not only the stimulus, differs between the blocks (`Term.only`)."""
        return any(t.only is not None for t in self.terms)

    @property
    def units(self) -> tuple[str, ...]:
        """Parameter units, shape (P,)."""
        return tuple(p.unit for p in self.parameters)

    @cached_property
    def delays(self) -> tuple[str, ...]:
        """Names of the parameters that are delays."""
        used = {name for t in self.terms for name in t.all_delays}
        return tuple(n for n in self.names if n in used)

    @cached_property
    def weights(self) -> tuple[str, ...]:
        """Names of the parameters that are sensory weights: the second gain of active terms that sense the stimulus."""
        used = {t.gain[1] for t in self.terms if t.noisy and t.sense == "stimulus" and len(t.gain) == 2}
        return tuple(n for n in self.names if n in used)

    @property
    def senses_motion(self) -> bool:
        """Whether a term or an output holds the rate or the acceleration of the stimulus."""
        sensed: list[Term | OutputTerm] = [*self.terms, *(t for o in self.outputs for t in o.terms)]
        return any(t.sense == "stimulus" and t.order > 0 for t in sensed)

    def with_values(self, values: Mapping[str, float]) -> Model:
        """This model with other nominal values (bounds unchanged); raises `ModelError` on an unknown name."""
        self.check_names(values)
        parameters = tuple(replace(p, value=values.get(p.name, p.value)) for p in self.parameters)
        replaced = [p.name for p in self.parameters if values.get(p.name, p.value) != p.value]
        return replace(self, parameters=parameters, provenance=with_replaced(self.provenance, replaced, self.names))

    def with_bounds(self, bounds: Mapping[str, tuple[float, float]]) -> Model:
        """This model with other bounds; raises `ModelError` on an unknown name or a value left outside."""
        self.check_names(bounds)
        return replace(
            self,
            parameters=tuple(
                replace(p, lower=bounds[p.name][0], upper=bounds[p.name][1]) if p.name in bounds else p
                for p in self.parameters
            ),
        )

    def with_terms(
        self,
        parameters: Iterable[Parameter] = (),
        terms: Iterable[Term] = (),
        filters: Iterable[Filter] = (),
        name: str | None = None,
    ) -> Model:
        """This model with more parameters, terms and filters: how an unmodelled effect is added."""
        return replace(
            self,
            name=name or self.name,
            parameters=(*self.parameters, *parameters),
            terms=(*self.terms, *terms),
            filters=(*self.filters, *filters),
        )

    def check_names(self, names: Iterable[str]) -> None:
        """Raise `ModelError` for a name that is no parameter."""
        for name in names:
            if name not in self.names:
                raise ModelError(f"unknown parameter {name!r}; the model has {', '.join(self.names)}")

    @cached_property
    def table(self) -> Table:
        """The flat numeric form of this model."""
        return Table.of(self)


@dataclass(frozen=True, slots=True)
class Table:
    """A `Model` as arrays, for the code that evaluates it. E terms, G groups, F filters, M monomials.

    A *group* is a distinct (delays, filters, block) triple; terms of one group share the factor exp(-delay s) *
    filters(s), with the sum of its delays, which is zero at the lines of other blocks where the group is of one alone.

    Attributes
    ----------
    entry: (E, 5) int64 - row (0 to R - 1), order, group, first gain, second gain (parameter indices, -1 none).
    weight: (E, 1 + R + 1) float64 - coefficient, then weights on the R angles, and last on the stimulus, -1 where it is
        sensed: A(s) q holds what is positive, b(s) the negative of its last column.
    noisy: (E,) bool - whether sensor noise enters the term.
    stimulus: (E,) int64 - which stimulus it senses, if it senses one.
    group_delay: (G, 2) int64 - parameter indices of the delays, -1 none; the second only where there is a first.
    group_filters: (G, 4) int64 - filter indices, -1 none.
    group_only: (G,) int64 - the block in whose lines alone its terms are there, -1 all.
    monomial: (M, 6) int64 - filter, 0 numerator / 1 denominator, order, power of the second parameter,
        first parameter, second parameter (-1 none); the first parameter's power is in ``monomial_power``.
    monomial_power: (M,) int64 - power of the first parameter.
    monomial_coefficient: (M,) float64.
    output_filter: (R,) int64 - filter index per angle, -1 none.
    output_weight: (Y, R + J, 4) float64 - what the Y outputs hold of the R measured angles and of each of J stimuli (1,
        or one for each of the model's ``blocks``), by power of s from -1 to 2; the identity at s^0 where the angles
        are the outputs.
    n_parameters, n_filters: sizes.
    """

    entry: np.ndarray
    weight: np.ndarray
    noisy: np.ndarray
    stimulus: np.ndarray
    group_delay: np.ndarray
    group_filters: np.ndarray
    group_only: np.ndarray
    monomial: np.ndarray
    monomial_power: np.ndarray
    monomial_coefficient: np.ndarray
    output_filter: np.ndarray
    output_weight: np.ndarray
    n_parameters: int
    n_filters: int

    @classmethod
    def of(cls, model: Model) -> Table:
        """Flatten a model."""
        index = {name: i for i, name in enumerate(model.names)}
        filter_index = {f.name: i for i, f in enumerate(model.filters)}
        groups: dict[tuple[tuple[int, ...], tuple[int, ...], int], int] = {}
        entry, weight, noisy = [], [], []
        for term in model.terms:
            delays = [index[name] for name in term.all_delays] + [-1, -1]
            only = -1 if term.only is None else term.only
            key = (tuple(delays[:2]), tuple(filter_index[f] for f in term.filters), only)
            group = groups.setdefault(key, len(groups))
            gains = [index[g] for g in term.gain] + [-1, -1]
            entry.append((model.rows.index(term.row), term.order, group, gains[0], gains[1]))
            weight.append((term.coefficient, *model.senses[term.sense]))
            noisy.append(term.noisy)
        group_filters = np.full((len(groups), 4), -1, dtype=np.int64)
        for (_, members, _), g in groups.items():
            if len(members) > 4:
                raise ModelError(f"model {model.name}: a term may pass through at most four filters")
            group_filters[g, : len(members)] = members
        monomial, power, coefficient = [], [], []
        for f, filt in enumerate(model.filters):
            for side, monomials in enumerate((filt.numerator, filt.denominator)):
                for m in monomials:
                    if len(m.powers) > 2:
                        raise ModelError(f"filter {filt.name}: a monomial may hold at most two parameters")
                    names = [index[n] for n, _ in m.powers] + [-1, -1]
                    powers = [p for _, p in m.powers] + [0, 0]
                    monomial.append((f, side, m.order, powers[1], names[0], names[1]))
                    power.append(powers[0])
                    coefficient.append(m.coefficient)
        output = [filter_index[name] if name is not None else -1 for name in model.output_filters]
        return cls(
            entry=np.array(entry, dtype=np.int64).reshape(-1, 5),
            weight=np.array(weight, dtype=np.float64).reshape(-1, model.n_rows + 2),
            noisy=np.array(noisy, dtype=bool),
            stimulus=np.array([t.stimulus for t in model.terms], dtype=np.int64),
            group_delay=np.array([d for d, _, _ in groups], dtype=np.int64).reshape(-1, 2),
            group_filters=group_filters,
            group_only=np.array([only for _, _, only in groups], dtype=np.int64),
            monomial=np.array(monomial, dtype=np.int64).reshape(-1, 6),
            monomial_power=np.array(power, dtype=np.int64),
            monomial_coefficient=np.array(coefficient, dtype=np.float64),
            output_filter=np.array(output, dtype=np.int64),
            output_weight=_output_weight(model),
            n_parameters=len(model.parameters),
            n_filters=len(model.filters),
        )

    @property
    def n_rows(self) -> int:
        """R."""
        return len(self.output_filter)

    def gains(self, theta: np.ndarray) -> np.ndarray:
        """Coefficient of every term times its gains at parameters ``theta`` (..., P), (..., E)."""
        padded = np.concatenate([theta, np.ones((*theta.shape[:-1], 1))], axis=-1)  # where -1, no gain, points to
        return np.asarray(self.weight[:, 0] * padded[..., self.entry[:, 3]] * padded[..., self.entry[:, 4]])


def _output_weight(model: Model) -> np.ndarray:
    """`Table.output_weight`."""
    R, J = model.n_rows, max(1, len(model.blocks))
    weight = np.zeros((model.n_outputs, R + J, len(ORDERS)))
    if not model.outputs:
        weight[:, :R, ORDERS.index(0)] = np.eye(R)
    for mine, output in zip(weight, model.outputs, strict=False):
        for term in output.terms:
            *angles, stimulus = model.senses[term.sense]
            at = ORDERS.index(term.order)
            mine[:R, at] += term.coefficient * np.array(angles)
            mine[R + term.stimulus, at] -= term.coefficient * stimulus
    return weight
