"""Steps that build the misshapen forms of `mcstudy_challenge.bodies.forms`: terms, filters, another body, rules.

They are written apart from those of the library, so that a mistake there is not repeated here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mcstudy.effect_library import edits
from mcstudy.effect_library.effect import TrialSetting
from mcstudy.stance.body import Body
from mcstudy.stance.feedback import Filter, Model, Monomial, Term
from mcstudy.stance.rules import reweighted
from mcstudy_challenge.bodies.out_of_library import constant

Shapes = Mapping[str, float]
"""Value of every shape constant."""

Build = Callable[[Model, float, Shapes], Model]
"""(model, size, shape constants) -> the model with the form."""

Rule = Callable[[float, Shapes, TrialSetting], dict[str, Any]]
"""(size, shape constants, trial) -> fields of `mcstudy.stance.rules.Rules`."""


def _polynomial(*coefficients: float) -> tuple[Monomial, ...]:
    """Coefficients of s^0, s^1, ..."""
    return tuple(Monomial(float(c), k) for k, c in enumerate(coefficients) if c)


def _ratio(name: str, above: tuple[float, ...], below: tuple[float, ...]) -> Filter:
    return Filter(name, _polynomial(*above), _polynomial(*below))


def through(which: Callable[[Term], bool], below: Callable[[float, Shapes], tuple[float, ...]]) -> Build:
    """Terms through a filter 1 / polynomial."""

    def build(model: Model, a: float, shape: Shapes) -> Model:
        return edits.filter_terms(model, which, _ratio("form", (1.0,), below(a, shape)))

    return build


def terms(*rows: tuple[str, str, int, str], below: str = "", late: bool = False) -> Build:
    """Terms a s^order sense, each with a shape constant as factor ("" for none), through 1/(T s + 1) if named."""

    def build(model: Model, a: float, shape: Shapes) -> Model:
        filters = [_ratio("form", (1.0,), (1.0, shape[below]))] if below else []
        names = tuple(f.name for f in filters)
        added = model.with_terms([constant("form_size", a)], (), filters)
        terms = [
            Term(
                row,
                sense,
                ("form_size",),
                order,
                edits.OWN if late else None,
                names,
                shape.get(factor, 1.0),
                noisy=late,
            )
            for row, sense, order, factor in rows
        ]
        return edits.add_terms(added, *terms)

    return build


def own_delay(model: Model, a: float, shape: Shapes) -> Model:
    """Acceleration feedback with a delay of its own."""
    delay = {p.name: p.value for p in model.parameters}[str(edits.loop_delay(model, "ankle"))]
    added = model.with_terms([constant("form_size", a), constant("form_delay", delay * shape["r"])])
    return added.with_terms(terms=[Term("ankle", "theta1", ("form_size",), 2, "form_delay", noisy=True)])


def leaky(row: str, sense: str) -> Build:
    """A reflex on one sense through a leaky filter."""

    def build(model: Model, a: float, shape: Shapes) -> Model:
        added = model.with_terms([constant("form_size", a)], (), [_ratio("form", (1.0,), (shape["b"], 1.0))])
        return edits.add_terms(added, Term(row, sense, ("form_size",), 0, edits.OWN, ("form",), noisy=True))

    return build


def head(detached: bool) -> Build:
    """A mass on the trunk at height h, with resonance f and damping ratio z."""

    def build(model: Model, a: float, shape: Shapes) -> Model:
        w, d, length = 2 * np.pi * shape["f"], shape["h"], edits.leg_length(edits.body_of(model))
        loss = 2 * shape["z"] * w
        filt = _ratio("form", (0.0, 0.0, -1.0) if detached else (w**2, loss), (w**2, loss, 1.0))
        terms = [
            Term(row, sense, ("form_size",), 2, filters=("form",), coefficient=arm * lever)
            for row, arm in (("hip", d), ("ankle", length + d))
            for sense, lever in (("theta1", length), ("theta2s", d))
        ]
        return model.with_terms([constant("form_size", a)], terms, [filt])

    return build


def _rebuilt(model: Model, body: Body) -> Model:
    """The model on another body; every gain stays."""
    kept = [t for t in model.terms if t.gain or t.delay or t.filters or t.sense == "stimulus"]
    return replace(model, terms=(*body.terms(), *kept))


def trunk(model: Model, a: float, shape: Shapes) -> Model:
    """Mass of the trunk times (1 + a), height of its centre times (1 + a)^r."""
    body = edits.body_of(model)
    mass, length = edits.trunk_mass(body), edits.leg_length(body)
    m, h = 1 + a, (1 + a) ** shape["r"]
    more = mass * (m - 1)
    inertia, coupling = body.J2 * m * h**2, body.C1 * m * h
    legs = body.J1 - mass * length**2 - body.C1
    return _rebuilt(
        model,
        Body(
            J1=legs + (mass + more) * length**2 + coupling,
            J2=inertia,
            C1=coupling,
            C2=coupling + inertia,
            A1=body.A1 + more * length,
            A2=body.A2 * m * h,
            g=body.g,
        ),
    )


def legs(model: Model, a: float, shape: Shapes) -> Model:
    """Inertia of the legs times (1 + a), their first moment times (1 + r a)."""
    body = edits.body_of(model)
    mass, length = edits.trunk_mass(body), edits.leg_length(body)
    legs = body.J1 - mass * length**2 - body.C1
    return _rebuilt(
        model, replace(body, J1=body.J1 + a * legs, A1=body.A1 + shape["r"] * a * (body.A1 - mass * length))
    )


def fading_gain(model: Model, a: float, shape: Shapes) -> Model:
    """A gain of the stimulus that fades with the time constant ``T``, s."""
    filt = _ratio("form", (1.0 + a, shape["T"]), (1.0, shape["T"]))
    return edits.filter_terms(model, edits.is_stimulus, filt)


def delay_and_lag(model: Model, a: float, shape: Shapes) -> Model:
    """A delay of the stimulus, and a lag that grows with it."""
    lagging = edits.filter_terms(model, edits.is_stimulus, _ratio("form", (1.0,), (1.0, shape["r"] * a)))
    return edits.delay_terms(lagging.with_terms([constant("form_delay", a)]), edits.is_stimulus, "form_delay")


def sensors(*angles: int, first: bool = False) -> Build:
    """Measured angles through a lag of second order, or (``first``) of first order with unequal time constants."""

    def build(model: Model, a: float, shape: Shapes) -> Model:
        for k in angles:
            T = a * (shape["r"] if first and k else 1.0)
            below = (1.0, T) if first else (1.0, 2 * shape["z"] * T, T**2)
            model = edits.filter_output(model, (k,), _ratio(f"form_{k}", (1.0,), below))
        return model

    return build


def reflex(model: Model, a: float, shape: Shapes) -> Model:
    """A delayed, low-passed reflex of the ankle on the rate of the lower body."""
    added = model.with_terms(
        [constant("form_size", a), constant("form_delay", shape["d"])], (), [_ratio("form", (1.0,), (1.0, shape["T"]))]
    )
    return added.with_terms(terms=[Term("ankle", "theta1", ("form_size",), 1, "form_delay", ("form",), noisy=True)])


def crossed(model: Model, a: float, shape: Shapes) -> Model:
    """Feedback of each angle to the other joint."""
    added = model.with_terms([constant("form_size", a)])
    pairs = (("hip", "theta1", 1.0), ("ankle", "theta2", shape["r"]))
    terms = [Term(row, sense, ("form_size",), 0, coefficient=c) for row, sense, c in pairs]
    terms += [Term(row, sense, ("form_size",), 1, coefficient=c * shape["T"]) for row, sense, c in pairs]
    return added.with_terms(terms=terms)


def _active_in(row: str) -> Callable[[Term], bool]:
    return lambda t: t.noisy and t.row == row


def two_filters(model: Model, a: float, shape: Shapes) -> Model:
    """Activation of second order at the ankle and the hip, with unequal time constants."""
    for row, T in (("ankle", a), ("hip", a * shape["r"])):
        model = edits.filter_terms(model, _active_in(row), _ratio(f"form_{row}", (1.0,), (1.0, 2 * T, T**2)))
    return model


def force(model: Model, a: float, shape: Shapes) -> Model:
    """Positive force feedback with its own time constant, at the hip with a share of the loop gain."""
    for row, gain in (("ankle", a), ("hip", a * shape["r"])):
        filt = _ratio(f"form_{row}", (1.0, shape["T"]), (1.0 - gain, shape["T"]))
        model = edits.filter_terms(model, _active_in(row), filt)
    return model


def dead(on_angle: bool, on_rate: bool) -> Rule:
    """A dead zone of the angle, of its rate, or of both."""

    def rule(a: float, shape: Shapes, _: TrialSetting) -> dict[str, Any]:
        angle = (a, a * shape["r"])
        rate = tuple(shape.get("q", 4.0) * x for x in angle)
        return {"dead_angle": angle if on_angle else (0.0, 0.0), "dead_rate": rate if on_rate else (0.0, 0.0)}

    return rule


def partial_drift(gains: Callable[[Term], bool]) -> Rule:
    """A drift of some of the gains."""

    def rule(a: float, _: Shapes, trial: TrialSetting) -> dict[str, Any]:
        names = {g for t in trial.model.terms if t.noisy and gains(t) for g in t.gain[:1]}
        return {"gain_drift": dict.fromkeys(sorted(names), a)}

    return rule


def reweighting_and_drift(a: float, shape: Shapes, trial: TrialSetting) -> dict[str, Any]:
    """Gains that depend on the amplitude and drift."""
    names = {g for t in trial.model.terms if t.noisy for g in t.gain[:1]}
    gain = reweighted(trial.amplitude, trial.reference, a)
    return {"active_gain": gain, "gain_drift": dict.fromkeys(sorted(names), shape["r"] * a)}
