"""What a person sees of a result: names and units of its own, numbers, files that other programs read."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import xarray as xr

import mcstudy
from mcstudy.analysis.accessor import MonteCarlo
from mcstudy.analysis.accuracy import mean_absolute_bias_percent
from mcstudy.errors import InputError
from mcstudy.own_model import run_model
from mcstudy.stance.body import one_segment
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study

STUDY = """
[study]
name = "small"
seed = 3

[group.accuracy]
realizations = 5
starts = 6
fmax = [1.2, 8.0]
amplitude = [3.0, 5.0]

[group.theory]
simulator = "none"
realizations = 2
starts = 3
fmax = [1.2]
amplitude = [5.0]
"""

EACH = "unit of the parameter"

STATISTICS: dict[str, dict[str, str]] = {
    "bias": {"value": EACH, "mcse": EACH},
    "sd": {"value": EACH, "mcse": EACH},
    "rmse": {"value": EACH, "mcse": EACH},
    "cv": {},
    "absolute_bias_percent": {"value": "%", "mcse": "%", "floor": "%"},
    "mean_absolute_bias_percent": {"value": "%", "mcse": "%", "floor": "%"},
    "mean_spread_percent": {"value": "%", "mcse": "%"},
    "correlation": {},
    "at_bound": {},
    "unstable": {},
    "outcomes": {},
    "realizations": {},
    "stable": {},
    "inside_bounds": {},
    "j_nc": {},
    "median_cost": {},
    "median_j_nc": {},
    "j_nc_within": {},
    "sensitivity": {},
    "efficiency": {"cramer_rao_sd": EACH, "paper_cost_sd": EACH, "box_rmse": EACH},
    "median_bias": dict.fromkeys(("value", "mcse", "lower", "upper"), EACH),
    "mad": {"value": EACH, "mcse": EACH},
    "quantiles": dict.fromkeys(("value", "mcse", "lower", "upper"), EACH),
    "performance": dict.fromkeys(("value", "mcse", "lower", "upper"), "see measure_unit"),
    "starts_needed": {},
    "starts_needed_quantiles": {},
    "minimum_curve": {},
    "asymptote": {},
    "basins": {"estimate": EACH},
    "atlas": {},
    "by_starts": {},
    "hit_rate_by_start": {},
}
"""Methods that return statistics; the units of their variables that are not pure numbers."""

SELECTIONS = ("best", "combined", "derived")


@pytest.fixture(scope="module")
def cube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small study on disk."""
    path = tmp_path_factory.mktemp("labels") / "cube.zarr"
    run_study(parse_study(STUDY), path)
    return path


@pytest.fixture(scope="module")
def group(cube: Path) -> xr.Dataset:
    """Its group with noise, as it is opened."""
    return mcstudy.open_results(cube)["accuracy"].to_dataset()


@pytest.fixture(scope="module")
def result_of(group: xr.Dataset) -> Callable[[str], Any]:
    """What a method returns for that group, computed once."""
    return cache(lambda method: getattr(group.mc, method)())


def variables(result: Any) -> dict[str, xr.DataArray]:
    return {str(result.name): result} if isinstance(result, xr.DataArray) else dict(result.data_vars)


def test_every_method_is_looked_at() -> None:
    public = {n for n in dir(MonteCarlo) if not n.startswith("_")}
    assert public == {*STATISTICS, *SELECTIONS, "only", "compare", "relative_precision", "model", "lazy"}


@pytest.mark.parametrize("method", STATISTICS)
def test_every_variable_of_a_statistic_has_a_name_and_a_unit_of_its_own(
    group: xr.Dataset, result_of: Callable[[str], Any], method: str
) -> None:
    inputs = {v.attrs["long_name"] for v in group.variables.values()}
    result = result_of(method)
    names = []
    for name, variable in variables(result).items():
        assert set(variable.attrs) == {"long_name", "units"}, name
        assert variable.attrs["long_name"] not in inputs, name
        assert variable.attrs["units"] == STATISTICS[method].get(name, "1"), name
        names.append(variable.attrs["long_name"])
    assert len(set(names)) == len(names)
    for name, axis in result.coords.items():
        assert axis.attrs.get("long_name"), name


