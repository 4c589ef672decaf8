"""The inference of the lost table: rows, emulator, posterior, and the command at a small size."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from mcstudy_goodworth2018.lost_table import (
    bank,
    calibration,
    checks,
    closed_form,
    contradictions,
    kept_files,
    posterior,
    result,
    run,
    search,
)
from mcstudy_goodworth2018.lost_table.bank import Bank, prior_points, simulated
from mcstudy_goodworth2018.lost_table.design import parse_inference, read_inference
from mcstudy_goodworth2018.lost_table.emulator import Emulator, packed, ridge, unpacked
from mcstudy_goodworth2018.lost_table.posterior import Likelihood, sample
from mcstudy_goodworth2018.lost_table.result import RESULT, opened
from mcstudy_goodworth2018.lost_table.rows import KEYS, ROWS, columns, folded, rounding, shown, stated
from mcstudy_goodworth2018.lost_table.simulate import Moments, damped, reduced, simulate, study_of, sway_rms
from mcstudy_goodworth2018.lost_table.unknowns import Prior
from mcstudy_goodworth2018.paper.values import cells_of, fit_values

from mcstudy import program
from mcstudy.cli import main
from mcstudy.errors import DesignError
from mcstudy.exits import Exit
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.truths import TRUTHS
from mcstudy.streams import stream
from mcstudy.study.group import Group
from mcstudy.study.models import build_model

FILE = """
[inference]
name = "tiny"
seed = 3
realizations = 5
prior_studies = 12
waves = [4]
search = [2]
aimed = 1
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


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """As few studies and particles as show the way from file to tables."""
    for module, name, value in (
        (bank, "DRAWS", 256),
        (checks, "CANDIDATES", 2),
        (checks, "LOOKED_AT", 4),
        (checks, "TRIALS", 2),
        (checks, "REPEATS", 3),
        (search, "PROPOSALS", 200),
        (search, "LOOKED_AT", 4),
        (calibration, "POWERS", (0.5, 1.0)),
        (calibration, "THOROUGH", 1),
        (run, "POWERS", (0.5, 1.0)),
        (run, "THOROUGH", 1),
        (result, "POWERS", (0.5, 1.0)),
        (result, "THOROUGH", 1),
        (result, "NOT_REPRODUCED", 1e-12),
        (checks, "LIMIT", 20.0),  # so that few rows are missed, each of which costs studies
        (posterior, "LAST", 1),
        (posterior, "MOVES", 2),
    ):
        monkeypatch.setattr(module, name, value)


