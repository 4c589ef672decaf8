"""What `pipelines/real_person.md` says of the intervals of a real person, where the recording is at hand."""

from __future__ import annotations

import pytest
from real_person import needs_wang, wang

from mcstudy.identification.fit import fit
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.settings import FitSettings

pytestmark = needs_wang


@pytest.fixture(scope="module")
def by_fmax() -> dict[float, FitRecord]:
    recording = wang()
    return {fmax: fit(recording, FitSettings(fmax=fmax)) for fmax in (2.0, 4.0)}


def test_only_the_sum_of_ankle_stiffness_is_determined(by_fmax: dict[float, FitRecord]) -> None:
    for f in by_fmax.values():
        e = f["K11 + Kpas1"]
        assert (e.low_from, e.high_from) == ("data", "data")
        assert 500 < e.low < 650 < e.high < 800
        assert f["K11"].low_from == "bound"
    first = by_fmax[2.0]["K11 + Kpas1"]
    assert [round(x) for x in (first.estimate, first.low, first.high)] == [667, 581, 720]
    assert by_fmax[2.0].p_value == pytest.approx(0.025, abs=0.002)


def test_the_fit_up_to_four_hertz_is_the_lowest_minimum(by_fmax: dict[float, FitRecord]) -> None:
    """A stable minimum with a squared residual of 11,900 was taken where the lowest has 432."""
    f = by_fmax[4.0]
    assert f.chi2 < 450
    assert f.growth_rate > 0  # and the text says so
    assert f.p_value < 0.01
