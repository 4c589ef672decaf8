"""J_NC against the paper's formula written out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from mcstudy.analysis.neural import j_nc, j_nc_within
from mcstudy.analysis.selection import best
from mcstudy.fitting.status import Status
from mcstudy.stance.body import one_segment, two_segment

Cube = Callable[..., xr.Dataset]


def written_out(theta: dict[str, float], truth: dict[str, float], f: np.ndarray) -> float:
    """Goodworth & Peterka 2018, Methods: the four transfer functions and their relative mean squared error."""
    s = 2j * np.pi * f

    def four(p: dict[str, float]) -> np.ndarray:
        e1, e2 = np.exp(-p["Td1"] * s), np.exp(-p["Td2"] * s)
        return np.array(
            [
                (p["K12"] + p["B12"] * s) * e2,
                (p["K22"] + p["B22"] * s) * e2 + p["Kpas2"],
                (p["K11"] + p["B11"] * s) * e1 + p["Kpas1"],
                (p["K21"] + p["B21"] * s) * e1,
            ]
        )

    true = four(truth)
    return float((np.abs((true - four(theta)) / np.abs(true)) ** 2).sum() / (4 * f.size))


def test_j_nc_of_every_start_is_the_papers_formula(make_cube: Cube) -> None:
    cube = make_cube(realizations=2, starts=2)
    out, within = j_nc(cube, two_segment()), j_nc_within(cube, two_segment())
    assert out.dims == within.dims == ("amplitude", "fmax", "realization", "start")
    names, f = [str(n) for n in cube["parameter"].values], cube["frequency"].values
    truth = dict(zip(names, cube["truth"].values, strict=True))
    for index in np.ndindex(out.shape):
        theta = dict(zip(names, cube["estimate"].values[index], strict=True))
        n = int(cube["n_frequencies"][index[1]])
        np.testing.assert_allclose(out.values[index], written_out(theta, truth, f), rtol=1e-10)
        np.testing.assert_allclose(within.values[index], written_out(theta, truth, f[:n]), rtol=1e-10)


def test_the_truth_has_no_error_and_a_missing_fit_has_no_number(make_cube: Cube) -> None:
    cube = make_cube(realizations=2, spread=0.0, hit_rate=1.0)
    cube["status"][0, 0, 0] = Status.PENDING
    out = j_nc(best(cube), two_segment())
    assert np.isnan(out.values[0, 0, 0])
    assert (out.stack(cell=out.dims)[1:] == 0).all()


def test_a_single_segment_has_one_controller(make_cube: Cube) -> None:
    cube = make_cube(realizations=1, starts=1, spread=0.0, model={"kind": "one_segment"})
    cube["estimate"] = cube["estimate"] * xr.where(cube["parameter"] == "Td", 1.0, 1.1)
    np.testing.assert_allclose(j_nc(cube, one_segment()), 0.01, rtol=1e-9)


def test_many_fits_are_evaluated_in_blocks_with_the_same_result(
    make_cube: Cube, monkeypatch: pytest.MonkeyPatch
) -> None:
    cube = make_cube(starts=7)
    whole = j_nc(cube, two_segment())
    monkeypatch.setattr("mcstudy.analysis.neural._BLOCK", 5)
    np.testing.assert_array_equal(j_nc(cube, two_segment()), whole)
