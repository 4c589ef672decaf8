"""The colour of noise at the lowest lines: estimated without bias, undone exactly, paid for in degrees of freedom."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.spectra.colour import BEND, Colour
from mcstudy.spectra.even_lines import EvenLineCovariance

EVEN = np.arange(2, 61, 2)
LINES = np.arange(1, 41, 2)


def rise(k: np.ndarray) -> np.ndarray:
    """Power (K,) by which lines of exponent 1 exceed white ones: BEND / k far below `BEND`, 1 far above."""
    return np.sqrt(1 + (BEND / k) ** 2)


def powers(exponent: float, trials: int, n: int, seed: int = 0) -> np.ndarray:
    """Mean squared Gaussian lines (n, E) that fall as k^-exponent well below `BEND`."""
    squares = np.random.default_rng(seed).gamma(trials, 1.0 / trials, (n, EVEN.size))
    return squares * rise(EVEN) ** exponent


@pytest.mark.parametrize("exponent", [-1.0, 0.0, 1.0])
def test_the_exponent_is_found_and_scatters_as_the_degrees_of_freedom_say(exponent: float) -> None:
    colour = Colour(EVEN, LINES, (2, 6))
    found = colour.exponent(np.array([powers(exponent, 2, 4000), 3.0 * powers(exponent, 6, 4000, 1)])[:, None])[0]
    assert found.mean() == pytest.approx(exponent, abs=0.05)  # the prior pulls by 2 %
    known = np.full(LINES.size, 1e9)
    # ln of the noise at line 1 moves by the exponent's error times the distance from the middle of the lines used
    distance = np.log(rise(LINES[:1])) - np.log(rise(EVEN[EVEN <= BEND])).mean()
    assert 1 / colour.dof(known)[0] == pytest.approx(found.var() * distance[0] ** 2, rel=0.15)


def test_levelling_flattens_and_restoring_undoes_it_at_the_same_line() -> None:
    colour = Colour(EVEN, EVEN, (2,))
    s = np.array([-0.7, 0.0, 1.3])
    assert colour.levelled(s) * colour.restored(s) == pytest.approx(np.ones((3, EVEN.size)))
    flat = rise(EVEN) ** (s[:, None] / 2) * colour.levelled(s)
    assert flat == pytest.approx(np.ones_like(flat))


def test_lines_above_the_bend_keep_their_degrees_of_freedom() -> None:
    given = np.full(LINES.size, 20.0)
    dof = Colour(EVEN, LINES, (2,)).dof(given)
    assert (dof[LINES >= BEND] == 20.0).all()
    assert dof[0] < 5.0 < dof[3]


def test_the_flattest_angle_tells_the_colour_of_all() -> None:
    colour = Colour(EVEN, LINES, (8,))
    found = colour.exponent(np.array([[powers(1.5, 8, 500), powers(0.2, 8, 500, 1)]]))
    assert (found[0] == found[1]).all()
    assert found.mean() == pytest.approx(0.2, abs=0.05)


def test_further_records_are_worth_degrees_of_freedom() -> None:
    given = np.full(LINES.size, 20.0)
    alone, with_more = (Colour(EVEN, LINES, records).dof(given) for records in ((2,), (2, 8)))
    assert with_more[0] > 2.5 * alone[0]


@pytest.mark.parametrize("fall", [0.0, 2.0])
def test_line_one_of_white_and_brown_noise_is_nearer_the_truth_than_with_a_presumed_colour(fall: float) -> None:
    """Sway with its resonance; two trials, eight more records."""
    rng = np.random.default_rng(3)
    k = np.maximum(np.arange(601.0), 1.0)
    resonance = 1 / (1 - (k / 45) ** 2 + 0.6j * k / 45)
    noise = rng.standard_normal((100, 10, 601, 2, 2)) @ np.array([1, 1j]) / np.sqrt(2)
    noise *= (resonance * k ** (-fall / 2))[:, None]
    noise[..., 1] += noise[..., 0] * (1 + 0.1j)
    off = {}
    for any_colour in (None, (2, 8)):
        estimator = EvenLineCovariance(np.arange(1, 485, 2), 600, any_colour)
        # the mean of two trials has half of it
        found = [2 * estimator(x[:2], None if any_colour is None else x[2:])[0, 0, 0].real for x in noise]
        off[any_colour] = abs(np.log(np.array(found) / abs(resonance[1]) ** 2).mean())
    assert off[None] > 0.5
    assert off[2, 8] < 0.4 * off[None]


def test_brown_noise_is_not_understated_where_its_colour_fades() -> None:
    """A power law that ended sharply at `BEND` would leave the lines there 6 % too small."""
    rng = np.random.default_rng(4)
    k = np.maximum(np.arange(601.0), 1.0)
    noise = (rng.standard_normal((400, 10, 601, 2, 2)) @ np.array([1, 1j]) / np.sqrt(2)) / k[:, None]
    estimator = EvenLineCovariance(np.arange(1, 485, 2), 600, (2, 8))
    found = np.mean([2 * estimator(x[:2], x[2:]) for x in noise], axis=0)
    near = np.flatnonzero((estimator.lines > 0.6 * BEND) & (estimator.lines < 1.4 * BEND))
    ratio = found[near, 0, 0].real * estimator.lines[near] ** 2
    assert ratio == pytest.approx(np.ones(near.size), abs=0.03)
