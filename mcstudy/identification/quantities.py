"""Quantities whose intervals are wanted: parameters, expressions of them, and Python functions."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mcstudy.errors import InputError
from mcstudy.stance.feedback import Model

STEP = 1e-20
"""Imaginary step of the derivative of an expression: exact to rounding, because nothing is subtracted."""

DIFFERENCE = 1e-5
"""Relative step of the central differences of a Python function."""

_BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_UNARY: dict[type, Callable[[Any], Any]] = {ast.USub: operator.neg, ast.UAdd: operator.pos}
_FUNCTIONS: dict[str, Callable[[Any], Any]] = {"sqrt": np.sqrt, "exp": np.exp, "log": np.log}


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
    try:
        tree = ast.parse(text, mode="eval").body
    except SyntaxError:
        raise InputError(f"quantity {text!r}: expected an expression of the parameters, e.g. 'K11 + Kpas1'") from None
    named = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name)} - set(_FUNCTIONS)
    for name in sorted(named - set(model.names)):
        raise InputError(f"quantity {text!r}: expected parameters of the model ({', '.join(model.names)}), got {name}")
    if not named:
        raise InputError(f"quantity {text!r}: expected a function of at least one parameter ({', '.join(model.names)})")
    compute = compiled(tree, text)

    def at(theta: np.ndarray) -> Any:
        with np.errstate(all="ignore"):  # where it is not defined it is nan or infinite, and its interval ends
            return compute(dict(zip(model.names, theta, strict=True)))

    def gradient(theta: np.ndarray) -> np.ndarray:
        steps = np.asarray(theta, dtype=complex) + 1j * STEP * np.eye(len(theta))
        return np.array([np.imag(at(row)) / STEP for row in steps])

    if not any(np.any(gradient(size * model.truth)) for size in (1.0, 1.3)):
        raise InputError(f"quantity {text!r}: expected a function that changes with at least one parameter")
    linear = _linear(tree)
    constant = gradient(model.truth) if linear else None
    units = {model.units[model.names.index(name)] for name in named}
    unit = units.pop() if linear and len(units) == 1 else ""
    slope = gradient if constant is None else lambda _: constant
    return Quantity(text, unit, lambda theta: float(at(theta)), slope, linear)


def function(model: Model, name: str, of: Callable[[Mapping[str, float]], float]) -> Quantity:
    """A Python function of a mapping from parameter names to values; its derivative by central differences."""

    def value(theta: np.ndarray) -> float:
        try:
            return float(of(dict(zip(model.names, map(float, theta), strict=True))))
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


def quantities(model: Model, given: Sequence[str] | Mapping[str, Any] = ()) -> tuple[Quantity, ...]:
    """All parameters of ``model``, the sums of active and passive stiffness it has, and those ``given``.

    ``given``: expressions, or a mapping from names to expressions and functions.
    """
    sums = [f"{a} + {b}" for a, b in (("K11", "Kpas1"), ("K22", "Kpas2")) if {a, b} <= set(model.names)]
    found = [*(parameter(model, name) for name in model.names), *(expression(model, text) for text in sums)]
    named = given if isinstance(given, Mapping) else {text: text for text in given}
    for name, of in named.items():
        if name in {q.name for q in found}:
            raise InputError(f"quantity {name!r}: expected a name that is not taken")
        found.append(expression(model, of) if isinstance(of, str) else function(model, name, of))
    return tuple(found)


def compiled(node: ast.expr, text: str) -> Callable[[Mapping[str, Any]], Any]:
    """A function of the named values; raises `InputError` for what is not allowed."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        number = float(node.value)
        return lambda _: number
    if isinstance(node, ast.Name) and node.id not in _FUNCTIONS:
        name = node.id
        return lambda values: values[name]
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        apply, left, right = _BINARY[type(node.op)], compiled(node.left, text), compiled(node.right, text)
        return lambda values: apply(left(values), right(values))
    if isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
        sign, inner = _UNARY[type(node.op)], compiled(node.operand, text)
        return lambda values: sign(inner(values))
    if (
        isinstance(node, ast.Call)
        and ast.unparse(node.func) in _FUNCTIONS
        and len(node.args) == 1
        and not node.keywords
    ):
        called, argument = _FUNCTIONS[ast.unparse(node.func)], compiled(node.args[0], text)
        return lambda values: called(argument(values))
    raise InputError(
        f"quantity {text!r}: expected parameters and numbers with + - * / **, sqrt, exp and log, "
        f"got {ast.unparse(node)!r}"
    )


def _linear(node: ast.expr) -> bool:
    """Whether an expression is a sum of parameters and numbers with signs, so that it has their unit."""
    if isinstance(node, ast.BinOp):
        return isinstance(node.op, ast.Add | ast.Sub) and _linear(node.left) and _linear(node.right)
    if isinstance(node, ast.UnaryOp):
        return _linear(node.operand)
    return isinstance(node, ast.Name | ast.Constant)
