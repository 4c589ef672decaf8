"""Quantities that follow from the parameters of a model: parameters, expressions of them, and Python functions.

Those that a model declares (`mcstudy.stance.feedback.Derived`) have statistics, intervals and bounds as its parameters
have; others are asked for by name.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mcstudy.errors import InputError
from mcstudy.expressions import expression as arithmetic
from mcstudy.expressions import shortened
from mcstudy.stance.feedback import Derived, Model

STEP = 1e-20
"""Imaginary step of the derivative of an expression: exact to rounding, because nothing is subtracted."""

DIFFERENCE = 1e-5
"""Relative step of the central differences of a Python function."""

LARGEST = 1e100
"""A quantity, and its change with each parameter, is smaller than this: their squares are still numbers."""

MOST_SHOWN = 6
"""Parameters that a message repeats with their values."""

EXAMPLE = "'K11 + Kpas1'"


@dataclass(frozen=True)
class Quantity:
    """A function of the parameters.

    Attributes
    ----------
    name: as it is printed. unit: its unit, "" when it is not known.
    value: of parameters (P,). gradient: derivative (P,) at parameters (P,).
    linear: whether the gradient is the same everywhere.
    of: of parameters (..., P) at once, (...); None for a Python function, which takes one body.
    """

    name: str
    unit: str
    value: Callable[[np.ndarray], float]
    gradient: Callable[[np.ndarray], np.ndarray]
    linear: bool = False
    of: Callable[[np.ndarray], np.ndarray] | None = None

    @property
    def label(self) -> str:
        """Its name in cubes and tables: an expression without blanks, ``K11+Kpas1``."""
        return self.name.replace(" ", "")


def parameter(model: Model, name: str) -> Quantity:
    """One of the parameters of ``model``."""
    k = model.names.index(name)
    unit = np.eye(len(model.names))[k]
    return Quantity(
        name, model.units[k], lambda theta: float(theta[k]), lambda _: unit, True, lambda theta: theta[..., k]
    )


def expression(model: Model, text: str) -> Quantity:
    """An expression such as ``"K11 + Kpas1 - 490"``: + - * / ** and sqrt, exp, log of parameters and numbers.

    Raises `InputError` for anything else, and for an expression that no parameter changes.
    """
    formula = arithmetic(text, [*model.names, "pi"], "quantity", EXAMPLE)
    shown = shortened(text)
    if not formula.names - {"pi"}:
        raise InputError(
            f"quantity {shown!r}: expected a function of at least one parameter ({', '.join(model.names)})"
        )

    def at(theta: np.ndarray) -> Any:  # where it is not defined it is nan or infinite, and its interval ends
        return formula({"pi": np.pi, **dict(zip(model.names, np.moveaxis(theta, -1, 0), strict=True))})

    def gradient(theta: np.ndarray) -> np.ndarray:
        steps = np.asarray(theta, dtype=complex) + 1j * STEP * np.eye(len(theta))
        with np.errstate(over="ignore"):
            return np.array([np.imag(at(row)) / STEP for row in steps])

    if not any(np.any(gradient(size * model.truth)) for size in (1.0, 1.3)):
        raise InputError(f"quantity {shown!r}: expected a function that changes with at least one parameter")
    constant = gradient(model.truth) if formula.linear else None
    units = {model.units[model.names.index(name)] for name in formula.names if name in model.names}
    unit = units.pop() if formula.linear and len(units) == 1 else ""
    slope = gradient if constant is None else lambda _: constant
    return Quantity(text, unit, lambda theta: float(at(theta)), slope, formula.linear, at)


def derived(model: Model) -> tuple[Quantity, ...]:
    """The quantities that ``model`` declares, those left out that need a parameter which it no longer has."""
    found = []
    for d in model.derived:
        if names_of(d, model.names):
            found.append(replace(expression(model, d.value), name=d.name, unit=d.unit))
    return tuple(found)


def names_of(d: Derived, known: Collection[str]) -> frozenset[str]:
    """The parameters that a quantity follows from; none where one of them is not known."""
    try:
        return arithmetic(d.value, [*known, "pi"], "derived", EXAMPLE).names - {"pi"}
    except InputError:
        return frozenset()


def sums(model: Model) -> dict[str, tuple[str, ...]]:
    """The declared quantities that are plain sums of parameters, by name, with what they add up."""
    found = {}
    for q in derived(model):
        slope = q.gradient(model.truth)
        if q.linear and {*slope} <= {0.0, 1.0} and q.value(np.zeros(slope.size)) == 0:
            found[q.name] = tuple(n for n, k in zip(model.names, slope, strict=True) if k)
    return found


def function(model: Model, name: str, formula: Callable[[Mapping[str, float]], float]) -> Quantity:
    """A Python function of a mapping from parameter names to values; its derivative by central differences."""

    def value(theta: np.ndarray) -> float:
        try:
            return float(formula(dict(zip(model.names, map(float, theta), strict=True))))
        except ArithmeticError:  # as an expression that is not defined there
            return np.nan
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"quantity {name!r}: expected a function of a mapping of parameters that returns a number: {error}"
            ) from None

    size = DIFFERENCE * np.maximum(np.abs(model.truth), 1e-6)

    def gradient(theta: np.ndarray) -> np.ndarray:
        steps = np.diag(size)
        return np.array([value(theta + d) - value(theta - d) for d in steps]) / (2 * size)

    if not np.any(gradient(model.truth)):
        raise InputError(f"quantity {name!r}: expected a function that changes with at least one parameter")
    return Quantity(name, "", value, gradient)


def require_finite(model: Model, wanted: Sequence[Quantity], theta: np.ndarray) -> None:
    """Raise `InputError` for a quantity that has no value or no derivative at the estimates ``theta`` (P,).

    Its interval begins there. Sizes whose squares are no numbers either are refused too.
    """
    size = np.maximum(np.abs(theta), np.abs(model.truth))
    for q in wanted:
        changes = np.abs(q.gradient(theta) * size)
        value, largest = q.value(theta), changes.max()
        if np.isfinite(value) and abs(value) < LARGEST and 1 / LARGEST < largest < LARGEST:
            continue
        used = [f"{n} = {v:.4g}" for n, v in zip(model.names, theta, strict=True) if re.search(rf"\b{n}\b", q.name)]
        at = f" ({', '.join(used)})" if 0 < len(used) <= MOST_SHOWN else ""
        if np.isfinite(value) and abs(value) < LARGEST:
            why = f"expected a derivative that is finite and not 0 at the estimates{at}, got {largest:.3g}"
        else:
            why = f"expected a finite number at the estimates{at}, got {value:.3g}"
        raise InputError(f"quantity {shortened(q.name)!r}: {why}")


def quantities(model: Model, given: Sequence[str] | Mapping[str, Any] = ()) -> tuple[Quantity, ...]:
    """All parameters of ``model``, the quantities that it declares, and those ``given``.

    ``given``: expressions, or a mapping from names to expressions and functions.
    """
    wanted = [*(parameter(model, name) for name in model.names), *derived(model)]
    named = given if isinstance(given, Mapping) else {text: text for text in given}
    for name, formula in named.items():
        if name in {q.name for q in wanted}:
            raise InputError(f"quantity {name!r}: expected a name that is not taken")
        wanted.append(expression(model, formula) if isinstance(formula, str) else function(model, name, formula))
    return tuple(wanted)
