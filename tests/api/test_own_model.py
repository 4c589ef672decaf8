"""A model declared in Python goes through the same study as one named in a study file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from mcstudy.analysis import accuracy, selection
from mcstudy.analysis.results import open_results
from mcstudy.errors import DesignError, ModelError
from mcstudy.own_model import run_model
from mcstudy.stance.body import one_segment, two_segment
from mcstudy.stance.feedback import Model, Parameter, Term
from mcstudy.stance.response import frf
from mcstudy.stance.stability import growth_rate
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study


def test_a_registered_model_given_as_an_object_has_the_bits_of_its_study_file(tiny: str, tmp_path: Path) -> None:
    study = parse_study(tiny)
    run_study(study, tmp_path / "cube.zarr")
    stored = open_results(tmp_path / "cube.zarr", lazy=False)["noisy"].to_dataset()
    own = run_model(two_segment(), seed=7, realizations=5, starts=6, fmax=(0.41, 1.2), amplitude=(3.0, 5.0))
    assert set(own.variables) == set(stored.variables)
    for name, variable in stored.variables.items():
        assert own[name].dims == variable.dims, name
        np.testing.assert_array_equal(own[name].values, variable.values, err_msg=str(name))
        assert own[name].attrs == variable.attrs, name


def test_noise_free_fits_of_an_own_model_find_its_truth() -> None:
    terms = tuple(replace(t, sense="sway") if t.sense == "theta1" else t for t in one_segment().terms)
    model = replace(one_segment(), name="own", terms=terms, angles=("sway",))
    cube = run_model(model, simulator="none", realizations=1, starts=30, fmax=(8.0,), amplitude=(5.0,))
    best = selection.best(cube)["estimate"].values.ravel()
    np.testing.assert_allclose(best, model.truth, rtol=1e-5)
    assert cube["angle"].values.tolist() == ["sway"]


def test_analysis_reads_it_like_a_group_of_a_cube() -> None:
    cube = run_model(one_segment(), realizations=6, starts=5, fmax=(1.2,), amplitude=(5.0,), noise={"psd": (0.0, 0.0)})
    bias = accuracy.absolute_bias_percent(selection.best(cube))
    assert bias["value"].sizes == {"amplitude": 1, "fmax": 1, "parameter": 4}
    assert float(bias["mcse"].max()) < 1e-3  # without noise every realization is the same


METHODS = (
    "bias", "cv", "rmse", "at_bound", "unstable", "efficiency", "sensitivity", "j_nc", "j_nc_within", "starts_needed",
    "starts_needed_quantiles", "minimum_curve", "asymptote", "basins", "atlas", "by_starts", "hit_rate_by_start",
    "outcomes", "realizations", "absolute_bias_percent", "mean_absolute_bias_percent",
)  # fmt: skip


@pytest.fixture(scope="module")
def sway() -> xr.Dataset:
    """A model of one's own whose parameters no registered model has."""
    own = one_segment()
    renamed = tuple(replace(p, name=f"own_{p.name}") for p in own.parameters)
    terms = tuple(
        replace(t, gain=tuple(f"own_{g}" for g in t.gain), delay=t.delay and f"own_{t.delay}") for t in own.terms
    )
    model = replace(own, name="own", parameters=renamed, terms=terms, derived=())
    return run_model(model, realizations=4, starts=5, fmax=(1.2, 8.0), amplitude=(3.0, 5.0))


@pytest.mark.parametrize("method", METHODS)
def test_every_method_of_mc_works_on_it(sway: xr.Dataset, method: str) -> None:
    result = getattr(sway.mc, method)()
    assert isinstance(result, xr.Dataset | xr.DataArray)


def test_the_declared_model_comes_back_whole(sway: xr.Dataset) -> None:
    model = sway.mc.model
    assert model.names == ("own_K", "own_B", "own_Kpas", "own_Td")
    f = sway["frequency"].values
    np.testing.assert_array_equal(frf(model, model.truth, f), sway["true_frf"].values)


def test_a_body_that_falls_is_refused_unless_it_is_asked_for() -> None:
    weak = one_segment().with_values({"K": 300.0})
    settings: dict[str, object] = {"realizations": 1, "starts": 1, "fmax": [1.2], "amplitude": np.array([5.0])}
    with pytest.raises(
        DesignError, match=r"^group\.model\.model\.truth: expected a stable closed loop, got .*growth rate \+"
    ):
        run_model(weak, **settings)  # type: ignore[arg-type]
    assert run_model(weak, allow_unstable=True, **settings).sizes["start"] == 1  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        ({"realizations": 0}, "realizations: "),
        ({"noise": {"psdd": (1.0, 1.0)}}, "noise.psdd: "),
        ({"stimulus": {"discard": 6}}, "stimulus.discard: "),
        ({"fmax": (0.04,)}, "fmax: expected at least 3 frequencies for 12 parameters"),
        ({"noise": {"psd": {1.0, 2.0}}}, ": expected numbers"),
        ({"amplitude": (1e308,)}, "amplitude.0: expected a number from 1e-06 to 1e+06, got 1e+308"),
    ],
)
def test_settings_are_refused_as_a_study_file_would_be(settings: dict[str, object], line: str) -> None:
    usual: dict[str, object] = {"realizations": 1, "starts": 1, "fmax": (1.2,), "amplitude": (5.0,)}
    with pytest.raises(DesignError) as refused:
        run_model(two_segment(), **{**usual, **settings})  # type: ignore[arg-type]
    assert str(refused.value).startswith(f"group.model{line if line.startswith(':') else f'.{line}'}")
    assert "\n" not in str(refused.value)


def plant(order: int) -> Model:
    """A row with a constant term of this order, and a gain."""
    return Model(
        name="circuit",
        rows=("node",),
        angles=("voltage",),
        parameters=(Parameter("R", "", 1.0, 0.0, 2.0, ""),),
        terms=(
            Term("node", "voltage", order=order),
            Term("node", "voltage", ("R",), noisy=True),
            Term("node", "stimulus"),
        ),
    )


def test_a_plant_without_inertia_is_a_plant() -> None:
    assert growth_rate(plant(1), plant(1).truth) == pytest.approx(-1.0)
    assert growth_rate(plant(2), plant(2).truth) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"rows": ("a", "b", "node")}, "rows: expected 1, one for each angle"),
        ({"rows": ("unused", "node"), "angles": ("voltage", "none")}, "rows: expected a term in each, got none in un"),
        ({"rows": ("node", "node")}, "rows: expected one to 4 different ones"),
        ({"angles": tuple("abcde")}, "angles: expected one to 4 different ones"),
        ({"angles": ("voltage", "voltage")}, "angles: expected one to 4 different ones"),
        ({"output_filters": (None, None, None)}, "output_filters: expected 1, one for each angle"),
    ],
)
def test_wrong_axes_are_refused_in_one_line(change: dict[str, tuple[str, ...]], expected: str) -> None:
    with pytest.raises(ModelError, match=f"model circuit: {expected}") as error:
        replace(plant(2), **change)
    assert "\n" not in str(error.value)
