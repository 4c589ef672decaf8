"""The fit of a declared model: its outputs are found by name, its bounds are its own, its minimum is that of others."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import RecordingError
from mcstudy.exits import Exit
from mcstudy.models.catalogue import checked_table, written
from tests.helpers.declared import ELBOW, TABLE, drive, drive_frf, measured


@pytest.fixture(scope="module")
def recording() -> mc.FrfRecording:
    return measured(seed=1)


@pytest.fixture(scope="module")
def fitted(recording: mc.FrfRecording) -> mc.FitResult:
    return mc.fit(recording)


def test_the_minimum_and_its_curvature_are_those_of_another_optimiser(
    recording: mc.FrfRecording, fitted: mc.FitResult
) -> None:
    sd = np.sqrt(np.einsum("nii->ni", recording.C).real / 2)

    def residual(p: np.ndarray) -> np.ndarray:
        z = (drive_frf(p, recording.f) - recording.y) / sd
        return np.concatenate([z.real.ravel(), z.imag.ravel()])

    model = drive()
    scale = model.truth
    other = least_squares(
        residual, scale, jac="3-point", x_scale=scale, bounds=(model.lower, model.upper), xtol=1e-14, ftol=1e-14
    )
    np.testing.assert_allclose(fitted.theta, other.x, rtol=1e-4)
    assert fitted.chi2 == pytest.approx(2 * other.cost, rel=1e-5)
    sd_of = np.sqrt(np.diag(np.linalg.inv(other.jac.T @ other.jac)))
    half = [(e.wald_high - e.wald_low) / 2 / 1.959964 for e in fitted.estimates]
    stated = half / sd_of
    assert np.all((stated > 0.97) & (stated < 1.3)), stated  # never below; above where the curvature widens it


def test_intervals_are_profiles_inside_the_bounds_of_the_model(fitted: mc.FitResult) -> None:
    model = drive()
    for e, low, high, truth in zip(fitted.estimates, model.lower, model.upper, model.truth, strict=True):
        assert low <= e.low < truth < e.high <= high, e
    assert "`mcstudy gap diagnose --fast` finds no gap" in fitted.text()
    for of_standing_bodies in (fitted.paper, fitted.coverage):
        assert of_standing_bodies is None


def test_columns_are_found_by_name_in_any_order_and_unit(
    recording: mc.FrfRecording, fitted: mc.FitResult, tmp_path: Path
) -> None:
    (tmp_path / "drive.toml").write_text(written(checked_table(TABLE)))
    (tmp_path / "frf.toml").write_text(
        'name = "drive"\nmodel = "drive.toml"\nunits = {angle = "mrad"}\nfrf = {file = "frf.csv"}\n'
    )
    columns = {"f": recording.f}
    for k, name in ((1, "load"), (0, "motor")):
        y, sd = 1e3 * recording.y[:, k], 1e3 * np.sqrt(recording.C[:, k, k].real)
        columns |= {f"gain_{name}": np.abs(y), f"phase_{name}": np.degrees(np.angle(y)), f"sd_{name}": sd}
    rows = np.column_stack(list(columns.values()))
    np.savetxt(tmp_path / "frf.csv", rows, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
    read = mc.read_recording(tmp_path / "frf.toml")
    assert read.columns.outputs == ("motor", "load")
    np.testing.assert_allclose(mc.fit(read).theta, fitted.theta, rtol=1e-6)
    again = mc.fit(tmp_path / "frf.toml", model=tmp_path / "drive.toml")
    np.testing.assert_allclose(again.theta, fitted.theta, rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ('model = "drivel.toml"\nfrf = {file = "frf.csv"}', "No such file"),
        ('model = "drivel"\nfrf = {file = "frf.csv"}', "expected a model file"),
        ('model = "one_segment"\nfrf = {file = "frf.csv"}', "expected a declared model or two_segment"),
        ('model = "drive.toml"\nfrf = {file = "frf.csv"}', "column 'gain_motor' is missing"),
        ('model = "drive.toml"\nfrf = {file = "frf.csv"}\nbody = {height = 1.8, weight = 70}', "body: expected none"),
        ('model = "drive.toml"\nrate_hz = 100\n[channels]\nlode = 1\n[[trials]]\nfile = "frf.csv"', "channels.lode"),
        ('model = "drive.toml"\nunits = {angle = "V"}\nfrf = {file = "frf.csv"}', "units.angle: unit: expected"),
    ],
)
def test_what_does_not_fit_the_model_is_refused_in_one_line(text: str, line: str, tmp_path: Path) -> None:
    (tmp_path / "drive.toml").write_text(written(checked_table(TABLE)))
    (tmp_path / "frf.csv").write_text("f,gain_load,sd_load\n" + "".join(f"{k},1,0.1\n" for k in range(1, 9)))
    (tmp_path / "rec.toml").write_text(text)
    with pytest.raises(RecordingError, match=line) as refused:
        mc.read_recording(tmp_path / "rec.toml")
    assert "\n" not in str(refused.value)


def test_a_recording_of_other_outputs_is_refused_in_one_line(recording: mc.FrfRecording) -> None:
    standing = replace(recording, model=None, stimulus="ankle_torque")
    with pytest.raises(RecordingError, match=r"motor: expected the outputs of model drive \(motor, load\), got theta1"):
        mc.fit(standing, model=drive())


@pytest.mark.parametrize(("table", "outputs"), [(TABLE, ("motor", "load")), (ELBOW, ("elbow",))])
def test_a_simulated_recording_knows_its_model_in_every_format_and_its_fit_holds_the_truth(
    table: dict[str, Any], outputs: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "model.toml").write_text(written(checked_table(table)))
    options = ["--model", str(tmp_path / "model.toml"), "--noise", "0.3", "--measurement-sd", "0.02", "--cycles", "4"]
    assert main(["simulate", *options, "--rate", "100", "--seed", "3", "-o", str(tmp_path / "rec.nc")]) == Exit.DONE
    recording = mc.read_recording(tmp_path / "rec.nc")
    assert isinstance(recording, mc.Recording)
    assert recording.columns.outputs == outputs
    for name in ("rec.zarr", "csv"):
        again = mc.read_recording(mc.write_recording(recording, tmp_path / name))
        assert again.columns == recording.columns
        np.testing.assert_allclose(again.trials[0].theta, recording.trials[0].theta, atol=1e-9)
    assert main(["fit", str(tmp_path / "rec.nc"), "--fmax", "8", "--json"]) == Exit.DONE
    quantities = {q["name"]: q for q in json.loads(capsys.readouterr().out.split("\n", 1)[1])["quantities"]}
    for p in recording.base_model().parameters:
        assert quantities[p.name]["low"] < p.value < quantities[p.name]["high"], p.name


def test_noise_of_what_is_recorded_is_that_which_was_asked_for() -> None:
    settings: dict[str, Any] = {"model": drive(), "seed": 1, "cycles": 3, "rate_hz": 100.0}
    clean, noisy = (mc.simulate(**settings, measurement_sd=sd) for sd in (0.0, (0.1, 0.3)))
    added = np.degrees(noisy.trials[0].theta - clean.trials[0].theta)
    np.testing.assert_allclose(added.std(axis=0), [0.1, 0.3], rtol=0.03)
    assert abs(np.corrcoef(added.T)[0, 1]) < 0.03


SETTINGS: dict[str, Any] = {"seed": 3, "cycles": 5, "rate_hz": 100.0, "noise": 0.3, "measurement_sd": 0.02}


def test_what_a_declared_model_lacks_is_a_gap() -> None:
    model = drive()
    heavier = tuple(
        replace(t, coefficient=1.15 * t.coefficient) if (t.row, t.order) == ("load", 2) else t for t in model.terms
    )
    lacking = mc.fit(mc.simulate(model=replace(model, terms=heavier), **SETTINGS), model=model, fmax=8.0)
    assert lacking.gap.p_value < 0.01
    assert lacking.p_value < 0.05
    right = mc.fit(mc.simulate(model=model, **SETTINGS), fmax=8.0)
    assert right.gap.p_value > 0.05


def test_a_study_of_the_experiment_has_the_model_its_frequencies_and_the_noise_that_was_simulated() -> None:
    study = mc.study_from(mc.fit(mc.simulate(model=drive(), **SETTINGS), fmax=10.0), realizations=2, starts=2)
    group = study.groups["experiment"]
    assert (group.model.title, group.fmax, group.spectra.highest_hz) == ("drive", (10.0,), 10.0)
    assert group.stimulus.cycles == 5
    np.testing.assert_allclose(group.noise.measurement.sd, 0.02, rtol=0.15)
    assert list(group.noise.table.psd) == ["motor"]  # the only sensor whose noise enters the loop
    values = [float(p.value) for p in group.model.parameter]
    np.testing.assert_allclose(values, drive().truth, rtol=0.1)
