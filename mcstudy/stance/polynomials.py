"""Polynomials of s with monomials of parameters as coefficients, read from text: ``1 + 2*b*s/w + s**2/w**2``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from mcstudy.errors import InputError, ModelError
from mcstudy.expressions import expression, shortened

Piece = tuple[float, int, tuple[tuple[str, int], ...]]
"""``coefficient * s**order * product(parameter**power)``: coefficient, order, names with their powers."""

_NAME = re.compile(r"[A-Za-z_]\w*")
_FUNCTIONS = {"sqrt", "exp", "log"}


def pieces(text: str | float, constants: Mapping[str, float] | None = None) -> tuple[Piece, ...]:
    """The pieces of a polynomial; names other than s, pi and the ``constants`` are parameters.

    Raises `ModelError`, one line, for what is none.
    """
    values: dict[str, Any] = {"pi": np.pi, **(constants or {})}
    text = repr(text) if isinstance(text, int | float) else text
    names = set(_NAME.findall(re.sub(r"\d[\d.]*[eE][+-]?\d+", "0", text))) - _FUNCTIONS
    values |= {n: Polynomial({(1, ()) if n == "s" else (0, ((n, 1),)): 1.0}) for n in names - values.keys()}
    try:
        result = expression(text, values, "polynomial", "1 + tau*s")(values)
    except InputError as error:
        raise ModelError(str(error)) from None
    except (TypeError, ValueError):
        raise ModelError(
            f"polynomial {shortened(text)!r}: expected sums and products of s and parameters, whole powers, and "
            "division by a single product"
        ) from None
    if not isinstance(result, Polynomial):
        result = Polynomial({(0, ()): float(result)})
    return tuple((c, order, powers) for (order, powers), c in result.terms.items())


def written(polynomial: tuple[Piece, ...]) -> str:
    """The text of a polynomial; `pieces` reads it back to the last bit."""
    out = []
    for coefficient, order, powers in polynomial:
        factors = [*(_power(name, power) for name, power in powers), *([_power("s", order)] if order else [])]
        number = [] if coefficient == 1 and factors else [repr(float(coefficient))]
        out.append("*".join([*number, *factors]))
    return " + ".join(out) or "0.0"


def _power(name: str, power: int) -> str:
    return name if power == 1 else f"{name}**{power}"


class Polynomial:
    """Coefficients by (order of s, powers of parameters in alphabetical order)."""

    __array_ufunc__ = None  # NumPy's numbers leave arithmetic with it to the methods below

    def __init__(self, terms: Mapping[tuple[int, tuple[tuple[str, int], ...]], float]) -> None:
        self.terms = dict(terms)

    def __add__(self, other: Any) -> Polynomial:
        out = dict(self.terms)
        for key, value in _terms(other).items():
            out[key] = out.get(key, 0.0) + value
        return Polynomial(out)

    def __mul__(self, other: Any) -> Polynomial:
        out: dict[tuple[int, tuple[tuple[str, int], ...]], float] = {}
        for (order, powers), a in self.terms.items():
            for (more, factors), b in _terms(other).items():
                key = (order + more, _product(powers, factors))
                out[key] = out.get(key, 0.0) + a * b
        return Polynomial(out)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Polynomial:
        return self * -1.0

    def __pos__(self) -> Polynomial:
        return self

    def __sub__(self, other: Any) -> Polynomial:
        return self + -1.0 * Polynomial(_terms(other))

    def __rsub__(self, other: Any) -> Polynomial:
        return -self + other

    def __truediv__(self, other: Any) -> Polynomial:
        ((order, powers), value), *more = _terms(other).items()
        if more:
            raise TypeError
        return self * Polynomial({(-order, tuple((n, -p) for n, p in powers)): 1.0 / value})

    def __rtruediv__(self, other: Any) -> Polynomial:
        return Polynomial(_terms(other)) / self

    def __pow__(self, power: Any) -> Polynomial:
        if float(power) != int(power) or (power < 0 and len(self.terms) > 1) or abs(power) > 20:
            raise TypeError
        out, base = Polynomial({(0, ()): 1.0}), self if power >= 0 else 1.0 / self
        for _ in range(abs(int(power))):
            out = out * base
        return out


def _terms(value: Any) -> Mapping[tuple[int, tuple[tuple[str, int], ...]], float]:
    return value.terms if isinstance(value, Polynomial) else {(0, ()): float(value)}


def _product(a: tuple[tuple[str, int], ...], b: tuple[tuple[str, int], ...]) -> tuple[tuple[str, int], ...]:
    powers = dict(a)
    for name, power in b:
        powers[name] = powers.get(name, 0) + power
    return tuple(sorted((n, p) for n, p in powers.items() if p))
