"""In a cube that was really run, what became of a fit stays told apart, and statistics say what they leave out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import quick_solver
import xarray as xr

import mcstudy.analysis.accessor  # noqa: F401 - registers .mc
from mcstudy import open_results
from mcstudy.fitting.problem import Fits, Problem
from mcstudy.fitting.status import Status
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.execution import tasks
from mcstudy.study.experiment import Experiment, Measurement
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study

STUDY = """
[study]
name = "mixed"
seed = 7

[group.noisy]
realizations = 9
starts = 3
fmax = [0.41]
amplitude = [5.0]
"""

FATES = {
    4: Status.SOLVER_ERROR,
    5: Status.NON_FINITE_MODEL,
    6: Status.NON_FINITE_DATA,
    7: Status.NON_FINITE_DATA,
    8: Status.PENDING,
}
"""What becomes of all starts of a realization; the others are fitted."""


@pytest.fixture(scope="module")
def group(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """The group of a cube in which every way to end occurs."""
    out = tmp_path_factory.mktemp("outcomes") / "mixed.zarr"
    make, fit_queue, now = Experiment.__init__, tasks.fit_queue, [-1]

    def fated(self: Experiment, *words: Any) -> None:
        make(self, *words)
        measure = self.measure

        def fated_measure(amplitude: float, realization: int) -> Measurement:
            now[:] = [realization]
            data = measure(amplitude, realization)
            if FATES.get(realization) is Status.PENDING:
                raise ValueError("this block never ends well")
            if FATES.get(realization) is Status.NON_FINITE_DATA:
                return Measurement(data.frf * np.nan, data.covariance)
            return data

        self.measure = fated_measure

    def fated_fit(problems: list[Problem], which: np.ndarray, starts: np.ndarray, *more: object) -> Fits:
        fate = FATES.get(now[0])
        if fate in (Status.SOLVER_ERROR, Status.NON_FINITE_MODEL):
            return Fits.failed(starts, fate)
        return fit_queue(problems, which, starts, *more)  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(*quick_solver.lm(fits_a_chunk=(1, 1)))  # one realization a chunk
        patch.setattr(Experiment, "__init__", fated)
        patch.setattr(tasks, "fit_queue", fated_fit)
        outcome = run_study(parse_study(STUDY), out, ClusterOptions(workers=1), block=1)
        assert len(outcome.failed_blocks) == 1
    return open_results(out)["noisy"].to_dataset().compute()


def test_every_way_to_end_is_its_own_in_the_cube_and_never_a_number(group: xr.Dataset) -> None:
    status = group["status"].isel(amplitude=0, fmax=0)
    for realization, fate in FATES.items():
        assert (status.sel(realization=realization) == fate).all()
        assert group["estimate"].sel(realization=realization).isnull().all()
        assert group["cost"].sel(realization=realization).isnull().all()
    assert status.sel(realization=slice(0, 3)).isin([s for s in Status if s.usable]).all()
    fits = group.mc.outcomes().isel(amplitude=0, fmax=0)
    for fate, n in ((Status.PENDING, 3), (Status.SOLVER_ERROR, 3), (Status.NON_FINITE_MODEL, 3)):
        assert int(fits.sel(outcome=fate.name.lower())) == n
    assert int(fits.sel(outcome="non_finite_data")) == 6
    assert int(fits.sum()) == 27


def test_realizations_left_out_are_accounted_for_one_way_each(group: xr.Dataset) -> None:
    account = {str(k): int(v) for k, v in group.mc.realizations().squeeze().data_vars.items()}
    assert account == {"used": 4, "not_run": 1, "non_finite": 2, "diverged": 1, "failed": 1}
    for statistic in ("bias", "sd", "cv", "rmse", "unstable", "mean_absolute_bias_percent"):
        result = getattr(group.mc, statistic)()
        assert (result["n"] == account["used"]).all(), statistic
        assert (result["left_out"] == 9 - account["used"]).all(), statistic


def test_conditional_statistics_leave_out_more_and_say_so_beside_those_of_all_replicates(group: xr.Dataset) -> None:
    cells = group.mc.best()
    one = cells["realization"] == 2
    cells["growth_rate"] = xr.where(one, 0.5, xr.where(cells["growth_rate"].notnull(), -1.0, np.nan))
    everyone, stable = cells.mc.bias(), cells.mc.only(cells.mc.stable()).mc.bias()
    assert (everyone["n"] == 4).all()
    assert (stable["n"] == 3).all()
    assert (stable["left_out"] == 6).all()
    kept = cells["estimate"].sel(realization=[0, 1, 3]).mean("realization")
    xr.testing.assert_allclose(stable["value"], (kept - cells["truth"]).rename("value"))
    assert (everyone["value"] != stable["value"]).any()
