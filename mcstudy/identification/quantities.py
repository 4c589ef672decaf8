"""Quantities whose intervals are wanted: parameters, expressions of them, and Python functions."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mcstudy import expressions
from mcstudy.errors import InputError
from mcstudy.stance.feedback import Model

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
    """

    name: str
    unit: str
    value: Callable[[np.ndarray], float]
    gradient: Callable[[np.ndarray], np.ndarray]
    linear: bool = False


def parameter(model: Model, name: str) -> Quantity:
    """One of the parameters of ``model``."""
    k = model.names.index(name)
    unit = np.eye(len(model.names))[k]
    return Quantity(name, model.units[k], lambda theta: float(theta[k]), lambda _: unit, linear=True)


def expression(model: Model, text: str) -> Quantity:
    """An expression such as ``"K11 + Kpas1 - 490"``: + - * / ** and sqrt, exp, log of parameters and numbers.

    Raises `InputError` for anything else, and for an expression that no parameter changes.
    """
    formula = expressions.expression(text, model.names, "quantity", EXAMPLE)
    shown = expressions.shortened(text)
    if not formula.names:
        raise InputError(
            f"quantity {shown!r}: expected a function of at least one parameter ({', '.join(model.names)})"
        )

    def at(theta: np.ndarray) -> Any:  # where it is not defined it is nan or infinite, and its interval ends
        return formula(dict(zip(model.names, theta, strict=True)))

    def gradient(theta: np.ndarray) -> np.ndarray:
        steps = np.asarray(theta, dtype=complex) + 1j * STEP * np.eye(len(theta))
        with np.errstate(over="ignore"):
            return np.array([np.imag(at(row)) / STEP for row in steps])

    if not any(np.any(gradient(size * model.truth)) for size in (1.0, 1.3)):
        raise InputError(f"quantity {shown!r}: expected a function that changes with at least one parameter")
    constant = gradient(model.truth) if formula.linear else None
    units = {model.units[model.names.index(name)] for name in formula.names}
    unit = units.pop() if formula.linear and len(units) == 1 else ""
    slope = gradient if constant is None else lambda _: constant
    return Quantity(text, unit, lambda theta: float(at(theta)), slope, formula.linear)


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
        raise InputError(f"quantity {expressions.shortened(q.name)!r}: {why}")


def quantities(model: Model, given: Sequence[str] | Mapping[str, Any] = ()) -> tuple[Quantity, ...]:
    """All parameters of ``model``, the sums of active and passive stiffness it has, and those ``given``.

    ``given``: expressions, or a mapping from names to expressions and functions.
    """
    sums = [f"{a} + {b}" for a, b in (("K11", "Kpas1"), ("K22", "Kpas2")) if {a, b} <= set(model.names)]
    wanted = [*(parameter(model, name) for name in model.names), *(expression(model, text) for text in sums)]
    named = given if isinstance(given, Mapping) else {text: text for text in given}
    for name, formula in named.items():
        if name in {q.name for q in wanted}:
            raise InputError(f"quantity {name!r}: expected a name that is not taken")
        wanted.append(expression(model, formula) if isinstance(formula, str) else function(model, name, formula))
    return tuple(wanted)
