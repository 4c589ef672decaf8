"""What `pipelines/real_person.md` says of a real person, where the recording is at hand."""

from __future__ import annotations

import json

import pytest
from real_person import needs_wang, wang

from mcstudy.files import schema
from mcstudy.gap.diagnose import diagnose
from mcstudy.gap.settings import DiagnosisSettings
from mcstudy.gap.tables import text
from mcstudy.results.diagnosis import Diagnosis

pytestmark = needs_wang


@pytest.fixture(scope="module")
def by_fmax() -> dict[float, Diagnosis]:
    every = {fmax: diagnose(wang(), DiagnosisSettings(fast=True, fmax=fmax)) for fmax in (2.0, 4.0, 8.0)}
    return {fmax: Diagnosis.of(diagnosis) for fmax, diagnosis in every.items()}


def test_there_is_a_gap_and_from_three_hertz_up_no_named_effect_explains_it(
    by_fmax: dict[float, Diagnosis],
) -> None:
    assert all(d.detected for d in by_fmax.values())
    assert 0.2 < by_fmax[2.0].unknown_probability < 0.9
    for fmax in (4.0, 8.0):
        d = by_fmax[fmax]
        assert d.unknown_probability > 0.999
        assert d.place["sensor"] > 0.9
        beyond = [(b.angle, b.low_hz) for b in d.detection.bands if b.beyond]
        assert any(angle == "theta2" and low >= 2.9 for angle, low in beyond)
        assert d.closed is not None
        assert d.closed.high < 0.9
        assert "No effect of the library explains the gap" in d.verdict()
        assert "would close" in d.verdict()


def test_active_and_passive_stiffness_trade_places_with_the_bandwidth(by_fmax: dict[float, Diagnosis]) -> None:
    at = {f: {s.name: s.without for s in d.shifts} for f, d in by_fmax.items()}
    assert abs(at[2.0]["K11"] - at[4.0]["K11"]) > 200
    total = [v["K11"] + v["Kpas1"] for v in at.values()]
    assert max(total) / min(total) < 1.1


def test_all_of_it_can_be_written(by_fmax: dict[float, Diagnosis]) -> None:
    for d in by_fmax.values():
        schema.validate("diagnosis", json.loads(json.dumps(d.to_dict(), allow_nan=False)), "diagnosis")
        assert "a cause outside the library" in text(d)
