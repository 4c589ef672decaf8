"""Draw a misshapen form: a body, shape constants and a size at which it has a drawn delta.

Linear forms have a closed form, so their size follows from it as for the effects of the library; forms that are rules
of the time-domain simulator are measured as other nonlinear effects are (`mcstudy_challenge.bodies.withheld_causes`).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mcstudy.effect_library.effect import TrialSetting
from mcstudy.effect_library.library import effect
from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.errors import ModelError
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf
from mcstudy_challenge.bodies.draws import NIMBLE, draw_body, draw_delta, shared
from mcstudy_challenge.bodies.forms import Form
from mcstudy_challenge.bodies.geometry import Geometry, free, searched_size, stands
from mcstudy_challenge.bodies.out_of_library import holding
from mcstudy_challenge.bodies.withheld_causes import Cause, Drawn, Measured, Simulate, draw_cause
from mcstudy_challenge.design import Series

BODIES = 12
"""Number of bodies tried, each with shorter delays, before a form is given up for a case."""

EXACT = 0.1
"""Relative tolerance of delta."""


def shaped(form: Form, base: Model, theta: np.ndarray, size: float, shapes: Mapping[str, float]) -> Model | None:
    """The model with parameters ``theta`` (P,) and a linear form; None for a size that no body has."""
    if form.build is None:
        return None
    try:
        return form.build(holding(base, theta), size, shapes)
    except ModelError:
        return None


def draw_form(series: Series, rng: np.random.Generator, form: Form) -> Drawn | None:
    """A body, shape constants and a size at which the form has about a drawn delta; None if no body is stable."""
    shapes = form.draw(rng)
    sign = -1.0 if form.both and rng.random() < 0.5 else 1.0
    name = effect(form.mechanism).size.name
    if form.rule is not None:
        return _ruled(series, rng, form, shapes, name)
    for attempt in range(BODIES):
        theta = draw_body(series, rng, False, 1.0 - (1.0 - NIMBLE) * min(1.0, 2 * attempt / BODIES))
        geometry = Geometry(free(two_segment()), theta, shared(series)[0], series.noise.sensor)
        measured = linear_form(series, rng, form, geometry, shapes, sign)
        model = None if measured is None else shaped(form, two_segment(), theta, measured.size, shapes)
        if measured is not None and model is not None:

            def simulate(protocol: Protocol, stream: np.random.Generator, model: Model = model) -> Recording:
                return simulate_recording(protocol, model.truth, stream, model=model)

            return Drawn(theta, geometry, measured, {name: measured.size, **shapes}, simulate)
    return None


def linear_form(
    series: Series,
    rng: np.random.Generator,
    form: Form,
    geometry: Geometry,
    shapes: Mapping[str, float],
    sign: float | None = None,
) -> Measured | None:
    """A linear form on one body at a drawn delta; None where the body does not stand with it.

    ``sign`` of the size; drawn if None.
    """
    if sign is None:
        sign = -1.0 if form.both and rng.random() < 0.5 else 1.0

    def response(size: float) -> np.ndarray | None:
        model = shaped(form, geometry.base, geometry.theta, size, shapes)
        if model is None or not stands(model, model.truth, series.body.decay):
            return None
        return frf(model, model.truth, geometry.setting.f)

    wanted = draw_delta(series, rng)
    size, delta = searched_size(geometry, response, sign * form.limit, wanted)
    y = response(size) if abs(delta / wanted - 1) < EXACT else None
    return None if y is None else Measured(size, y, delta, delta)


def _ruled(
    series: Series, rng: np.random.Generator, form: Form, shapes: Mapping[str, float], name: str
) -> Drawn | None:
    rule = form.rule
    assert rule is not None

    def make(theta: np.ndarray) -> Simulate:
        def simulate(size: float, protocol: Protocol, stream: np.random.Generator) -> Recording:
            def fields(trial: TrialSetting) -> Mapping[str, object]:
                return rule(size, shapes, trial) if size else {}

            return simulate_recording(protocol, theta, stream, rule=fields)

        return simulate

    cause = Cause(make=make, start=form.limit / 8, top=form.limit, lasting=form.lasting)
    return draw_cause(series, rng, cause, name, shapes)
