"""A plan counts exactly and predicts precision the way Monte Carlo errors behave."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mcstudy
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube import run_log
from mcstudy.study.cube.store import Cube
from mcstudy.study.extent import Extent, extent
from mcstudy.study.plan import plan_study
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study

STUDY = """
[study]
name = "planned"
seed = 3
[group.noisy]
realizations = 80
starts = 20
fmax = [1.2, 8.0]
amplitude = [5.0]
"""


def test_bytes_and_monte_carlo_errors_are_within_30_percent_of_what_a_run_gives(tmp_path: Path) -> None:
    study = parse_study(STUDY)
    planned = plan_study(study)
    run_study(study, tmp_path / "out.zarr", ClusterOptions(workers=1))
    written = sum(file.stat().st_size for file in (tmp_path / "out.zarr").rglob("*") if file.is_file())
    assert planned.bytes == pytest.approx(written, rel=0.3)
    noisy = mcstudy.open_results(tmp_path / "out.zarr")["noisy"].to_dataset()
    error = (100 * noisy.mc.bias()["mcse"] / abs(noisy["truth"])).mean("parameter").isel(amplitude=0)
    for expected in planned.groups[0].precision:
        assert expected.mean == pytest.approx(float(error.sel(fmax=expected.fmax)), rel=0.3)


@pytest.mark.parametrize("threads", [1, 2])
def test_files_and_tasks_are_exactly_those_of_the_run(tmp_path: Path, tiny: str, threads: int) -> None:
    study = parse_study(tiny)
    planned = extent(study, threads)
    out = tmp_path / "out.zarr"
    run_study(study, out, ClusterOptions(workers=threads))
    assert planned.files == sum(file.is_file() for file in out.rglob("*"))
    assert planned.tasks == sum(event["event"] == "block" for event in run_log.events(out))
    assert planned.chunks == sum(len(store.layout.chunks) for store in Cube.open(out).groups.values())


def test_tasks_grow_with_the_fits_until_a_chunk_holds_50000_and_the_memory_of_a_run_stays() -> None:
    def of(fits: int) -> Extent:
        return extent(
            parse_study(
                STUDY.replace("realizations = 80", f"realizations = {fits // 1000}").replace(
                    "starts = 20", "starts = 500"
                )
            ),
            threads=2,
        )

    assert [of(10**k).chunks for k in (7, 8, 9)] == [400, 2000, 20_000]
    assert [of(10**k).tasks for k in (8, 9)] == [2000, 20_000]
    assert of(10**9).files == pytest.approx(20_000 * 10, rel=0.01)
    assert of(10**9).memory(2) == of(10**8).memory(2) < 300e6


def test_time_by_the_clock_is_shared_by_the_threads_except_for_the_start(tiny: str) -> None:
    planned = plan_study(parse_study(tiny), imports=5.0)
    assert planned.start_up > 5.0
    one, four = planned.wall(1), planned.wall(4)
    assert one >= planned.cpu
    assert (one - four) / 0.75 == pytest.approx(one - planned.start_up * planned.slowdown)


def test_fits_are_exact_and_precision_is_for_noisy_groups_only(tiny: str) -> None:
    noisy, ideal = plan_study(parse_study(tiny)).groups
    assert (noisy.fits, ideal.fits) == (120, 8)
    # estimate and initial alone: 12 parameters of 8 bytes, twice, a fit
    assert noisy.bytes > 120 * 2 * 12 * 8
    assert noisy.seconds > 0
    assert [(p.amplitude, p.fmax) for p in noisy.precision] == [(3.0, 0.41), (3.0, 1.2), (5.0, 0.41), (5.0, 1.2)]
    assert ideal.precision == ()


def test_four_times_the_realizations_halve_the_monte_carlo_error(tiny: str) -> None:
    few, _ = plan_study(parse_study(tiny)).groups
    many, _ = plan_study(parse_study(tiny.replace("realizations = 5", "realizations = 20"))).groups
    np.testing.assert_allclose([p.mean for p in many.precision], [p.mean / 2 for p in few.precision], rtol=1e-12)


def test_a_larger_stimulus_promises_smaller_errors(tiny: str) -> None:
    noisy, _ = plan_study(parse_study(tiny.replace("[3.0, 5.0]", "[1.0, 20.0]"))).groups
    mean = {(p.amplitude, p.fmax): p.mean for p in noisy.precision}
    assert mean[20.0, 1.2] < mean[1.0, 1.2]
