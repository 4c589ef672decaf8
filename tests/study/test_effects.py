"""Studies whose simulated body has effects that the fitted model lacks, or the reverse.

What a missing effect does is checked against the linearised formula, with responses that are coded here from the
equations of motion (pipelines/docs/model.md), and the time simulator against the closed form.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import mcstudy as mc
from mcstudy.analysis.show.tables import show
from mcstudy.errors import DesignError, FallsError
from mcstudy.stance.body import Body
from mcstudy.study.experiment import Experiment
from mcstudy.study.replay import replay
from mcstudy.study.verify import verify

WIDE = {"bounds": {"lower": -2.0, "upper": 6.0, "delay_margin_s": 0.05}}
NOISELESS: dict[str, Any] = {
    "realizations": 1,
    "starts": 1,
    "fmax": [8.0],
    "amplitude": [5.0],
    "simulator": "none",
    "model": WIDE,
    "fit": {"starts": "linearised"},
}
SHORT = {"stages": 4, "state_s": 0.05, "rate_hz": 100.0, "cycles": 5}
NOISY: dict[str, Any] = {
    "realizations": 60,
    "starts": 1,
    "fmax": [3.0],
    "amplitude": [50.0],
    "model": WIDE,
    "fit": {"starts": "linearised", "cost": "ml"},
    "spectra": {"points": "odd_lines", "ramp": "remove"},
}


def study(*groups: Mapping[str, Any]) -> mc.Study:
    made = mc.Study("effects", seed=7)
    for k, fields in enumerate(groups):
        made = made.group(f"g{k}", **fields)
    return made


def run(path: Path, *groups: Mapping[str, Any]) -> list[xr.Dataset]:
    tree = mc.run(study(*groups), path / "cube.zarr", workers=1)
    return [tree[f"g{k}"].to_dataset() for k in range(len(groups))]


def responses(theta: Mapping[str, float], f: np.ndarray) -> np.ndarray:
    """(N, 2) angles per N m of the two-segment body, from its equations of motion; ``Bpas1``: damping of the ankle."""
    body, s = Body(), 2j * np.pi * f
    late1, late2 = np.exp(-theta["Td1"] * s), np.exp(-theta["Td2"] * s)
    trunk_hip, trunk_ankle = (x * s**2 - body.A2 * body.g for x in (body.J2, body.C2))
    hip1 = body.C1 * s**2 + trunk_hip + (theta["K12"] + theta["B12"] * s) * late2
    hip2 = trunk_hip + (theta["K22"] + theta["B22"] * s) * late2 + theta["Kpas2"]
    ankle1 = body.J1 * s**2 - body.A1 * body.g + trunk_ankle + (theta["K11"] + theta["B11"] * s) * late1
    ankle1 = ankle1 + theta["Kpas1"] + theta.get("Bpas1", 0.0) * s
    ankle2 = trunk_ankle + (theta["K21"] + theta["B21"] * s) * late1
    return np.stack([-hip2, hip1], axis=-1) / (hip1 * ankle2 - hip2 * ankle1)[:, None]


def values(data: xr.Dataset) -> dict[str, float]:
    return dict(zip(map(str, data["parameter"].values), data["truth"].values.tolist(), strict=True))


def jacobian(theta: Mapping[str, float], f: np.ndarray) -> np.ndarray:
    """(N, 2, P) by central differences."""
    columns = []
    for name, value in theta.items():
        step = 1e-6 * abs(value)
        columns.append(
            (responses({**theta, name: value + step}, f) - responses({**theta, name: value - step}, f)) / step
        )
    return np.stack(columns, axis=-1) / 2


def linearised_bias(
    theta: Mapping[str, float], missing: Mapping[str, float], f: np.ndarray, W: np.ndarray
) -> np.ndarray:
    """(J' W J)^-1 J' W D, D being the change of the responses by what is missing; ``W`` (N, 2, 2) weighs them."""
    J, D = jacobian(theta, f), responses({**theta, **missing}, f) - responses(theta, f)
    scale = np.abs(list(theta.values()))
    WJ = np.einsum("nij,njp->nip", W, J * scale).reshape(-1, scale.size)
    WD = np.einsum("nij,nj->ni", W, D).ravel()
    real = [np.concatenate([x.real, x.imag]) for x in (WJ, WD)]
    return np.asarray(np.linalg.lstsq(*real, rcond=None)[0] * scale)


def estimates(data: xr.Dataset) -> np.ndarray:
    return data.mc.best()["estimate"].squeeze(["amplitude", "fmax"]).transpose("realization", "parameter").values


def of_paper(data: xr.Dataset) -> np.ndarray:
    """Weights of the paper's cost: each response relative to its size."""
    size = np.abs(data["true_frf"].values)
    return np.einsum("ni,ij->nij", 1 / size, np.eye(2))


def test_the_responses_of_the_body_that_is_simulated_have_the_effect_and_those_of_the_fit_do_not(
    tmp_path: Path,
) -> None:
    (data,) = run(tmp_path, {**NOISELESS, "effects": {"truth": {"passive_damping_ankle": 40.0}}})
    f = data["frequency"].values
    expected = responses({**values(data), "Bpas1": 40.0}, f)
    np.testing.assert_allclose(data["true_frf"].values, expected, rtol=1e-9)
    np.testing.assert_allclose(data["frf"].values[0, 0], expected, rtol=1e-9)
    assert "Bpas1" not in data["parameter"].values


def shares_of_truth(path: Path, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Bias by missing damping of the ankle without noise, of the fit and of the formula, in units of the truth."""
    (data,) = run(path, {**NOISELESS, "effects": {"truth": {"passive_damping_ankle": size}}})
    theta, truth = values(data), data["truth"].values
    expected = linearised_bias(theta, {"Bpas1": size}, data["frequency"].values, of_paper(data))
    return (estimates(data)[0] - truth) / truth, expected / truth


@pytest.mark.parametrize("size", [0.5, -0.5])
def test_a_small_missing_effect_biases_the_fit_as_the_linearised_formula_says(tmp_path: Path, size: float) -> None:
    bias, expected = shares_of_truth(tmp_path, size)
    np.testing.assert_allclose(bias, expected, atol=1e-3)
    assert abs(expected[8]) == pytest.approx(0.16, abs=0.01)  # Kpas1


def test_a_large_one_biases_it_otherwise_than_to_first_order(tmp_path: Path) -> None:
    bias, expected = shares_of_truth(tmp_path, 69.0)
    assert np.linalg.norm(bias - expected) > 0.2 * np.linalg.norm(expected)


def test_with_noise_the_mean_shift_of_paired_fits_is_the_linearised_bias(tmp_path: Path) -> None:
    plain, missing = run(tmp_path, NOISY, {**NOISY, "effects": {"truth": {"passive_damping_ankle": 2.0}}})
    shift = estimates(missing) - estimates(plain)
    mean, error = shift.mean(axis=0), shift.std(axis=0, ddof=1) / np.sqrt(len(shift))
    covariance = plain["noise_covariance"].mean("realization").values[0, : int(plain["n_frequencies"][0])]
    W = np.linalg.inv(np.linalg.cholesky(covariance))
    expected = linearised_bias(values(plain), {"Bpas1": 2.0}, plain["frequency"].values[: len(W)], W)
    spread = estimates(plain).std(axis=0, ddof=1)
    assert np.linalg.norm((mean - expected) / spread) < 0.1 * np.linalg.norm(expected / spread)
    assert np.abs(expected / error).max() > 10


def test_fitting_the_effect_returns_its_size_and_no_bias(tmp_path: Path) -> None:
    both = {"truth": {"passive_damping_ankle": 40.0}, "fit": ["passive_damping_ankle"]}
    fitted, spare = run(
        tmp_path, {**NOISELESS, "effects": both}, {**NOISELESS, "effects": {"fit": ["passive_damping_hip"]}}
    )
    assert values(fitted)["Bpas1"] == 40.0
    assert values(spare)["Bpas2"] == 0.0
    for data in (fitted, spare):
        np.testing.assert_allclose(estimates(data)[0], data["truth"].values, rtol=1e-4, atol=1e-4)


def test_the_time_simulator_has_the_responses_of_the_closed_form_for_a_linear_effect(tmp_path: Path) -> None:
    settled = {**SHORT, "cycles": 12, "discard": 11}
    (data,) = run(
        tmp_path,
        {
            **NOISELESS,
            "simulator": "time_domain",
            "stimulus": settled,
            "noise": {"psd": 0.0},
            "spectra": {"points": "odd_lines"},
            "effects": {"truth": {"sensor_lag_theta1": 0.02}},
        },
    )
    np.testing.assert_allclose(data["frf"].values[0, 0], data["true_frf"].values, rtol=2e-2)
    below = data["frequency"].values < 2
    np.testing.assert_allclose(data["frf"].values[0, 0, below], data["true_frf"].values[below], rtol=2e-3)


def test_gains_that_depend_on_the_amplitude_are_found_as_the_rule_sets_them(tmp_path: Path) -> None:
    fields = {
        **NOISELESS,
        "amplitude": [3.0, 12.0],
        "simulator": "time_domain",
        "stimulus": {**SHORT, "cycles": 12, "discard": 11},
        "noise": {"psd": 0.0},
        "spectra": {"points": "odd_lines"},
        "effects": {"truth": {"amplitude_reweighting": 0.1}},
    }
    (data,) = run(tmp_path, fields)
    found = data.mc.best()["estimate"].squeeze(["fmax", "realization"]).sel(parameter="B11").values
    np.testing.assert_allclose(found / values(data)["B11"], [2.0**0.1, 2.0**-0.1], rtol=2e-2)


def test_a_size_may_be_stated_by_its_detectability(tmp_path: Path) -> None:
    """Delta is the length of what the parameters cannot absorb, in standard deviations of the responses' errors."""
    (data,) = run(
        tmp_path, {**NOISY, "amplitude": [5.0], "effects": {"truth": {"passive_damping_ankle": {"delta": 3.0}}}}
    )
    size = json.loads(data.attrs["design"])["effects"]["truth"]["passive_damping_ankle"]
    n = int(data["n_frequencies"][0])
    theta, f = values(data), data["frequency"].values[:n]
    W = np.sqrt(2) * np.linalg.inv(np.linalg.cholesky(data["noise_covariance"].mean("realization").values[0, :n]))
    D = responses({**theta, "Bpas1": size}, f) - responses(theta, f)
    absorbed = jacobian(theta, f) @ linearised_bias(theta, {"Bpas1": size}, f, W)
    left = np.einsum("nij,nj->ni", W, D - absorbed)
    assert np.linalg.norm(left) == pytest.approx(3.0, rel=0.15)


def test_a_cube_with_two_models_is_resumed_verified_replayed_and_shown(tmp_path: Path) -> None:
    fields = {**NOISY, "realizations": 3, "store": {"standard_errors": True}, "stimulus": SHORT}
    effects = {"truth": {"head_mode": {"m_head": 4.0}, "passive_damping_ankle": 20.0}, "fit": ["passive_damping_ankle"]}
    made = study({**fields, "effects": effects})
    tree = mc.run(made, tmp_path / "cube.zarr", workers=1)
    again = mc.run(mc.Study.from_json(made.to_json()), tmp_path / "cube.zarr", workers=1)
    xr.testing.assert_identical(tree["g0"].to_dataset(), again["g0"].to_dataset())
    assert verify(tmp_path / "cube.zarr", cells=3).damage == []
    assert replay(tmp_path / "cube.zarr", realization=1, start=0).reproduced
    grown = mc.extend(tmp_path / "cube.zarr", realizations=4)
    np.testing.assert_array_equal(estimates(grown["g0"].to_dataset())[:3], estimates(tree["g0"].to_dataset()))
    text = show(tmp_path / "cube.zarr").text()
    assert "The simulated body has m_head = 4, f_head = 2.75, which the fitted model lacks." in " ".join(text.split())


def test_a_study_without_effects_has_no_place_for_them() -> None:
    plain = study(NOISELESS)
    assert "effects" not in plain.numbers()["group"]["g0"]
    assert study({**NOISELESS, "effects": {}}).fingerprint == plain.fingerprint
    sized = study({**NOISELESS, "effects": {"truth": {"passive_damping_ankle": 1.0}}})
    assert sized.fingerprint != plain.fingerprint


SECTION = "group.g0.effects"
REFUSED: list[tuple[dict[str, Any], str]] = [
    (
        {"effects": {"truth": {"sensor_lag_theta": 0.02}}},
        f"{SECTION}.truth.sensor_lag_theta: unknown effect (similar: sensor_lag_theta",
    ),
    (
        {"effects": {"truth": {"head_mode": {"m_had": 4.0}}}},
        f"{SECTION}.truth.head_mode.m_had: unknown parameter, expected one of m_head, f_head, delta",
    ),
    (
        {"effects": {"truth": {"head_mode": {"f_head": 2.0}}}},
        f"{SECTION}.truth.head_mode: expected its size m_head, or delta",
    ),
    (
        {"effects": {"truth": {"dead_zone": 0.1}}},
        "group.g0.simulator: expected 'time_domain' for dead_zone, which has no closed form, got 'none'",
    ),
    (
        {"effects": {"fit": ["dead_zone"]}},
        f"{SECTION}.fit[0]: expected an effect with a closed form, got 'dead_zone', which is nonlinear",
    ),
    (
        {"effects": {"fit": ["head_mode", "head_mode"]}},
        f"{SECTION}.fit: effects head_mode, head_mode: each may be named once",
    ),
    (
        {"effects": {"truth": {"head_mode": {"delta": 3.0}}}},
        f"{SECTION}.truth.head_mode.delta: expected a group with noise",
    ),
    ({"effects": {"truht": {}}}, f"{SECTION}.truht: unknown key, expected one of truth, fit, reference_amplitude"),
    (
        {"model": {"kind": "one_segment"}, "effects": {"truth": {"passive_damping_hip": 3.0}}},
        f"{SECTION}.truth: model one_segment+passive_damping_hip: no hip row for this effect to act on",
    ),
]


@pytest.mark.parametrize(("changes", "line"), REFUSED)
def test_what_cannot_be_simulated_or_fitted_is_refused_in_one_line(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(DesignError) as refused:
        study({**NOISELESS, "model": {}, **changes})
    assert str(refused.value).startswith(line)


def test_a_body_that_falls_with_its_effects_is_refused_before_anything_runs(tmp_path: Path) -> None:
    falls = study({**NOISELESS, "effects": {"truth": {"activation_dynamics": 0.1}}})
    with pytest.raises(
        DesignError, match=r"^group\.g0\.effects\.truth: expected a stable closed loop, got an unstable one"
    ):
        mc.run(falls, tmp_path / "cube.zarr", workers=1)
    assert not (tmp_path / "cube.zarr").exists()


def test_a_body_that_falls_in_the_time_simulator_is_named_with_its_effect() -> None:
    saturated = {"truth": {"torque_saturation": 0.5}}
    fields = {**NOISELESS, "simulator": "time_domain", "stimulus": SHORT, "spectra": {"points": "odd_lines"}}
    experiment = Experiment(study({**fields, "effects": saturated}).groups["g0"], 7)
    with pytest.raises(
        FallsError, match=r"^effects\.truth: the body falls with saturation = 0\.5 at amplitude 5; reduce"
    ):
        experiment.measure(5.0, 0)
