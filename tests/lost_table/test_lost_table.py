"""The inference of the lost table: rows, emulator, posterior, and the command at a small size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mcstudy.analysis.paper.values import cells_of, fit_values
from mcstudy.errors import DesignError
from mcstudy.lost_table.bank import Bank, prior_points, simulated
from mcstudy.lost_table.design import parse_inference, read_inference
from mcstudy.lost_table.emulator import Emulator, packed, ridge, unpacked
from mcstudy.lost_table.posterior import Likelihood, sample
from mcstudy.lost_table.rows import KEYS, ROWS, columns, folded, rounding, shown, stated
from mcstudy.lost_table.simulate import Moments, damped, reduced, simulate, study_of, sway_rms
from mcstudy.lost_table.unknowns import Prior
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.stance.body import two_segment
from mcstudy.streams import stream

FILE = """
[inference]
name = "tiny"
seed = 3
realizations = 5
prior_studies = 12
waves = [4]
papers = 2
particles = 50
"""

ONE = ClusterOptions(workers=1)


def estimates(rng: np.random.Generator, spread: float = 0.2) -> np.ndarray:
    model = two_segment()
    return model.truth * (1 + spread * rng.standard_normal((3, 2, 50, len(model.truth))))


def test_the_rows_are_those_of_the_comparison_with_the_paper() -> None:
    model, x = two_segment(), estimates(np.random.default_rng(1))
    f = np.array([0.1, 0.3, 1.0, 2.0, 4.0, 8.0])
    ours = shown(columns(reduced(model, x, sway_rms(model, 1.0), f), np.array(0.0)))
    theirs = fit_values(cells_of(np.swapaxes(x, 0, 1), model.truth, model.names))
    compared = [key for key in KEYS if key in theirs and key != "low_cv"]
    assert len(compared) >= 25
    for key in compared:
        assert ours[KEYS.index(key)] == pytest.approx(theirs[key].value, rel=1e-9, abs=1e-9), key
    low = 100 * (0.2 / theirs["low_cv"].value - 1)
    assert ours[KEYS.index("low_cv")] == pytest.approx(low, rel=1e-9)


def test_printed_numbers_survive_the_change_of_scale() -> None:
    printed = np.array([row.value for row in ROWS])
    np.testing.assert_allclose(shown(stated()), printed, atol=1e-12)
    assert all((rounding()[k] > 0) == (row.half > 0) for k, row in enumerate(ROWS))


def test_an_expected_absolute_value_is_that_of_many_draws() -> None:
    draws = np.abs(0.3 + 0.5 * np.random.default_rng(2).standard_normal(400_000))
    assert folded(np.array(0.3), np.array(0.5)) == pytest.approx(
        draws.mean(), abs=4 * draws.std() / np.sqrt(draws.size)
    )


def test_points_of_the_prior_are_damped_and_prefixes_of_longer_draws() -> None:
    prior = Prior()
    few, many = (prior_points(prior, stream(1, "table_prior"), n) for n in (5, 40))
    np.testing.assert_array_equal(few, many[:5])
    assert damped(prior.values(many)).all()
    values = dict(zip(prior.names, prior.values(many)[0], strict=True))
    again = prior.values(prior.positions(values))
    np.testing.assert_allclose(again, prior.values(many)[0], rtol=1e-12)


def test_a_leave_one_out_prediction_is_that_of_a_regression_without_the_study() -> None:
    rng = np.random.default_rng(3)
    x = np.column_stack([np.ones(30), rng.standard_normal((30, 3))])
    y = x @ np.array([[1.0], [2.0], [-1.0], [0.5]]) + 0.1 * rng.standard_normal((30, 1))
    _, left_out = ridge(x, y)
    rest = np.arange(30) != 7
    plain = np.linalg.lstsq(x[rest], y[rest], rcond=None)[0]
    assert left_out[7, 0] == pytest.approx((x[7] @ plain).item(), abs=2e-3)


def test_packing_moments_loses_nothing() -> None:
    m = reduced(two_segment(), estimates(np.random.default_rng(4)), np.ones((2, 2)), np.array([0.1, 1.0, 5.0]))
    again = unpacked(packed(m))
    for name in ("bias", "spread", "sway", "influence"):
        np.testing.assert_allclose(getattr(again, name), getattr(m, name), rtol=1e-12)


def invented(prior: Prior, u: np.ndarray, rng: np.random.Generator) -> Bank:
    """Studies whose moments follow the configuration by a rule: no simulation, so that many are cheap."""
    x = prior.features(u)
    lead = (len(u), 3, 2, 14)
    spread = 0.15 * np.exp(0.5 * x[:, :14].reshape(len(u), 1, 1, 14) + 0.3 * x[:, 12].reshape(-1, 1, 1, 1))
    spread = np.broadcast_to(spread, lead) * np.exp(0.05 * rng.standard_normal(lead))
    bias = 0.05 * np.broadcast_to(x[:, 1:15].reshape(len(u), 1, 1, 14), lead) + 0.01 * rng.standard_normal(lead)
    sway = 0.1 * np.exp(2.0 * x[:, 12])[:, None, None] * np.ones((1, 2, 2))
    influence = np.exp(x[:, :12])
    return Bank(u, Moments(bias, spread, sway, influence))


def test_a_known_table_is_inferred_better_than_its_prior_from_invented_studies() -> None:
    prior = Prior()
    rng = np.random.default_rng(5)
    bank = invented(prior, rng.random((500, len(prior))), rng)
    truth = prior_points(prior, rng, 3)
    papers = invented(prior, truth, rng)
    over = prior.values(truth)[:, prior.names.index("sway_over")]
    emulator = Emulator.of(prior, bank, 50)
    start = prior_points(prior, rng, 60)
    noise, error, before = prior.names.index("noise"), [], []
    for k, observed in enumerate(columns(papers.moments, over)):
        found = sample(Likelihood.of(emulator, observed), rng, 60, start=start).u
        error.append(np.abs(found[:, noise].mean() - truth[k, noise]))
        before.append(np.abs(start[:, noise].mean() - truth[k, noise]))
    assert np.mean(error) < 0.5 * np.mean(before)


def test_a_likelihood_without_rows_of_a_kind_is_flat_in_them() -> None:
    prior, rng = Prior(), np.random.default_rng(6)
    emulator = Emulator.of(prior, invented(prior, rng.random((300, len(prior))), rng), 50)
    others = tuple(k for k in KEYS if k not in ("sway_1", "sway_2"))
    likelihood = Likelihood.of(emulator, stated(), leave_out=others)
    rows = np.tile(emulator.rows(rng.random((1, len(prior)))), (2, 1))
    rows[1, KEYS.index("bias_12_8")] += 5.0
    values = likelihood.at(rows)
    assert values[0] == values[1]


def test_a_simulated_study_is_the_study_that_its_file_describes() -> None:
    prior = Prior()
    values = prior.values(prior_points(prior, stream(2, "table_prior"), 1)[0])
    values[-1] = 0.0
    study = study_of(values, 11, 4)
    first, second = (simulate(values, 11, 4) for _ in range(2))
    np.testing.assert_array_equal(first.spread, second.spread)
    assert study.groups["accuracy"].model.truth["K11"] == values[0]
    assert first.bias.shape == (3, 2, 14)


def test_a_damaged_file_of_the_bank_is_simulated_again_with_the_same_bits(tmp_path: Path) -> None:
    prior = Prior()
    u = prior_points(prior, stream(2, "table_prior"), 2)
    first = simulated(prior, u, (2, 0, 3), tmp_path / "bank", ONE)
    file = next((tmp_path / "bank").glob("*.npz"))
    file.write_bytes(file.read_bytes()[:-40])
    again = simulated(prior, u, (2, 0, 3), tmp_path / "bank", ONE)
    np.testing.assert_array_equal(first.moments.bias, again.moments.bias)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"seed": -1}, "inference.seed: "),
        ({"prior_studies": 0}, "inference.prior_studies: "),
        ({"strange": 1}, "inference.strange: "),
    ],
)
def test_a_mistake_in_the_file_gives_one_line_with_the_field(change: dict[str, int], line: str) -> None:
    plain = {"name": "x", "seed": 1, "prior_studies": 3, **change}
    with pytest.raises(DesignError) as caught:
        parse_inference({"inference": plain})
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("prior", "line"),
    [
        ({"K99": [1.0, 2.0]}, "prior.K99: unknown"),
        ({"K11": [5.0, 2.0]}, "prior.K11: expected 0 < lowest < highest"),
        ({"Td1": [0.01, 0.1]}, "prior.Td1: expected delays above 0.031 s"),
    ],
)
def test_a_mistake_in_the_prior_gives_one_line_with_the_field(prior: dict[str, list[float]], line: str) -> None:
    with pytest.raises(DesignError) as caught:
        parse_inference({"inference": {"name": "x", "seed": 1, "prior_studies": 3}, "prior": prior})
    assert str(caught.value).startswith(line)


def test_the_shipped_file_is_found_by_name() -> None:
    assert read_inference("table_one").inference.name == "table_one"
