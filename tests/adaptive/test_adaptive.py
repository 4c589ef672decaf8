"""A study grows until its Monte Carlo error is as asked, says why, and then equals the study made at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from mcstudy import adaptive as until
from mcstudy.adaptive import PrecisionTarget, look, parse_target, run_until
from mcstudy.analysis import accuracy
from mcstudy.analysis.results import open_results
from mcstudy.analysis.selection import best
from mcstudy.cli import main
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.files.durable import tree_digest
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube.store import Cube
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study

STUDY = """
[study]
name = "until"
seed = 7

[group.noisy]
realizations = 6
starts = 4
fmax = [1.2]
amplitude = [5.0]

[group.ideal]
simulator = "none"
realizations = 2
starts = 2
fmax = [8.0]
amplitude = [5.0]
"""
ONE = ClusterOptions(workers=1)


def largest_mcse(out: Path) -> float:
    cells = best(open_results(out)["noisy"].to_dataset().compute())
    return float((100 * accuracy.bias(cells)["mcse"] / abs(cells["truth"])).max())


def test_it_grows_to_the_target_and_equals_the_study_made_at_once(tmp_path: Path) -> None:
    out, once, said = tmp_path / "out.zarr", tmp_path / "once.zarr", []
    found = run_until(parse_study(STUDY), out, PrecisionTarget("bias", 12.0), 20_000, ONE, say=said.append)
    assert found.reached
    assert largest_mcse(out) <= 12.0
    assert f"{largest_mcse(out):.3g} %" in found.statement
    assert said == found.steps != []
    grown = Cube.open(out).study
    assert grown.groups["noisy"].realizations > 6
    assert grown.groups["ideal"] == parse_study(STUDY).groups["ideal"]  # no error to lower there
    assert found.outcome.fits == grown.fits
    run_study(parse_study(grown.to_toml()), once, ONE)
    assert tree_digest(out) == tree_digest(once)
    # The same command again has nothing to do, though the study file is smaller than the cube by now.
    again = run_until(parse_study(STUDY), out, PrecisionTarget("bias", 12.0), 20_000, ONE)
    assert (again.reached, again.steps, again.outcome.fits) == (True, [], 0)


def test_where_the_budget_ends_first_it_says_so_and_goes_on_with_a_larger_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "s.toml", tmp_path / "out.zarr"
    file.write_text(STUDY)
    words = ["run", str(file), "-o", str(out), "--workers", "1", "--until-mcse", "bias=1%", "--budget-fits"]
    assert main([*words, "60"]) == Exit.NOT_REACHED
    said = capsys.readouterr().out.splitlines()[-1]
    assert said.startswith("stopped: the budget of 60 fits is spent (60 run); largest MCSE of bias")
    assert "target 1 %" in said
    assert main([*words, "61"]) == Exit.NOT_REACHED
    assert Cube.open(out).study.fits == 60  # one fit is no realization
    assert main([*words, "80"]) == Exit.NOT_REACHED
    assert Cube.open(out).study.fits == 80


def cube(estimates: np.ndarray, cost: np.ndarray) -> xr.Dataset:
    """A cube of one parameter with truth 1; both (realization, start)."""
    return xr.Dataset(
        {
            "estimate": (("amplitude", "fmax", "realization", "start", "parameter"), estimates[None, None, ..., None]),
            "cost": (("amplitude", "fmax", "realization", "start"), cost[None, None]),
            "status": (("amplitude", "fmax", "realization", "start"), np.ones((1, 1, *cost.shape), dtype=np.uint8)),
            "truth": ("parameter", [1.0]),
        },
        coords={"amplitude": [5.0], "fmax": [1.2], "parameter": ["K"]},
    )


def test_starts_are_asked_for_where_the_second_half_of_them_still_moves_the_bias() -> None:
    rng, n = np.random.default_rng(0), 200
    estimates = 1 + 0.01 * rng.standard_normal((n, 4))
    estimates[:, :2] += 0.2  # the minimum is found by the last two starts only
    cost = np.broadcast_to([2.0, 2.0, 1.0, 1.0], (n, 4))
    late, early = (
        look(cube(estimates, cost), PrecisionTarget("bias", 1.0)),
        look(cube(estimates, -cost), PrecisionTarget("bias", 1.0)),
    )
    assert late.shift == pytest.approx(20, abs=1)
    assert early.shift == 0
    group = parse_study(STUDY).groups["noisy"]
    step = until._wanted("noisy", group, late, PrecisionTarget("bias", 1.0))
    assert step is not None
    assert step.starts == 8
    assert "so the number of starts limits precision" in step.why
    assert until._wanted("noisy", group, early, PrecisionTarget("bias", 1.0)) is None


def test_realizations_follow_the_square_law_but_not_by_more_than_four_times_at_once() -> None:
    group = parse_study(STUDY).groups["noisy"].model_copy(update={"realizations": 100})
    found = look(cube(np.ones((3, 1)), np.ones((3, 1))), PrecisionTarget("bias", 1.0))

    def realizations(mcse: float) -> int | None:
        step = until._wanted("noisy", group, until.replace(found, mcse=mcse), PrecisionTarget("bias", 1.0))
        return None if step is None else step.realizations

    assert realizations(1.0) is None
    assert realizations(1.5) == 237  # 1.05 x 100 x 1.5^2
    assert realizations(9.0) == 400
    assert realizations(float("inf")) == 101  # not known


@pytest.mark.parametrize(
    "text",
    ["bias", "bias=1", "bias=0%", "bias=-1%", "bias=nan%", "cv=1%", "bias=1..2%", "", "bias=1e-300%", "bias=1e300%"],
)
def test_a_target_that_is_none_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(InputError, match=r"^target: expected bias=PERCENT% or mean_bias=PERCENT%.*$"):
        parse_target(text)


def test_what_cannot_be_reached_is_refused_before_it_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = tmp_path / "s.toml", tmp_path / "out.zarr"
    file.write_text(STUDY)
    words = ["run", str(file), "-o", str(out)]
    assert main([*words, "--until-mcse", "bias=1%"]) == 2
    assert main([*words, "--until-mcse", "bias=1%", "--budget-fits", "20"]) == 2
    assert "expected at least 28" in capsys.readouterr().err
    silent = STUDY.replace("[group.noisy]", '[group.noisy]\nsimulator = "none"')
    with pytest.raises(InputError, match="expected a study with noise"):
        run_until(parse_study(silent), out, PrecisionTarget("bias", 1.0), 1000, ONE)
    assert not out.exists()


def test_a_cube_of_another_study_is_refused_as_always(tmp_path: Path) -> None:
    out = tmp_path / "out.zarr"
    run_study(parse_study(STUDY.replace("seed = 7", "seed = 8")), out, ONE)
    with pytest.raises(InputError, match=r"study\.seed = 8, not 7"):
        run_until(parse_study(STUDY), out, PrecisionTarget("bias", 1.0), 1000, ONE)
