"""The Cramér-Rao bound and the linearised covariance, against simulated linear problems and known cases."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr
from scipy.optimize import lsq_linear

import mcstudy.analysis.registration  # noqa: F401 - registers .mc
from mcstudy.analysis import efficiency
from mcstudy.analysis.derived import combined
from mcstudy.analysis.selection import best
from mcstudy.errors import InputError
from mcstudy.fitting.problem import paper_cost
from mcstudy.fitting.standard_errors import joint_covariance, overlap_of
from mcstudy.spectra.bands import odd_lines, published
from mcstudy.stance import information
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf, frf_jacobian

Cube = Callable[..., xr.Dataset]
MODEL = two_segment()


def random_covariance(rng: np.random.Generator, f: np.ndarray) -> np.ndarray:
    """Covariances with correlated angles, a thousandth of the FRFs in size."""
    H = frf(MODEL, MODEL.truth, f)
    G = rng.standard_normal((f.size, 2, 2)) + 1j * rng.standard_normal((f.size, 2, 2)) + 2 * np.eye(2)
    G *= 1e-3 * np.abs(H)[:, :, None]
    return G @ G.conj().transpose(0, 2, 1)


def linear_estimates(weight: np.ndarray, C: np.ndarray, f: np.ndarray, rng: np.random.Generator, n: int) -> np.ndarray:
    """Errors (n, P) of weighted least squares in the linearised model, FRF errors drawn from C."""
    _, J = frf_jacobian(MODEL, MODEL.truth, f)
    scale = MODEL.upper - MODEL.lower
    root = np.linalg.cholesky(C)
    white = (rng.standard_normal((n, f.size, 2)) + 1j * rng.standard_normal((n, f.size, 2))) / np.sqrt(2)
    error = np.einsum("nij,...nj->...ni", weight, np.einsum("nij,...nj->...ni", root, white)).reshape(n, -1)
    design = np.einsum("nij,njp->nip", weight, J * scale).reshape(-1, scale.size)
    real = np.concatenate([design.real, design.imag])
    rhs = np.concatenate([error.real, error.imag], axis=1)
    return np.linalg.lstsq(real, rhs.T, rcond=None)[0].T * scale


def test_the_best_weights_reach_the_bound_and_the_papers_weights_their_sandwich() -> None:
    rng, f = np.random.default_rng(0), odd_lines(2.0).f
    C = random_covariance(rng, f)
    joint = joint_covariance(C)
    bound = information.cramer_rao(MODEL, MODEL.truth, f, joint)
    ml = np.linalg.inv(np.linalg.cholesky(C))
    paper = paper_cost(MODEL, f, frf(MODEL, MODEL.truth, f)).weight
    sandwich = efficiency.linearised_covariance(MODEL, MODEL.truth, f, paper, joint)
    np.testing.assert_allclose(efficiency.linearised_covariance(MODEL, MODEL.truth, f, ml, joint), bound, rtol=1e-5)
    for weight, expected in ((ml, bound), (paper, sandwich)):
        sd = linear_estimates(weight, C, f, rng, 3000).std(axis=0)
        np.testing.assert_allclose(sd, np.sqrt(np.diag(expected)), rtol=0.06)
    assert (np.diag(sandwich) >= np.diag(bound) * (1 - 1e-9)).all()


def test_points_that_share_lines_say_less_than_independent_ones() -> None:
    f, rng = published().below(1.2).f, np.random.default_rng(1)
    C = random_covariance(rng, f)
    overlap = overlap_of(published().below(1.2))
    assert overlap[3, 4] == pytest.approx(0.5)  # harmonics 7, 9 and 9, 11
    assert overlap[0, 1] == 0
    joint = joint_covariance(C, overlap)
    np.testing.assert_allclose(joint, joint.conj().T)
    np.testing.assert_allclose(joint[6:8, 6:8], C[3])
    assert np.linalg.eigvalsh(joint).min() > 0


def test_too_few_points_are_refused() -> None:
    f = published().f[:2]
    with pytest.raises(InputError, match="2 points do not determine 12 parameters"):
        information.cramer_rao(MODEL, MODEL.truth, f, joint_covariance(random_covariance(np.random.default_rng(2), f)))


def test_a_parameter_that_its_bounds_hold_has_no_bound_and_the_others_that_of_knowing_it() -> None:
    f = published().below(1.2).f
    joint = joint_covariance(random_covariance(np.random.default_rng(3), f))
    k = MODEL.names.index("Kpas1")
    value = float(MODEL.truth[k])
    narrow = MODEL.with_bounds({"Kpas1": (value - 5e-10, value + 5e-10)})
    assert information.fixed_by_bounds(narrow, MODEL.truth, f, joint).tolist() == [n == "Kpas1" for n in MODEL.names]
    assert not information.fixed_by_bounds(MODEL, MODEL.truth, f, joint).any()
    free = np.delete(np.arange(len(MODEL.names)), k)
    weight = paper_cost(MODEL, f, frf(MODEL, MODEL.truth, f)).weight
    for found in (
        information.cramer_rao(narrow, MODEL.truth, f, joint),
        efficiency.linearised_covariance(narrow, MODEL.truth, f, weight, joint),
    ):
        assert np.isnan(found[k]).all()
        assert np.isnan(found[:, k]).all()
        assert np.isfinite(found[np.ix_(free, free)]).all()
    # knowing a parameter is conditioning on it: the Schur complement of the bound
    C = information.cramer_rao(MODEL, MODEL.truth, f, joint)
    known = C[np.ix_(free, free)] - np.outer(C[free, k], C[k, free]) / C[k, k]
    found = information.cramer_rao(narrow, MODEL.truth, f, joint)[np.ix_(free, free)]
    np.testing.assert_allclose(np.diag(found), np.diag(known), rtol=1e-5)


def test_efficiency_is_one_for_estimates_that_scatter_like_the_bound(make_cube: Cube) -> None:
    cube = make_cube(realizations=400, starts=1)
    cells = best(cube)
    f = cells["frequency"].values
    C = random_covariance(np.random.default_rng(5), f)
    dims = ("amplitude", "frequency", "angle", "angle_2")
    covariance = xr.DataArray(np.stack([C, C * 9 / 25]), dims=dims)
    bounds = efficiency.bounds_on_sd(cells, MODEL, covariance)
    z = cells["estimate"].copy(data=np.random.default_rng(6).standard_normal(cells["estimate"].shape))
    cells["estimate"] = cells["truth"] + z * bounds["cramer_rao"]
    cells["estimate"] = cells["estimate"].transpose("amplitude", "fmax", "realization", "parameter")
    out = efficiency.efficiency(cells, bounds)
    deviation = (out["value"] - 1) / out["mcse"]
    assert abs(deviation).max() < 4.5
    assert 0.8 < float(deviation.std()) < 1.25
    np.testing.assert_allclose(
        bounds["cramer_rao"].isel(amplitude=1), bounds["cramer_rao"].isel(amplitude=0) * 3 / 5, rtol=1e-9
    )
    assert (bounds["cramer_rao"].diff("fmax") <= 0).all()


def test_a_bound_on_any_parameter_takes_the_cramer_rao_bound_from_all(make_cube: Cube) -> None:
    cube = make_cube(realizations=20, starts=1, fmax=(1.2, 8.0), amplitude=(5.0,))
    assert bool(cube.mc.efficiency()["applies"].all())
    cube["at_bound"][0, 0, :3, :, 2] = 1  # 15 % of the fits at 1.2 Hz
    cube["at_bound"][0, 1, :2, :, 2] = 1  # 10 % at 8 Hz
    found = cube.mc.efficiency().isel(amplitude=0)
    assert found["applies"].values.tolist() == [False, True]
    assert float(found["at_bound"].sel(fmax=1.2, parameter="K11")) == 0
    assert bool(found[["value", "mcse"]].sel(fmax=1.2).isnull().all().to_array().all())
    assert bool(found["value"].sel(fmax=8.0).notnull().all())
    assert bool(found[["box", "box_mcse"]].notnull().all().to_array().all())
    unbounded = (found["cramer_rao_sd"] / cube.mc.sd()["value"].isel(amplitude=0)) ** 2
    kept = [name for name in found.data_vars if found[name].dims == unbounded.dims and found[name].dtype == float]
    assert not any(np.isclose(found[name].sel(fmax=1.2), unbounded.sel(fmax=1.2)).any() for name in kept)
    assert not bool(cube.mc.only(cube.mc.best()["cost"] < 0).mc.efficiency()["applies"].any())


def test_the_bound_within_the_box_lies_between_data_and_box_and_below_estimates_in_it() -> None:
    rng, f = np.random.default_rng(9), published().below(1.2).f
    C = random_covariance(rng, f)
    width = MODEL.upper - MODEL.lower
    root = {s: information.van_trees(MODEL, MODEL.truth, f, joint_covariance(C * s)) for s in (1e-8, 1, 1e15)}
    plain = information.cramer_rao(MODEL, MODEL.truth, f, joint_covariance(C))
    np.testing.assert_allclose(root[1e-8], plain * 1e-8, rtol=1e-3, atol=0)
    np.testing.assert_allclose(np.diag(root[1e15]), (width / (2 * np.pi)) ** 2, rtol=1e-3)
    assert (np.linalg.eigvalsh((plain - root[1]) / width / width[:, None]) > -1e-12).all()
    # estimates in the box: linear least squares within it (scipy), for true values drawn from the density
    _, J = frf_jacobian(MODEL, MODEL.truth, f)
    white = np.sqrt(2) * np.linalg.solve(np.linalg.cholesky(C), J * width).reshape(-1, width.size)
    design = np.concatenate([white.real, white.imag])
    grid = np.linspace(0, 1, 2001)
    truth = np.interp(rng.random((60, width.size)), grid - np.sin(2 * np.pi * grid) / (2 * np.pi), grid)
    data = truth @ design.T + rng.standard_normal((60, len(design)))
    found = np.array([lsq_linear(design, y, bounds=(0, 1)).x for y in data])
    error = ((found - truth) ** 2).mean(0)
    allowed = np.diag(root[1]) / width**2
    spread = ((found - truth) ** 2).std(0) / np.sqrt(60)
    assert (error > allowed - 3 * spread).all()
    assert error.sum() > allowed.sum()


def test_the_bound_of_combined_stiffnesses_is_that_of_the_sum(make_cube: Cube) -> None:
    cube = make_cube(realizations=20, starts=1, fmax=(1.2,), amplitude=(5.0,))
    cells = best(cube)
    f = cells["frequency"].values[: int(cells["n_frequencies"][0])]
    C = random_covariance(np.random.default_rng(7), cells["frequency"].values)
    covariance = xr.DataArray(C[None], dims=("amplitude", "frequency", "angle", "angle_2"))
    bounds = efficiency.bounds_on_sd(combined(cells), MODEL, covariance).isel(amplitude=0, fmax=0)
    whole = information.cramer_rao(MODEL, MODEL.truth, f, joint_covariance(C[: f.size]))
    i, j = MODEL.names.index("K11"), MODEL.names.index("Kpas1")
    expected = np.sqrt(whole[i, i] + whole[j, j] + 2 * whole[i, j])
    assert float(bounds["cramer_rao"].sel(parameter="K11+Kpas1")) == pytest.approx(expected, rel=1e-9)
    assert float(bounds["cramer_rao"].sel(parameter="Td1")) == pytest.approx(np.sqrt(whole[-2, -2]), rel=1e-9)
    assert expected < np.sqrt(whole[i, i])  # the sum is what the data determine
    found = cube.mc.combined().mc.efficiency()
    assert found["value"].sizes["parameter"] == 10
    alone = cube.mc.efficiency().sel(parameter=["Td1", "B11"])
    np.testing.assert_allclose(found["value"].sel(parameter=["Td1", "B11"]), alone["value"], rtol=1e-9)
    cube["at_bound"][..., 0] = 1
    assert not bool(cube.mc.combined().mc.efficiency()["applies"].any())
    assert bool(cube.mc.combined().mc.inside_bounds().equals(cube.mc.inside_bounds()))


def test_parameters_of_another_model_have_no_bound(make_cube: Cube) -> None:
    cells = make_cube().mc.best()
    renamed = cells.assign_coords(parameter=[f"own_{n}" for n in cells["parameter"].values])
    with pytest.raises(InputError, match="parameter: expected those of model two_segment or their sums, found own_K11"):
        renamed.mc.efficiency()


def test_a_group_without_noise_has_no_bound(make_cube: Cube) -> None:
    with pytest.raises(InputError, match="without noise"):
        efficiency.measured_covariance(best(make_cube(simulator="none")))
