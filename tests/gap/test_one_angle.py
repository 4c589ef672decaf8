"""Published responses, of one angle above all, through the fit, the diagnosis and both pages."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.effect_library.library import apply
from mcstudy.errors import RecordingError
from mcstudy.gap.diagnose import detect
from mcstudy.gap.settings import FAST
from mcstudy.identification import words
from mcstudy.identification.fit import fit
from mcstudy.identification.settings import FitSettings
from mcstudy.recordings.frf import FrfRecording
from mcstudy.stance.body import Body, one_segment, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf

ANGLE = "only one angle was published, so the hip is not tested"


def published(
    model: Model, n: int, noise: float, seed: int, kind: str, body: Body, theta: np.ndarray | None = None
) -> FrfRecording:
    """Responses (n points) of a model with relative noise, of one angle if the model has one."""
    rng, f = np.random.default_rng(seed), np.geomspace(0.02, 2.4, n)
    y = frf(model, model.truth if theta is None else theta, f)
    sd = noise * np.abs(y)
    y = y + sd * (rng.standard_normal(y.shape) + 1j * rng.standard_normal(y.shape)) / np.sqrt(2)
    C = (sd[:, :, None] ** 2 * np.eye(model.n_outputs)).astype(complex)
    return FrfRecording(f, y, C, kind, body, single=model.n_outputs == 1)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("kind", ["ankle_torque", "surface_tilt"])
@pytest.mark.parametrize(("n", "noise"), [(4, 0.05), (28, 0.02)])
@pytest.mark.parametrize("effect", [None, "integral_ankle"])
def test_one_angle_is_fitted_and_diagnosed(tmp_path: Path, kind: str, n: int, noise: float, effect: str | None) -> None:
    body = Body.from_person(1.68, 73)
    model = one_segment(body, kind)
    theta = model.truth
    if effect:
        model, theta = apply(model, effect), np.append(theta, 100.0)
    recording = published(model, n, noise, 1, kind, body, theta)
    fitted, diagnosis = mc.fit(recording), mc.diagnose(recording, fast=True)
    assert ANGLE in fitted.warnings
    assert ANGLE in diagnosis.warnings
    assert {band.angle for band in diagnosis.detection.bands} == {"theta1"}
    assert diagnosis.to_dict()["z_map"].keys() == {"f", "theta1", "limit"}
    if effect and n == 28:
        assert diagnosis.detected
        assert diagnosis.causes[0].effects == (effect,)
        assert diagnosis.nearest is not None
    fitted.to_html(tmp_path / "fit.html")
    diagnosis.to_html(tmp_path / "diagnosis.html")


def test_an_angle_that_was_not_measured_adds_no_noise() -> None:
    """Under the null the squared residual of one angle is that of 2 N numbers, and p is uniform."""
    n = 12
    results = [
        fit(published(one_segment(), n, 0.08, seed, "ankle_torque", Body()), FitSettings(seed=seed))
        for seed in range(12)
    ]
    assert 2 * n - 4 - 1 < results[0].expected_chi2 < 2 * n
    assert 0.2 < np.mean([r.p_value for r in results]) < 0.8
    wrong = published(one_segment(), n, 0.08, 0, "ankle_torque", Body())
    shifted = FrfRecording(wrong.f, wrong.y * np.exp(0.6j * np.sin(9 * wrong.f))[:, None], wrong.C, single=True)
    assert fit(shifted, FitSettings()).p_value < 0.01
    assert detect(shifted, FAST).p_value < 0.05


RESPONSES = {
    "re1": ["0.1", "0.08", "0.05", "0.01"],
    "im1": ["-0.01", "-0.03", "-0.04", "-0.03"],
    "sd1": ["0.004"] * 4,
    "re2": ["-0.05", "-0.04", "-0.03", "-0.02"],
    "im2": ["0.01", "0.02", "0.02", "0.02"],
    "sd2": ["0.003"] * 4,
    "gain1": ["0.1005", "0.0854", "0.0640", "0.0316"],
    "phase1": ["-5.7", "-20.6", "-38.7", "-71.6"],
    "phase2": ["20"] * 4,
    "c12_im": ["0"] * 4,
}


def table(folder: Path, columns: dict[str, list[str]]) -> Path:
    """A description of published responses at four frequencies."""
    rows = zip(["0.1", "0.3", "0.6", "1.2"], *columns.values(), strict=True)
    text = "\n".join([",".join(["f", *columns]), *map(",".join, rows)])
    (folder / "responses.csv").write_text(text)
    (folder / "responses.toml").write_text(
        'units = {angle = "deg"}\nbody = {reference = "goodworth2018"}\nfrf = {file = "responses.csv"}\n'
    )
    return folder / "responses.toml"


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("re2 im2 sd2", "column 'gain1' is missing: a fit needs the first angle"),
        ("re1 im1", "column 'sd1' is missing: the standard error of the complex response"),
        ("re1 im1 re2 im2 sd1", "column 'sd2' is missing: the standard error"),
        ("re1 im1 sd1 sd2", "column 'gain2' is missing: another column tells of the second angle"),
        ("re1 im1 sd1 im2 sd2", "column 're2' is missing"),
        ("gain1 phase1 sd1 phase2", "column 'gain2' is missing"),
        ("re1 im1 sd1 re2 im2 sd2 c12_im", "column 'c12_re' is missing"),
    ],
)
def test_part_of_an_angle_is_refused_in_one_line(tmp_path: Path, columns: str, message: str) -> None:
    path = table(tmp_path, {name: RESPONSES[name] for name in columns.split()})
    for read in (mc.fit, mc.diagnose):
        with pytest.raises(RecordingError, match=re.escape(message)) as refusal:
            read(path)
        assert "\n" not in str(refusal.value)


def test_both_forms_of_a_response_must_agree(tmp_path: Path) -> None:
    both = {name: RESPONSES[name] for name in ("re1", "im1", "gain1", "phase1", "sd1")}
    read = mc.read_recording(table(tmp_path, both))
    assert isinstance(read, FrfRecording)
    np.testing.assert_allclose(
        read.y[:, 0], np.pi / 180 * np.array([0.1 - 0.01j, 0.08 - 0.03j, 0.05 - 0.04j, 0.01 - 0.03j])
    )
    with pytest.raises(RecordingError, match=r"re1, im1 and gain1, phase1 contradict each other at f = 0.6 Hz"):
        mc.read_recording(table(tmp_path, both | {"gain1": ["0.1005", "0.0854", "3.7", "0.0316"]}))


def test_all_points_of_a_published_response_are_used_unless_another_end_is_wanted() -> None:
    recording = published(two_segment(), 28, 0.05, 3, "ankle_torque", Body())
    recording = FrfRecording(np.append(np.geomspace(0.0229, 7.0909, 27), 8.0055), recording.y, recording.C)
    all_of_them, cut = fit(recording, FitSettings()), fit(recording, FitSettings(fmax=8.0))
    assert len(all_of_them.lines) == 28
    assert all_of_them.method.fmax == 8.0055
    assert "28 points up to 8.01 Hz" in words.text(all_of_them)
    assert len(cut.lines) == 27
    assert "the last point, 8.0055 Hz, is above fmax = 8 Hz and left out" in cut.warnings
    with pytest.raises(RecordingError, match=r"expected at least 4 points up to fmax = 0.03 Hz"):
        fit(recording, FitSettings(fmax=0.03))
