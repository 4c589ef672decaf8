"""Points of group FRFs: what a model says of them, and the covariance of people."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from mcstudy.errors import InputError
from mcstudy.recordings.frf_group import group_dataset
from mcstudy.recordings.sheets.frf_group_sheet import TableSheet
from mcstudy.spectra.frf_groups import as_complex, as_real, model_points, model_points_jacobian, scatter
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.response import frf
from mcstudy.stance.stimulus import Prts

POINTS = ((1,), (2,), (3, 4), (4, 5, 6))


def empty_group(stimulus: str = "surface_tilt") -> xr.Dataset:
    sheet = TableSheet(file="", gain="*", phase="*", period_s=20.0, points=POINTS, prts_state_s=0.25)
    f_line, average = sheet.lines()
    frf = np.zeros((1, 1, 2, len(POINTS)), dtype=complex)
    return group_dataset(frf, ["ann"], [()], [], f_line, average, stimulus, Body())


def test_a_model_is_averaged_as_spectra_are_summed() -> None:
    """Against the ratio of summed cross spectrum and summed power of the stimulus waveform itself."""
    model = two_segment(stimulus="surface_tilt")
    group = empty_group()
    U = np.fft.rfft(Prts(stages=4, state_s=0.25, rate_hz=2000.0).waveform())
    harmonic = 2 * np.arange(1, 7) - 1
    U, H = U[harmonic], frf(model, model.truth, harmonic / 20.0)
    upper = H.sum(axis=1)
    for n, point in enumerate(POINTS):
        at = np.array(point) - 1
        cross, power = (upper[at] * np.abs(U[at]) ** 2).sum(), (np.abs(U[at]) ** 2).sum()
        assert abs(model_points(model, model.truth, group)[1, n] / (cross / power) - 1) < 1e-4


def test_the_derivatives_at_points_are_those_of_differences() -> None:
    model, group = two_segment(stimulus="surface_tilt"), empty_group()
    H, J = model_points_jacobian(model, model.truth, group)
    np.testing.assert_allclose(H, model_points(model, model.truth, group))
    step = 1e-6 * np.diag(model.truth)
    up, down = model_points(model, model.truth + step, group), model_points(model, model.truth - step, group)
    np.testing.assert_allclose(J, (up - down) / (2e-6 * model.truth[:, None, None]), rtol=1e-6, atol=1e-9)


def test_real_numbers_and_complex_ones_are_the_same() -> None:
    H = np.random.default_rng(1).normal(size=(3, 2, 5, 2)) @ [1, 1j]
    np.testing.assert_array_equal(as_complex(as_real(H)), H)


def test_a_shrunk_covariance_is_nearer_to_the_true_one_than_the_sample_and_the_diagonal() -> None:
    rng, d = np.random.default_rng(2), 30
    true = 0.7 ** np.abs(np.subtract.outer(np.arange(d), np.arange(d)))
    errors = []
    for _ in range(20):
        x = rng.multivariate_normal(np.zeros(d), true, size=15)
        found, sample = scatter(x).covariance, np.cov(x.T)
        assert np.linalg.eigvalsh(found).min() > 0
        np.testing.assert_allclose(np.diag(found), np.diag(sample))
        errors.append([np.linalg.norm(c - true) for c in (found, sample, np.diag(np.diag(sample)))])
    ours, of_sample, of_diagonal = np.mean(errors, axis=0)
    assert ours < 0.9 * of_sample
    assert ours < 0.9 * of_diagonal


def test_means_of_several_groups_do_not_count_as_scatter() -> None:
    x = np.random.default_rng(3).normal(size=(20, 6))
    both = scatter(x[:10], x[10:] + 100.0)
    np.testing.assert_allclose(both.covariance, scatter(x[:10], x[10:]).covariance, rtol=1e-6)
    assert both.dof == 18


def test_too_few_people_are_refused() -> None:
    with pytest.raises(InputError, match="expected at least 4"):
        scatter(np.eye(3))