@pytest.mark.parametrize("method", SELECTIONS)
def test_best_fits_are_named_as_such(group: xr.Dataset, method: str) -> None:
    result = getattr(group.mc, method)()
    assert result["estimate"].attrs["long_name"].startswith("parameters of the best fit")
    assert all(v.attrs.get("long_name") for v in result.variables.values())
    assert "start" not in result.dims
    kept = group.mc.only(group.mc.stable())
    assert kept["cost"].attrs["long_name"] == "cost of the best fit, selected fits only"
    assert kept["cost"].attrs["units"] == "1"


def test_names_and_units_are_those_of_the_field(group: xr.Dataset) -> None:
    said = {m: getattr(group.mc, m)()["value"].attrs for m in ("bias", "cv", "unstable", "starts_needed")}
    assert said["bias"] == {"long_name": "bias (mean estimate minus truth)", "units": EACH}
    assert said["cv"] == {"long_name": "coefficient of variation", "units": "1"}
    assert said["unstable"] == {"long_name": "fraction of best fits that are unstable", "units": "1"}
    assert said["starts_needed"]["long_name"] == "new starts needed for 95 % certainty"
    assert group.mc.by_starts(mean_absolute_bias_percent)["value"].attrs["units"] == "%"


def test_a_plot_says_what_it_shows(group: xr.Dataset) -> None:
    pytest.importorskip("matplotlib").use("Agg")
    import matplotlib.pyplot as plt

    for method in ("bias", "cv", "unstable", "j_nc"):
        result = getattr(group.mc, method)()
        values = result if isinstance(result, xr.DataArray) else result["value"]
        places = {d: 0 for d in values.dims if d != "amplitude"}
        figure, axes = plt.subplots()
        values.isel(places).plot(ax=axes)
        shown = axes.get_ylabel().replace("\n", " ")
        assert shown == f"{values.attrs['long_name']} [{values.attrs['units']}]"
        if "parameter" in places:  # the unit of the one that is drawn
            assert "parameter_unit = N m/rad" in axes.get_title().replace("\n", " ")
        plt.close(figure)


def test_the_unit_of_parameters_that_share_one_is_theirs(group: xr.Dataset) -> None:
    stiffness = group.mc.best().sel(parameter=["K11", "K12"])
    assert stiffness.mc.bias()["value"].attrs["units"] == "N m/rad"
    assert group.mc.bias().coords["parameter_unit"].sel(parameter="Td1") == "s"
    assert group.mc.combined().mc.bias().coords["parameter_unit"].sel(parameter="K11+Kpas1") == "N m/rad"


def test_a_statistic_knows_whose_it_is(group: xr.Dataset) -> None:
    attributes = group.mc.bias().attrs
    assert attributes["fingerprint"] == group.attrs["fingerprint"]
    assert attributes["seed"] == 3
    assert not any(isinstance(v, dict) for v in attributes.values())


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
@pytest.mark.parametrize("method", [*STATISTICS, *SELECTIONS])
def test_every_result_can_be_written_as_netcdf_and_read_back(
    result_of: Callable[[str], Any], method: str, engine: Any, tmp_path: Path
) -> None:
    result = result_of(method)
    if engine == "scipy" and isinstance(result, xr.Dataset):  # NetCDF 3 has no complex numbers
        result = result.drop_vars([n for n, v in result.variables.items() if v.dtype.kind == "c"])
    result.to_netcdf(tmp_path / "result.nc", engine=engine)
    opened = xr.load_dataset if isinstance(result, xr.Dataset) else xr.load_dataarray
    back = opened(tmp_path / "result.nc", engine=engine)
    xr.testing.assert_equal(back, result)
    for name, variable in variables(result).items():
        assert variables(back)[name].attrs["long_name"] == variable.attrs["long_name"]


def test_the_cube_itself_can_be_written_and_asked_again(cube: Path, group: xr.Dataset, tmp_path: Path) -> None:
    mcstudy.open_results(cube).to_netcdf(tmp_path / "tree.nc", engine="h5netcdf")
    group.to_netcdf(tmp_path / "group.nc", engine="h5netcdf")
    again = xr.load_dataset(tmp_path / "group.nc", engine="h5netcdf")
    xr.testing.assert_equal(again.mc.bias(), group.mc.bias())
    assert again.mc.model == group.mc.model


