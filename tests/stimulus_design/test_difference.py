"""The criterion that tells two models apart: its distances, against fits of noisy responses, and its optimum."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.effect_library import library
from mcstudy.errors import DesignError
from mcstudy.files import schema
from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.lines.priors import weak_prior
from mcstudy.report.design_page import design_page
from mcstudy.spectra.periods import ramp_removed
from mcstudy.stance.simulate_time import simulate, with_derivatives
from mcstudy.stimulus_design.difference import difference
from mcstudy.stimulus_design.spectrum import whitener

SHOW: dict[str, Any] = {
    "design": {"name": "show", "seed": 3, "phase_starts": 1, "criterion": "difference", "effects": ["integral_ankle"]},
    "limits": {"bodies_within": 0.0},
    "prior": {"bodies": 1},
    "stimulus": {"stages": 6},
    "verify": {"bodies": 1},
}
LAG = "sensor_lag_theta2"
RECORDINGS = 10


def asking(*effects: str, **more: Any) -> dict[str, Any]:
    return {**SHOW, "design": {**SHOW["design"], "effects": list(effects), **more}}


@pytest.fixture(scope="module")
def shown() -> Any:
    return mc.design(SHOW)


@pytest.fixture(scope="module")
def told_apart() -> Any:
    return mc.design(asking("passive_damping_ankle", "force_feedback"))


def test_the_distance_is_the_noncentrality_of_fits_to_noisy_responses(shown: Any) -> None:
    """The mean fall of chi-squared by the effect is its one parameter and the squared distance (Wilks, Wald)."""
    d = shown.designed.difference
    power = shown.designed.after
    weight = d.whitener * np.sqrt(power)[:, None, None]
    rng = np.random.default_rng(7)
    with_effect = library.apply(d.base, *d.effects)
    fitters = [Fitter(m, weak_prior(m, d.base), d.f) for m in (d.base, with_effect)]
    start = np.array([*d.base.truth, d.sizes[0]["Ki1"]])
    falls = []
    for _ in range(60):
        noise = rng.standard_normal((d.f.size, 2)) + 1j * rng.standard_normal((d.f.size, 2))
        y = d.responses[0] + np.einsum("nij,nj->ni", np.linalg.inv(weight), noise)
        without, best = (
            fitter.best(Data(d.f, y, weight), x).chi2 for fitter, x in zip(fitters, (d.base.truth, start), strict=True)
        )
        falls.append(without - best)
    expected = 1 + shown.distances[1, 0] ** 2
    assert np.mean(falls) == pytest.approx(expected, abs=4 * np.std(falls) / np.sqrt(60))
    assert np.std(falls) / np.sqrt(60) < 0.1 * expected


def test_simulated_recordings_of_the_designed_stimulus_show_the_effect_as_predicted(shown: Any) -> None:
    """In the time domain, with noise inside the loop: nothing of the prediction enters but the covariance of errors."""
    d, file = shown.designed.difference, shown.designed.file
    with_effect = library.apply(d.base, *d.effects)
    theta = np.array([*d.base.truth, d.sizes[0]["Ki1"]])
    stimulus = shown.designed.stimulus
    cycle, rate = with_derivatives(stimulus.waveform(), stimulus.rate_hz), stimulus.rate_hz
    record = np.tile(cycle, (file.cycles, 1))
    used = shown.designed.after > 0
    f, weight = d.f[used], d.whitener[used] * np.sqrt(shown.designed.after[used])[:, None, None]
    lines = np.rint(f * len(cycle) / rate).astype(int)
    drive = stimulus.coefficients()[lines]
    fitters = [Fitter(m, weak_prior(m, d.base), f) for m in (d.base, with_effect)]
    falls = []
    for seed in range(RECORDINGS):
        noise = file.noise.of(("theta1", "theta2")).sample(np.random.default_rng(seed), len(record), rate)
        sway = simulate(with_effect, theta, record, rate, noise=noise).theta
        y = ramp_removed(sway, len(cycle), file.stimulus.discard)[lines] / drive[:, None]
        without, best = (
            fitter.best(Data(f, y, weight), x).chi2 for fitter, x in zip(fitters, (d.base.truth, theta), strict=True)
        )
        falls.append(without - best)
    expected = 1 + d.distances(shown.designed.after)[0] ** 2
    assert np.mean(falls) == pytest.approx(expected, abs=4 * np.std(falls) / np.sqrt(RECORDINGS))
    assert np.std(falls) / np.sqrt(RECORDINGS) < 0.15 * expected


def test_a_design_shows_an_effect_better_than_the_sequence_and_better_than_one_for_the_parameters(shown: Any) -> None:
    plain = mc.design({**SHOW, "design": {**SHOW["design"], "criterion": "D", "effects": []}})
    sequence, best = shown.distances[:, 0]
    assert best > 1.02 * sequence
    assert best > 1.02 * shown.designed.difference.distances(plain.designed.after)[0]


def test_the_first_order_distance_is_exact_at_its_reference(shown: Any) -> None:
    file, model, f = shown.designed.file, shown.designed.model, shown.designed.f
    power = shown.designed.after
    d = difference(model, ("force_feedback",), f, power, whitener(file, model, f))
    M = np.tensordot(power, d.information, axes=1)
    assert 1 / np.sqrt(np.linalg.inv(M)[-1, -1]) == pytest.approx(d.distances(power)[0], rel=0.05)


def test_two_effects_are_told_from_each_other(told_apart: Any) -> None:
    d = told_apart.designed
    assert (told_apart.distances[1] > told_apart.distances[0]).all()
    alone = difference(d.model, d.difference.effects[:1], d.f, d.before, d.difference.whitener)
    assert told_apart.distances[0, 0] < alone.distances(d.before)[0]  # the other effect explains a part
    assert "optimal to tell passive_damping_ankle from force_feedback" in told_apart.text().replace("\n", " ")
    page = design_page(told_apart)
    assert 'id="difference"' in page
    assert all(f"x{ratio:.3g}" in page for ratio in told_apart.distances[1] / told_apart.distances[0])


def test_the_file_holds_the_distances_and_their_sizes(told_apart: Any) -> None:
    value = told_apart.to_dict()
    schema.validate("stimulus_design", value, "design.json")
    assert [d["effect"] for d in value["differences"]] == ["passive_damping_ankle", "force_feedback"]
    np.testing.assert_array_equal([d["design"] for d in value["differences"]], told_apart.distances[1])
    assert mc.design({**SHOW, "design": {"name": "plain", "seed": 1, "phase_starts": 1}}).to_dict()["differences"] == []


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"effects": []}, "design.effects: expected one or two effects for criterion 'difference', got 0"),
        ({"effects": ["lag"]}, "design.effects: expected linear effects (passive_damping_ankle"),
        ({"effects": ["dead_zone"]}, "design.effects: expected linear effects (passive_damping_ankle"),
        ({"effects": [LAG, LAG]}, "design.effects: expected effects of different causes"),
        ({"effects": [LAG], "criterion": "D"}, "design.effects: expected none for criterion 'D'"),
        (
            {"effects": ["joint_stretch_frame"]},
            "design.effects: under ankle torque, joint_stretch_frame is compensated",
        ),
        ({"effects": ["stimulus_lag", "sensor_lag_both"]}, "design.effects: under ankle torque, stimulus_lag and"),
    ],
)
def test_effects_that_cannot_be_shown_are_refused_in_one_line(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(DesignError) as error:
        mc.design({**SHOW, "design": {**SHOW["design"], **fields}})
    assert str(error.value).startswith(words)
    assert "\n" not in str(error.value)


def test_an_effect_of_the_hip_is_refused_for_a_body_without_hip() -> None:
    with pytest.raises(DesignError, match=r"^design\.effects: passive_damping_hip: "):
        mc.design({**asking("passive_damping_hip"), "model": {"kind": "one_segment"}})
    found = mc.design({**asking("integral_ankle"), "model": {"kind": "one_segment"}})
    assert found.distances[1, 0] > found.distances[0, 0]
