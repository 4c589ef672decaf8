"""The parameters of one person: estimates, where they come from, and how they are told."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import RecordingError
from mcstudy.exits import Exit
from mcstudy.files import schema
from mcstudy.identification.correction import correction, simulated
from mcstudy.identification.fit import fit_lines
from mcstudy.identification.minimum import MISSED
from mcstudy.spectra.line_noise import LineNoise
from mcstudy.spectra.measure import measure


@pytest.fixture(scope="module")
def recording() -> mc.Recording:
    return mc.simulate(seed=5, cycles=3)


@pytest.fixture(scope="module")
def fitted(recording: mc.Recording) -> mc.FitResult:
    return mc.fit(recording, fmax=2.0)


def test_the_intervals_of_a_simulated_person_hold_most_true_values(fitted: mc.FitResult) -> None:
    """Fourteen intervals of 95 %: eleven or more hold the truth in all but one recording of a thousand."""
    truth = dict(zip(fitted.model.names, fitted.model.truth, strict=True))
    held = [
        e.low <= eval(e.name, {}, truth) <= e.high for e in fitted.estimates
    ]  # the body of the recording is nominal
    assert sum(held) >= 11


def test_the_lowest_minimum_is_found_and_stable(fitted: mc.FitResult) -> None:
    assert fitted.minima.missed < MISSED
    assert fitted.growth_rate < 0
    assert fitted.p_value > 1e-3
    assert fitted.chi2 == fitted.minima.chi2.min()


def test_no_prior_pulls_an_estimate(recording: mc.Recording) -> None:
    """Typical values only start the search: other ones lead to the same estimate."""
    body = recording.base_model()
    other = body.with_bounds({n: (0, 10 * v) for n, v in zip(body.names, body.truth, strict=True)}).with_values(
        {"K11": 1.5 * body.truth[0], "B22": 0.6 * body.truth[7]}
    )
    bounds = {p.name: (0.0, 3 * p.value) for p in body.parameters if p.name not in body.delays}
    first, second = (mc.fit(recording, model=m, bounds=bounds, fmax=2.0) for m in (body, other))
    np.testing.assert_allclose(first.theta, second.theta, rtol=1e-3)


def test_a_known_covariance_needs_no_correction() -> None:
    J, gradients = np.random.default_rng(0).standard_normal((40, 3)), np.eye(3)
    known = LineNoise(np.tile(np.eye(2, dtype=complex), (10, 1, 1)), np.full(10, 1e6))
    found = correction(J, gradients, simulated(known, np.random.default_rng(1)))
    np.testing.assert_allclose(found.threshold(0.95), 3.841, atol=1e-3)
    assert found.null_chi2.mean() == pytest.approx(37, abs=1.5)  # forty numbers, three parameters


def test_few_degrees_of_freedom_widen_an_interval(recording: mc.Recording) -> None:
    lines = measure(recording, 1.2)
    J = np.random.default_rng(0).standard_normal((4 * len(lines), 3))
    found = correction(J, np.eye(3), simulated(lines.noise, np.random.default_rng(1)))
    assert (found.threshold(0.95) > 3.9).all()


def test_the_text_says_what_is_not_determined(fitted: mc.FitResult) -> None:
    said = fitted.text()
    open_ = [e.name for e in fitted.estimates if e.verdict != "identifiable"]
    assert "Kpas1" in open_
    told = re.findall(r"^(?:.*\. )?(?:Not identifiable|Lower limit only|Upper limit only): (.*?)\.", said, re.MULTILINE)
    assert {name for part in told for name in part.split(", ")} <= set(open_)
    assert told
    assert "Only K11 + Kpas1 is determined" in said


def test_the_document_conforms_and_the_dataset_holds_the_same_numbers(fitted: mc.FitResult) -> None:
    document = fitted.to_dict()
    schema.validate("fit", document, "fit")
    data = fitted.to_xarray()
    assert list(data.quantity.values) == [q["name"] for q in document["quantities"]]
    assert data.low.sel(quantity="B22") == fitted["B22"].low
    assert sum(document["quantities"][0]["information"]) == pytest.approx(1)
    with pytest.raises(KeyError, match="K11"):
        fitted["nothing"]


def test_the_command_prints_and_writes_what_python_returns(
    recording: mc.Recording, fitted: mc.FitResult, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "simulated.nc"
    mc.write_recording(recording, file)
    assert main(["fit", str(file), "--fmax", "2", "-o", str(tmp_path)]) == Exit.DONE
    assert capsys.readouterr().out.strip() == fitted.text()
    assert json.loads((tmp_path / "fit.json").read_text())["quantities"] == fitted.to_dict()["quantities"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--bounds", "K11=5"], "expected NAME=LOW:HIGH"),
        (["--bounds", "K11=5:1"], "bounds of K11: expected a lower and a larger upper value"),
        (["--bounds", "Td1=-1:1"], "bounds of Td1"),
        (["--bounds", "X=0:1"], "got 'X'"),
        (["--bounds", "K11=0:5", "--bounds", "K11=1:6"], "expected one pair of bounds for K11"),
        (["--quantity", "K11 + Kpas1"], "expected a name that is not taken"),
        (["--quantity", "K11 @ Kpas1"], "expected names and numbers with"),
        (["--level", "2"], "level: expected a number"),
        (["--quantity", "3"], "at least one parameter"),
        (["--fmax", "0.1"], "0.1 Hz"),
    ],
)
def test_a_wrong_argument_is_one_line(
    recording: mc.Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    file = tmp_path / "r.nc"
    mc.write_recording(recording, file)
    assert main(["fit", str(file), *words]) == Exit.BAD_INPUT
    line = capsys.readouterr().err.strip()
    assert said in line
    assert "\n" not in line


def test_fewer_lines_than_parameters_need_are_one_line(recording: mc.Recording) -> None:
    few = measure(recording, 2.0)
    few = few.below(float(few.f[2]))
    with pytest.raises(RecordingError, match="expected more than 3 lines, got 3"):
        fit_lines(few, recording.base_model())


def test_a_stimulus_without_power_is_one_line(recording: mc.Recording) -> None:
    silent = [replace(t, stimulus=np.zeros_like(t.stimulus)) for t in recording.trials]
    with pytest.raises(RecordingError, match="stimulus"):
        mc.fit(replace(recording, trials=tuple(silent)))


def test_an_added_effect_has_a_size_with_an_interval() -> None:
    recording = mc.simulate({"passive_damping_ankle": 60.0}, cycles=3, seed=2)
    fitted = mc.fit(recording, fmax=3.0, effects=["passive_damping_ankle"])
    size = fitted[mc.effects["passive_damping_ankle"].size.name]
    assert size.low < 60 < size.high
    assert fitted.without_chi2 is not None
    assert fitted.chi2 < fitted.without_chi2
    assert "With passive_damping_ankle the squared residual falls" in fitted.text()
    with pytest.raises(mc.InputError, match="no closed form"):
        mc.fit(recording, effects=["dead_zone"])