def test_own_models_results_can_be_written_too(tmp_path: Path) -> None:
    own = run_model(one_segment(), realizations=3, starts=2, fmax=(1.2,), amplitude=(5.0,))
    own.to_netcdf(tmp_path / "own.nc", engine="h5netcdf")
    again = xr.load_dataset(tmp_path / "own.nc", engine="h5netcdf")
    xr.testing.assert_equal(again.mc.cv(), own.mc.cv())
    assert again.mc.model == own.mc.model


@pytest.mark.parametrize("plain", [False, True])
def test_matlab_files_can_hold_it(cube: Path, group: xr.Dataset, plain: bool, tmp_path: Path) -> None:
    opened = xr.open_zarr(cube, group="accuracy", consolidated=False) if plain else group
    asked = [opened.mc.best(), opened.mc.bias(), opened.mc.realizations()]
    for data in [*asked, *([] if plain else [group])]:
        scipy.io.savemat(tmp_path / "data.mat", {str(k): v.values for k, v in data.variables.items()})
        back = scipy.io.loadmat(tmp_path / "data.mat")
        for name, variable in data.variables.items():
            if variable.dtype.kind not in "biufc":
                assert variable.values.dtype.kind == "U", name  # what every library knows, unlike NumPy's StringDType
                assert [str(x).strip() for x in back[str(name)].ravel()] == list(map(str, variable.values.ravel()))
            else:
                np.testing.assert_array_equal(back[str(name)].reshape(variable.shape), variable.values)


def test_pandas_gets_the_numbers(group: xr.Dataset) -> None:
    table = group.mc.bias().sel(amplitude=5.0, fmax=1.2)[["value", "mcse", "n"]].to_dataframe()
    assert table.loc["K11", "parameter_unit"] == "N m/rad"
    assert table["value"].notna().all()
    assert group.mc.cv()["value"].to_series().index.names == ["amplitude", "fmax", "parameter"]


def test_a_printed_statistic_shows_numbers(group: xr.Dataset, result_of: Callable[[str], Any]) -> None:
    assert group["estimate"].chunks is not None
    for method in STATISTICS:
        assert "dask" not in repr(result_of(method)), method


def test_the_accessor_lists_its_methods(group: xr.Dataset) -> None:
    lines = repr(group.mc).splitlines()
    for method in ("bias", "only", "efficiency", "best", "lazy"):
        (line,) = [x for x in lines if x.split()[0] == method]
        assert len(line.split()) > 2, method
    assert "  bias                        Mean estimate minus truth, in the unit of the parameter." in lines
    assert max(map(len, lines)) <= 160


def test_the_root_of_the_tree_names_its_groups(cube: Path) -> None:
    tree = mcstudy.open_results(cube)
    assert "bias" in repr(tree.mc)
    with pytest.raises(InputError, match="choose a group: accuracy, theory") as refused:
        tree.mc.bias()
    assert "\n" not in str(refused.value)


def test_a_statistic_is_no_group(group: xr.Dataset) -> None:
    with pytest.raises(InputError, match="expected a group of a cube or its best fits, got a Dataset with value, mcse"):
        group.mc.bias().mc.cv()


def test_mc_is_there_as_soon_as_a_result_is_and_importing_the_package_stays_light(cube: Path) -> None:
    light = "import sys, mcstudy; assert not {'xarray', 'numpy', 'dask', 'numba'} & set(sys.modules)\n"
    opened = f"{light}tree = mcstudy.open_results({str(cube)!r}); tree['accuracy'].mc.bias()"
    own = (
        f"{light}from mcstudy.stance.body import one_segment\nfrom mcstudy.own_model import run_model\n"
        "run_model(one_segment(), realizations=3, starts=1, fmax=(1.2,), amplitude=(5.0,)).mc.bias()"
    )
    file = (
        f"{light}import xarray, mcstudy.analysis.registration\n"
        f"xarray.open_zarr({str(cube)!r}, group='accuracy', consolidated=False).mc.bias()"
    )
    for script in (opened, own, file):
        subprocess.run([sys.executable, "-W", "error", "-c", script], check=True)
