"""Shape constants of effects: numbers unless opened, and then parameters with the declared form as their nominal."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.effect_library import library
from mcstudy.effect_library.constants import with_constants
from mcstudy.effect_library.effect import Form
from mcstudy.errors import InputError, ModelError
from mcstudy.stance.body import one_segment, two_segment
from mcstudy.stance.response import frf

BASE = two_segment()
F = np.array([0.05, 0.3, 1.0, 2.5, 6.0])
SHAPED = [e.name for e in library.LIBRARY.values() if e.forms]


@pytest.mark.parametrize("name", SHAPED)
def test_an_effect_in_its_nominal_form_is_the_declared_one_and_every_constant_matters(name: str) -> None:
    effect = library.effect(name)
    declared, opened = library.apply(BASE, name), library.apply(BASE, name, opened=[name])
    assert opened.names == (*declared.names, *effect.nominal_form)
    sizes = [sum(s.published) / 2 for s in effect.sizes]
    theta = np.array([*BASE.truth, *sizes, *effect.nominal_form.values()])
    expected = frf(declared, theta[: len(declared.names)], F)
    np.testing.assert_allclose(frf(opened, theta, F), expected, rtol=1e-9)
    for k, form in enumerate(effect.forms, start=len(declared.names)):
        other = theta.copy()
        other[k] = form.high if form.high != form.nominal else form.low
        assert np.abs(frf(opened, other, F) / expected - 1).max() > 1e-4, form.name
        assert form.meaning
        assert form.source


def test_most_linear_effects_leave_a_constant_open() -> None:
    assert len(SHAPED) >= 0.9 * len(library.LIBRARY.linear)


def test_a_body_without_a_hip_has_the_forms_of_its_ankle() -> None:
    one = one_segment()
    model = library.apply(one, "acceleration_feedback", opened=["acceleration_feedback"])
    assert {t.row for t in model.terms} == {"ankle"}
    assert "ratio_Ka1" in model.names


def test_a_delay_is_no_shape_constant() -> None:
    with pytest.raises(ModelError, match="the delay Td1 cannot be a shape constant"):
        with_constants(BASE, {"Td1": 0.1})


def test_a_form_outside_its_range_is_refused() -> None:
    with pytest.raises(InputError, match="form 'zeta': expected 0 <= low < high and nominal between"):
        Form(name="zeta", unit="", nominal=2.0, low=0.1, high=0.5, meaning="damping", source="nobody")
