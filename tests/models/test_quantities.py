"""Quantities are functions of the parameters, with exact derivatives; anything else is refused in one line."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

import mcstudy as mc
from mcstudy.errors import InputError
from mcstudy.expressions import expression as formula
from mcstudy.fitting.penalised import whiten
from mcstudy.fitting.problem import Data
from mcstudy.identification.trades import bodies
from mcstudy.models.quantities import expression, function, quantities, require_finite
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf

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
        ("abs(K11)", "got 'abs(K11)'"),
        ("k11", "(similar: K11)"),
        ("exp", "expected exp(...)"),
        ("1j * K11", "got '1j'"),
        ("True * K11", "got 'True'"),
        ("3(K11)", "got '3(K11)'"),
        ("K11 << 9", "got 'K11 << 9'"),
        ("1e400 * K11", "expected numbers below 1.8e308"),
        ("1" * 3000 + " * K11", "expected numbers below 1.8e308"),
        ("+".join(["K11"] * 3000), "expected at most 4000 characters, got 11999"),
        ("(" * 10_000 + "K11" + ")" * 10_000, "expected at most 4000 characters"),
        ("(" * 300 + "K11" + ")" * 300, "expected less nesting"),
        ("-" * 3900 + "K11", "less nesting"),
        ("K11\0", "expected an expression"),
        ("", "expected an expression"),
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
    assert len(str(error.value)) < 300


@pytest.mark.parametrize("text", ["9**9**9**9*K11", "K11*1e308*1e10", "exp(K11 * K11)", "1/(Kpas2 - Kpas2)"])
def test_what_is_too_large_for_a_number_is_infinite_at_once(text: str) -> None:
    assert formula(text, MODEL.names, "quantity", "'K11'")(VALUES) == np.inf


def test_what_is_not_real_is_no_number() -> None:
    assert np.isnan(formula("(-1)**0.5 * K11", MODEL.names, "quantity", "'K11'")(VALUES))
    assert np.isnan(formula("log(-K11)", MODEL.names, "quantity", "'K11'")(VALUES))


def test_whole_numbers_do_not_overflow() -> None:
    assert formula("cycles**cycles", ["cycles"], "cost", "'cycles'")({"cycles": np.array([40])}) == 40.0**40


def test_a_sum_of_many_terms_is_as_deep_as_any_other() -> None:
    assert formula("+".join(["K11"] * 900), MODEL.names, "quantity", "'K11'")({"K11": 2.0}) == 1800


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("K11/Kpas2", r"at the estimates \(K11 = [\d.]+, Kpas2 = 0\), got inf"),
        ("exp(1000 * K11)", "got inf"),
        ("log(-K11)", "got nan"),
        ("1e150 * K11", "got"),
        ("1e-150 * K11", "expected a derivative"),
        ("Kpas2 * Kpas2", "expected a derivative"),
    ],
)
def test_a_quantity_without_a_value_or_a_derivative_at_the_estimates_is_refused_in_one_line(text, said) -> None:
    theta = np.where(np.array(MODEL.names) == "Kpas2", 0.0, THETA)
    with pytest.raises(InputError, match=said):
        require_finite(MODEL, [expression(MODEL, text)], theta)


def test_a_python_function_that_divides_by_zero_has_no_value_there() -> None:
    quantity = function(MODEL, "ratio", lambda v: v["K11"] / v["Kpas2"])
    assert np.isnan(quantity.value(np.where(np.array(MODEL.names) == "Kpas2", 0.0, THETA)))


@pytest.mark.parametrize("of", [len, lambda v: v["foo"], repr])
def test_a_python_function_that_is_none_of_the_parameters_is_refused(of) -> None:
    with pytest.raises(InputError, match="quantity 'mine'"):
        function(MODEL, "mine", of)


def test_a_name_is_taken_once() -> None:
    with pytest.raises(InputError, match="taken"):
        quantities(MODEL, {"K11": "K11 * 2"})


def test_intervals_of_quantities_with_a_pole_or_an_inner_maximum_hold_every_body_that_fits() -> None:
    """Bodies whose deviance is below the threshold of chi-squared are in every interval whose ends the data set."""
    texts = ("K11*Kpas1", "1/(Kpas1-100)")
    r = mc.fit(mc.simulate(cycles=3, rate_hz=50.0, seed=1), fmax=3.0, quantities={t: t for t in texts})
    by_name = {e.name: e for e in r.estimates}
    data, everybody = Data.of(r.lines), bodies(r.estimates)
    residuals = [whiten(data.weight, data.y - frf(r.model, body, data.f)) for body in everybody]
    fitting = everybody[[residual @ residual - r.chi2 <= chi2.ppf(0.95, 1) for residual in residuals]]
    assert len(fitting) > 100
    product, inverse = (expression(r.model, text) for text in texts)
    values = np.array([product.value(body) for body in fitting])
    e = by_name[texts[0]]
    assert e.low <= values.min() < values.max() <= e.high
    at = r.model.names.index("Kpas1")
    assert values.max() > max(product.value(fitting[k]) for k in (fitting[:, at].argmin(), fitting[:, at].argmax()))
    passive, e = by_name["Kpas1"], by_name[texts[1]]
    assert passive.low < 100 < passive.high
    assert (e.low_from, e.high_from) == ("steps", "steps")  # no end is claimed: the quantity has none
    assert e.low <= inverse.value(everybody[everybody[:, at].argmin()]) + 1e-12
    assert e.high > 100
