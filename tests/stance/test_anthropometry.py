"""Bodies from height and mass: the tables agree with what their own publications state of the whole and its parts."""

from __future__ import annotations

import math
from itertools import product

import pytest

from mcstudy.errors import ModelError
from mcstudy.stance.anthropometry import _MAN, _WOMAN, Part, _DeLeva, _joined, hanging, proportions, segments
from mcstudy.stance.body import Body

FEET = {"winter": 2 * 0.0145, "male": 2 * 0.0137, "female": 2 * 0.0129}
"""Mass of both feet, which the segments leave out: Winter (2009), de Leva (1996)."""

PEOPLE = [(None, "winter"), ("male", "deleva"), ("female", "deleva")]


@pytest.mark.parametrize(("sex", "table"), PEOPLE)
def test_the_segments_and_the_feet_make_up_the_whole_body(sex: str | None, table: str) -> None:
    found = segments(1.0, 1.0 * 75, sex, table)
    assert (found["m1"] + found["m2"]) / 75 + FEET[sex or table] == pytest.approx(1.0, abs=2e-4)


def test_the_upper_body_agrees_with_the_same_table_taken_apart() -> None:
    """Winter's rows "trunk head neck" and "total arm" joined give his row "HAT", to its rounding and rounding of H."""
    trunk = Part(0.578, 0.66 * 0.288, 0.503 * 0.288)
    arms = hanging(2 * 0.050, 0.288, 0.186 + 0.146, 0.530, 0.368)
    mass, height, gyration = _joined((trunk, arms))
    (hat,) = proportions(table="winter").upper
    assert mass == pytest.approx(hat.mass)
    assert height == pytest.approx(hat.height, rel=0.02)
    assert gyration == pytest.approx(hat.gyration, rel=0.02)


def test_the_legs_agree_with_the_published_whole_leg() -> None:
    """Winter's row "total leg" holds the foot too: 0.161, centre at 0.447 of the length, gyration 0.326 of it."""
    legs = proportions(table="winter")
    foot = Part(2 * 0.0145, -0.0195, 0.475 * 0.039)
    mass, height, gyration = _joined((*legs.legs, foot))
    assert mass == pytest.approx(2 * 0.161)
    assert 1 - height / legs.length == pytest.approx(0.447, abs=0.02)
    assert gyration / legs.length == pytest.approx(0.326, abs=0.02)


@pytest.mark.parametrize(
    ("rows", "trunk", "head", "shank"),
    [(_MAN, (0.4310, 515.5), (0.5976, 203.3), 0.4395), (_WOMAN, (0.3782, 497.9), (0.5894, 200.2), 0.4352)],
    ids=["man", "woman"],
)
def test_both_published_definitions_of_a_segment_place_its_centre_alike(
    rows: _DeLeva, trunk: tuple[float, float], head: tuple[float, float], shank: float
) -> None:
    """de Leva's Table 4 gives trunk, head and shank a second time, between other landmarks, in other fractions."""
    assert (1 - rows.trunk[1]) * rows.c7_hip == pytest.approx((1 - trunk[0]) * trunk[1], abs=0.2)
    assert rows.head[1] * rows.vertex_c7 == pytest.approx(head[0] * head[1], abs=0.2)
    assert rows.shank[1] * rows.knee_malleolus == pytest.approx(shank * rows.knee_ankle, abs=0.2)


@pytest.mark.parametrize(("sex", "table"), PEOPLE)
def test_the_centre_of_mass_of_the_whole_body_lies_where_it_is_measured(sex: str | None, table: str) -> None:
    """Between 53 and 59 % of the height above the floor, with the feet, whose centre is about 0.02 heights up."""
    body, found = Body.from_person(1.0, 75.0, sex, table), segments(1.0, 75.0, sex, table)
    moment = body.A1 + body.A2 + 0.039 * (found["m1"] + found["m2"]) + 0.0195 * 75 * FEET[sex or table]
    assert 0.53 < moment / 75 < 0.59


def test_a_taller_or_heavier_person_has_a_body_of_the_same_shape() -> None:
    small, large = segments(1.5, 50.0, "female"), segments(1.8, 75.0, "female")
    for name, exponents in {"m1": (0, 1), "h2": (1, 0), "I2": (2, 1), "L1": (1, 0)}.items():
        assert large[name] / small[name] == pytest.approx(1.2 ** exponents[0] * 1.5 ** exponents[1])


def test_a_stated_sex_chooses_the_table_of_that_sex() -> None:
    assert "Winter" in proportions().source
    assert "de Leva" in proportions("male").source
    assert "Winter" in proportions("male", "winter").source
    assert segments(1.7, 70.0, "male") != segments(1.7, 70.0, "female")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((180, 75), "body.height: expected a number from 0.5 to 2.6 m, got 180; is it in m?"),
        ((1.8, 75e3), "body.weight: expected a number from 5 to 400 kg, got 75000; is it in kg?"),
        ((math.nan, 75), "body.height"),
        ((1.8, 75, "man"), "body.sex: expected female or male"),
        ((1.8, 75, None, "dempster"), "body.table: expected winter or deleva"),
        ((1.8, 75, None, "deleva"), "expected body.sex"),
    ],
)
def test_a_body_of_nobody_is_refused_by_name(arguments: tuple[float, float], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        segments(*arguments)


def test_every_height_and_weight_in_range_gives_a_body() -> None:
    for height, mass, (sex, table) in product((0.5, 2.6), (5.0, 400.0), PEOPLE):
        assert Body.from_person(height, mass, sex, table).mgh > 0
