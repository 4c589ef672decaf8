"""Whether there is a gap: the null distributions hold, and an effect that shows is found where it acts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from dask.callbacks import Callback

from mcstudy.effect_library import library
from mcstudy.fitting.penalised import Fitter, whiten
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.scores import Scores, log_factor
from mcstudy.gap.candidates.signatures import applicable, signatures
from mcstudy.gap.questions import detection
from mcstudy.gap.questions.detection import Detection, detect, linear_null, refitted_null
from mcstudy.lines.base_fit import drawn_starts
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf

BASE = two_segment()
OPEN = opened(BASE)


def test_draws_have_the_level_and_the_heavy_tails_of_measured_errors(plain_lines: list[Lines]) -> None:
    """Whitened with their own estimated covariance, errors are wider than a chi-squared says."""
    lines = plain_lines[0]
    draws = lines.noise.draw(np.random.default_rng(0), 2000)
    assert draws.shape == (4 * len(lines), 2000)
    assert (draws**2).mean() == pytest.approx(1.0, abs=0.02)
    total = (draws**2).sum(axis=0)
    assert total.std() > 1.15 * np.sqrt(2 * 4 * len(lines))
    errors = np.array([whiten(x.noise.whitener, x.y - frf(BASE, BASE.truth, x.f)) for x in plain_lines])
    assert (errors**2).mean() == pytest.approx(1.0, abs=0.06)


def test_linearised_and_refitted_nulls_agree(plain_lines: list[Lines]) -> None:
    data = Data.of(plain_lines[0])
    fitter = Fitter(OPEN, weak_prior(OPEN, OPEN), data.f)
    fitted = fitter.best(data, drawn_starts(OPEN, 0, 8))
    noise = plain_lines[0].noise.draw(np.random.default_rng(1), 40)
    linear, refitted = linear_null(fitted, data, noise), refitted_null(fitted, fitter, data, noise)
    ratio = (refitted**2).sum(axis=0) / (linear**2).sum(axis=0)
    assert np.abs(ratio - 1).max() < 0.02


def test_refits_are_dask_tasks_and_their_bits_do_not_depend_on_the_task(
    plain_lines: list[Lines], monkeypatch: pytest.MonkeyPatch
) -> None:
    data = Data.of(plain_lines[0])
    fitter = Fitter(OPEN, weak_prior(OPEN, OPEN), data.f)
    fitted = fitter.best(data, drawn_starts(OPEN, 0, 8))
    noise = plain_lines[0].noise.draw(np.random.default_rng(1), 20)
    ran: list[str] = []
    found = []
    for size, tasks in ((20, 1), (7, 3)):
        monkeypatch.setattr(detection, "REFITS_A_TASK", size)
        ran.clear()
        with Callback(posttask=lambda key, *_: ran.append(key)):
            found.append(refitted_null(fitted, fitter, data, noise))
        assert len(ran) == tasks
    assert (found[0] == found[1]).all()


def test_score_of_no_deviation_is_evidence_against_one() -> None:
    z = np.linspace(-6, 6, 25)
    both, right = log_factor(z, 6.0, False), log_factor(z, 6.0, True)
    assert both[12] < -1.5
    np.testing.assert_allclose(both, both[::-1])
    assert (right[z < -1] < both[z < -1]).all()
    assert (right[z > 1] > both[z > 1]).all()
    # the prior integrates to one: the mean Bayes factor under the null is 1
    x = np.linspace(-9, 9, 4001)
    density = np.exp(-0.5 * x**2) / np.sqrt(2 * np.pi)
    for one_sided in (True, False):
        assert np.trapezoid(density * np.exp(log_factor(x, 1.5, one_sided)), x) == pytest.approx(1.0, abs=2e-3)


def _detect(lines: Lines, refits: bool = False, draws: int = 200) -> Detection:
    data = Data.of(lines)
    fitter = Fitter(OPEN, weak_prior(OPEN, OPEN), data.f)
    base = fitter.best(data, drawn_starts(OPEN, 0, 8))
    found = signatures(base, data, [library.effect("head_mode"), library.effect("sensor_lag_both")])
    scores = Scores(base, data, found, [library.effect(s.effect).size.signed for s in found])
    return detect(base, fitter, data, lines, scores, np.random.default_rng(2), draws, refits)


def test_nothing_missing_raises_no_alarm(plain_lines: list[Lines]) -> None:
    p = np.array([_detect(x).p_value for x in plain_lines[:8]])
    assert (p > 0.05).sum() >= 6
    assert p.max() > 0.3


def test_a_gap_stands_out_in_bands_and_noise_does_not(
    plain_lines: list[Lines], with_effects: Callable[..., Lines]
) -> None:
    """Where it stands out is where refitting could not hide it, not where the effect acts."""
    out = _detect(with_effects(0, {"head_mode": {"m_head": 2.0, "f_head": 2.5}}), refits=True)
    assert out.p_value == pytest.approx(1 / 201)
    assert any(b.beyond for b in out.bands)
    noise = [any(b.beyond for b in _detect(x).bands) for x in plain_lines[:8]]
    assert sum(noise) <= 2
    assert out.z.shape == (175, 2)


def test_a_delta_of_four_is_usually_found(plain_lines: list[Lines], with_effects: Callable[..., Lines]) -> None:
    """V alone would find it once in ten."""
    data = Data.of(plain_lines[0])
    base = Fitter(OPEN, weak_prior(OPEN, OPEN), data.f).best(data, OPEN.truth[None])
    (signature,) = signatures(base, data, [library.effect("sensor_lag_both")])
    size = signature.sizes["tau_sensors"] * 4 / signature.delta
    found = [_detect(with_effects(k, {"sensor_lag_both": {"tau_sensors": size}})).p_value < 0.05 for k in range(8)]
    assert sum(found) >= 5


def test_effects_that_do_not_fit_the_model_are_left_out() -> None:
    from mcstudy.stance.body import one_segment

    names = {e.name for e in applicable(opened(one_segment()))}
    assert "activation_dynamics" in names
    assert "passive_damping_hip" not in names


def test_refits_that_go_far_do_not_widen_the_null(plain_lines: list[Lines]) -> None:
    """Few lines leave the parameters open: refits move along curved valleys, and must not look like gaps for it."""
    lines = plain_lines[0].below(0.6)
    data = Data.of(lines)
    fitter = Fitter(OPEN, weak_prior(OPEN, OPEN), data.f)
    base = fitter.best(data, drawn_starts(OPEN, 0, 8))
    noise = 3 * lines.noise.draw(np.random.default_rng(3), 200)
    scores = Scores(base, data, [], [])
    linear = scores(linear_null(base, data, noise), linear=True).gap
    far = refitted_null(base, fitter, data, noise)
    assert np.quantile(scores(far, linear=True).gap, 0.95) < np.quantile(linear, 0.95) + 2
    assert np.quantile(scores(far).gap, 0.95) > np.quantile(linear, 0.95) + 5
