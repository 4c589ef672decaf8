"""Estimates under published conventions: each cost is what its source states, and finds the truth without noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.errors import InputError
from mcstudy.identification.conventions import BANDS, CONVENTIONS, Points, estimates
from mcstudy.recordings.columns import model_of
from mcstudy.spectra.measure import measure
from mcstudy.stance.response import frf

F = 0.05 * np.arange(1, 50, 2)


def response(noise: float, seed: int = 0) -> mc.FrfRecording:
    model = model_of("sensorimotor_integration")
    assert model is not None
    y = frf(model, model.truth, F)
    error = np.array([1, 1j]) @ np.random.default_rng(seed).standard_normal((2, F.size))
    C = (0.05 * np.abs(y)) ** 2
    return mc.FrfRecording(F, y + noise * np.abs(y) * error[:, None], C[:, :, None].astype(complex), model=model)


def test_the_costs_are_those_of_their_sources() -> None:
    H, Y = np.array([[2.0 + 0j], [1j]]), np.array([[1.0 + 0j], [2j]])
    cost = {name: c.cost(H, Y) for name, c in CONVENTIONS.items()}
    assert cost["peterka2002"] == pytest.approx(1.0 + 0.25)  # squares, over the data
    assert cost["peterka2018"] == pytest.approx(0.5 + 1.0)  # absolute values, over the model
    scales = np.linspace(0.3, 2.0, 20001)
    likelihood = sum(
        np.log(2 * scales * abs(h)) + abs(h - y) / (scales * abs(h)) for h, y in zip(H[:, 0], Y[:, 0], strict=True)
    )
    assert cost["asslaender2023"] == pytest.approx(likelihood.min(), rel=1e-6)


@pytest.mark.parametrize("name", ["peterka2002", "peterka2018"])
def test_without_noise_a_convention_finds_the_truth(name: str) -> None:
    fit = mc.fit(response(0.0))
    np.testing.assert_allclose(estimates(fit, name), fit.model.truth, rtol=1e-3)


def test_points_of_a_cycle_of_20_s_are_the_twelve_overlapping_bands() -> None:
    recording = mc.simulate(
        model="sensorimotor_integration", cycles=3, rate_hz=50, amplitude=0.02, noise=0.3, measurement_sd=0.02, seed=1
    )
    lines = measure(recording, 2.5)
    period = float(np.median(lines.harmonic / lines.f))
    assert Points.of(lines).weight.shape == (len(lines), len(lines))  # of 43.72 s: lines as they are
    as_if = Points.of(replace(lines, f=lines.f * period / 20))
    assert len(as_if.weight) == len(BANDS[20.0])
    np.testing.assert_allclose(as_if.weight.sum(axis=1), 1.0)
    assert np.flatnonzero(as_if.weight[6]).tolist() == [4, 5, 6]  # odd lines 5 to 7
    np.testing.assert_allclose(as_if.weight[6] @ (lines.harmonic / 20.0), np.mean([9, 11, 13]) / 20.0)


def test_the_table_has_a_column_for_each_and_several_conditions_are_refused() -> None:
    noisy = response(0.04)
    table = mc.fit(noisy).conventions()
    assert list(table.header[2:]) == ["maximum likelihood", *(c.title for c in CONVENTIONS.values())]
    assert [row[0] for row in table.rows] == ["Kp", "Kd", "tau", "Kt", "Wp", "Kp/mgh", "Kd/mgh"]
    both = mc.fit_conditions([replace(noisy, name="a"), replace(response(0.04, 1), name="b")])
    with pytest.raises(InputError, match="convention: expected a fit of one recording"):
        both.fit.conventions()
    with pytest.raises(InputError, match="convention: expected one of peterka2002, peterka2018"):
        estimates(both.fit, "other")
