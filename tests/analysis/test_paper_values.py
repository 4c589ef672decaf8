"""Values of the paper's rows: against plain numpy, and in blocks of the paper's size."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from mcstudy_goodworth2018.paper import accuracy_rows, model_rows, published
from mcstudy_goodworth2018.paper.values import cells_of, fit_values, relation_values

from mcstudy.analysis.publications import sampling
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.simulate_spectral import NoiseSway

MODEL = two_segment()
TRUTH = MODEL.truth
NAMES = list(MODEL.names)


def estimates(realizations: int, seed: int = 3, shift: float = 0.1) -> np.ndarray:
    """Invented best fits (A, F, R, P): each parameter has its own bias and spread."""
    rng = np.random.default_rng(seed)
    spread = np.linspace(0.05, 0.6, len(NAMES))
    noise = rng.standard_normal((2, 3, realizations, len(NAMES)))
    return np.asarray(TRUTH * (1 + shift * np.linspace(-1, 1, len(NAMES)) + spread * noise))


def values(x: np.ndarray, **more: np.ndarray) -> dict[str, float]:
    """Values of all rows that these fits have."""
    cells = cells_of(x, TRUTH, NAMES, frequency=np.geomspace(0.023, 8.0, 28), **more)
    return {key: v.value for key, v in fit_values(cells, MODEL).items()}


def test_rows_equal_plain_sums_over_arrays() -> None:
    x = estimates(50)
    growth = np.random.default_rng(1).standard_normal((2, 3, 50))
    found = values(x, growth_rate=growth)
    bias = 100 * abs(x.mean(2) / TRUTH - 1)
    sd, cv = 100 * x.std(2, ddof=1) / TRUTH, x.std(2, ddof=1) / x.mean(2)
    assert found["bias_12_0.41"] == pytest.approx(bias[:, 0].mean())
    assert found["bias_amplitude"] == pytest.approx(bias[0].mean() - bias[1].mean())
    assert found["spread_fmax"] == pytest.approx(100 * (1 - sd[:, 1].mean() / sd[:, 0].mean()))
    assert found["spread_amplitude_8"] == pytest.approx(100 * (1 - sd[1, 2].mean() / sd[0, 2].mean()))
    assert found["spread_amplitude_cv_8"] == pytest.approx(100 * (1 - cv[1, 2].mean() / cv[0, 2].mean()))
    sums = {n: NAMES.index(n) for n in ("K11", "Kpas1", "K22", "Kpas2")}
    first, second = (x[..., sums[a]] + x[..., sums[b]] for a, b in published.REDUNDANT)
    true = [TRUTH[sums[a]] + TRUTH[sums[b]] for a, b in published.REDUNDANT]
    of_sums = [100 * abs(s[:, 1].mean(-1) / t - 1) for s, t in zip((first, second), true, strict=True)]
    assert found["bias_2_1.2"] == pytest.approx(np.mean(of_sums))
    others = [bias[:, 1, i] for i, n in enumerate(NAMES) if n not in sums]
    assert found["bias_10_1.2"] == pytest.approx(np.mean([*of_sums, *others]))
    assert found["bias_below_5_12_1.2"] == pytest.approx(100 * (bias[:, 1].mean(0) < 5).mean())
    assert found["unstable_8"] == pytest.approx(100 * (growth[:, 2] > 0).mean())
    r = [np.corrcoef(x[a, f, :, sums["K11"]], x[a, f, :, sums["Kpas1"]])[0, 1] for a in range(2) for f in range(3)]
    assert found["together_1"] == pytest.approx(np.mean(r))


def test_a_larger_study_is_the_mean_over_blocks_of_the_papers_size() -> None:
    x = estimates(170)
    whole = fit_values(cells_of(x, TRUTH, NAMES))
    parts = [fit_values(cells_of(x[:, :, i : i + 50], TRUTH, NAMES)) for i in (0, 50, 100)]
    for key, found in whole.items():
        one = [p[key] for p in parts]
        assert found.value == pytest.approx(np.mean([p.value for p in one])), key
        assert (found.n, found.blocks) == (150, 3)
        assert found.study_error == pytest.approx(np.sqrt(np.mean([p.study_error**2 for p in one]))), key
        assert found.mcse == pytest.approx(found.study_error / np.sqrt(3))


@pytest.mark.parametrize("at_once", [1, 3])
def test_blocks_in_slabs_give_what_all_blocks_together_give(at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    x = estimates(230, seed=5)
    x[0, 1, ::17] = np.nan
    whole = fit_values(cells_of(x, TRUTH, NAMES))
    monkeypatch.setattr(sampling, "BLOCKS_AT_ONCE", at_once)
    assert [s.stop for s in sampling.slabs(230, 50)] == {1: [50, 100, 150, 230], 3: [150, 230]}[at_once]
    again = fit_values(cells_of(x, TRUTH, NAMES))
    assert list(again) == list(whole)
    for key, value in whole.items():
        assert (again[key].n, again[key].blocks, again[key].detail) == (value.n, 4, value.detail)
        found = [(v.value, v.mcse, v.study_error) for v in (again[key], value)]
        np.testing.assert_allclose(*found, rtol=1e-11)


def test_the_error_of_one_study_is_the_scatter_between_equal_studies() -> None:
    keys = (
        "bias_12_1.2",
        "spread_fmax",
        "spread_amplitude_8",
        "combined_cv_ratio",
        "together_1",
        "bias_below_5_12_1.2",
    )
    studies = [fit_values(cells_of(estimates(50, seed=s), TRUTH, NAMES)) for s in range(60)]
    for key in keys:
        scatter = np.std([s[key].value for s in studies], ddof=1)
        stated = np.sqrt(np.mean([s[key].study_error ** 2 for s in studies]))
        assert 0.7 < stated / scatter < 1.5, key  # sampling error of a standard deviation from 60: 9 %


def test_fewer_realizations_than_the_papers_say_so_and_their_error_is_scaled() -> None:
    found = fit_values(cells_of(estimates(10), TRUTH, NAMES))["spread_fmax"]
    assert (found.n, found.blocks) == (10, 1)
    assert found.study_error == pytest.approx(found.mcse / np.sqrt(5))


def test_rows_that_need_more_than_the_arrays_hold_are_absent() -> None:
    found = fit_values(cells_of(estimates(50)[:, 1:2], TRUTH, NAMES, fmax=[1.2]))
    assert {"bias_12_1.2", "lowest_cv"} <= found.keys()
    assert not found.keys() & {"bias_12_8", "spread_fmax", "unstable_8", "influence_cv"}


def test_a_relation_that_weakens_is_positive() -> None:
    r = xr.DataArray(
        np.broadcast_to(np.array([[0.9, 0.9, 0.5], [1.0, 1.0, 0.8]])[..., None], (2, 3, 50)),
        dims=("amplitude", "fmax", "realization"),
        coords={"amplitude": [3.0, 5.0], "fmax": [0.41, 1.2, 8.0]},
    )
    found = relation_values(r)
    assert found["relation_noise_starts"].value == pytest.approx(0.2)
    assert found["relation_8hz_starts"].value == pytest.approx(0.3)


def test_expected_sway_is_that_of_simulated_records() -> None:
    noise, rng = SensorNoise(), np.random.default_rng(5)
    source = NoiseSway(MODEL, TRUTH, noise, 6 * 8744, 200.0)
    records = np.degrees(np.stack([source.sample(rng) for _ in range(60)]))
    whole, scatter, window = model_rows.sway_rms(MODEL, TRUTH, noise, 262.32, 6, 200.0)
    ms = (records**2).mean(1)
    assert np.allclose(np.sqrt(ms.mean(0)), whole, rtol=0.08)
    assert np.allclose(np.sqrt(ms).std(0, ddof=1), scatter, rtol=0.35)
    windows = records.reshape(60, 6, 8744, 2)
    assert np.allclose(np.sqrt(windows.var(2).mean((0, 1))), window, rtol=0.08)


def test_a_ranking_by_its_worst_member() -> None:
    x, names = np.array([3.0, 2.0, 1.0, 0.5]), "abcd"
    assert accuracy_rows.lead(x, list(names), ("a", "b"), largest=True) == pytest.approx(100.0)
    assert accuracy_rows.lead(x, list(names), ("a", "c"), largest=True) == pytest.approx(-50.0)
    assert accuracy_rows.lead(x, list(names), ("d",), largest=False) == pytest.approx(100.0)
