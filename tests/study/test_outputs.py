"""Studies of models with declared outputs: what is recorded, in its units, through the cube, its checks and words."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from linked_segments import model

from mcstudy.analysis.context import covariance_of, group_of, points_of
from mcstudy.analysis.results import open_results
from mcstudy.api.cubes import verify, write_report
from mcstudy.api.studies import summary
from mcstudy.spectra.frf_law import frf_law
from mcstudy.stance.feedback import Output, OutputTerm
from mcstudy.study.design import Study
from mcstudy.study.measure import stimulus
from mcstudy.study.run import run_study

OUTPUTS = (
    Output("centre of mass", (OutputTerm("ankle"), OutputTerm("hip", 0.2))),
    Output("trunk", (OutputTerm("ankle + knee + hip"),)),
    Output("rate", (OutputTerm("hip", order=1),), "rad/s"),
    Output("torque", (OutputTerm("ankle", 72.0, 2), OutputTerm("ankle", -650.0), OutputTerm("stimulus", -1.0)), "N m"),
)
NOISE = {"psd": [4e-4, 7e-5, 7e-5], "measurement": {"sd": [0.02, 0.02, 0.01, 0.5]}}


@pytest.mark.parametrize("simulator", ["spectral", "time_domain"])
def test_outputs_go_through_a_study(simulator: str, tmp_path: Path) -> None:
    three = model(3, OUTPUTS)
    bounded = replace(
        three,
        parameters=tuple(
            replace(p, lower=p.value - 0.1 * abs(p.value), upper=p.value + 0.1 * abs(p.value)) for p in three.parameters
        ),
    )
    study = Study("outputs", seed=1).group(
        "g", model=bounded, simulator=simulator, realizations=3, starts=2, fmax=[4.0], amplitude=[5.0], noise=NOISE,
        stimulus={"stages": 5, "state_s": 0.04, "rate_hz": 200.0}, fit={"cost": "ml"},
        spectra={"points": "odd_lines", "ramp": "remove"}, store={"standard_errors": True},
    )  # fmt: skip
    out = tmp_path / "outputs.zarr"
    assert run_study(study, out).failed_blocks == []
    cube = open_results(out, lazy=False)["g"].to_dataset()
    assert cube["angle"].values.tolist() == [o.name for o in OUTPUTS]
    assert cube["angle_unit"].values.tolist() == ["rad", "rad", "rad/s", "N m"]
    assert cube["frf"].attrs["units"] == "see angle_unit"
    n = cube.sizes["frequency"]
    assert cube["noise_covariance"].shape == (1, 3, n, 4, 4)
    assert np.isfinite(cube["estimate"]).all()
    # the mean of the records is the closed form, within their errors, in each output; with leakage, for the torque
    group = group_of(cube)
    law = frf_law(
        bounded, stimulus(group, 1.0), group.noise_source, points_of(cube), 6, 1, True, group.measurement_noise
    )
    error = (cube["frf"].mean("realization") - cube["true_frf"]).values[0] * 5.0
    variance = np.einsum("nii->ni", law.covariance).real / 3
    np.testing.assert_allclose((np.abs(error) ** 2 / variance).mean(axis=0), 1.0, atol=0.5)
    theory = covariance_of(cube).values[0]  # without leakage
    np.testing.assert_allclose(np.einsum("nii->ni", theory).real[:, :3] * 25, 3 * variance[:, :3], rtol=0.2)
    assert verify(out).damage == []
    assert "noise.measurement.sd = [0.02, 0.02, 0.01, 0.5]" in summary(out).details()
    write_report(out, tmp_path / "page.html")
    assert "centre of mass" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_a_cube_of_angles_has_the_layout_it_had(tmp_path: Path) -> None:
    study = Study("angles", seed=1).group("g", realizations=1, starts=1, fmax=[1.2], amplitude=[5.0])
    run_study(study, tmp_path / "a.zarr")
    cube = open_results(tmp_path / "a.zarr", lazy=False)["g"].to_dataset()
    assert "angle_unit" not in cube
    assert cube["frf"].attrs["units"] == "rad/(N m)"
