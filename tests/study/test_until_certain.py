"""``starts = "until certain"``: each fit problem gets as many starts as it needs, whoever runs it and however often."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

from mcstudy.analysis.results import open_results
from mcstudy.analysis.search.convergence import starts_needed
from mcstudy.analysis.selection import best
from mcstudy.errors import DesignError, InputError
from mcstudy.files.durable import tree_digest
from mcstudy.fitting.status import Status
from mcstudy.study.cube.store import Cube
from mcstudy.study.design import Study
from mcstudy.study.execution.tasks import fill
from mcstudy.study.extend import Growth, extend
from mcstudy.study.plan import plan_study
from mcstudy.study.replay import replay
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify

MOST = 250
AXES = {"realizations": 3, "fmax": [8.0], "amplitude": [3.0]}
"""Three problems, of which some need 100 starts and some more."""


def study(most: int = MOST, **more: object) -> Study:
    asked = {"starts": "until certain", "most_starts": most}
    return Study("certain", seed=41).group("noisy", **{**AXES, **asked, **more})


@pytest.fixture(scope="module")
def cube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("certain") / "a.zarr"
    outcome = run_study(study(), out)
    status = open_results(out)["noisy"]["status"].values
    assert outcome.fits == (status == Status.CONVERGED).sum()
    assert outcome.not_needed == (status == Status.NOT_NEEDED).sum()
    return out


def test_starts_are_drawn_until_the_rule_holds_and_no_further(cube: Path) -> None:
    group = open_results(cube, lazy=False)["noisy"].to_dataset()
    drawn = []
    for cost, status in zip(group["cost"].values[0, 0], group["status"].values[0, 0], strict=True):
        n = int(np.isfinite(cost).sum())
        assert (status[:n] == Status.CONVERGED).all()
        assert (status[n:] == Status.NOT_NEEDED).all()
        for look in (100, 200):
            hits = int((cost[:look] <= np.nanmin(cost[:look]) * 1.001).sum())
            enough = (1 - binomtest(hits, look).proportion_ci(method="wilson").low) ** look < 0.01
            assert enough == (n <= look), (n, look, hits)
            if n <= look:
                break
        drawn.append(n)
    assert set(drawn) <= {100, 200, MOST}
    assert len(set(drawn)) > 1, "the problems differ in difficulty"


def test_each_fit_is_that_of_a_study_with_a_fixed_number_of_starts(cube: Path, tmp_path: Path) -> None:
    run_study(Study("certain", seed=41).group("noisy", **AXES, starts=100), tmp_path / "b.zarr")
    some, fixed = (open_results(p, lazy=False)["noisy"].to_dataset() for p in (cube, tmp_path / "b.zarr"))
    for name in ("initial", "estimate", "cost", "status", "growth_rate", "iterations"):
        np.testing.assert_array_equal(some[name].values[:, :, :, :100], fixed[name].values)


def test_starts_that_were_not_needed_are_neither_failed_nor_attempted(cube: Path) -> None:
    group = open_results(cube, lazy=False)["noisy"].to_dataset()
    needed = starts_needed(group)
    ran = (group["status"] == Status.CONVERGED).sum("start")
    np.testing.assert_array_equal(needed["starts"], ran)
    np.testing.assert_array_equal(best(group)["usable_starts"], ran)
    assert (needed["missed_upper"].where(ran < MOST, 0.0) < 0.01).all()
    assert group["initial"].isnull().all("parameter").equals(group["status"] == Status.NOT_NEEDED)


def test_a_stopped_chunk_is_completed_with_the_same_decisions(cube: Path) -> None:
    store = Cube.open(cube).groups["noisy"]
    (chunk, *_) = store.layout.chunks
    whole = store.layout.empty(chunk)
    fill(store.experiment, store.layout, chunk, whole)
    data = store.layout.empty(chunk)
    for stop in (1, 2, 3):  # each call gets one call of the solver further
        calls = iter(range(10))
        fill(store.experiment, store.layout, chunk, data, lambda calls=calls, stop=stop: next(calls) >= min(stop, 2))
    fill(store.experiment, store.layout, chunk, data)
    for name, values in whole.items():
        np.testing.assert_array_equal(data[name], values, err_msg=name)
        np.testing.assert_array_equal(store.read(name, chunk), values, err_msg=name)


def test_a_raised_maximum_gives_the_cube_of_a_study_run_at_once(cube: Path, tmp_path: Path) -> None:
    run_study(study(120), tmp_path / "a.zarr")
    extend(tmp_path / "a.zarr", Growth(starts=MOST))
    assert Cube.open(tmp_path / "a.zarr").study.fingerprint == Cube.open(cube).study.fingerprint
    assert tree_digest(tmp_path / "a.zarr") == tree_digest(cube)


def test_verify_finds_starts_that_were_left_out_wrongly(cube: Path, tmp_path: Path) -> None:
    assert not verify(cube, cells=2).damage
    shutil.copytree(cube, tmp_path / "a.zarr")
    store = Cube.open(tmp_path / "a.zarr").groups["noisy"]
    chunk = store.layout.chunks[0]
    data = store.existing(chunk)
    gone = data["status"][0, 0, :, 50:] == Status.CONVERGED
    for name in ("initial", "estimate", "cost", "iterations", "at_bound", "growth_rate"):
        data[name][0, 0, :, 50:][gone] = store.layout.arrays[name].fill
    data["status"][0, 0, :, 50:] = Status.NOT_NEEDED
    store.write(chunk, data)
    assert any("marked as not needed where they are needed" in line for line in verify(tmp_path / "a.zarr", 0).damage)


def test_a_start_that_was_not_needed_cannot_be_replayed(cube: Path) -> None:
    with pytest.raises(InputError, match="this one was not needed"):
        replay(cube, realization=0, start=MOST - 1)


def test_the_plan_counts_the_starts_that_are_needed() -> None:
    planned = plan_study(study(), workers=1)
    assert 3 * 100 <= planned.fits <= 3 * MOST
    assert "starts of at most 250" in str(planned)


def test_a_study_file_keeps_the_words() -> None:
    one = study()
    assert 'starts = "until certain"' in one.to_toml()
    assert parse_study(one.to_toml()).fingerprint == Study.from_json(one.to_json()).fingerprint == one.fingerprint
    assert Study("a", seed=1).group("g", **AXES, starts="until certain").groups["g"].starts == 1000
    plain = Study("a", seed=1).group("g", **AXES, starts=5)
    assert "most_starts" not in plain.to_toml()
    assert "at most 250 starts, until certain" in repr(one)


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"starts": 5, "most_starts": 9}, r"group\.g\.most_starts: expected starts = 'until certain' beside it, got 9"),
        ({"starts": "until sure"}, r"group\.g\.starts: expected a whole number or 'until certain', got 'until sure'"),
        ({"starts": "until certain", "most_starts": 0}, r"group\.g\.most_starts: expected at least 1, got 0"),
        ({"starts": "until certain", "fit": {"starts": "latin_hypercube"}}, r"g\.fit\.starts: expected another kind"),
    ],
)
def test_a_mistake_is_one_line(fields: dict[str, object], says: str) -> None:
    with pytest.raises(DesignError, match=says):
        Study("a", seed=1).group("g", **AXES, **fields)
