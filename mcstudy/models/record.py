"""A model as a table of a file: what a user writes, its checks, and the same as `mcstudy.stance.feedback.Model`.

The table holds names and numbers only. Numbers may be arithmetic of the model's constants (``"m*g*h"``), filters
polynomials of s and of parameters (``"1 + tau*s"``).
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, SerializerFunctionWrapHandler, StringConstraints, model_serializer

from mcstudy.errors import DesignError, InputError, ModelError
from mcstudy.expressions import Expression, expression, shortened
from mcstudy.files.sections import Section, without_defaults
from mcstudy.models.quantities import expression as quantity_of
from mcstudy.models.quantities import require_finite
from mcstudy.stance.body import DELAY_MARGIN
from mcstudy.stance.feedback import (
    MOST_ROWS,
    SENSES,
    Block,
    Derived,
    Filter,
    Model,
    Monomial,
    Output,
    OutputTerm,
    Parameter,
    Term,
    any_unit,
)
from mcstudy.stance.polynomials import pieces, written
from mcstudy.text_tables import similar

Symbol = Annotated[str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,63}$")]
"""A name that arithmetic can hold."""

Words = Annotated[str, StringConstraints(max_length=200)]
Number = float | Annotated[str, StringConstraints(max_length=4000)]
"""A number, or arithmetic of the model's constants."""

RESERVED = ("s", "pi", "sqrt", "exp", "log", "stimulus")

MOST = Field(max_length=1000)


def _listed(given: Any) -> Any:
    """A single name as a list of one."""
    return (given,) if isinstance(given, str) else tuple(given) if isinstance(given, list) else given


Names = Annotated[
    tuple[Symbol, ...], MOST, BeforeValidator(_listed, json_schema_input_type=Symbol | tuple[Symbol, ...])
]
"""Names, or a single one."""


