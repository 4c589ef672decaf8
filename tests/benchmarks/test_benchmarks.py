"""The benchmark gives everyone the same problem, and names its numbers as announced. Nothing here is timed."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from mcstudy.fitting.lm import normal_equations
from mcstudy.fitting.status import Status
from mcstudy.stance.response import frf
from mcstudy.study.cube.store import Cube
from mcstudy.study.verify import verify
from pipelines.benchmarks import (
    basin_hopping,
    counting,
    instant,
    kernel_time,
    large_cubes,
    paper_solver,
    peers,
    profiles,
    scale,
    speedup,
    starts_needed,
)
from pipelines.benchmarks.cases import FMAX, cases
from pipelines.benchmarks.model import Compiled
from pipelines.benchmarks.report import QUICK
from pipelines.benchmarks.suite import BENCHMARKS

SLOW = {"scipy_trust_constr", "scipy_trust_constr_bfgs"}  # minutes of a thousand iterations; the loose one stands in


def test_cells_are_the_papers_28_points_at_8_hz_and_16_at_1_2_hz() -> None:
    assert [(c.fmax, c.problem.f.size) for c in cases(1, 3)] == [(1.2, 16), (8.0, 28)]


@pytest.mark.parametrize("case", cases(1, 3), ids=lambda c: f"{c.fmax:g} Hz")
def test_peers_get_the_residual_and_jacobian_of_the_problem(case) -> None:
    model = Compiled(case.problem)
    for theta in case.starts:
        z = (theta - model.lower) / model.width
        jacobian = case.problem.jacobian(theta) * model.width
        np.testing.assert_allclose(2 * model.value(z), case.problem.cost(theta), rtol=1e-12)
        np.testing.assert_allclose(model.hessian(z), jacobian.T @ jacobian, rtol=1e-9, atol=1e-9)
        expected = jacobian.T @ case.problem.residual(theta)
        np.testing.assert_allclose(model.gradient(z), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("peer", sorted(set(peers.PEERS) - SLOW))
def test_from_the_truth_everyone_ends_in_the_same_minimum(peer: str) -> None:
    if peer in peers.missing():
        pytest.skip(f"{peer}: package of the bench extra not installed")
    problem = cases(1, 3)[0].problem
    start = problem.model.truth[None]
    own, theirs = peers.own(problem, start), peers.PEERS[peer](problem, start)
    np.testing.assert_allclose(own, theirs, rtol=1e-6 if "trust" in peer else 1e-9)


def test_operations_are_counted_on_the_kernels_own_arithmetic() -> None:
    problem = cases(1, 3)[0].problem
    flops, triangle = counting.evaluation(problem, problem.model.truth)
    cost, gradient, gram = normal_equations(problem, problem.model.truth[None])
    P = gradient.shape[1]
    expected = [*gram[0][np.tril_indices(P)], *gradient[0], *cost]
    np.testing.assert_allclose(triangle, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
    # at the least one product and sum per entry of J^T J, real and imaginary part
    assert flops > 2 * 2 * problem.f.size * P * (P + 1) / 2


def test_speedup_announces_every_peer_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = {"scipy_trf", "scipy_trust_constr", "pypesto_ls_trf", "pypesto_fides", "lmfit"}
    assert expected <= set(peers.PEERS)
    monkeypatch.setattr(peers, "PEERS", {"scipy_trf": peers.scipy_trf})
    monkeypatch.setattr(peers, "missing", lambda: ("lmfit",))
    result = speedup.run(dataclasses.replace(QUICK, starts=3))
    assert {"speedup.scipy_trf", *(f"speedup.scipy_trf.fmax_{f:g}" for f in FMAX)} <= set(result.keys)
    assert result.keys["speedup.scipy_trf"] > 0
    assert any("lmfit" in note for note in result.notes)
    assert [row["solver"] for row in result.table] == ["mcstudy", "scipy_trf"]


def test_the_papers_solver_is_compared_on_the_same_cost_and_settings() -> None:
    problem = cases(1, 3)[0].problem
    settings = paper_solver.VARIANTS["bounds_scaled"].model_copy(update={"max_evaluations": 260})
    start = problem.model.truth[None] * 1.02
    (theirs,) = paper_solver.scipy_differences(problem, start, settings)
    assert theirs < problem.cost(start[0])
    assert set(paper_solver.VARIANTS) == {"own_identity", "own_scaled", "bounds_identity", "bounds_scaled"}


def test_basin_hopping_fits_the_loop_with_pade_delay_to_the_same_minimum() -> None:
    model, f = basin_hopping.model(), np.array([0.05, 0.45, 2.45])
    padded = basin_hopping.response(basin_hopping.TRUTH, basin_hopping.INERTIA, basin_hopping.LOAD, f)
    np.testing.assert_allclose(frf(model, model.truth, f)[:, 0], padded, rtol=2e-6)  # order 5 is that good to 2.45 Hz
    data = frf(model, model.truth, basin_hopping.frequencies())[:, 0]
    start = (model.truth * 1.02 - model.lower) / (model.upper - model.lower)
    found = basin_hopping.hopped(basin_hopping.relative_squares, data, start, 0, hops=0)
    np.testing.assert_allclose(found, model.truth, rtol=1e-2)


def test_profiles_are_compared_with_the_intervals_of_the_fit_at_the_same_threshold() -> None:
    fit = profiles.fitted(0)
    names = [e.name for e in profiles.ended(fit)]
    assert {"K12", "K21"} <= set(names)
    ends = profiles.own(fit, ["K21"])
    width = fit["K21"].high - fit["K21"].low
    np.testing.assert_allclose(ends, [[fit["K21"].low, fit["K21"].high]], atol=1e-6 * width)
    pytest.importorskip("pypesto", reason="package of the bench extra not installed")
    np.testing.assert_allclose(profiles.pypesto(fit, ["K21"]), ends, atol=0.05 * width)


def test_kernel_benchmark_states_time_operations_and_fraction(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(counting, "whole", lambda *_: (50_000, 1))
    keys = kernel_time.run(dataclasses.replace(QUICK, starts=8)).keys
    for name in ("iteration_us", "flops_per_iteration", "fraction_of_peak"):
        assert all(keys[f"kernel.{name}.fmax_{f:g}"] > 0 for f in FMAX)


def test_starts_needed_follow_from_the_hit_rate() -> None:
    assert speedup.needed(0.0) == math.inf
    assert speedup.needed(0.95) == 1.0
    assert 1 - (1 - 0.3) ** speedup.needed(0.3) == pytest.approx(0.95)


def test_the_curve_of_starts_ends_where_the_starts_did() -> None:
    hits = np.array([False, True, False, False, True])
    row = starts_needed._row("lmfit", "uniform", 1.2, [(hits, 1e-3), (~hits, 1e-3)])
    assert max(row["curve"]) == 5
    assert row["curve"][1] == pytest.approx(0.5)
    assert row["curve"][2] == pytest.approx(np.mean([1 - 0.6**2, 1 - 0.4**2]))


def test_a_cube_of_invented_numbers_is_sound_and_complete(tmp_path: Path) -> None:
    assert large_cubes.write_cube(tmp_path / "a.zarr", 300) == 300
    found = verify(tmp_path / "a.zarr", cells=0)
    assert (found.damage, found.pending) == ([], 0)


def test_every_part_of_the_suite_has_a_name() -> None:
    names = {"speedup", "kernel", "framework", "starts", "study", "plan", "workers", "limits", "growth", "diagnosis"}
    names |= {"latency", "show", "paper_solver", "wheel", "scale", "profiles", "kernel_sizes", "basin_hopping"}
    names |= {"stability"}
    assert names == set(BENCHMARKS)


def test_a_fit_that_returns_at_once_gives_the_same_numbers_whenever_it_runs(tmp_path: Path) -> None:
    large_cubes.write_cube(tmp_path / "a.zarr", 300)
    (store,) = Cube.open(tmp_path / "a.zarr").groups.values()
    chunk = store.layout.chunks[0]
    whole = store.existing(chunk)
    resumed = {name: values.copy() for name, values in whole.items()}
    for name in ("status", "estimate", "cost"):
        resumed[name][:, 1] = store.layout.empty(chunk)[name][:, 1]
    instant.fill(store, chunk, resumed, lambda: True)
    assert (resumed["status"][:, 1] == Status.PENDING).all()
    instant.fill(store, chunk, resumed, lambda: False)
    assert all(resumed[name].tobytes() == whole[name].tobytes() for name in whole)


def test_the_figure_of_scale_has_a_line_for_every_verb_also_where_one_was_not_measured(tmp_path: Path) -> None:
    row = {"fits": 10.0, "files": 7, "files_planned": 7, "tasks": 2, "tasks_planned": 2, "bytes": 900}
    row |= {f"{verb}_{what}": 5.0 for verb in scale.VERBS for what in ("cpu_s", "peak_bytes")}
    larger = {k: 10 * v for k, v in row.items() if not k.startswith("report")}
    scale.draw([scale._shown(row), scale._shown(larger)], tmp_path / "scale.svg")
    drawn = (tmp_path / "scale.svg").read_text()
    assert all(f"<!-- {label} -->" in drawn for label in (*scale.VERBS, "files, found", "tasks, found", "planned"))
