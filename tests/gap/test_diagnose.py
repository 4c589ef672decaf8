"""The whole diagnosis of time-domain recordings: verdict, JSON, and mistakes that are caught."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from mcstudy.errors import RecordingError
from mcstudy.gap.ambiguity import Undetectable
from mcstudy.gap.diagnose import diagnose, diagnose_fast
from mcstudy.gap.make_recording import Protocol, simulate_recording
from mcstudy.gap.recording import Recording
from mcstudy.stance.body import two_segment
from mcstudy.stance.stimulus import Prts
from mcstudy.study import schema

MODEL = two_segment()
FAST = Protocol(waveform=Prts(rate_hz=100.0))


@pytest.fixture(scope="module")
def lagging() -> Recording:
    rng = np.random.default_rng(4)
    return simulate_recording(
        FAST, 0.95 * MODEL.truth, rng, effects=["sensor_lag_theta1"], sizes={"tau_theta1": 0.01}, name="lagging"
    )


def test_json_conforms_to_its_schema_and_says_what_the_object_says(lagging: Recording) -> None:
    out = diagnose_fast(lagging, seed=3)
    plain = json.loads(json.dumps(out.to_dict(), allow_nan=False))
    schema.validate("diagnosis", plain, "diagnosis")
    assert plain["detected"] is True
    assert plain["causes"][0]["effects"] == list(out.causes[0].effects)
    assert "sensor_lag_theta1" in plain["causes"][0]["alternatives"][0]
    size = plain["causes"][0]["size"]["tau_theta1"]
    assert abs(size["estimate"] - 0.01) < 4 * size["se"]
    assert plain["place"]["sensor"] > 0.5
    assert plain["closed"]["fraction"] > 0.8
    assert plain["sway_rms_deg"]["after"] < plain["sway_rms_deg"]["before"]
    assert [p["name"] for p in plain["parameters"]] == list(MODEL.names)
    text = out.verdict()
    assert text.startswith("A gap beyond noise")
    assert "sensor lag theta1" in text
    assert "<table>" in out._repr_html_()


def test_what_is_named_as_a_cause_is_not_also_said_to_be_invisible(lagging: Recording) -> None:
    """At its typical size an effect may be hard to see, and yet be what these data show."""
    out = diagnose_fast(lagging)
    leading = out.causes[0].effects[0]
    missed = (Undetectable(leading, "delta 1.0", None, "s", None), Undetectable("dead_zone", "why", None, "rad", None))
    last = replace(out, undetectable=missed).verdict().split("Not excluded")[1]
    assert "dead zone" in last
    assert leading.replace("_", " ") not in last
    nothing = replace(out, undetectable=missed, detected=False, closed=None).verdict().split("Not excluded")[1]
    assert leading.replace("_", " ") in nothing


def test_same_seed_same_diagnosis_and_bootstrap_agrees(lagging: Recording) -> None:
    first, again = diagnose_fast(lagging, seed=3).to_dict(), diagnose_fast(lagging, seed=3).to_dict()
    assert first == again
    slow = diagnose(lagging, bootstrap=100, seed=3)
    assert slow.detected
    assert slow.method["null"] == "bootstrap with refits"
    assert slow.causes[0].effects == tuple(first["causes"][0]["effects"])


@pytest.mark.parametrize(("factor", "estimate"), [(2.0, -0.5), (0.5, 1.0)])
def test_amplitude_convention_is_named_as_the_stimulus(factor: float, estimate: float) -> None:
    """A stimulus recorded as peak-to-peak in place of peak, or the other way round."""
    rng = np.random.default_rng(5)
    plain = simulate_recording(FAST, MODEL.truth, rng)
    wrong = replace(plain, trials=tuple(replace(t, stimulus=factor * t.stimulus, amplitude=None) for t in plain.trials))
    out = diagnose_fast(wrong)
    assert out.detected
    assert out.causes[0].effects == ("stimulus_gain",)
    assert out.causes[0].sizes[0].estimate == pytest.approx(estimate, abs=0.05)
    assert "peak-to-peak" in out.verdict()


def test_exchanged_channels_are_refused(lagging: Recording) -> None:
    exchanged = replace(lagging, trials=tuple(replace(t, theta=t.theta[:, ::-1].copy()) for t in lagging.trials))
    with pytest.raises(RecordingError, match="exchanged"):
        diagnose_fast(exchanged)


def test_degrees_declared_as_radians_are_refused(lagging: Recording) -> None:
    wrong = replace(lagging, trials=tuple(replace(t, theta=np.rad2deg(t.theta)) for t in lagging.trials))
    with pytest.raises(RecordingError, match="deg"):
        diagnose_fast(wrong)


def test_recordings_of_different_kinds_are_not_pooled(lagging: Recording) -> None:
    other = replace(lagging, rate_hz=50.0, period_s=lagging.period_s and 2 * lagging.period_s, name="slow")
    with pytest.raises(RecordingError, match="slow: rate_hz"):
        diagnose_fast([lagging, other])
    both = diagnose_fast([lagging.select((0,)), lagging.select((1,))])
    assert both.method["trials"] == 2
