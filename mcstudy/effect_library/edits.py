"""Operations by which an effect changes a model: new terms, a filter or delay on existing terms, an output filter.

Every function returns a new `Model` and changes only its table, so the closed form, the compiled kernel and the
time-domain simulator all use the change. The functions read what they need (the delay of a loop, the inertia of the
body) from the model instead of naming its parameters, so they work on any model with rows "hip" and "ankle".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mcstudy.errors import ModelError
from mcstudy.stance import anthropometry
from mcstudy.stance.body import Body, tilt_of, tilt_terms, with_scaled_gains
from mcstudy.stance.feedback import Filter, Model, Monomial, Term

GRAVITY = 9.81
"""m/s^2; gravity enters a model only as a product with A1 and A2 of the body."""

TRUNK_GYRATION = (0.496 / 0.626) ** 2
"""I2 / (m2 h2^2) of head, arms and trunk, about their centre of mass (anthropometry of Winter 2009, Table 4.1)."""

OWN = "own delay of the row"
"""Placeholder for the delay of the active feedback in the row of a new term; `add_terms` replaces it."""

ONE = Monomial(1.0, 0)


def low_pass(name: str, time_constant: str) -> Filter:
    """1/(tau s + 1)."""
    return Filter(name, (ONE,), (ONE, Monomial(1.0, 1, ((time_constant, 1),))))


def product(name: str, first: Filter, second: Filter) -> Filter:
    """The two filters in series as one filter."""

    def multiply(a: Sequence[Monomial], b: Sequence[Monomial]) -> tuple[Monomial, ...]:
        return tuple(
            Monomial(x.coefficient * y.coefficient, x.order + y.order, _merge(x.powers, y.powers)) for x in a for y in b
        )

    return Filter(
        name,
        multiply(first.numerator, second.numerator),
        multiply(first.denominator, second.denominator),
    )


def _merge(a: tuple[tuple[str, int], ...], b: tuple[tuple[str, int], ...]) -> tuple[tuple[str, int], ...]:
    powers: dict[str, int] = {}
    for name, power in (*a, *b):
        powers[name] = powers.get(name, 0) + power
    return tuple(powers.items())


def loop_delay(model: Model, row: str) -> str | None:
    """Name of the delay of the row's active feedback; raises `ModelError` when the row has no active feedback."""
    for term in model.terms:
        if term.row == row and term.noisy:
            return term.delay
    raise ModelError(f"model {model.name}: no active feedback in the {row} row for this effect to act on")


def add_terms(model: Model, *terms: Term, at_joint: bool = False) -> Model:
    """Add terms to the table; the delay `OWN` is replaced by that of the row's active feedback.

    With a tilt, feedback of theta1 senses it too (`mcstudy.stance.body.tilt_terms`, also for ``at_joint``).
    """
    if any(t.row == "hip" for t in terms) and not any(t.row == "hip" for t in model.terms):
        raise ModelError(f"model {model.name}: no hip row for this effect to act on")
    resolved = [replace(t, delay=loop_delay(model, t.row)) if t.delay == OWN else t for t in terms]
    tilt = tilt_of(model)
    sensed = tilt_terms(tilt, resolved, at_joint=at_joint) if tilt else ()
    return model.with_terms(terms=[*resolved, *sensed])


def add_hip_share(model: Model, first: Term, ratio: str) -> Model:
    """The term ``first`` of the ankle again at the hip, of the hip angle, times ``ratio``; nothing without a hip."""
    if not any(t.row == "hip" for t in model.terms):
        return model
    return add_terms(model, replace(first, row="hip", sense="theta2", gain=(*first.gain, ratio)))


def sense_tilt(model: Model, terms: Sequence[Term], share: str) -> Model:
    """Add what feedback of ``share`` times theta1 by the gains of ``terms`` senses of a tilt; none for other stimuli.

    The legs' weighted sum of the senses serves it too: ``share`` times (theta1 - W u). A term may have two gains, here
    its own and W, so the share is the difference of a filter, 2 + share, and 2: it does not vanish without the effect.
    """
    tilt = tilt_of(model)
    if not tilt:
        return model
    sensed = tilt_terms(tilt, [replace(t, sense="theta1") for t in terms])
    shifted = Filter(f"2 + {share}", (Monomial(2.0, 0), Monomial(1.0, 0, ((share, 1),))), (ONE,))
    return model.with_terms(
        filters=(shifted,),
        terms=[
            new
            for t in sensed
            for new in (replace(t, filters=(*t.filters, shifted.name)), replace(t, coefficient=-2.0 * t.coefficient))
        ],
    )


def filter_terms(model: Model, selects: Callable[[Term], bool], filt: Filter) -> Model:
    """Append a filter to every term that ``selects`` selects."""
    if not any(selects(t) for t in model.terms):
        raise ModelError(f"model {model.name}: no term for filter {filt.name} to act on")
    terms = tuple(replace(t, filters=(*t.filters, filt.name)) if selects(t) else t for t in model.terms)
    return replace(model, terms=terms, filters=(*model.filters, filt))


