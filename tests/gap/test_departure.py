"""A named effect may leave a small smooth remainder: its evidence falls gently, and its energy is known by samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mcstudy.effect_library import library
from mcstudy.fitting.penalised import Fitted, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.free_deviations import free_torques
from mcstudy.gap.candidates.remainder import Remainder
from mcstudy.gap.candidates.scores import Projection
from mcstudy.gap.questions.departure import departed, left_energies, remainder, with_departures
from mcstudy.gap.questions.evidence import Hypothesis, single
from mcstudy.lines.base_fit import drawn_starts
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf

OPEN = opened(two_segment())

ENERGIES = np.array([4.0, 100.0])


@pytest.fixture(scope="module")
def exact(plain_lines: list[Lines]) -> tuple[Data, Fitted]:
    """Lines without noise, and the fit that is their truth."""
    data = Data.of(plain_lines[0])
    data = data.with_y(frf(OPEN, OPEN.truth, data.f))
    return data, Fitter(OPEN, weak_prior(OPEN, OPEN), data.f).best(data, OPEN.truth[None])


def _with_residual(data: Data, r: np.ndarray) -> Data:
    """The lines with a whitened residual (4 N,) added."""
    z = r.reshape(2, -1, 2)
    return data.with_y(data.y + np.einsum("nij,nj->ni", np.linalg.inv(data.weight), z[0] + 1j * z[1]))


def test_bayes_factors_of_noise_average_to_one_and_samples_hold_drawn_energies(exact: tuple[Data, Fitted]) -> None:
    data, fitted = exact
    rng = np.random.default_rng(3)
    families, project = free_torques(fitted, data), Projection.of(fitted, data)
    noise, ranks, drawn = [], [], []
    for _ in range(120):
        e = rng.standard_normal(4 * data.f.size)
        noise.append(Remainder(fitted, _with_residual(data, e), np.array([4.0])).log_factor)
        own, size = families[rng.integers(len(families))], rng.choice(ENERGIES)
        gram = own.columns.T @ project(own.columns)
        c = rng.standard_normal(len(gram)) * np.sqrt(size / np.trace(gram))
        drawn.append(c @ gram @ c / size)
        beside = Remainder(fitted, _with_residual(data, own.columns @ c + e), ENERGIES)
        ranks.append((beside.samples(rng, 400) < c @ gram @ c).mean())
    assert np.mean(drawn) == pytest.approx(1.0, abs=0.3)
    assert np.exp(noise).mean() == pytest.approx(1.0, abs=0.3)
    # true energies fall anywhere among the samples, each tenth as often
    assert abs(np.mean(ranks) - 0.5) < 3.5 * np.sqrt(1 / 12 / 120)
    assert np.std(ranks) == pytest.approx(np.sqrt(1 / 12), rel=0.2)


@pytest.mark.parametrize("share", [0.0, 0.15])
def test_evidence_pays_little_for_a_remainder_and_gains_where_there_is_one(
    plain_lines: list[Lines], share: float
) -> None:
    lines = plain_lines[0]
    body, s = library.apply(OPEN, "sensor_lag_both"), 2j * np.pi * lines.f
    change = frf(body, np.append(OPEN.truth, 0.02), lines.f) - frf(OPEN, OPEN.truth, lines.f)
    wave = share * change * np.exp(1j * np.log(np.abs(s)) * 1.5)[:, None]
    data = Data.of(replace(lines, y=lines.y + change + wave))
    base = Fitter(OPEN, weak_prior(OPEN, OPEN), data.f).best(data, drawn_starts(OPEN, 0, 16))
    h = single(base, np.array([base.theta]), data, "sensor_lag_both", [], base.residual(data))
    gain = departed(base, data, h).log_evidence - h.log_evidence
    left = left_energies(base, h.fitted, data, np.random.default_rng(4), 1000)
    if share == 0.0:
        assert -np.log(2) < gain < 0.0
        assert (left == 0.0).mean() > 0.8
    else:
        assert gain > 5.0
        assert (left > 0.0).all()


def test_only_effects_near_the_best_that_explain_something_have_a_remainder(exact: tuple[Data, Fitted]) -> None:
    data, fitted = exact
    assert remainder(fitted, fitted, data) is None
    none, far = Hypothesis(("head_mode",), -1.0, fitted), Hypothesis(("loose_head",), -100.0, fitted)
    assert with_departures(fitted, data, [none, far]) == [none, far]
