"""What shall be reached: ``cv(Td1) <= 10%``, ``sd(K11 + Kpas1) <= 40 N m/rad``, ``mcse(bias(B11)) <= 1%``.

A target is a measure of a quantity with a largest value. Measures are those of `mcstudy.planning.multilevel.MEASURES`
and the Monte Carlo standard error (``mcse``) of each. A quantity is a parameter or an expression of parameters. A value
in percent is relative to the truth, for ``cv`` to the mean; any other value has the unit of the quantity. The bias may
have either sign.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.errors import InputError
from mcstudy.expressions import shortened
from mcstudy.models.quantities import Quantity, expression
from mcstudy.planning.multilevel import MEASURES, Measure, of_one_realization
from mcstudy.stance.feedback import Model

FORM = re.compile(r"(?:(?P<mcse>mcse)\()?(?P<measure>\w+)\((?P<of>.+)\)\s*<=?\s*(?P<value>[^\s%]+)\s*(?P<unit>.*)")

EXAMPLE = "such as 'cv(Td1) <= 10%'"


@dataclass(frozen=True, eq=False)
class Target:
    """One target.

    Attributes
    ----------
    measure: of the estimates of ``quantity``; for ``mcse`` that of one realization, to be divided by the root of their
    number. limit: largest value, in percent where ``percent``, else in the unit of the quantity.
    """

    text: str
    measure: Measure
    quantity: Quantity
    mcse: bool
    limit: float
    percent: bool
    truth: float

    @property
    def factor(self) -> float:
        """From values of the measure to the unit of ``limit``."""
        if not self.percent:
            return 1.0
        return 100.0 if self.measure.relative else 100.0 / abs(self.truth)

    @property
    def unit(self) -> str:
        """Unit of ``limit``."""
        return "%" if self.percent else self.quantity.unit

    @property
    def name(self) -> str:
        """The measure as text, without its limit."""
        return self.text.split("<")[0].strip()

    def of(self, estimates: np.ndarray) -> np.ndarray:
        """The quantity of estimated parameters (..., P)."""
        flat = estimates.reshape(-1, estimates.shape[-1])
        if self.quantity.linear:
            slope = self.quantity.gradient(flat[0])
            return np.asarray(self.truth + (flat - self._true) @ slope).reshape(estimates.shape[:-1])
        return np.array([self.quantity.value(x) for x in flat]).reshape(estimates.shape[:-1])

    _true: np.ndarray = None  # type: ignore[assignment]


def parse_targets(model: Model, texts: Sequence[str]) -> tuple[Target, ...]:
    """Targets for the estimates of a model; raises `InputError` with one line for the first mistake."""
    if not texts:
        raise InputError(f"target: expected at least one, {EXAMPLE}")
    targets = tuple(_target(model, text) for text in texts)
    seen: dict[str, str] = {}
    for target in targets:
        key = re.sub(r"\s", "", target.name)
        if key in seen:
            first, second = shortened(seen[key]), shortened(target.text)
            raise InputError(f"target {second!r}: contradicts or repeats {first!r}; expected each measure once")
        seen[key] = target.text
    return targets


def _target(model: Model, text: str) -> Target:
    if not isinstance(text, str):
        raise InputError(f"target {text!r}: expected text, {EXAMPLE}")
    text = " ".join(text.split())
    said = f"target {shortened(text)!r}"
    match = FORM.fullmatch(text)
    if match is None:
        raise InputError(f"{said}: expected MEASURE(QUANTITY) <= VALUE with a unit, {EXAMPLE}")
    mcse, name, formula = bool(match["mcse"]), match["measure"], match["of"]
    if mcse:
        formula, closed, rest = formula.rpartition(")")
        if not closed or rest.strip():
            raise InputError(f"{said}: expected mcse(MEASURE(QUANTITY)) <= VALUE, such as 'mcse(cv(Td1)) <= 1%'")
    if name not in MEASURES:
        known = ", ".join(MEASURES)
        raise InputError(f"{said}: expected one of {known}, or mcse of one of them, got {name!r}")
    try:
        quantity = expression(model, formula.strip())
    except InputError as error:
        raise InputError(f"{said}: {error}") from None
    truth = quantity.value(model.truth)
    if not np.isfinite(truth):
        raise InputError(f"{said}: expected a quantity that is defined at the true values, got {truth}")
    measure = of_one_realization(MEASURES[name]) if mcse else MEASURES[name]
    limit, percent = _limit(said, match["value"], match["unit"].strip(), measure, quantity)
    if percent and not measure.relative and truth == 0:
        raise InputError(f"{said}: expected a value in {quantity.unit or 'the unit'}, because the truth is 0")
    return Target(text, measure, quantity, mcse, limit, percent, truth, model.truth)


def _limit(said: str, value: str, unit: str, measure: Measure, quantity: Quantity) -> tuple[float, bool]:
    known = "%" if measure.relative or not quantity.unit else f"% or {quantity.unit}"
    try:
        limit = float(value)
    except ValueError:
        raise InputError(f"{said}: expected a number in {known}, got {value!r}") from None
    if not 0 < limit < float("inf"):
        raise InputError(f"{said}: expected a value above 0 in {known}, got {value}")
    if unit not in known.split(" or "):
        raise InputError(f"{said}: expected a value in {known}, got {unit or 'no unit'}")
    return limit, unit == "%"
