"""Which effect: signatures, groups, evidence, and the posterior on bodies whose cause is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mcstudy.effect_library import library
from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.fitting.penalised import Fitted, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.scores import WRONG_SIGN
from mcstudy.gap.candidates.signatures import WANTED, alike_groups, applicable, signatures, similarity
from mcstudy.gap.diagnose import diagnose, diagnose_lines
from mcstudy.gap.questions.evidence import log_prior, single
from mcstudy.gap.settings import FAST, Asked, DiagnosisSettings
from mcstudy.lines.base_fit import drawn_starts
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.stimulus import Prts

BASE = two_segment()
OPEN = opened(BASE)


@pytest.fixture(scope="module")
def fitted(plain_lines: list[Lines]) -> tuple[Fitted, Data]:
    data = Data.of(plain_lines[0])
    return Fitter(OPEN, weak_prior(OPEN, OPEN), data.f).best(data, drawn_starts(OPEN, 0, 8)), data


def test_signatures_are_what_refitting_leaves(fitted: tuple[Fitted, Data]) -> None:
    base, data = fitted
    found = signatures(base, data, applicable(OPEN))
    J = base.jacobian(data)
    for s in found:
        assert s.delta < 8 * WANTED
        if s.delta > 1:
            # at right angles to the parameters, up to the pull of the prior and curvature
            cosine = J.T @ s.vector / np.linalg.norm(J, axis=0) / s.delta
            assert np.abs(cosine).max() < 0.2, s.effect
    delta = {s.effect: s.delta for s in found}
    for name in ("passive_damping_ankle", "sensor_lag_both", "stimulus_gain", "integral_ankle"):
        assert delta[name] == pytest.approx(WANTED, rel=0.25)


def test_exact_ambiguities_are_one_group(fitted: tuple[Fitted, Data]) -> None:
    """One stimulus: a lag of both sensors is a lag of the stimulus; both are nearly a delay."""
    base, data = fitted
    found = signatures(base, data, applicable(OPEN))
    names, cosine = similarity([s.effect for s in found], np.array([s.vector / s.delta for s in found]))
    at = names.index
    assert cosine[at("sensor_lag_both"), at("stimulus_lag")] > 0.999
    assert cosine[at("stimulus_delay"), at("stimulus_lag")] > 0.95
    assert cosine[at("passive_damping_ankle"), at("sensor_lag_theta2")] < 0.9
    joined = next(g for g in alike_groups(names, cosine) if "stimulus_lag" in g)
    assert {"sensor_lag_both", "stimulus_lag", "stimulus_delay"} <= set(joined)
    assert sorted(n for g in alike_groups(names, cosine) for n in g) == sorted(names)


@pytest.mark.parametrize("name", ["passive_damping_hip", "trunk_inertia_error", "stimulus_gain", "activation_dynamics"])
def test_prior_of_a_size_integrates_to_one(name: str) -> None:
    size = library.effect(name).size
    span = 12 * max(size.published[1], 0.1)
    a = np.linspace(-span, span + 1, 400001)
    p = np.exp(log_prior(size, a, 0.3 * size.published[1]))
    assert np.trapezoid(p, a) == pytest.approx(1.0, abs=2e-3)
    if not size.signed:
        assert np.trapezoid(p[a < 0], a[a < 0]) == pytest.approx(WRONG_SIGN, rel=0.1)


def test_size_comes_back_with_its_error(with_effects: Callable[..., Lines]) -> None:
    z = []
    for k in range(6):
        data = Data.of(with_effects(k, {"passive_damping_ankle": {"Bpas1": 60.0}}))
        base = Fitter(OPEN, weak_prior(OPEN, OPEN), data.f).best(data, drawn_starts(OPEN, 0, 8))
        effect = library.effect("passive_damping_ankle")
        found = single(base, base.theta[None], data, effect.name, signatures(base, data, [effect]), base.residual(data))
        size = found.sizes[0]
        assert size.low < size.estimate < size.high
        assert size.se < 15
        z.append((size.estimate - 60.0) / size.se)
    assert np.abs(z).max() < 3.5


@pytest.mark.parametrize(
    ("effects", "group"),
    [
        ({"sensor_lag_theta1": {"tau_theta1": 0.02}}, "sensor_lag_theta1"),
        ({"passive_damping_ankle": {"Bpas1": 60.0}}, "passive_damping_ankle"),
        ({"head_mode": {"m_head": 5.0, "f_head": 2.0}}, "head_mode"),
        ({"trunk_inertia_error": {"eps_trunk": -0.2}}, "trunk_inertia_error"),
    ],
)
def test_the_true_group_is_named(
    with_effects: Callable[..., Lines], effects: dict[str, dict[str, float]], group: str
) -> None:
    out = diagnose_lines(with_effects(1, effects), BASE, FAST)
    assert out.detected
    first = out.causes[0]
    assert len(first.effects) == 1
    assert group in first.alternatives[0]
    assert first.probability > 0.6
    assert 0 in out.credible_set
    assert out.none_probability < 0.01


def test_nothing_missing_is_the_most_probable_when_nothing_is(plain_lines: list[Lines]) -> None:
    out = [diagnose_lines(x, BASE, FAST) for x in plain_lines[:4]]
    best = [x.none_probability > max(x.unknown_probability, x.causes[0].probability) for x in out]
    assert sum(best) >= 3
    for x in out:
        total = x.none_probability + x.unknown_probability + sum(c.probability for c in x.causes)
        assert total == pytest.approx(1.0)
        assert sum(x.place.values()) + x.place_abstained == pytest.approx(1.0)


def test_a_cause_that_no_effect_imitates_is_called_unknown(plain_lines: list[Lines]) -> None:
    """The hip sensor rings at 3 Hz: the library has no such thing."""
    from dataclasses import replace

    from mcstudy.stance.response import frf

    lines = plain_lines[2]
    s = 2j * np.pi * lines.f
    w = 2 * np.pi * 3.0
    ring = np.stack([np.ones_like(s), 1 - 0.15 * s**2 / (s**2 + 0.3 * w * s + w**2)], axis=1)
    change = frf(BASE, BASE.truth, lines.f) * (ring - 1)
    out = diagnose_lines(replace(lines, y=lines.y + change, repeats=lines.repeats + change), BASE, FAST)
    assert out.detected
    assert out.unknown_probability > 0.5
    assert "unknown" in out.credible_set


def test_the_energy_that_a_threshold_scatters_between_lines_is_no_cause_outside_the_library() -> None:
    """Before, seven of seven dead zones were called a cause outside the library with certainty."""
    protocol = Protocol(waveform=Prts(rate_hz=100.0), amplitudes=(3.0, 5.0))
    small = {"effects": ["dead_zone"], "sizes": {"dead_angle": 0.0005}}
    d = diagnose(
        simulate_recording(protocol, BASE.truth, np.random.default_rng(2), **small),
        DiagnosisSettings(fast=True, asked=Asked(False, False)),
    )
    assert d.detection.chi2 > 1.3 * d.detection.chi2_noise[1]
    assert d.causes[0].effects == ("dead_zone",)
    assert d.causes[0].probability > 0.5
    # but another nonlinearity may do the same
    assert 0.1 < d.unknown_probability < 0.5


def test_only_effects_that_are_nonlinear_within_a_trial_scatter_energy() -> None:
    assert [e.name for e in library.LIBRARY.values() if e.scatters] == ["dead_zone", "torque_saturation"]
