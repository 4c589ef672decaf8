"""Noise from a table has the densities of the table, is the noise of a study, and leaves other studies as they were."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mcstudy.errors import DesignError
from mcstudy.stance.noise import DEG2_TO_RAD2, SensorNoise, TabulatedNoise
from mcstudy.study.design import Study
from mcstudy.study.study_file import parse_study

F = np.geomspace(0.01, 100.0, 300)
PINK = SensorNoise()


def table(f: np.ndarray = F) -> dict[str, list[float]]:
    first, second = PINK.psd(f).T / DEG2_TO_RAD2
    return {"f_hz": f.tolist(), "theta1": first.tolist(), "theta2": second.tolist()}


def study(**noise: Any) -> Study:
    return Study("a", seed=1).group("g", realizations=1, starts=1, fmax=[3.1], amplitude=[5.0], noise=noise)


def test_the_densities_are_those_of_the_table_and_stay_beyond_it() -> None:
    noise = TabulatedNoise((0.1, 1.0, 10.0), ((4.0, 1.0, 1.0), (1.0, 100.0, 1.0)), ("first", "second"))
    found = noise.psd(np.array([0.0, 0.01, 0.1, np.sqrt(0.1), 1.0, 99.0])) / DEG2_TO_RAD2
    np.testing.assert_allclose(found, [[0, 0], [4, 1], [4, 1], [2, 10], [1, 100], [1, 1]], rtol=1e-12)


def test_a_dense_table_of_the_usual_noise_gives_the_usual_study() -> None:
    """The data of a realization, against those with the formula."""
    first, second = (
        next(iter(s.groups.values())).noise_source.sample(np.random.default_rng(1), 8744, 200.0)
        for s in (study(), study(table=table()))
    )
    np.testing.assert_allclose(second, first, atol=2e-3 * first.std())


def test_a_file_keeps_the_table_and_one_without_a_table_says_nothing_of_it() -> None:
    with_table = study(table=table(np.array([0.1, 1.0, 8.0])))
    text = with_table.to_toml()
    assert parse_study(text).groups["g"].noise == with_table.groups["g"].noise
    assert "psd" not in text
    assert "corner_hz" not in text
    assert "table" not in study().to_toml()
    assert with_table.groups["g"].noisy


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        ({"table": {"f_hz": [1.0, 0.5], "theta1": [1.0, 1.0], "theta2": [1.0, 1.0]}}, "noise.table.f_hz: expected"),
        ({"table": {"f_hz": [1.0, 2.0], "theta1": [1.0], "theta2": [1.0, 1.0]}}, "noise.table.theta1: expected 2"),
        ({"table": {"f_hz": [1.0], "theta1": [1.0], "theta2": [0.0]}}, "noise.table.theta2"),
        ({"table": {"f_hz": [1.0], "theta1": [1.0], "theta2": [1.0]}, "corner_hz": 1.0}, "either a table, or psd"),
    ],
)
def test_a_table_that_is_no_noise_is_refused_in_one_line(noise: dict[str, Any], words: str) -> None:
    with pytest.raises(DesignError) as error:
        study(**noise)
    assert words in str(error.value)
    assert "\n" not in str(error.value)
