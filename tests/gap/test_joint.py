"""One person under several stimuli, diagnosed at once."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from examples import module

import mcstudy as mc
from mcstudy.files import schema
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.scores import Scores
from mcstudy.gap.questions.closure import energy, smooth_directions
from mcstudy.gap.trial_planning.trials import PlannedTrial
from mcstudy.recordings.recording import Recording
from mcstudy.results.diagnosis import Diagnosis
from mcstudy.spectra.lines import joined


def recordings(effects: dict[str, float], seed: int, cycles: int = 3) -> list[Recording]:
    kinds = (("ankle_torque", 5.0), ("hip_torque", 2.0))
    return [
        mc.simulate(effects, stimulus=kind, amplitude=a, seed=seed + k, cycles=cycles, rate_hz=50)
        for k, (kind, a) in enumerate(kinds)
    ]


@pytest.fixture(scope="module")
def delayed() -> Diagnosis:
    """A passive damping of the ankle."""
    return mc.diagnose(recordings({"passive_damping_ankle": 100.0}, 1), fast=True, fmax=3.1)


def test_the_cause_is_found_from_all_recordings(delayed: Diagnosis) -> None:
    assert delayed.detected
    assert delayed.causes[0].effects == ("passive_damping_ankle",)
    size = delayed.causes[0].sizes[0]
    assert size.estimate == pytest.approx(100.0, abs=4 * size.se)
    assert len(delayed.detection.parts) == 2
    assert sum(p.chi2 for p in delayed.detection.parts) == pytest.approx(delayed.detection.chi2)


def test_every_part_shows_the_responses_to_its_own_stimulus(delayed: Diagnosis) -> None:
    ankle, hip = delayed.parts
    whole = delayed.base.response(delayed.lines.f)
    np.testing.assert_allclose(whole[delayed.lines.blocks[1]], hip.base.response(hip.lines.f), rtol=1e-9)
    assert ankle.added is not None
    assert delayed.added is not None
    whole = delayed.added.response(delayed.lines.f)
    np.testing.assert_allclose(whole[delayed.lines.blocks[0]], ankle.added.response(ankle.lines.f), rtol=1e-9)
    arrays, both = hip.to_xarray(), delayed.to_xarray()
    assert arrays["torque_gain"].sizes["line"] == len(hip.lines)
    np.testing.assert_allclose(arrays["nearest"], both["nearest"][delayed.lines.blocks[1]], rtol=1e-9)


def test_the_energy_of_repeats_without_noise_is_that_of_their_deviation(delayed: Diagnosis) -> None:
    """Within recordings and across them: the squared length of the deviation in the space, to rounding."""
    members = []
    for part in delayed.parts:
        off = part.lines.y - part.base.response(part.lines.f)
        still = np.tile(part.base.response(part.lines.f) + off, (len(part.lines.repeats), 1, 1))
        members.append(replace(part.lines, repeats=still))
    lines, base = joined(members), delayed.base
    data = Data.of(lines)
    space = np.concatenate([f.columns for f in Scores(base, data, [], []).families[:4]], axis=1)
    smooth = smooth_directions(base, data, space)
    found = energy(base, data, lines, smooth)
    J = base.jacobian(data)
    basis = np.linalg.svd(_without(space, J), full_matrices=False)[0][:, : smooth.shape[1]]
    residual = _without(base.residual(data)[:, None], J)[:, 0]
    assert found == pytest.approx(float(((basis.T @ residual) ** 2).sum()), rel=0.05)


def _without(x: np.ndarray, J: np.ndarray) -> np.ndarray:
    """What is left of columns (M, K) at right angles to those of ``J``."""
    return np.asarray(x - J @ np.linalg.lstsq(J, x, rcond=None)[0])


def test_json_verdict_and_page_tell_of_every_recording(delayed: Diagnosis, tmp_path: Path) -> None:
    plain = json.loads(json.dumps(delayed.to_dict(), allow_nan=False))
    schema.validate("diagnosis", plain, "diagnosis")
    assert [r["name"] for r in plain["recordings"]] == ["ankle_torque", "hip_torque"]
    assert "Squared residual of each recording" in delayed.verdict()
    page = delayed.to_html(tmp_path / "page.html").read_text()  # type: ignore[attr-defined]
    for label in ("ankle_torque", "hip_torque"):
        assert f"Frequency responses: {label}" in page
        assert f"Sway in time: {label}" in page


def test_one_mislabelled_recording_of_a_set_is_named() -> None:
    ankle, hip = recordings({}, 1)
    halved = replace(hip, trials=tuple(replace(t, theta=t.theta * np.array([1.0, 0.5])) for t in hip.trials))
    found = mc.diagnose([ankle, halved], fast=True, fmax=2.0)
    assert found.causes[0].effects == ("half_theta2_recording_2",)
    assert "Recording 2 (hip_torque): theta2: seems to be 2 times too small." in found.verdict()
    assert found.place["recording"] > 0.9
    seen = found.parts[1].causes[0].fitted
    assert np.abs(seen.residual(Data.of(found.parts[1].lines))).mean() < 1.2  # the reading explains its recording


def test_the_comparison_of_one_and_three_stimuli_takes_equal_time_and_counts_both() -> None:
    module("next_trial")  # the other example imports it
    example = module("joint_power")
    ankle = PlannedTrial("ankle_torque", 5.0, "prts", 7, 6, 1, 2.0)
    compared = example.plans(ankle)
    assert {sum(t.duration_s for t in plan) for plan in compared.values()} == {3 * 6 * ankle.duration_s / 42}
    platform = next(t for t in compared["joint"] if t.kind == "platform_translation")
    whole = replace(platform, fmax=8.0)
    assert np.sqrt(2 * (np.abs(whole.drive) ** 2).sum()) == pytest.approx(example.PLATFORM_RMS_M)
    found, missed = ({"detected": d, "p": p, "set": 2, "held": True} for d, p in ((True, 1.0), (False, 0.5)))
    rows = [
        {"case": 0, "cause": "head_mode", "ankle": missed, "joint": found},
        {"case": 1, "cause": None, "ankle": missed, "joint": missed},
        {"case": 2, "left_out": "unstable"},
    ]
    table = example.table(rows)
    assert table.startswith("1 cases with an effect, 1 without, 1 left out\nankle: detected 0 of 1")
    assert f"minus that of joint: {np.log(2):.2f}" in table


def test_a_body_that_lacks_nothing_is_called_sound() -> None:
    sound = mc.diagnose(recordings({}, 11), fast=True, fmax=2.0)
    assert not sound.detected