def delay_terms(model: Model, selects: Callable[[Term], bool], delay: str) -> Model:
    """Add a delay to every term that ``selects`` selects, after the delay that it has already, as a sensed tilt has."""

    def delayed(term: Term) -> Term:
        if term.late is not None:
            raise ModelError(f"model {model.name}: a term of {term.sense} has the further delay {term.late} already")
        return replace(term, delay=delay) if term.delay is None else replace(term, late=delay)

    return replace(model, terms=tuple(delayed(t) if selects(t) else t for t in model.terms))


def scale_stimulus(model: Model, error: str, corner: str) -> Model:
    """Stimulus times (1 + error / (corner s + 1)): a copy of every stimulus term with the error as its gain.

    Terms of a tilt have two gains already, the most that a term may have: there the factor is a filter.
    """
    below = (ONE, Monomial(1.0, 1, ((corner, 1),)))
    if tilt_of(model):
        return filter_terms(model, is_stimulus, Filter(error, (*below, Monomial(1.0, 0, ((error, 1),))), below))
    fading = Filter(f"fading_{error}", (ONE,), below)
    copies = [
        replace(t, gain=(*t.gain, error), filters=(*t.filters, fading.name)) for t in model.terms if is_stimulus(t)
    ]
    return model.with_terms(terms=copies, filters=(fading,))


def filter_output(model: Model, angles: Sequence[int], filt: Filter) -> Model:
    """Add a filter between the true and the measured angle, in series with one that is there."""
    there = [k for k in angles if k < model.n_rows]
    if not there:
        raise ModelError(f"model {model.name}: no second angle for this effect to act on")
    have = {f.name: f for f in model.filters}
    output, filters = list(model.output_filters), list(model.filters)
    for k in there:
        existing = output[k]
        placed = filt if existing is None else product(f"{existing}*{filt.name}", have[existing], filt)
        if placed.name not in {f.name for f in filters}:
            filters.append(placed)
        output[k] = placed.name
    return replace(model, filters=tuple(filters), output_filters=tuple(output))


def is_active(term: Term) -> bool:
    """Whether a term is active (sensed, delayed, noisy) feedback."""
    return term.noisy


def is_active_ankle(term: Term) -> bool:
    """Whether a term is active feedback to ankle torque."""
    return term.noisy and term.row == "ankle"


def is_stimulus(term: Term) -> bool:
    """Whether a term is part of b(s)."""
    return term.sense == "stimulus"


def body_of(model: Model) -> Body:
    """The body a two-segment model was built on, read back from its table (undelayed terms without a gain).

    Derived: with rows (hip, ankle) in joint coordinates, M = [[C1 + J2, J2], [J1 + C2, C2]] and the gravity matrix is
    -g [[A2, A2], [A1 + A2, A2]]. Raises `ModelError` when the model has no trunk.
    """
    mass, weight = np.zeros((2, 2)), np.zeros((2, 2))
    for t in model.terms:
        if t.gain or t.delay or t.filters or t.sense == "stimulus":
            continue
        w = t.coefficient * np.array(model.senses[t.sense][:2])
        if t.order == 2:
            mass[model.rows.index(t.row)] += w
        elif t.order == 0:
            weight[model.rows.index(t.row)] += w
    if mass[0, 1] <= 0 or weight[0, 1] >= 0:
        raise ModelError(f"model {model.name}: no trunk segment for this effect to act on")
    a2 = -weight[0, 1] / GRAVITY
    return Body(
        J1=mass[1, 0] - mass[1, 1],
        J2=mass[0, 1],
        C1=mass[0, 0] - mass[0, 1],
        C2=mass[1, 1],
        A1=-weight[1, 0] / GRAVITY - a2,
        A2=a2,
        g=GRAVITY,
    )


def trunk_mass(body: Body) -> float:
    """Mass of head, arms and trunk in kg, from A2 = m2 h2 and J2 = m2 h2^2 (1 + `TRUNK_GYRATION`) (derived)."""
    return body.A2**2 * (1 + TRUNK_GYRATION) / body.J2


def leg_length(body: Body) -> float:
    """L1 = C1 / A2 in m (derived: C1 = m2 L1 h2)."""
    return body.C1 / body.A2


def scale_trunk(model: Model, error: str, height: str) -> Model:
    """Trunk mass times (1 + error): in A2, J2, C1, C2 and, through the leg length, in A1 and J1.

    To first order in the error, the height of the trunk's centre of mass is also times (1 + ``height`` error).
    """
    body = body_of(model)
    m2, length, g = trunk_mass(body), leg_length(body), GRAVITY
    terms = [
        Term("hip", "theta2s", (error,), 2, coefficient=body.J2),
        Term("hip", "theta2s", (error,), coefficient=-body.A2 * g),
        Term("hip", "theta1", (error,), 2, coefficient=body.C1),
        Term("ankle", "theta1", (error,), 2, coefficient=m2 * length**2 + body.C1),
        Term("ankle", "theta1", (error,), coefficient=-m2 * length * g),
        Term("ankle", "theta2s", (error,), 2, coefficient=body.C2),
        Term("ankle", "theta2s", (error,), coefficient=-body.A2 * g),
    ]
    both = (error, height)
    terms += [
        Term("hip", "theta2s", both, 2, coefficient=2 * body.J2),
        Term("hip", "theta2s", both, coefficient=-body.A2 * g),
        Term("hip", "theta1", both, 2, coefficient=body.C1),
        Term("ankle", "theta1", both, 2, coefficient=body.C1),
        Term("ankle", "theta2s", both, 2, coefficient=body.C1 + 2 * body.J2),
        Term("ankle", "theta2s", both, coefficient=-body.A2 * g),
    ]
    return model.with_terms(terms=[*terms, *_platform(model, error, body.A2, m2 * length + body.A2)])


