"""Published responses, of one angle above all, through the fit, the diagnosis and both pages."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.effect_library.library import apply
from mcstudy.errors import RecordingError
from mcstudy.gap.diagnose import detect_fast
from mcstudy.identification.fit import fit
from mcstudy.recordings.frf import FrfRecording
from mcstudy.stance.body import Body, one_segment, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf

README = Path(mc.__file__).parent / "recordings" / "README.md"
ANGLE = "only one angle was published, so the hip is not tested"


def published(
    model: Model, n: int, noise: float, seed: int, kind: str, body: Body, theta: np.ndarray | None = None
) -> FrfRecording:
    """Responses (n points) of a model with relative noise, of one angle if the model has one."""
    rng, f = np.random.default_rng(seed), np.geomspace(0.02, 2.4, n)
    y = frf(model, model.truth if theta is None else theta, f)
    sd = noise * np.abs(y)
    y = y + sd * (rng.standard_normal(y.shape) + 1j * rng.standard_normal(y.shape)) / np.sqrt(2)
    C = np.zeros((n, 2, 2), dtype=complex)
    single = model.n_angles == 1
    C[:, 0, 0], C[:, 1, 1] = sd[:, 0] ** 2, 1.0 if single else sd[:, 1] ** 2
    return FrfRecording(f, y, C, kind, body, single)


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
    if effect and n == 28:
        assert diagnosis.detected
        assert diagnosis.causes[0].effects == (effect,)
        assert diagnosis.nearest is not None
    fitted.to_html(tmp_path / "fit.html")
    diagnosis.to_html(tmp_path / "diagnosis.html")


def test_an_angle_that_was_not_measured_adds_no_noise() -> None:
    """Under the null the squared residual of one angle is that of 2 N numbers, and p is uniform."""
    n = 12
    results = [fit(published(one_segment(), n, 0.08, seed, "ankle_torque", Body()), seed=seed) for seed in range(12)]
    assert 2 * n - 4 - 1 < results[0].expected_chi2 < 2 * n
    assert 0.2 < np.mean([r.p_value for r in results]) < 0.8
    wrong = published(one_segment(), n, 0.08, 0, "ankle_torque", Body())
    shifted = FrfRecording(wrong.f, wrong.y * np.exp(0.6j * np.sin(9 * wrong.f))[:, None], wrong.C, single=True)
    assert fit(shifted).p_value < 0.01
    assert detect_fast(shifted).p_value < 0.05


def documented(folder: Path) -> list[Path]:
    """The published responses of the documentation as files, each with its table."""
    text = README.read_text(encoding="utf-8")
    tables = re.findall(r"cat > (\S+\.csv) <<END\n(.*?)END\n", text, re.DOTALL)
    sheets = re.findall(r"```toml\n# (\S+\.toml)\n(.*?)```", text, re.DOTALL)
    for name, content in (*tables, *sheets):
        (folder / name).write_text(content)
    return [folder / name for name, content in sheets if re.search(r"^frf = ", content, re.MULTILINE)]


def test_every_documented_response_goes_through_fit_diagnosis_and_pages(tmp_path: Path) -> None:
    found = documented(tmp_path)
    assert [p.name for p in found] == ["published.toml"]
    for path in found:
        mc.fit(path).to_html(tmp_path / "fit.html")
        for diagnosis in (mc.diagnose(path, fast=True), mc.diagnose(path, bootstrap=50)):
            assert diagnosis.verdict()
            diagnosis.to_html(tmp_path / "diagnosis.html")


def test_all_points_of_a_published_response_are_used_unless_another_end_is_wanted() -> None:
    recording = published(two_segment(), 28, 0.05, 3, "ankle_torque", Body())
    recording = FrfRecording(np.append(np.geomspace(0.0229, 7.0909, 27), 8.0055), recording.y, recording.C)
    all_of_them, cut = fit(recording), fit(recording, fmax=8.0)
    assert len(all_of_them.lines) == 28
    assert all_of_them.method["fmax"] == 8.0055
    assert "28 points up to 8.01 Hz" in all_of_them.text()
    assert len(cut.lines) == 27
    assert "the last point, 8.0055 Hz, is above fmax = 8 Hz and left out" in cut.warnings
    with pytest.raises(RecordingError, match=r"expected at least 4 points up to fmax = 0.03 Hz"):
        fit(recording, fmax=0.03)
