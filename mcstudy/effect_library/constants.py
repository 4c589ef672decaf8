"""Shape constants of an effect: parameters of its declaration that become numbers unless a diagnosis opens them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from mcstudy.errors import ModelError
from mcstudy.stance.feedback import Filter, Model, Monomial


def with_constants(model: Model, values: Mapping[str, float]) -> Model:
    """The model with the named parameters replaced by numbers, and without terms and filters that then do nothing.

    Raises `ModelError` if one of them is a delay, which has no coefficient that could hold it.
    """
    if not values:
        return model
    for name in values:
        if name in model.delays:
            raise ModelError(f"model {model.name}: the delay {name} cannot be a shape constant")
    filters = [
        replace(f, numerator=_numbers(f.numerator, values), denominator=_numbers(f.denominator, values))
        for f in model.filters
    ]
    kept: dict[str, str | None] = {}  # a filter's name, that of an equal one, or None if it does nothing
    first: dict[tuple[object, object], str] = {}
    for f in filters:
        same = first.setdefault((f.numerator, f.denominator), f.name)
        kept[f.name] = None if f.numerator == f.denominator else same
    terms = []
    for t in model.terms:
        coefficient = t.coefficient
        for name in t.gain:
            coefficient *= values.get(name, 1.0)
        if coefficient or not t.coefficient:
            through = tuple(n for n in (kept[f] for f in t.filters) if n is not None)
            gain = tuple(g for g in t.gain if g not in values)
            stays = coefficient == t.coefficient and gain == t.gain and through == t.filters
            terms.append(t if stays else replace(t, coefficient=coefficient, gain=gain, filters=through))
    output = tuple(None if name is None else kept[name] for name in model.output_filters)
    used = {n for t in terms for n in t.filters} | {n for n in output if n is not None}
    return replace(
        model,
        parameters=tuple(p for p in model.parameters if p.name not in values),
        terms=tuple(terms),
        filters=tuple(f for f in filters if f.name in used),
        output_filters=output,
    )


def _numbers(monomials: tuple[Monomial, ...], values: Mapping[str, float]) -> tuple[Monomial, ...]:
    out = []
    for m in monomials:
        coefficient = m.coefficient
        for name, power in m.powers:
            coefficient *= values[name] ** power if name in values else 1.0
        if coefficient:
            out.append(Monomial(coefficient, m.order, tuple(p for p in m.powers if p[0] not in values)))
    return tuple(out)


def low_pass_of_order(name: str, time_constant: str, curvature: str) -> Filter:
    """1 / (q tau^2 s^2 + tau s + 1): of first order for q = 0, with double root for 0.25, of Butterworth for 0.5."""
    unity = Monomial(1.0, 0)
    linear, square = Monomial(1.0, 1, ((time_constant, 1),)), Monomial(1.0, 2, ((time_constant, 2), (curvature, 1)))
    return Filter(name, (unity,), (unity, linear, square))
