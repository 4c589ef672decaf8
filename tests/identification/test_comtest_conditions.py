"""One segment fitted to 49 people in four conditions at once; the people are no part of the project."""

from __future__ import annotations

import numpy as np
from examples import module as example
from many_people import comtest, needs_comtest

import mcstudy as mc
from mcstudy.stance.body import Body
from mcstudy.stance.response import frf


def test_the_model_is_that_of_the_whole_body() -> None:
    body = Body()
    model = example("comtest_conditions").model_on(body)
    values = dict(zip(model.names, model.truth, strict=True))
    s = 2j * np.pi * np.array([0.1, 1.0])
    late = (values["Kp"] + values["Kd"] * s) * np.exp(-values["tau"] * s)
    active = late / (1 - values["Kt"] / s * late)
    expected = values["Wp"] * active / ((body.J1 + body.C2) * s**2 - body.mgh + active)
    np.testing.assert_allclose(frf(model, model.truth, np.array([0.1, 1.0]))[:, 0], expected, rtol=1e-10)
    assert values["Kp"] / body.mgh == 1019.25 / 755


@needs_comtest
def test_the_weight_falls_with_open_eyes_and_with_the_tilt() -> None:
    group, made = comtest(), example("comtest_conditions")
    model = made.model_on(Body(*group.attrs["body"]))
    people = np.arange(group.sizes["person"])
    fit = mc.fit_conditions(made.responses(group, "centre of mass", people, model), fmax=made.FMAX_HZ)
    weight = {name: fit["Wp", name].estimate for name in fit.conditions}
    assert weight["closed, 0.5"] > weight["closed, 1.0"] > weight["open, 0.5"] > weight["open, 1.0"]
    np.testing.assert_allclose(list(weight.values()), [0.733, 0.652, 0.526, 0.426], atol=2e-3)
    assert abs(1e3 * fit["tau"].estimate - 159) < 1
    assert fit.sharing("Wp").p_value < 1e-4