class Short(Section):
    """A table that leaves out what has its default, so that a new key changes no design and no fingerprint."""

    @model_serializer(mode="wrap")
    def _short(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return without_defaults(self, dump(self), type(self).model_fields)


class ParameterTable(Short):
    """An unknown of the model: its true value, and bounds of the fit.

    Without bounds they are 0 and twice the value, and of a delay the value plus and minus 30 ms.
    """

    name: Symbol
    unit: Words = ""
    value: Number
    lower: Number | None = None
    upper: Number | None = None
    meaning: Words = ""

    def scaled(self, ratio: float) -> ParameterTable:
        """The numbers of a gain in N m times ``ratio``, of one per N m over it; arithmetic of constants follows."""
        power = 1 if self.unit.startswith("N m") else -1 if self.unit.endswith("/(N m)") else 0
        given = {n: v for n in ("value", "lower", "upper") if isinstance(v := getattr(self, n), float | int)}
        return self.model_copy(update={name: value * ratio**power for name, value in given.items()}) if power else self


class TermTable(Short):
    """A torque that is proportional to a signal: coefficient, gains, s^order, delays and filters times what is sensed.

    In the balance of a ``joint``, the sum of the terms that sense joints equals the sum of those that sense the
    stimulus. ``sense``: a joint, ``stimulus`` (the name of one of several), or a sum such as ``ankle + hip``; the joint
    itself when left out.
    """

    joint: Symbol | None = None
    sense: Words | None = None
    gain: Names = ()
    order: int = 0
    delay: Names = ()
    filter: Names = ()
    coefficient: Number = 1.0
    noisy: bool = False


class FilterTable(Short):
    """A ratio of two polynomials of s, whose coefficients hold parameters and constants."""

    name: Symbol
    numerator: Number = 1.0
    denominator: Number = 1.0


class StimulusTable(Short):
    """One of several stimuli, each applied in recordings of its own; terms and outputs sense it by its name."""

    name: Symbol
    unit: Words = "N m"


class OutputTable(Short):
    """What is measured: ``value = "ankle + w*hip"`` of joint angles, the stimulus, powers of s and constants.

    Without a unit it has that of the angles.
    """

    name: Words
    value: Number
    unit: Words | None = None


class DerivedTable(Short):
    """A quantity that follows from parameters and constants: ``value = "sqrt(K/J)/(2*pi)"``.

    Without a name it is called as its value is written. A plain sum of parameters has their unit.
    """

    value: Annotated[str, StringConstraints(max_length=4000)]
    name: Words = ""
    unit: Words = ""
    meaning: Words = ""


class ModelTable(Short):
    """A closed loop of one to four joints and auxiliary unknowns, as a file declares it.

    ``angles``: names of the joint angles where they are not those of the joints. ``sensor_filter``: filter between the
    true and the measured angle, by joint. ``output``: what is measured, where it is not the angles. ``stimulus``: the
    stimuli, where there are several. ``provenance``: where the true values come from.
    """

    name: Symbol | None = None
    description: str = ""
    joints: Annotated[tuple[Symbol, ...], MOST] = ()
    angles: Annotated[tuple[Symbol, ...], MOST] = ()
    unit: Words = "rad"
    stimulus_unit: Words = "N m"
    provenance: Annotated[str, StringConstraints(max_length=2000)] = ""
    constants: dict[Symbol, Number] = Field(default={}, max_length=1000)
    parameter: Annotated[tuple[ParameterTable, ...], MOST] = ()
    term: Annotated[tuple[TermTable, ...], MOST] = ()
    filter: Annotated[tuple[FilterTable, ...], MOST] = ()
    sensor_filter: dict[Symbol, Symbol] = Field(default={})
    output: Annotated[tuple[OutputTable, ...], MOST] = ()
    stimulus: Annotated[tuple[StimulusTable, ...], MOST] = ()
    derived: Annotated[tuple[DerivedTable, ...], MOST] = ()

    def values(self) -> dict[str, float]:
        """The constants as numbers."""
        return resolved(self.constants)

    def with_constants(self, given: Mapping[str, float]) -> ModelTable:
        """The table with numbers of a person in place of its own; gains follow the ratio of ``mgh``, if that is one.

        Raises `DesignError` for a name that is no constant of the model.
        """
        for name in given:
            _known(name, self.constants, f"constants.{name}")
        table = self.model_copy(update={"constants": {**self.constants, **given}})
        if "mgh" not in given:
            return table
        ratio = given["mgh"] / self.values()["mgh"]
        return table.model_copy(update={"parameter": tuple(p.scaled(ratio) for p in self.parameter)})

    @property
    def stimuli(self) -> tuple[str, ...]:
        """Names of the stimuli; ``"stimulus"`` where there is one."""
        return tuple(s.name for s in self.stimulus) or ("stimulus",)

    @property
    def delays(self) -> set[str]:
        """Names of the parameters that are delays."""
        return {name for t in self.term for name in t.delay}

    def model(self, lower: float = 0.0, upper: float = 2.0, delay_margin_s: float = DELAY_MARGIN) -> Model:
        """The model; `DesignError`, one line that starts with the field, for the first mistake.

        ``lower``, ``upper``: bounds where the table has none, as multiples of the value; ``delay_margin_s``: of delays.
        """
        _check_names(self)
        known = self.values()
        names = {p.name for p in self.parameter}
        multiples = (lower, upper)
        rows, angles = self._axes()
        joints = dict(zip(self.joints, angles[: len(self.joints)], strict=True))
        parameters = tuple(
            _parameter(p, known, multiples, delay_margin_s if p.name in self.delays else None) for p in self.parameter
        )
        filters = tuple(self._filter(f, known, names) for f in self.filter)
        terms = tuple(self._term(t, f"term.{i}", known, names, joints) for i, t in enumerate(self.term))
        for joint, name in self.sensor_filter.items():
            _known(joint, self.joints, f"sensor_filter.{joint}")
            _known(name, [f.name for f in filters], f"sensor_filter.{joint}")
        measured = tuple(self.sensor_filter.get(joint) for joint in self.joints)
        outputs = tuple(self._output(o, known, joints) for o in self.output)
        self._check_used(terms, filters)
        try:
            model = Model(
                self.name or "model",
                parameters,
                terms,
                filters,
                measured if any(measured) else (),
                rows,
                angles,
                any_unit(s.unit for s in self.stimulus) or self.stimulus_unit,
                self.provenance,
                tuple(Block(s.unit, None, s.name) for s in self.stimulus),
                self.unit,
                outputs,
            )
        except ModelError as error:
            raise DesignError(str(error)) from None
        return replace(model, derived=tuple(_derived(d, known, model) for d in self.derived))

    def _axes(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        if not self.joints:
            raise DesignError(f"joints: missing, expected the names of one to {MOST_ROWS} joints")
        if len(self.joints) > MOST_ROWS:
            raise DesignError(f"joints: expected one to {MOST_ROWS} names, got {len(self.joints)}")
        angles = self.angles or self.joints
        if len(angles) != len(self.joints):
            raise DesignError(f"angles: expected one name for each of {len(self.joints)} joints, got {len(angles)}")
        return tuple(reversed(self.joints)), angles

    def _output(self, table: OutputTable, known: Mapping[str, float], joints: Mapping[str, str]) -> Output:
        """A sum of joint angles, their derivatives and the stimulus."""
        where = f"output.{table.name}"
        signals = {**joints, **{angle: angle for angle in joints.values()}}
        stimuli = {name: k for k, name in enumerate(self.stimuli)}
        try:
            polynomial = pieces(table.value, known)
        except ModelError as error:
            raise DesignError(f"{where}.value: {error}") from None
        terms, summed = [], ", ".join([*signals, *stimuli])
        for coefficient, order, powers in polynomial:
            for name, _ in powers:
                _known(name, [*signals, *stimuli, *known], f"{where}.value")
            if len(powers) != 1 or powers[0][1] != 1:
                raise DesignError(
                    f"{where}.value: expected a sum of {summed}, each times constants and powers of s, got "
                    f"{table.value!r}"
                )
            ((name, _),) = powers
            terms.append(OutputTerm(signals.get(name, "stimulus"), coefficient, order, stimuli.get(name, 0)))
        if not any(t.coefficient for t in terms):
            raise DesignError(f"{where}.value: expected a sum of {summed}, got nothing: {table.value!r}")
        return Output(table.name, tuple(terms), self.unit if table.unit is None else table.unit)

    def _filter(self, table: FilterTable, known: Mapping[str, float], names: set[str]) -> Filter:
        sides, orders = [], []
        for side in ("numerator", "denominator"):
            where = f"filter.{table.name}.{side}"
            try:
                polynomial = pieces(getattr(table, side), known)
            except ModelError as error:
                raise DesignError(f"{where}: {error}") from None
            for _, _, powers in polynomial:
                for name, _ in powers:
                    _known(name, [*names, *known], where)
            sides.append(tuple(Monomial(*piece) for piece in polynomial))
            orders.append([order for _, order, _ in polynomial])
        if min(map(min, orders)) < 0:
            raise DesignError(f"filter.{table.name}: expected powers of s of at least 0 above and below")
        if max(orders[0]) > max(orders[1]):
            raise DesignError(
                f"filter.{table.name}.numerator: expected at most the power of s of the denominator, s^{max(orders[1])}"
                f" (a proper filter), got s^{max(orders[0])}"
            )
        return Filter(table.name, sides[0], sides[1])

    def _term(
        self, t: TermTable, where: str, known: Mapping[str, float], names: set[str], joints: Mapping[str, str]
    ) -> Term:
        if t.joint is None and len(self.joints) > 1:
            raise DesignError(f"{where}.joint: missing, expected one of {', '.join(self.joints)}")
        joint = t.joint or self.joints[0]
        _known(joint, self.joints, f"{where}.joint")
        for field, most, wanted in (
            ("gain", 2, names),
            ("delay", 2, names),
            ("filter", 4, {f.name for f in self.filter}),
        ):
            given = getattr(t, field)
            what = "the name of a filter" if field == "filter" else "the name of a parameter"
            for name in given:
                if name not in wanted:
                    raise DesignError(
                        f"{where}.{field}: expected {what}, one of {', '.join(sorted(wanted))}, got {name!r}"
                    )
            if len(given) > most:
                raise DesignError(f"{where}.{field}: expected at most {most} names, got {len(given)}")
        if t.order not in (-1, 0, 1, 2):
            raise DesignError(f"{where}.order: expected -1 (integral), 0, 1 (rate) or 2 (acceleration), got {t.order}")
        sense = self._sense(t.sense or joint, joints, f"{where}.sense")
        coefficient = number(t.coefficient, known, f"{where}.coefficient")
        delay, late = (*t.delay, None, None)[:2]
        stimulus = 0
        if sense in self.stimuli:
            sense, stimulus = "stimulus", self.stimuli.index(sense)
        return Term(joint, sense, t.gain, t.order, delay, t.filter, coefficient, t.noisy, stimulus, late)

    def _sense(self, sense: str, joints: Mapping[str, str], where: str) -> str:
        """What a term senses, by the names of angles; joints stand for their angles."""
        if sense in self.stimuli or sense in joints.values():
            return sense
        text = re.sub(r"[A-Za-z_]\w*", lambda m: joints.get(m.group(), m.group()), sense)
        try:
            expression(text, joints.values(), "sum", " + ".join(self.joints))
        except InputError:
            known = ", ".join(dict.fromkeys([*self.joints, *joints.values()]))
            raise DesignError(
                f"{where}: expected {', '.join(self.stimuli)}, {known}, or a sum of joints, got {sense!r}"
            ) from None
        return text

    def _check_used(self, terms: tuple[Term, ...], filters: tuple[Filter, ...]) -> None:
        through = {f for t in terms for f in t.filters} | set(self.sensor_filter.values())
        used = {name for t in terms for name in (*t.gain, *t.all_delays)}
        for f in filters:
            if f.name not in through:
                raise DesignError(
                    f"filter.{f.name}: expected a filter that a term passes through, got one that none does"
                )
            used |= {name for m in (*f.numerator, *f.denominator) for name, _ in m.powers}
        for p in self.parameter:
            if p.name not in used:
                raise DesignError(f"parameter.{p.name}: expected a parameter that a term holds, got one that none does")
        if not self.parameter:
            raise DesignError("parameter: missing, expected at least one table [[model.parameter]]")
        for k, name in enumerate(self.stimuli):
            if not any(t.sense == "stimulus" and t.stimulus == k for t in terms):
                raise DesignError(f"term: expected one that senses the {name}, got none")
        for joint in self.joints:
            if not any(t.row == joint for t in terms):
                raise DesignError(f"joints: expected terms in the balance of every joint, got none for {joint}")

    @classmethod
    def of(cls, model: Model) -> ModelTable:
        """The table of a model, with numbers for all arithmetic. Raises `ModelError` for a set of several stimuli."""
        return cls(**table_of(model))


def resolved(constants: Mapping[str, Number]) -> dict[str, float]:
    """Values of constants that may hold each other; `DesignError` for a cycle or an unknown name."""
    values: dict[str, float] = {}
    waiting = dict(constants)
    formulas = {}
    for name, given in constants.items():
        try:
            formulas[name] = _arithmetic(given, constants)
        except InputError as error:
            raise DesignError(f"constants.{name}: {error}") from None
    while waiting:
        ready = [n for n in waiting if formulas[n].names <= values.keys() | {"pi"}]
        if not ready:
            raise DesignError(f"constants.{next(iter(waiting))}: expected no cycle, got one of {', '.join(waiting)}")
        for name in ready:
            values[name] = number(waiting.pop(name), values, f"constants.{name}")
    return values


def number(given: Number, known: Mapping[str, float], where: str) -> float:
    """The value of a number or of arithmetic of known constants; `DesignError` for what has none."""
    try:
        value = _arithmetic(given, known)({"pi": np.pi, **known})
    except InputError as error:
        raise DesignError(f"{where}: {error}") from None
    if not np.isfinite(value):
        raise DesignError(f"{where}: expected a finite number, got {given!r} = {value}")
    return float(value)


def _arithmetic(given: Number, known: Collection[str]) -> Expression:
    text = given if isinstance(given, str) else repr(float(given))
    return expression(text, [*known, "pi"], "number", "m*g*h")


def _parameter(
    table: ParameterTable, known: Mapping[str, float], multiples: tuple[float, float], margin: float | None
) -> Parameter:
    """A parameter with its bounds; ``margin``: of a delay, s."""
    where = f"parameter.{table.name}"
    value = number(table.value, known, f"{where}.value")
    usual = sorted(m * value for m in multiples) if margin is None else (value - margin, value + margin)
    low, high = (
        given if given is None else number(given, known, f"{where}.{name}")
        for name, given in (("lower", table.lower), ("upper", table.upper))
    )
    low, high = usual[0] if low is None else low, usual[1] if high is None else high
    if not low < high:
        raise DesignError(f"{where}.lower: expected less than upper, got {low:g} and {high:g}")
    if not low <= value <= high:
        raise DesignError(f"{where}.value: expected a value inside its bounds {low:g} to {high:g}, got {value:g}")
    if margin is not None and low < 0:
        raise DesignError(f"{where}.lower: expected a delay of at least 0 s, got {low:g}")
    return Parameter(table.name, table.unit, value, low, high, table.meaning)


def _derived(table: DerivedTable, known: Mapping[str, float], model: Model) -> Derived:
    """A quantity with numbers for its constants, checked at the true values of the model."""
    where = f"derived.{shortened(table.name or table.value)}"
    numbers = {name: f"({value!r})" for name, value in known.items()}
    text = re.sub(r"\b[A-Za-z_]\w*", lambda m: numbers.get(m.group(), m.group()), table.value)
    try:
        expression(table.value, [*model.names, *known, "pi"], "derived", "sqrt(K/J)/(2*pi)")
        quantity = quantity_of(model, text)
        require_finite(model, [quantity], model.truth)
    except InputError as error:
        raise DesignError(f"{where}: {error}") from None
    if quantity.unit and table.unit not in ("", quantity.unit):
        raise DesignError(f"{where}.unit: expected {quantity.unit}, that of what it adds up, got {table.unit!r}")
    return Derived(text, table.unit or quantity.unit, table.name or table.value, table.meaning)


def _known(name: str, among: Collection[str], where: str) -> None:
    if name not in among:
        raise DesignError(f"{where}: expected one of {', '.join(among)}, got {name!r}{similar(name, among)}")


def _check_names(table: ModelTable) -> None:
    """Raise `DesignError` for a name that stands for two things."""
    taken: dict[str, str] = dict.fromkeys(RESERVED, "a word of the grammar")
    for what, names in (
        ("joint", table.joints),
        ("stimulus", [s.name for s in table.stimulus]),
        ("constant", table.constants),
        ("parameter", [p.name for p in table.parameter]),
        ("filter", [f.name for f in table.filter]),
        ("output", [o.name for o in table.output if o.name not in (*table.joints, *table.angles)]),
        ("derived", [d.name or d.value for d in table.derived]),
    ):
        for name in names:
            if name in taken:
                raise DesignError(f"{what}.{name}: expected a name of its own, got one that is {taken[name]}, too")
            taken[name] = f"{'an' if what[0] in 'aeiou' else 'a'} {what}"
    for angle in table.angles:
        if table.angles.count(angle) > 1 or (angle in taken and angle not in table.joints):
            raise DesignError(f"angles: expected names of their own, got {angle!r} twice")


def table_of(model: Model) -> dict[str, Any]:
    """The plain table of a model, without what has its default."""
    if any(b.lines is not None for b in model.blocks):
        raise ModelError(f"model {model.name}: expected stimuli that share their lines, got those of recordings")
    joints, angles = tuple(reversed(model.rows)), model.angles
    sums = {model.senses[angle]: angle for angle in angles}
    if len(angles) == len(SENSES["theta2s"]) - 1:
        sums[SENSES["theta2s"]] = " + ".join(angles)
    own = angles[0] if len(angles) == 1 else ""

    def term(t: Term) -> dict[str, Any]:
        named = t.sense in angles
        sense = t.sense if named else sums.get(model.senses[t.sense], t.sense)
        if t.sense == "stimulus":
            sense = model.stimulus_names[t.stimulus]
        return {
            "joint": None if len(angles) == 1 else t.row,
            "sense": None if sense == own else sense,
            "gain": t.gain,
            "order": t.order,
            "delay": t.all_delays,
            "filter": t.filters,
            "coefficient": float(t.coefficient),
            "noisy": t.noisy,
        }

    def polynomial(monomials: tuple[Monomial, ...]) -> str:
        return written(tuple((m.coefficient, m.order, m.powers) for m in monomials))

    def output(o: Output) -> str:
        found = (
            (t.coefficient * (-weight if t.sense == "stimulus" else weight), t.order, ((name, 1),))
            for t in o.terms
            for name, weight in zip(
                (*model.angles, model.stimulus_names[t.stimulus]), model.senses[t.sense], strict=True
            )
            if weight
        )
        return written(tuple(found))

    whole = {
        "name": model.name,
        "joints": joints,
        "angles": () if angles == joints else angles,
        "unit": model.unit,
        "stimulus_unit": ModelTable.model_fields["stimulus_unit"].default if model.blocks else model.stimulus_unit,
        "stimulus": [{"name": b.name, "unit": b.unit} for b in model.blocks],
        "provenance": model.provenance,
        "parameter": [
            {"name": p.name, "unit": p.unit, "value": p.value, "lower": p.lower, "upper": p.upper, "meaning": p.meaning}
            for p in model.parameters
        ],
        "term": [term(t) for t in model.terms],
        "filter": [
            {"name": f.name, "numerator": polynomial(f.numerator), "denominator": polynomial(f.denominator)}
            for f in model.filters
        ],
        "derived": [
            {"value": d.value, "name": d.name if d.name != d.value else "", "unit": d.unit, "meaning": d.meaning}
            for d in model.derived
        ],
        "sensor_filter": {j: f for j, f in zip(joints, model.output_filters, strict=False) if f is not None},
        "output": [
            {"name": o.name, "value": output(o), "unit": None if o.unit == model.unit else o.unit}
            for o in model.outputs
        ],
    }
    plain: dict[str, Any] = ModelTable.model_validate_json(json.dumps(whole)).model_dump(mode="json")
    return plain
