"""Diagnosis of recordings of declared models: what is missing is named at the joints of the model."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.errors import InputError
from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.rational_torque import Loop, paths
from mcstudy.gap.document import document
from mcstudy.gap.tables import text
from mcstudy.gap.trial_planning.next_trial import next_trial
from mcstudy.gap.verdict import verdict
from mcstudy.lines.priors import weak_prior
from mcstudy.models.catalogue import checked_table, read_model
from mcstudy.recordings.columns import model_of
from mcstudy.report.diagnosis.page import gap_page
from mcstudy.stance.feedback import Model, Parameter, Term
from mcstudy.stance.response import frf
from tests.helpers.declared import TABLE, drive

SETTINGS: dict[str, Any] = {"seed": 3, "cycles": 5, "rate_hz": 100.0, "noise": 0.3, "measurement_sd": 0.02}


def _found(model: Model, truth: Model | None = None, **effects: float) -> mc.Diagnosis:
    recording = mc.simulate(effects, model=truth or model, **SETTINGS)
    return mc.diagnose(replace(recording, model=model), fast=True, fmax=8.0)


@pytest.fixture(scope="module")
def heavier() -> mc.Diagnosis:
    """The load of the body that was recorded is heavier than the model says."""
    constants = {**TABLE["constants"], "Jl": 0.0575}
    return _found(drive(), checked_table({**TABLE, "constants": constants}).model())


def test_an_inertia_that_is_wrong_is_named_at_its_joint_with_its_size(heavier: mc.Diagnosis) -> None:
    assert heavier.detected
    leading = heavier.leading
    assert leading is not None
    assert leading.effects == ("inertia_load",)
    assert leading.probability > 0.5
    (size,) = leading.sizes
    assert size.low < 0.0075 < size.high
    assert max(heavier.place, key=heavier.place.__getitem__) == "load"
    assert "Most likely cause: inertia at the load [inertia_load]" in verdict(heavier)
    assert heavier.closed is not None
    assert heavier.closed.low > 0.9


def test_its_tables_document_arrays_and_page_have_the_names_of_the_model(heavier: mc.Diagnosis) -> None:
    assert set(heavier.place) == {"motor", "load", "stimulus", "sensor"}
    assert document(heavier)["z_map"].keys() == {"f", "outputs", "limit"}
    assert document(heavier)["z_map"]["outputs"].keys() == {"motor", "load"}
    data = heavier.to_xarray()
    assert list(data.angle.values) == ["motor", "load"]
    page = gap_page(heavier)
    for shown in (text(heavier), verdict(heavier), page):
        assert not re.search(r"theta|θ|\b(ankle|hip|person|physiological)\b", shown)
    assert not re.search(r"\bsway\b", text(heavier) + verdict(heavier))
    assert "gain of load" in page


def test_nothing_is_missing_in_a_recording_of_the_model_itself() -> None:
    sound = _found(drive())
    assert not sound.detected
    assert sound.none_probability > 0.3


def test_one_angle_reports_what_it_cannot_distinguish_as_one_set() -> None:
    late = mc.simulate({"stimulus_lag": 0.004}, model="elbow", seed=1, cycles=4, rate_hz=200.0, noise=0.3)
    found = mc.diagnose(late, fast=True, fmax=12.0)
    assert found.detected
    assert found.leading is not None
    (alternatives,) = found.leading.alternatives
    assert {"stimulus_lag", "sensor_lag_elbow"} <= set(alternatives)  # the same factor on the only response


def test_a_torque_that_is_left_is_described_at_any_joint() -> None:

    model = read_model("leg_trunk_head").model()
    assert {(p.row, p.sense) for p in paths(model)} == {
        (row, sense) for row in ("ankle", "hip", "neck") for sense in ("ankle", "hip", "neck", "stimulus")
    }
    f = np.array([0.3, 1.0, 3.0])
    data = Data(f, frf(model, model.truth, f), np.tile(np.eye(3), (3, 1, 1)))
    fitted = Fitter(model, weak_prior(model, model), f).best(data, model.truth)
    path = next(p for p in paths(model) if (p.row, p.sense) == ("neck", "stimulus"))
    change = Loop.of(fitted, f).change(path, model)

    small = model.with_terms([Parameter("g", "", 0.0, -1.0, 1.0)], [Term("neck", "stimulus", ("g",), coefficient=-1.0)])
    step = 1e-6
    numeric = (frf(small, np.array([*fitted.theta, step]), f) - fitted.response(f)) / step
    np.testing.assert_allclose(change, numeric, rtol=1e-4)


def test_the_next_trial_of_a_declared_model_is_refused_in_one_line(heavier: mc.Diagnosis) -> None:
    with pytest.raises(InputError, match=r"expected a standing body, .* got the model drive") as refused:
        next_trial(heavier)
    assert "\n" not in str(refused.value)


def test_an_inductance_is_named_in_the_impedance_of_a_cell() -> None:
    cell, f = model_of("electrochemical_cell"), np.geomspace(1.0, 1e5, 41)
    assert cell is not None
    R0, R1, C = cell.truth
    s, rng = 2j * np.pi * f, np.random.default_rng(1)
    Z = (R0 + R1 / (1 + R1 * C * s) + 20e-6 * s)[:, None]
    error = 0.01 * np.abs(Z) * (rng.standard_normal((41, 2)) @ [[1.0], [1j]]) / np.sqrt(2)
    covariance = (1e-4 * np.abs(Z) ** 2)[:, :, None].astype(complex)
    found = mc.diagnose(mc.FrfRecording(f, Z + error, covariance, model=cell, name="cell"), fast=True)
    assert found.leading is not None
    assert found.leading.effects == ("stimulus_rate_voltage",)
    assert found.leading.sizes[0].low < 20e-6 < found.leading.sizes[0].high
    assert "further term" in verdict(found)
