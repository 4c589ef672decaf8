"""What must hold of a model beyond its table: it is checked against code that shares nothing with the table's.

The independent evaluation assembles the closed loop term by term from what the file says, as plain matrices, and its
derivatives are differences.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mcstudy.errors import DesignError, ModelError
from mcstudy.expressions import expression
from mcstudy.models.record import ModelTable, Number, number
from mcstudy.stance.response import frf_jacobian

FREQUENCIES = np.geomspace(0.05, 8.0, 5)
"""Where a model is evaluated both ways, Hz."""

EQUAL, SLOPES = 1e-9, 1e-4
"""Largest relative differences of responses, and of derivatives from differences."""

STEP = 1e-5
"""Of the differences, relative to the parameter."""

ROUNDING = 1e-13
"""Of a response, relative; over the step it is the error that rounding leaves in a difference."""

STILL = 1e-12
"""Relative change of the response over the bounds of a parameter that moves nothing."""


def response(table: ModelTable, values: Mapping[str, float], f: np.ndarray) -> np.ndarray:
    """Responses of the joints, or the declared outputs, from the file alone, (N J, Y) complex.

    To each of J stimuli in turn at every frequency ``f`` (N,).
    """
    s, constants = 2j * np.pi * f, table.values()
    known = {**constants, **values, "s": s, "pi": np.pi}
    n = len(table.joints)
    names = [*table.joints, *table.angles]

    def polynomial(given: Number) -> np.ndarray:
        return np.asarray(expression(given if isinstance(given, str) else repr(given), known, "filter", "")(known))

    through = {x.name: polynomial(x.numerator) / polynomial(x.denominator) for x in table.filter}
    loop, drive = np.zeros((f.size, n, n), dtype=complex), np.zeros((f.size, n, len(table.stimuli)), dtype=complex)
    for t in table.term:
        joint = t.joint or table.joints[0]
        row = table.joints.index(joint)
        factor = number(t.coefficient, constants, "coefficient") * s**t.order
        for name in t.gain:
            factor = factor * values[name]
        for name in t.delay:
            factor = factor * np.exp(-values[name] * s)
        for name in t.filter:
            factor = factor * through[name]
        sense = t.sense or joint
        if sense in table.stimuli:
            drive[:, row, table.stimuli.index(sense)] += factor
            continue
        sensed = expression(sense, names, "sense", "")
        for column in range(n):
            unit = {name: float(i % n == column) for i, name in enumerate(names)}
            loop[:, row, column] += factor * sensed(unit)
    H = np.linalg.solve(loop, drive)
    for joint, name in table.sensor_filter.items():
        H[:, table.joints.index(joint)] *= through[name][..., None]
    H = np.moveaxis(H, 2, 1).reshape(-1, n)
    if not table.output:
        return np.asarray(H)
    at = {**known, "s": np.repeat(s, len(table.stimuli))}
    stimuli = {name: np.tile(np.eye(len(table.stimuli))[k], f.size) + 0.0j for k, name in enumerate(table.stimuli)}
    signals = {**at, **stimuli} | {name: H[:, i % n] for i, name in enumerate(names)}
    outputs = [expression(str(o.value), signals, "output", "")(signals) for o in table.output]
    return np.stack([np.broadcast_to(y, len(H)) for y in outputs], axis=-1)


def check_response(table: ModelTable, f: np.ndarray = FREQUENCIES) -> tuple[float, float]:
    """Raise `DesignError` unless the model responds as its table says, in every output, to every parameter.

    Returns the largest relative differences of responses and of derivatives from the independent evaluation.
    """
    model = table.model()
    names = [o.name for o in table.output] or list(table.joints)
    n = len(names)
    values = {p.name: p.value for p in model.parameters}
    try:
        with np.errstate(all="ignore"):
            H, slope = frf_jacobian(model, model.truth, np.repeat(f, len(table.stimuli)))
            H, slope = H[:, :n], slope[:, :n]
            expected = response(table, values, f)
    except np.linalg.LinAlgError:
        raise DesignError("term: expected a closed loop with a response, got a singular one") from None
    for joint, size in zip(names, np.abs(expected).T, strict=True):
        if not np.isfinite(size).all():
            raise DesignError(f"term: expected a finite response of {joint}, got one that overflows")
        if not size.all():
            raise DesignError(f"term: expected a stimulus that moves every output, got no response of {joint}")
    apart = float(np.max(np.abs(H - expected) / np.abs(expected)))
    if not apart <= EQUAL:
        raise DesignError(f"term: expected the independent evaluation of the closed loop, got {apart:.2g} beside it")
    worst = 0.0
    for i, p in enumerate(model.parameters):
        step = STEP * (abs(p.value) or p.upper - p.lower)
        beside = [response(table, values | {p.name: p.value + sign * step}, f) for sign in (1, -1)]
        difference = (beside[0] - beside[1]) / (2 * step)
        if not (np.abs(slope[..., i]) * (p.upper - p.lower) > STILL * np.abs(H)).any():
            raise DesignError(
                f"parameter.{p.name}: expected a parameter that moves the response, got one that does not"
            )
        off = np.abs(slope[..., i] - difference) - ROUNDING / step * np.abs(H)
        worst = max(worst, float(off.max() / np.abs(slope[..., i]).max()))
    if not worst <= SLOPES:
        raise DesignError(f"term: expected the derivatives of the independent evaluation, got {worst:.2g} beside them")
    return apart, worst


def check_stability(table: ModelTable) -> float:
    """Growth rate at the true values, 1/s; raises `DesignError` for an improper or an unstable closed loop.

    Minus infinity for a loop without dynamics.
    """
    from mcstudy.stance.stability import growth_rate  # loads compiled code

    model = table.model()
    try:
        growth = float(growth_rate(model, model.truth))
    except ModelError as error:
        raise DesignError(f"term: {error}") from None
    if np.isnan(growth):
        raise DesignError("term: expected a closed loop with characteristic roots, got a singular one")
    if growth == np.inf:
        raise DesignError("term: expected a proper closed loop, got a delayed term of a higher order than all others")
    if not growth < 0:
        raise DesignError(
            f"parameter: expected a stable closed loop at the true values, got growth rate {growth:+.3g} 1/s"
        )
    return growth