@pytest.mark.usefixtures("few")
def test_a_killed_inference_resumes_with_the_same_bits_and_prints_its_tables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "tiny.toml"
    file.write_text(FILE)
    killed, undisturbed = tmp_path / "killed", tmp_path / "undisturbed"
    command = [sys.executable, "-m", "mcstudy", "infer", str(file), "-o", str(killed), "--workers", "1"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while process.poll() is None and not list(killed.glob("bank/*.npz")):
            time.sleep(0.05)
        process.kill()
    assert len(list(killed.glob("bank/*.npz"))) < 4  # the bank and its wave have four files
    assert not (killed / RESULT).exists()
    for out in (killed, undisturbed):
        figure = ["--figure", str(out / "m.svg"), "--trade-offs", str(out / "t.svg")]
        assert main(["infer", str(file), "-o", str(out), "--workers", "1", *figure]) == Exit.DONE
    xr.testing.assert_identical(opened(killed), opened(undisturbed))
    for name in ("m.svg", "t.svg"):
        assert (killed / name).read_bytes() == (undisturbed / name).read_bytes()
        assert "An inference about a lost table" in (killed / name).read_text()
    assert (killed / "t.svg").read_text().count(">others missed</text>") == opened(killed).sizes["missed"] > 0
    printed = capsys.readouterr().out
    for part in ("an inference about a lost table", "Unknowns", "Choices", "Printed numbers", "Calibration"):
        assert part in printed
    file.write_text(FILE.replace("seed = 3", "seed = 4"))
    assert main(["infer", str(file), "-o", str(killed)]) == Exit.BAD_INPUT
    assert "made from another inference file" in capsys.readouterr().err
    # Another program goes on with nothing of this one, and says whose result it prints.
    file.write_text(FILE)
    monkeypatch.setattr(program, "source", lambda *_: "0" * 64)
    assert main(["infer", str(file), "-o", str(killed)]) == Exit.DONE
    assert "Note: made by another program: source" in " ".join(capsys.readouterr().out.split())
    shutil.rmtree(killed / RESULT)
    assert main(["infer", str(file), "-o", str(killed)]) == Exit.BAD_INPUT
    assert "made by another program: source" in capsys.readouterr().err


def test_kept_arrays_of_another_program_are_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def made(value: float) -> float:
        jobs, options = [0], ClusterOptions(workers=1)
        kind = kept_files.Kind(tmp_path / "kept", ("x",))
        where = {"u": np.zeros(2)}
        (arrays,) = kept_files.kept(
            kind, jobs, lambda _: "a.npz", lambda _: where, lambda _: {"x": np.array(value)}, options
        )
        return float(arrays["x"])

    assert [made(1.0), made(2.0)] == [1.0, 1.0]
    monkeypatch.setattr(program, "source", lambda *_: "0" * 64)
    assert made(2.0) == 2.0


def test_a_trade_off_is_what_cannot_be_improved_in_both() -> None:
    x, y = np.array([1.0, 2.0, 3.0, 2.5, 0.5]), np.array([3.0, 2.0, 1.0, 2.5, 9.0])
    points = {tuple(p) for p in contradictions.front(x, y)}
    assert points == {(0.5, 9.0), (1.0, 3.0), (2.0, 2.0), (3.0, 1.0)}


def test_two_numbers_that_no_study_meets_together_are_found_to_contradict_and_others_are_not() -> None:
    rng, error = np.random.default_rng(8), np.full(len(ROWS), 0.1)
    first, second = KEYS.index("bias_12_0.41"), KEYS.index("spread_fmax_10")
    rows = np.where([row.kind == "above" for row in ROWS], 1.0, stated()) + 0.02 * rng.standard_normal((80, len(ROWS)))
    rows[:, first] = stated()[first] + np.linspace(-2, 2, 80)
    rows[:, second] = stated()[second] + 1.5 - np.abs(np.linspace(-2, 2, 80))  # met only where the first is missed
    pairs, many = contradictions.trade_offs(rows, error, ["bias_12_0.41"])
    both = pairs[0].max(axis=-1).min(axis=-1)
    assert both[second] > 3
    assert np.nanmax(np.delete(both, second)) < 1
    assert many[0][many[0][:, 0] <= 3][:, 1].min() == 1
    assert many[0][:, 1].min() == 0


def test_the_power_chosen_is_the_largest_whose_intervals_cover() -> None:
    rng = np.random.default_rng(9)
    rank = 0.02 + 0.96 * rng.random((200, len(calibration.POWERS), 17))  # a little too wide
    narrow = rank[:, 2:]
    rank[:, 2:] = np.where(narrow < 0.5, narrow**2, 1 - (1 - narrow) ** 2)  # too often at the ends
    unused = np.zeros_like(rank)
    found = calibration.Calibration(rank, unused, unused, unused[:, 0])
    assert found.chosen == 1
    assert found.covered[2, :, 1].mean() == pytest.approx(0.95, abs=0.05)
    assert found.covered[2, :, 2].mean() < 0.9


def test_the_power_that_checks_a_paper_is_chosen_by_the_others() -> None:
    rank = np.full((2, len(calibration.POWERS), 17), 0.5)
    rank[0, 1:] = 0.0  # the first paper alone finds all powers but the smallest too narrow
    unused = np.zeros_like(rank)
    found = calibration.Calibration(rank, unused, unused, unused[:, 0])
    assert found.chosen_by_others.tolist() == [len(calibration.POWERS) - 1, 0]


def test_a_search_that_aims_at_a_number_proposes_what_the_emulator_expects_to_meet_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(search, "PROPOSALS", 600)
    monkeypatch.setattr(search, "LOOKED_AT", 4)
    prior, rng = Prior(), np.random.default_rng(10)
    bank = invented(prior, prior_points(prior, rng, 300), rng)
    emulator, aim = Emulator.of(prior, bank, 50), KEYS.index("sway_1")
    error = np.full(len(ROWS), 0.05)
    proposed = search.promising(prior, bank, emulator, error, np.random.default_rng(1), 4, aim)
    assert damped(prior.values(proposed)).all()
    assert np.abs(emulator.rows(proposed)[:, aim] - stated()[aim]).max() < 0.1
    assert np.median(np.abs(emulator.rows(bank.u)[:, aim] - stated()[aim])) > 0.5


def test_rows_without_noise_that_a_configuration_misses_are_those_of_show() -> None:
    prior = Prior()
    stand_in = prior.values(checks.stand_in_point(prior))
    # README: delays at high frequencies (two readings) and sway of both angles (one of them in both readings) differ
    assert closed_form.misses(stand_in[None]).tolist() == [5]


def test_a_study_file_names_a_set_of_true_values_and_its_origin_is_shown() -> None:
    def model(truth: object) -> Model:
        plain = {"realizations": 1, "starts": 1, "fmax": [1.2], "amplitude": [5.0], "model": {"truth": truth}}
        return build_model(Group(**plain))

    for name, truth in TRUTHS.items():
        named = model(name)
        assert {p.name: p.value for p in named.parameters} == dict(truth.values)
        assert named.provenance == truth.provenance
    changed = model({**TRUTHS["stand_in"].values, "K11": 1000.0})
    assert changed.provenance.endswith("replaced by the study file: K11")
    with pytest.raises(DesignError, match="truth: expected a table, or one of stand_in"):
        model("strange")
