"""Effects that a declared model may lack, generated from its table and named by its own joints, angles and stimulus.

Sizes are in proportion to the model at its nominal values. Of a joint that is the dynamic stiffness Z(s), the torque
that its angle needs while all other joints are held: beyond a *corner* w it is that of an inertia J alone, so usual
sizes are parts of J, J w and J w^2, and of 1/w for lags and delays. They are assumptions, not published values. An
effect that other values of the parameters imitate exactly, at any frequency, is no effect of that model and left out.
Derived.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from mcstudy.effect_library import edits as add
from mcstudy.effect_library.constants import with_constants
from mcstudy.effect_library.declarations import DECLARATIONS
from mcstudy.effect_library.effect import Effect, Form, Size
from mcstudy.errors import ModelError
from mcstudy.stance.feedback import Filter, Model, Monomial, Term
from mcstudy.stance.joint import changed
from mcstudy.stance.response import frf, frf_jacobian, system

SOURCE = "assumption: in proportion to the model itself"

GRID = np.geomspace(1e-3, 1e7, 1200)
"""Angular frequencies, rad/s, among which corners are sought."""

NEAR = np.geomspace(0.01, 30.0, 40)
"""Angular frequencies, in units of the corner, at which an effect must differ from a change of the parameters."""

IMITATED = 1e-4
"""Share of the derivative of the responses that must be left, the parameters refitted, for an effect to be one."""

TORQUE = {"rad": "N m", "deg": "N m", "m": "N"}
"""Unit of what balances in a row, by that of the angles."""

ANY_CHANGE = ("amplitude_reweighting", "gain_drift")
"""Effects of the stance library that act on any active feedback."""


@dataclass(frozen=True)
class Joint:
    """A row with inertia: its ``angle``, the ``inertia`` J of its dynamic stiffness, and its ``corner`` w, rad/s."""

    row: str
    angle: str
    inertia: float
    corner: float


def generic_effects(model: Model) -> tuple[Effect, ...]:
    """All effects that ``model`` may lack and that its parameters cannot imitate."""
    corner = _corner(model)
    joints = joints_of(model)
    every = [
        *(e for j in joints for e in _of_joint(model, j)),
        *_of_feedback(model, joints, corner),
        *_of_signals(model, corner),
        *_of_stimulus(model, corner),
        *_of_sensors(model, corner),
    ]
    rows = tuple(dict.fromkeys(t.row for t in model.terms if t.noisy))
    changes = [replace(e, place=rows) for e in DECLARATIONS if e.name in ANY_CHANGE]
    return (*(e for e in _apart(every, model) if _is_effect(model, e, corner)), *changes)


def own_angles(model: Model) -> dict[str, str]:
    """The angle of every row, the lowest joint first."""
    return dict(zip(reversed(model.rows), model.angles, strict=True))


def torque_unit(model: Model) -> str:
    """Unit of what balances in a row; empty where it is unknown."""
    return TORQUE.get(model.unit, "")


def _per(model: Model, seconds: str = "") -> str:
    """Unit of a torque per angle, times ``seconds``."""
    unit = torque_unit(model)
    return f"{unit} {seconds}".strip() + f"/{model.unit}" if unit else ""


def _apart(effects: Iterable[Effect], model: Model) -> Iterator[Effect]:
    """The effects without those whose names the model uses for something else, or that are there twice."""
    taken = {*model.names, *(f.name for f in model.filters)}
    for e in effects:
        names = {e.name, *e.parameters, *e.nominal_form}
        if not names & taken:
            taken |= names
            yield e


@lru_cache(maxsize=64)
def joints_of(model: Model) -> tuple[Joint, ...]:
    """The joints, the lowest first; a row without inertia is none."""
    angles = own_angles(model)
    at = {row: (model.rows.index(row), model.angles.index(angle)) for row, angle in angles.items()}
    heavy = [
        row
        for row, (_, k) in at.items()
        if any(t.row == row and t.order == 2 and model.senses[t.sense][k] for t in model.terms)
    ]
    A = system(model, model.truth, 1j * GRID)[0]
    out = []
    for row in heavy:
        free = [at[r] for r in at if r == row or r not in heavy]
        rows, columns = np.array(free).T
        k = free.index(at[row])
        Z = 1 / np.linalg.inv(A[:, rows[:, None], columns])[:, k, k]
        inertia = float(np.abs(Z[-1])) / float(GRID[-1]) ** 2
        beside = np.flatnonzero(np.abs(Z + inertia * GRID**2) > inertia * GRID**2)
        out.append(Joint(row, angles[row], inertia, float(GRID[beside.max(initial=0)])))
    return tuple(out)


def _corner(model: Model) -> float:
    """Corner of the lowest joint; without one, where the response changes most with frequency, rad/s."""
    if joints := joints_of(model):
        return joints[0].corner
    H = frf(model, model.truth, GRID / (2 * np.pi))[:, 0]
    slope = np.abs(np.gradient(np.log(H), np.log(GRID)))
    return float(GRID[int(np.where(np.isfinite(slope), slope, 0.0).argmax())])


def _is_effect(model: Model, effect: Effect, corner: float) -> bool:
    """Whether it can be added, and responses with it are none of the model with other values."""
    added = [*(s.parameter for s in effect.sizes), *(f.parameter for f in effect.forms)]
    try:
        larger = with_constants(changed(model.with_terms(parameters=added), effect.build), effect.nominal_form)
        larger.table  # noqa: B018  # too many filters on a term
    except ModelError:
        return False
    theta = np.array([*model.truth, *(sum(s.published) / 2 for s in effect.sizes)])
    f = np.repeat(NEAR * corner / (2 * np.pi), max(1, len(model.blocks)))
    H, slopes = frf_jacobian(larger, theta, f)
    J = (slopes / np.maximum(np.abs(H), 1e-300)[..., None]).reshape(-1, theta.size)[:, : len(model.names) + 1]
    J = np.concatenate([J.real, J.imag])
    length = np.linalg.norm(J, axis=0)
    if not np.isfinite(length).all() or length[-1] == 0:
        return False
    J = J[:, length > 0] / length[length > 0]
    known, column = np.linalg.qr(J[:, :-1])[0], J[:, -1]
    left = column - known @ (known.T @ column)
    return bool(np.linalg.norm(left) > IMITATED)


def _named(what: str, where: str) -> str:
    return re.sub(r"\W+", "_", f"{what}_{where}").strip("_")


def _size(
    name: str,
    unit: str,
    scale: float,
    usual: tuple[float, float],
    meaning: str,
    signed: bool = False,
    least: float = -1,
) -> Size:
    """A size of usually ``usual`` times ``scale``; fits stay between ``least`` and 6 times the larger one."""
    low, high = (scale * u for u in usual)
    return Size(
        name=name,
        unit=unit,
        lower=6 * high * (-1.0 if signed else least),
        upper=6 * high,
        published=(low, high),
        meaning=meaning,
        signed=signed,
    )


def _effect(
    name: str, words: str, equation: str, place: str, size: Size, build: Callable[[Model], Model], **further: object
) -> Effect:
    return Effect(
        name=name,
        words=words,
        equation=equation,
        place=(place,),
        sizes=(size,),
        build=build,
        source=SOURCE,
        **further,  # type: ignore[arg-type]
    )


def _of_joint(model: Model, j: Joint) -> Iterator[Effect]:
    """Damping, stiffness and inertia beside those of the model, and a hidden mass on a spring and damper."""
    kinds = (
        ("damping", 1, "s", "", (0.03, 0.3), False),
        ("stiffness", 0, "", "", (0.03, 0.3), True),
        ("inertia", 2, "s^2", "^2", (0.03, 0.3), True),
    )
    for what, order, seconds, power, usual, signed in kinds:
        name, words = _named(what, j.row), f"{what} at the {j.row}"
        size = _size(name, _per(model, seconds), j.inertia * j.corner ** (2 - order), usual, words, signed, least=-0.3)
        of = f" s{power}" if order else ""
        equation = f"{j.row} + {name}{of} {j.angle}"
        build = partial(_with_terms, terms=(Term(j.row, j.angle, (name,), order),))
        yield _effect(name, words, equation, j.row, size, build)
    yield _hidden_mass(model, j)


def _with_terms(model: Model, terms: Sequence[Term], filters: Sequence[Filter] = ()) -> Model:
    return model.with_terms(terms=terms, filters=filters)


def _hidden_mass(model: Model, j: Joint) -> Effect:
    """Reaction m s^2 (2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2) of a mass that a spring and a damper carry."""
    name, frequency, zeta = _named("hidden_mass", j.row), _named("hidden_hz", j.row), _named("hidden_damping", j.row)
    w, hz = 2 * np.pi, j.corner / (2 * np.pi)
    stiffness = Monomial(w**2, 0, ((frequency, 2),))
    damping = Monomial(2 * w, 1, ((frequency, 1), (zeta, 1)))
    mode = Filter(name, (stiffness, damping), (Monomial(1.0, 2), damping, stiffness))
    words = f"a hidden mass on a spring at the {j.row}"
    size = _size(name, _per(model, "s^2"), j.inertia, (0.03, 0.2), "inertia of the hidden mass", least=-0.3)
    resonance = Size(
        name=frequency,
        unit="Hz",
        null=None,
        lower=0.5 * hz,
        upper=12 * hz,
        published=(hz, 6 * hz),
        meaning="frequency of its resonance",
    )
    form = Form(name=zeta, nominal=0.2, low=0.05, high=0.4, meaning="damping ratio of its resonance", source=SOURCE)
    effect = _effect(
        name,
        words,
        f"{j.row} + m s^2 (2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2) {j.angle}",
        j.row,
        size,
        partial(_with_terms, terms=(Term(j.row, j.angle, (name,), 2, filters=(name,)),), filters=(mode,)),
        forms=(form,),
    )
    return replace(effect, sizes=(size, resonance))


def is_feedback(model: Model, t: Term) -> bool:
    """Whether a term is feedback that is sensed, not the part of an equation that defines an unknown with its noise."""
    defines = t.sense == own_angles(model).get(t.row) and not (t.gain or t.delay or t.filters)
    return (t.delay is not None or t.noisy) and not defines


def _of_feedback(model: Model, joints: Sequence[Joint], corner: float) -> Iterator[Effect]:
    """Of the feedback in every row: its gain, lag and delay, an integral and the acceleration of what it senses."""
    inertia = {j.row: j.inertia for j in joints}
    for row in own_angles(model):
        selects = partial(_feeds_back, model, row=row)
        own = [t for t in model.terms if selects(t)]
        if not own:
            continue
        yield from _of_terms("feedback", row, f"the feedback at the {row}", row, selects, corner)
        first = next((t for t in model.terms if t in own and t.order == 0 and t.sense != "stimulus"), None)
        if first is None:
            continue
        alike = [t for t in own if t.order == 0 and t.gain[:1] == first.gain[:1]] if first.gain else [first]
        gain = abs(first.coefficient * float(np.prod([model.truth[model.names.index(g)] for g in first.gain])))
        J = inertia.get(row, joints[0].inertia if joints else gain / corner**2)
        for what, order, seconds, scale in (("integral", -1, "/s", gain * corner), ("acceleration", 2, "s^2", J)):
            name = _named(what, row)
            terms = tuple(_as(t, name, order, bool(first.gain)) for t in alike)
            words = f"feedback of the {what} of {first.sense} at the {row}"
            unit = _per(model, seconds) if order == 2 else f"{_per(model)} {seconds}".replace(" /s", "/s")
            power = "s^2" if order == 2 else "1/s"
            size = _size(name, unit.strip() if _per(model) else "", scale, (0.01, 0.1), words, least=-0.5)
            yield _effect(
                name,
                words,
                f"{row} + {name} {power} of {first.sense}, as late as its feedback",
                row,
                size,
                partial(_with_terms, terms=terms),
            )


def _as(t: Term, gain: str, order: int, first: bool) -> Term:
    """The term with another power of s, its first gain replaced (or added)."""
    sign = t.coefficient if first else float(np.sign(t.coefficient))
    return replace(t, gain=(gain, *t.gain[1:]), order=order, coefficient=sign)


def _of_signals(model: Model, corner: float) -> Iterator[Effect]:
    """Of the feedback of every sensed angle, in all rows: its gain, lag and delay; none where a row alone has it."""
    rows = [[t for t in model.terms if _feeds_back(model, t, row=row)] for row in model.rows]
    for angle in own_angles(model).values():
        selects = partial(_feeds_back, model, sense=angle)
        sensed = [t for t in model.terms if selects(t)]
        if sensed and sensed not in rows:
            yield from _of_terms("sense", angle, f"the sensed {angle}", "sensor", selects, corner)


def _feeds_back(model: Model, t: Term, row: str = "", sense: str = "") -> bool:
    """Whether a term is feedback in a row, or of an angle."""
    return is_feedback(model, t) and row in ("", t.row) and sense in ("", t.sense)


def _of_terms(
    what: str, where: str, words: str, place: str, selects: Callable[[Term], bool], corner: float
) -> Iterator[Effect]:
    """Gain, lag and delay of the terms that ``selects`` selects."""
    lag, delay, gain = (_named(f"{what}_{kind}", where) for kind in ("lag", "delay", "gain"))
    yield _effect(
        lag,
        f"a lag of {words}",
        f"{words} / ({lag} s + 1)",
        place,
        _size(lag, "s", 1 / corner, (0.03, 0.3), "time constant", least=0.0),
        partial(add.filter_terms, selects=selects, filt=add.low_pass(lag, lag)),
        order=2,
    )
    yield _effect(
        delay,
        f"a further delay of {words}",
        f"{words} x e^(-{delay} s)",
        place,
        _size(delay, "s", 1 / corner, (0.03, 0.3), "delay", least=0.0),
        partial(add.delay_terms, selects=selects, delay=delay),
        order=2,
    )
    factor = Filter(gain, (add.ONE, Monomial(1.0, 0, ((gain, 1),))), (add.ONE,))
    yield _effect(
        gain,
        f"another gain of {words}",
        f"{words} x (1 + {gain})",
        place,
        _size(gain, "", 1.0, (0.03, 0.15), "relative error of the gain", signed=True),
        partial(add.filter_terms, selects=selects, filt=factor),
        order=2,
    )


def _of_stimulus(model: Model, corner: float) -> Iterator[Effect]:
    """Gain, lag and delay of the stimulus; in an equation without inertia also its rate and its integral."""
    yield from _of_terms("stimulus", "", "the stimulus", "stimulus", add.is_stimulus, corner)
    heavy = {j.row for j in joints_of(model)}
    for row in (r for r in own_angles(model) if r not in heavy):
        if not any(t.row == row and add.is_stimulus(t) and not t.delay for t in model.terms):
            continue
        b = float(np.abs(frf(model, model.truth, np.array([corner / (2 * np.pi)] * max(1, len(model.blocks))))[0, 0]))
        for what, order, seconds in (("rate", 1, " s"), ("integral", -1, "/s")):
            name = _named(f"stimulus_{what}", row)
            words = f"the {what} of the stimulus in {row}"
            unit = f"{model.unit}/{model.stimulus_unit}" + seconds
            yield _effect(
                name,
                words,
                f"{row} = ... + {name} {'s' if order == 1 else '1/s'} stimulus",
                row,
                _size(name, unit, b * corner**-order, (0.01, 0.3), words, least=-0.3),
                partial(_with_terms, terms=(Term(row, "stimulus", (name,), order),)),
            )


def _of_sensors(model: Model, corner: float) -> Iterator[Effect]:
    """A lag and a wrong gain of every measured angle."""
    measured = {t.sense for o in model.outputs for t in o.terms} if model.outputs else set(model.angles)
    for angle in own_angles(model).values():
        at = model.angles.index(angle)
        if not any(angle == m or model.senses[m][at] for m in measured if m != "stimulus"):
            continue
        lag, gain = _named("sensor_lag", angle), _named("sensor_gain", angle)
        factor = Filter(gain, (add.ONE, Monomial(1.0, 0, ((gain, 1),))), (add.ONE,))
        yield _effect(
            lag,
            f"a lag of the sensor of {angle}",
            f"measured {angle} = {angle} / ({lag} s + 1)",
            "sensor",
            _size(lag, "s", 1 / corner, (0.03, 0.3), "time constant", least=0.0),
            partial(add.filter_output, angles=(at,), filt=add.low_pass(lag, lag)),
            order=2,
        )
        yield _effect(
            gain,
            f"another gain of the sensor of {angle}",
            f"measured {angle} = {angle} x (1 + {gain})",
            "sensor",
            _size(gain, "", 1.0, (0.03, 0.15), "relative error of the gain", signed=True),
            partial(add.filter_output, angles=(at,), filt=factor),
            order=2,
        )
