"""A chunk's content depends on its coordinates alone, not on how often it was interrupted or how fits were batched."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import quick_solver

from mcstudy.files.durable import tree_digest
from mcstudy.fitting.status import Status
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.store import Cube, GroupStore
from mcstudy.study.execution import tasks
from mcstudy.study.execution.tasks import Task, fill, run_task
from mcstudy.study.measure import Measurement
from mcstudy.study.study_file import parse_study


def cube_of(path: Path, text: str) -> Cube:
    return Cube.create(path, parse_study(text))


def task(cube: Cube, group: str = "noisy") -> Task:
    chunks = tuple(cube.groups[group].layout.chunks)
    return Task("test", str(cube.path), cube.study.to_json(), group, cube.depths[group], chunks)


def filled(store: GroupStore, chunk: Chunk) -> dict[str, np.ndarray]:
    data = store.layout.empty(chunk)
    fill(store.experiment, store.layout, chunk, data)
    return data


def test_a_task_leaves_no_fit_pending_and_no_hole(tmp_path: Path, tiny: str) -> None:
    cube = cube_of(tmp_path / "a.zarr", tiny)
    report = run_task(task(cube))
    assert report.complete
    assert report.fits == cube.study.groups["noisy"].fits == 120
    store = cube.groups["noisy"]
    for chunk in store.layout.chunks:
        data = store.existing(chunk)
        assert (data["status"] != Status.PENDING).all()
        assert all(np.isfinite(data[name]).all() for name in ("estimate", "cost", "initial", "frf", "growth_rate"))
        assert (data["estimate"] >= store.experiment.model.lower).all()
        assert (data["estimate"] <= store.experiment.model.upper).all()


def test_without_noise_the_truth_is_found(tmp_path: Path, tiny: str) -> None:
    store = cube_of(tmp_path / "a.zarr", tiny).groups["ideal"]
    data = filled(store, store.layout.chunks[0])
    best = data["estimate"].reshape(-1, 12)[np.argmin(data["cost"])]
    np.testing.assert_allclose(best, store.experiment.model.truth, rtol=1e-6)


@pytest.mark.parametrize("calls", [0, 3])
def test_a_stopped_chunk_is_completed_to_the_same_bytes(
    tmp_path: Path, tiny: str, calls: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(*quick_solver.lm(starts_a_call=4))
    whole, stopped = cube_of(tmp_path / "a.zarr", tiny), cube_of(tmp_path / "b.zarr", tiny)
    run_task(task(whole))
    left = iter(range(calls))

    class StopAfter(threading.Event):
        def is_set(self) -> bool:
            return next(left, None) is None

    monkeypatch.setitem(tasks.STOP, "test", StopAfter())
    first = run_task(task(stopped))
    assert not first.complete
    monkeypatch.delitem(tasks.STOP, "test")
    second = run_task(task(stopped))
    assert first.fits + second.fits == 120
    assert tree_digest(stopped.path) == tree_digest(whole.path)


def test_a_slow_chunk_is_written_before_it_is_complete(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(*quick_solver.lm(starts_a_call=4))
    monkeypatch.setattr(tasks, "CHECKPOINT_S", 0.0)
    whole, killed = cube_of(tmp_path / "a.zarr", tiny), cube_of(tmp_path / "b.zarr", tiny)
    run_task(task(whole))
    writes = iter(range(5))
    write = GroupStore.write

    def kill(self: GroupStore, chunk: Chunk, data: dict[str, np.ndarray], *environments: Iterable[str]) -> None:
        if next(writes, None) is None:
            raise KeyboardInterrupt
        write(self, chunk, data, *environments)

    with monkeypatch.context() as patch:
        patch.setattr(GroupStore, "write", kill)
        with pytest.raises(KeyboardInterrupt):
            run_task(task(killed))
    assert 0 < run_task(task(killed)).fits < 120
    assert tree_digest(killed.path) == tree_digest(whole.path)


@pytest.mark.parametrize("batch", [1, 8, 100])
def test_a_fit_does_not_depend_on_its_neighbours(
    tmp_path: Path, tiny: str, batch: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = cube_of(tmp_path / "a.zarr", tiny.replace("starts = 6", "starts = 21")).groups["noisy"]
    reference = filled(store, store.layout.chunks[0])
    monkeypatch.setitem(*quick_solver.lm(starts_a_call=batch))
    for name, values in filled(store, store.layout.chunks[0]).items():
        assert values.tobytes() == reference[name].tobytes(), name


def test_more_starts_and_fmax_keep_every_fit_bit_identical(tmp_path: Path, tiny: str) -> None:
    small = cube_of(tmp_path / "a.zarr", tiny).groups["noisy"]
    grown = tiny.replace("starts = 6", "starts = 11").replace("[0.41, 1.2]", "[0.41, 0.9, 1.2]")
    large = cube_of(tmp_path / "b.zarr", grown).groups["noisy"]
    chunk = small.layout.chunks[0]
    before, after = filled(small, chunk), filled(large, chunk)
    for name in ("estimate", "cost", "status", "growth_rate", "iterations"):
        assert after[name][:, [0, 2], :, :6].tobytes() == before[name].tobytes()


def test_data_that_are_not_finite_are_an_outcome_with_a_reason(tmp_path: Path, tiny: str) -> None:
    store = cube_of(tmp_path / "a.zarr", tiny).groups["noisy"]
    good = store.experiment.measure

    def broken(amplitude: float, realization: int) -> Measurement:
        data = good(amplitude, realization)
        return Measurement(data.frf * (np.nan if realization == 1 else 1.0), data.covariance)

    store.experiment.measure = broken
    data = filled(store, store.layout.chunks[0])
    assert (data["status"][:, :, 1] == Status.NON_FINITE_DATA).all()
    assert np.isnan(data["estimate"][:, :, 1]).all()
    assert (data["status"][:, :, [0, 2, 3, 4]] == Status.CONVERGED).any()


@pytest.mark.parametrize(
    "section",
    [
        "[fit]\nsolver = 'trf'",
        "[fit]\nsolver = 'trust-constr'\nmax_iterations = 20",
        "[fit]\nsolver = 'interior_point'\n[fit.interior_point]\nunits = 'bounds'\nhessian = 'scaled'",
        "[fit]\nsolver = 'interior_point'\n[group.noisy.fit]\ncost = 'ml'",
        "[fit]\nstarts = 'linearised'",
        "[fit]\nstarts = 'sobol'",
        "[fit]\nstarts = 'latin_hypercube'",
        "[model]\nkind = 'one_segment'",
        "[stimulus]\nkind = 'platform_translation'\n[group.noisy.stimulus]\ncycles = 3",
        "[stimulus]\nkind = 'hip_torque'\nconvention = 'peak_to_peak'",
        "[stimulus]\nstages = 5\nstate_s = 0.1\n[spectra]\npoints = 'odd_lines'",
        "[group.noisy.fit]\ncost = 'ml'",
        "[spectra]\nramp = 'remove'",
        "[spectra]\npoints = 'averaged'",
        "[spectra]\nwidth = 0.25",
    ],
)
def test_every_choice_of_the_study_file_runs(tmp_path: Path, tiny: str, section: str) -> None:
    few = tiny.replace("realizations = 5", "realizations = 1").replace("starts = 6", "starts = 2")
    cube = cube_of(tmp_path / "a.zarr", f"{few}\n{section}\n")
    report = run_task(task(cube))
    assert report.complete
    assert all(Status(s).usable for s in report.counts)


@pytest.mark.parametrize(("model", "starts"), [("two_segment", "linearised"), ("one_segment", "uniform")])
def test_a_study_of_a_tilt_estimates_its_weight(tmp_path: Path, tiny: str, model: str, starts: str) -> None:
    text = tiny.replace("amplitude = [3.0, 5.0]", "amplitude = [0.01, 0.02]").replace(
        "amplitude = [5.0]", "amplitude = [0.02]"
    )
    text += f"[stimulus]\nkind = 'visual_tilt'\n[model]\nkind = '{model}'\n[model.truth]\nWvis = 0.4\n"
    text += f"[fit]\nstarts = '{starts}'\n"
    cube = cube_of(tmp_path / "a.zarr", text.replace("[1.2]", "[8.0]"))
    ideal = cube.groups["ideal"]
    names = ideal.experiment.model.names
    assert names[-1] == "Wvis"
    assert (ideal.experiment.model.lower[-1], ideal.experiment.model.upper[-1]) == (0.0, 1.0)
    data = filled(ideal, ideal.layout.chunks[0])
    best = np.nanargmin(data["cost"])
    assert data["estimate"].reshape(-1, len(names))[best, -1] == pytest.approx(0.4, abs=1e-6)


def test_the_time_domain_measures_what_the_spectral_simulator_does(tmp_path: Path, tiny: str) -> None:
    quiet = tiny + "[noise]\npsd = [0.0, 0.0]\n[spectra]\npoints = 'odd_lines'\n"
    frfs = {}
    for simulator in ("spectral", "time_domain"):
        text = quiet.replace("[group.noisy]", f"[group.noisy]\nsimulator = '{simulator}'")
        store = cube_of(tmp_path / f"{simulator}.zarr", text).groups["noisy"]
        frfs[simulator] = store.experiment.measure(5.0, 0).frf
    # The residual transient after one cycle is what the paper's Fig. 2D shows; it is small.
    np.testing.assert_allclose(frfs["time_domain"], frfs["spectral"], rtol=0.05)


def test_a_damaged_chunk_killed_while_it_is_made_again_is_not_taken_for_done(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kill comes inside a checkpoint: arrays that are only begun are on disk, their status is not."""
    cube = cube_of(tmp_path / "a.zarr", tiny)
    run_task(task(cube))
    whole = tree_digest(cube.path)
    store = cube.groups["noisy"]
    chunk = store.layout.chunks[0]
    damaged = store.chunk_file("estimate", chunk)
    damaged.write_bytes(damaged.read_bytes()[:-1])

    def killed(*given: Any) -> None:
        data = given[3]
        for name in store.layout.results[:-1]:
            store.put(name, chunk, data[name])
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(tasks, "fill", killed)
        with pytest.raises(KeyboardInterrupt):
            run_task(task(cube))
    assert store.pending(chunk) == store.layout.fits(chunk)
    tasks.open_group.cache_clear()
    run_task(task(cube))
    assert tree_digest(cube.path) == whole
