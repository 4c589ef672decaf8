"""Colours of a figure differ in grey print and to the colour-blind."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from mcstudy.report.style import COLOURS, DARK, DASHES, MARKERS, SERIES

DEUTERANOPIA = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
)
"""What remains of linear red, green, blue (Machado, Oliveira & Fernandes 2009, severity 1)."""

LEAST_CONTRAST = 1.6
"""Of the two main colours, as luminances; below, thin lines look alike in grey."""

LEAST_DIFFERENCE = 0.15
"""Largest difference of two colours in any channel, of 1, where the eye still tells small markers apart."""


def linear(colour: str) -> np.ndarray:
    """Linear red, green, blue (3,)."""
    c = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def luminance(colour: str) -> float:
    return float(linear(colour) @ np.array([0.2126, 0.7152, 0.0722]))


@pytest.mark.parametrize("scheme", [COLOURS, DARK], ids=["light", "dark"])
def test_blue_and_orange_differ_in_grey(scheme: dict[str, str]) -> None:
    low, high = sorted(luminance(scheme[name]) for name in ("blue", "orange"))
    assert (high + 0.05) / (low + 0.05) > LEAST_CONTRAST


@pytest.mark.parametrize("scheme", [COLOURS, DARK], ids=["light", "dark"])
def test_three_series_differ_under_deuteranopia(scheme: dict[str, str]) -> None:
    seen = {n: np.clip(DEUTERANOPIA @ linear(scheme[n]), 0, 1) ** (1 / 2.4) for n in ("blue", "orange", "green")}
    for one, other in combinations(seen, 2):
        assert np.abs(seen[one] - seen[other]).max() > LEAST_DIFFERENCE, (one, other)


def test_up_to_four_lines_and_six_markers_differ_without_colour() -> None:
    assert len(set(DASHES)) >= 4
    assert len(set(MARKERS)) == len(MARKERS) == len(SERIES)
