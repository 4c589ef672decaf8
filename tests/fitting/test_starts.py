"""Starts lie between the bounds, follow their stream, and grow where they say so."""

import numpy as np
import pytest
from scipy.stats import qmc

from mcstudy.fitting.starts import DIRECTIONS, STARTS, sobol_points
from mcstudy.stance.body import one_segment, two_segment

GROWING = ["uniform", "sobol"]


def draw(kind: str, n: int, seed: int = 3) -> np.ndarray:
    return STARTS[kind](two_segment(), np.random.default_rng(seed), n)


@pytest.mark.parametrize("kind", STARTS)
@pytest.mark.parametrize("n", [0, 1, 5, 64])
def test_starts_lie_between_the_bounds(kind: str, n: int) -> None:
    model = two_segment()
    starts = draw(kind, n)
    assert starts.shape == (n, len(model.parameters))
    assert (starts >= model.lower).all()
    assert (starts <= model.upper).all()


@pytest.mark.parametrize("kind", STARTS)
def test_a_stream_decides_the_starts(kind: str) -> None:
    assert draw(kind, 9).tobytes() == draw(kind, 9).tobytes()
    assert (draw(kind, 9) != draw(kind, 9, seed=4)).all()


@pytest.mark.parametrize("kind", GROWING)
@pytest.mark.parametrize(("short", "long"), [(1, 2), (5, 8), (8, 9), (50, 500)])
def test_a_longer_draw_begins_with_a_shorter_one(kind: str, short: int, long: int) -> None:
    assert draw(kind, short).tobytes() == draw(kind, long)[:short].tobytes()


@pytest.mark.parametrize("dimensions", range(1, len(DIRECTIONS) + 3))
@pytest.mark.parametrize("n", [1, 2, 64, 1000])
def test_sobol_points_are_scipys_to_the_last_bit(dimensions: int, n: int) -> None:
    seed = 100 * dimensions + n
    expected = qmc.Sobol(dimensions, seed=np.random.default_rng(seed)).random_base2((n - 1).bit_length())[:n]
    assert sobol_points(dimensions, np.random.default_rng(seed), n).tobytes() == expected.tobytes()


def test_a_latin_hypercube_does_not_grow() -> None:
    assert (draw("latin_hypercube", 8)[:5] != draw("latin_hypercube", 5)).any()


@pytest.mark.parametrize("kind", ["latin_hypercube", "sobol"])
def test_even_starts_put_one_point_in_every_slice_of_every_parameter(kind: str) -> None:
    model, n = one_segment(), 64
    starts = STARTS[kind](model, np.random.default_rng(1), n)
    slices = np.floor((starts - model.lower) / (model.upper - model.lower) * n)
    assert (np.sort(slices, axis=0) == np.arange(n)[:, None]).all()


def test_uniform_starts_leave_slices_empty() -> None:
    model, n = one_segment(), 64
    starts = STARTS["uniform"](model, np.random.default_rng(1), n)
    slices = np.floor((starts - model.lower) / (model.upper - model.lower) * n)
    assert all(np.unique(column).size < n for column in slices.T)
