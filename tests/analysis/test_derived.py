"""Quantities that a model declares have statistics, bounds and tables as its parameters have."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import mcstudy as mc
from mcstudy.analysis import efficiency
from mcstudy.analysis.show.summary import show_data
from mcstudy.analysis.view import StudyView
from mcstudy.models.catalogue import read_model
from mcstudy.models.quantities import quantities
from mcstudy.stance.information import cramer_rao

ELBOW = read_model("elbow").model()


@pytest.fixture(scope="module")
def group() -> xr.Dataset:
    return mc.run_model(ELBOW, seed=2, realizations=6, starts=4, fmax=(8.0,), amplitude=(1.0,))


def test_statistics_are_those_of_the_quantity_in_every_realization(group: xr.Dataset) -> None:
    best = group.mc.best().isel(amplitude=0, fmax=0)
    value = {n: best["estimate"].sel(parameter=n).values for n in ELBOW.names}
    fn = np.sqrt((value["K"] + value["Kr"]) / 0.08) / (2 * np.pi)
    true = np.sqrt(18 / 0.08) / (2 * np.pi)
    cells = group.mc.derived()
    assert cells["parameter"].values.tolist() == ["K+Kr", "fn"]
    assert cells["parameter_unit"].values.tolist() == ["N m/rad", "Hz"]
    assert float(cells["truth"].sel(parameter="fn")) == pytest.approx(true, rel=1e-14)
    for statistic, expected in (("bias", fn.mean() - true), ("sd", fn.std(ddof=1)), ("cv", fn.std(ddof=1) / fn.mean())):
        found = getattr(cells.mc, statistic)()["value"].sel(parameter="fn")
        np.testing.assert_allclose(found, expected, rtol=1e-9)
    lazy = group.chunk({"realization": 2}).mc.derived()
    xr.testing.assert_allclose(lazy, cells)


def test_the_bound_of_a_quantity_is_that_of_the_delta_method(group: xr.Dataset) -> None:
    cells = group.mc.derived()
    covariance = efficiency.measured_covariance(group)
    found = efficiency.bounds_on_sd(cells, ELBOW, covariance).isel(amplitude=0, fmax=0)
    f, C = group["frequency"].values, covariance.isel(amplitude=0).values
    n = int(group["n_frequencies"][0])
    whole = cramer_rao(ELBOW, ELBOW.truth, f[:n], efficiency.joint_covariance(C[:n]))
    k, kr = ELBOW.names.index("K"), ELBOW.names.index("Kr")
    total = whole[k, k] + whole[kr, kr] + 2 * whole[k, kr]
    of_sum = 0.5 / (2 * np.pi) / np.sqrt(18 * 0.08)  # derivative of sqrt(S / J) / (2 pi) by S
    np.testing.assert_allclose(found["cramer_rao"].sel(parameter="K+Kr"), np.sqrt(total), rtol=1e-9)
    np.testing.assert_allclose(found["cramer_rao"].sel(parameter="fn"), of_sum * np.sqrt(total), rtol=1e-9)


def test_tables_hold_them_after_the_parameters(group: xr.Dataset) -> None:
    (cell,) = show_data(StudyView(xr.DataTree.from_dict({"model": group})))["groups"]["model"]["cells"]
    assert [p["name"] for p in cell["parameters"]] == [*ELBOW.names, "K+Kr", "fn"]
    fn = cell["parameters"][-1]
    assert (fn["unit"], fn["truth"]) == ("Hz", pytest.approx(2.3873, rel=1e-4))
    np.testing.assert_allclose(fn["sd"]["value"], float(group.mc.derived().mc.sd()["value"].sel(parameter="fn")[0, 0]))
    assert {"bias", "cv", "rmse", "efficiency"} <= fn.keys()
    assert [q.name for q in quantities(ELBOW)] == [*ELBOW.names, "K + Kr", "fn"]  # what a fit of a recording reports