def scale_legs(model: Model, error: str, moment_share: str) -> Model:
    """Leg mass times (1 + error), in J1 and A1 minus the contribution of the trunk's mass at the hip.

    Their first moment is times (1 + ``moment_share`` error).
    """
    body = body_of(model)
    m2, length = trunk_mass(body), leg_length(body)
    moment = body.A1 - m2 * length
    terms = [
        Term("ankle", "theta1", (error,), 2, coefficient=body.J1 - m2 * length**2 - body.C1),
        Term("ankle", "theta1", (error, moment_share), coefficient=-moment * GRAVITY),
    ]
    return model.with_terms(terms=[*terms, *_platform(model, error, 0.0, moment)])


def _platform(model: Model, gain: str, hip: float, ankle: float) -> list[Term]:
    """The share of a translation's inertial torque -s^2 (hip, ankle) x that follows a change of the body."""
    if model.stimulus_unit != "m":
        return []
    first = next(t for t in model.terms if is_stimulus(t))
    return [
        replace(first, row=row, gain=(gain,), order=2, coefficient=-c)
        for row, c in (("hip", hip), ("ankle", ankle))
        if c
    ]


HEAD_HEIGHT = 0.60
"""Height of the head above the hip in m (adult; anthropometry of Winter 2009)."""


def resonant_mass(model: Model, mass: str, filt: Filter) -> Model:
    """A point mass at `HEAD_HEIGHT` on the trunk whose motion is ``filt`` times that of its attachment.

    Derived: the attachment moves by x = L1 theta1 + d theta2s, the reaction is m s^2 filt(s) x, and it loads the
    hip by d and the ankle by L1 + d. Gravity on the small mass is neglected.
    """
    d, length = HEAD_HEIGHT, leg_length(body_of(model))
    return model.with_terms(
        filters=(filt,),
        terms=[
            Term(row, sense, (mass,), 2, filters=(filt.name,), coefficient=arm * lever)
            for row, arm in (("hip", d), ("ankle", length + d))
            for sense, lever in (("theta1", length), ("theta2s", d))
        ],
    )


def gyrations() -> tuple[tuple[float, float], ...]:
    """I / (m h^2) of (legs, upper body) in every published table of `mcstudy.stance.anthropometry`."""
    tables = ((None, "winter"), ("female", "deleva"), ("male", "deleva"))
    people = (anthropometry.segments(1.75, 75.0, sex, table) for sex, table in tables)
    return tuple((p["I1"] / (p["m1"] * p["h1"] ** 2), p["I2"] / (p["m2"] * p["h2"] ** 2)) for p in people)


def exchanged_segments(model: Model, legs_gyration: float, trunk_gyration: float) -> Model:
    """The model on the body whose two segments, masses, heights and inertias, are exchanged; the leg length stays.

    Derived: what is declared as the upper body are the legs. The masses follow from moments and inertias with the
    ratios I / (m h^2) given (`gyrations`). Gains and bounds keep their ratio to the weight. Raises `ModelError` for a
    body that has no such exchange.
    """
    body = body_of(model)
    length = leg_length(body)
    legs = body.A2**2 * (1 + legs_gyration) / body.J2  # mass of what is declared as the upper body
    moment = body.A1 - legs * length
    inertia = body.J1 - body.C1 - legs * length**2
    if not (moment > 0 and inertia > 0):
        raise ModelError(f"model {model.name}: no body has these segments exchanged")
    trunk = moment**2 * (1 + trunk_gyration) / inertia
    coupling = moment * length
    other = Body(
        J1=body.J2 + trunk * length**2 + coupling,
        J2=inertia,
        C1=coupling,
        C2=coupling + inertia,
        A1=body.A2 + trunk * length,
        A2=moment,
        g=body.g,
    )
    ratio = other.mgh / body.mgh
    terms = [t for t in model.terms if t.gain or t.delay or t.filters or t.sense == "stimulus"]
    first = {"hip": (body.A2, other.A2), "ankle": (body.A1 + body.A2, other.A1 + other.A2)}
    if model.stimulus_unit == "m":
        terms = [
            replace(t, coefficient=t.coefficient * first[t.row][1] / first[t.row][0]) if t.sense == "stimulus" else t
            for t in terms
        ]
    return with_scaled_gains(replace(model, terms=(*other.terms(), *terms)), ratio)
