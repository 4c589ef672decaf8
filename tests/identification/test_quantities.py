"""Quantities are functions of the parameters, with exact derivatives; anything else is refused in one line."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.errors import InputError
from mcstudy.identification.quantities import expression, function, quantities
from mcstudy.stance.body import two_segment

MODEL = two_segment()
THETA = MODEL.truth * np.linspace(0.8, 1.2, MODEL.truth.size)
VALUES = dict(zip(MODEL.names, THETA, strict=True))


@pytest.mark.parametrize(
    ("text", "of"),
    [
        ("K11 + Kpas1 - 490", lambda v: v["K11"] + v["Kpas1"] - 490),
        ("-K11 / (2 * B11)", lambda v: -v["K11"] / (2 * v["B11"])),
        (
            "sqrt(K22) + exp(Td1) - log(B22) ** 2",
            lambda v: np.sqrt(v["K22"]) + np.exp(v["Td1"]) - np.log(v["B22"]) ** 2,
        ),
    ],
)
def test_an_expression_has_the_value_and_the_derivative_of_the_same_python_function(text, of) -> None:
    quantity, same = expression(MODEL, text), function(MODEL, "same", of)
    assert quantity.value(THETA) == pytest.approx(of(VALUES), rel=1e-14)
    np.testing.assert_allclose(quantity.gradient(THETA), same.gradient(THETA), rtol=1e-6, atol=1e-9)


def test_a_sum_of_parameters_has_their_unit_and_other_expressions_none() -> None:
    assert expression(MODEL, "K11 + Kpas1 - 490").unit == "N m/rad"
    assert expression(MODEL, "K11 / Kpas1").unit == ""
    assert expression(MODEL, "K11 + B11").unit == ""


def test_every_parameter_and_the_two_sums_of_stiffness_are_quantities() -> None:
    found = [q.name for q in quantities(MODEL, {"ratio": lambda v: v["K11"] / v["K22"]})]
    assert found == [*MODEL.names, "K11 + Kpas1", "K22 + Kpas2", "ratio"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("K11 + foo", "got foo"),
        ("3", "at least one parameter"),
        ("K11 - K11", "changes with at least one parameter"),
        ("0 * K11 + 3", "changes with at least one parameter"),
        ("K11 +", "expected an expression"),
        ("K11.real", "got 'K11.real'"),
        ("abs(K11)", "got abs"),
        ("sqrt(K11, 2)", "got 'sqrt(K11, 2)'"),
        ("__import__('os').system('true') + K11", "expected"),
        ("K11 if K11 else 1", "got 'K11 if K11 else 1'"),
    ],
)
def test_anything_that_is_no_arithmetic_of_parameters_is_refused_in_one_line(text: str, said: str) -> None:
    with pytest.raises(InputError, match="quantity") as error:
        expression(MODEL, text)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("of", [len, lambda v: v["foo"], repr])
def test_a_python_function_that_is_none_of_the_parameters_is_refused(of) -> None:
    with pytest.raises(InputError, match="quantity 'mine'"):
        function(MODEL, "mine", of)


def test_a_name_is_taken_once() -> None:
    with pytest.raises(InputError, match="taken"):
        quantities(MODEL, {"K11": "K11 * 2"})
