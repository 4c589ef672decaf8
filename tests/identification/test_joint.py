"""One person under several stimuli, fitted at once."""

from __future__ import annotations

import json
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import InputError, RecordingError
from mcstudy.exits import Exit
from mcstudy.files import schema
from mcstudy.identification.forecast import fisher
from mcstudy.recordings.joint_recording import JointRecording
from mcstudy.stance.body import Body
from mcstudy.stance.joint import members

VALIDATION = Path(__file__).parents[2] / "pipelines" / "validation"


@pytest.fixture(scope="module")
def recordings() -> list[mc.Recording]:
    ankle = mc.simulate(seed=1, cycles=4, rate_hz=50)
    hip = mc.simulate(seed=2, cycles=3, rate_hz=100, stimulus="hip_torque")
    return [replace(ankle, name="a"), replace(hip, name="h")]


@pytest.fixture(scope="module")
def fitted(recordings: list[mc.Recording]) -> mc.FitResult:
    return mc.fit(recordings, fmax=2.0)


def test_recordings_with_other_stimulus_length_and_rate_are_fitted_together(fitted: mc.FitResult) -> None:
    assert isinstance(fitted.recording, JointRecording)
    assert fitted.labels == ("ankle_torque", "hip_torque")
    assert [p.chi2 for p in fitted.part_fits] == pytest.approx(
        [float((abs(_whitened(part)) ** 2).sum()) for part in fitted.parts]
    )
    assert sum(p.chi2 for p in fitted.part_fits) == pytest.approx(fitted.chi2)
    truth = dict(zip(fitted.model.names, fitted.model.truth, strict=True))
    held = [e.low <= eval(e.name, {}, truth) <= e.high for e in fitted.estimates]
    assert sum(held) >= 11  # in all but one set of a thousand


def _whitened(part: mc.FitResult) -> np.ndarray:
    from mcstudy.stance.response import frf

    residual = part.lines.y - frf(part.model, part.theta, part.lines.f)
    return np.einsum("nij,nj->ni", part.lines.noise.whitener, residual)


def test_the_information_of_independent_recordings_adds_up(fitted: mc.FitResult) -> None:
    """The whole set against every recording with its own model of one stimulus."""
    whole = fisher(fitted.model, fitted.theta, fitted.lines)
    alone = zip(members(fitted.model), fitted.lines.parts, strict=True)
    np.testing.assert_allclose(sum(fisher(m, fitted.theta, p) for m, p in alone), whole, rtol=1e-9)


def test_two_stimuli_determine_what_one_leaves_open(recordings: list[mc.Recording], fitted: mc.FitResult) -> None:
    alone = mc.fit(recordings[0], fmax=2.0)
    for name in ("K11", "Kpas1"):
        assert fitted[name].high - fitted[name].low < 0.8 * (alone[name].high - alone[name].low)


def test_text_page_and_json_tell_of_every_recording(fitted: mc.FitResult, tmp_path: Path) -> None:
    assert "ankle_torque" in fitted.text()
    assert "hip_torque" in fitted.text()
    plain = json.loads(json.dumps(fitted.to_dict(), allow_nan=False))
    schema.validate("fit", plain, "fit")
    assert [r["name"] for r in plain["recordings"]] == ["ankle_torque", "hip_torque"]
    page = mc.fit.__module__ and fitted.to_html(tmp_path / "page.html").read_text()  # type: ignore[attr-defined]
    assert "Frequency responses: ankle_torque" in page
    assert "Frequency responses: hip_torque" in page


def test_a_study_of_several_stimuli_is_refused(fitted: mc.FitResult) -> None:
    with pytest.raises(InputError, match="one stimulus, because a study has one, got ankle_torque and hip"):
        mc.study_from(fitted, "mine")


def test_bodies_that_differ_are_refused_in_one_line(recordings: list[mc.Recording]) -> None:
    other = replace(recordings[1], body=Body(A2=14.0))
    with pytest.raises(RecordingError, match=r"^h: body.A2: expected 14.45 as in a, got 14; one person has one body$"):
        mc.fit([recordings[0], other])


def test_a_model_of_one_stimulus_is_refused(recordings: list[mc.Recording]) -> None:
    with pytest.raises(InputError, match="model: expected none for recordings under different stimuli"):
        mc.fit(recordings, model=recordings[0].base_model())


def test_the_command_takes_files_of_different_kinds(
    recordings: list[mc.Recording], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(mc.write_recording(r, tmp_path / f"{r.name}.nc")) for r in recordings]
    assert main(["fit", *files, "--fmax", "1.2"]) == Exit.DONE
    assert "Squared residual of each recording" in " ".join(capsys.readouterr().out.split())


def test_the_example_prints_a_row_for_every_quantity(capsys: pytest.CaptureFixture[str]) -> None:
    example = runpy.run_path(str(VALIDATION / "joint_recordings.py"))
    example["main"](["coverage", "--sets", "1", "--fmax", "1.2"])
    rows = capsys.readouterr().out.splitlines()
    assert rows[0].startswith("1 sets of one trial each")
    assert len(rows) == 2 + 14 + 1
    assert 0 < float(rows[-1].split()[-1]) < 1  # two stimuli tell more than one
