"""The fit of a recording with a tilt."""

import mcstudy as mc
from mcstudy.recordings.recording import Recording


def test_the_fit_of_a_recording_with_a_tilting_scene_estimates_the_weight_of_vision() -> None:
    recording = mc.simulate(
        stimulus="visual_tilt", amplitude=0.03, cycles=3, rate_hz=50, parameters={"Wvis": 0.35}, seed=4
    )
    assert isinstance(recording, Recording)
    assert recording.base_model().truth[-1] == 0.2
    fit = mc.fit(recording, fmax=2)
    weight = fit["Wvis"]
    assert 0.0 < weight.low < 0.35 < weight.high < 1.0
    assert (weight.low_from, weight.high_from) == ("data", "data")
    assert fit.p_value > 0.01
