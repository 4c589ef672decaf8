"""Comparisons of amplitudes and of first and last cycles: only where the noise of the difference is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mcstudy.fitting.penalised import Fitted, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.questions.contrasts import FIRST_HARMONIC, contrast
from mcstudy.lines.base_fit import drawn_starts
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment

OPEN = opened(two_segment())


@pytest.fixture(scope="module")
def fitted(plain_lines: list[Lines]) -> Fitted:
    data = Data.of(plain_lines[0])
    return Fitter(OPEN, weak_prior(OPEN, OPEN), data.f).best(data, drawn_starts(OPEN, 0, 8))


def changed(lines: Lines, harmonics: list[int]) -> tuple[Lines, Lines]:
    """First and last cycles, the last ones as if the response had grown by a tenth at these lines."""
    halves = lines.halves()
    assert halves is not None
    assert lines.harmonic is not None
    first, last = halves
    at = np.isin(lines.harmonic, harmonics)
    return first, replace(last, y=np.where(at[:, None], 1.1 * last.y, last.y))


def test_first_and_last_cycles_are_not_compared_at_the_lowest_lines(plain_lines: list[Lines], fitted: Fitted) -> None:
    def p_value(harmonics: list[int], kind: str) -> float:
        first, last = changed(plain_lines[0], harmonics)
        return contrast(kind, first, last, (3.0, 5.0), fitted, np.random.default_rng(2), 200).p_value

    low = list(range(1, FIRST_HARMONIC, 2))
    assert p_value(low, "time") == p_value([], "time")
    higher = list(range(FIRST_HARMONIC, 101, 2))
    assert p_value(higher, "time") == 1 / 201 < p_value([], "time")
    assert p_value(low, "amplitude") != p_value([], "amplitude")  # between trials nothing cancels
