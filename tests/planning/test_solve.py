"""From targets to the cheapest design: the language, the local model, the search, its files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.files import schema
from mcstudy.planning.arm import Candidate
from mcstudy.planning.local_model import LocalModel, Prediction
from mcstudy.planning.multilevel import MEASURES, Draws, Estimate, estimated
from mcstudy.planning.space import space_of
from mcstudy.planning.targets import parse_targets
from mcstudy.report.solution_page import solution_page, solution_picture
from mcstudy.stance.body import two_segment

STUDY = mc.Study("small", seed=2).group(
    "a",
    realizations=20,
    starts=5,
    fmax=[1.2],
    amplitude=[5.0],
    stimulus={"stages": 6, "cycles": 12, "rate_hz": 50.0},  # records a fifth as long as the paper's
    spectra={"points": "odd_lines"},
)


@pytest.fixture(scope="module")
def found() -> Any:
    return mc.solve(STUDY, "cv(K11 + Kpas1) <= 4%", over="amplitude=2:12", workers=1)


def test_the_answer_reaches_the_target_in_fits_that_the_search_did_not_make(found: Any, tmp_path: Path) -> None:
    """The study of the answer with other noise, run as any study and judged by the analysis."""
    study = found.to_study()
    fields = study.groups["a"].model_dump(mode="json") | {"realizations": 150}
    again = mc.Study("again", seed=77).group("a", **fields)
    cells = mc.run(again, tmp_path / "again.zarr", workers=1)["a"].mc.best().mc.combined()
    cv = cells.mc.cv().sel(parameter="K11+Kpas1")
    value, mcse = 100 * cv["value"].item(), 100 * cv["mcse"].item()
    reading = found.readings[0]
    assert abs(value - reading.value) < 3.5 * np.hypot(mcse, (reading.high - reading.low) / 3.92)
    assert reading.low < 4.0 < reading.high * 1.01
    low, high = found.interval["amplitude"]
    assert low <= found.design["amplitude"] <= high * 1.01
    assert high / low < 1.25  # twice the half-width that was asked


def test_the_interval_is_that_of_the_looks(found: Any) -> None:
    """By hand, from the last look alone and the slope of linear theory: no wider than that, and around the same."""
    look = found.looks[-1]
    by_hand = look.design.amplitude * look.found[0].value
    assert found.design["amplitude"] == pytest.approx(by_hand, rel=3 * look.found[0].error + 0.03)


def test_everything_found_is_written(found: Any) -> None:
    schema.validate("solution", found.to_dict(), "solution")
    assert found.table["value"].shape == (len(found.looks), 1)
    assert "95 % interval of the amplitude" in found.text()
    assert "amplitude" in repr(found)
    assert not found.flat
    words = replace(found, flat=True).text().replace("\n", " ")
    assert "cv(K11 + Kpas1) changes less than the amplitude there: it is known to ±" in words
    (panel,) = solution_picture(found).axes
    (fitted,) = [line for line in panel.lines if line.get_label() == "fitted"]
    assert len(fitted.get_xdata()) == len(found.looks)
    assert "cv(K11 + Kpas1)" in panel.get_ylabel()
    page = solution_page(found)
    assert 'id="curve"' in page
    assert all(f"{look.design.amplitude:.4g}" in page for look in found.looks)
    assert "target at most 4.00 %" in page


def test_the_command_prints_and_writes_what_python_returns(found: Any, tmp_path: Path, capsys: Any) -> None:
    file, out = tmp_path / "small.toml", tmp_path / "answer.toml"
    file.write_text(STUDY.to_toml(), encoding="utf-8")
    words = ["solve", str(file), "--target", "cv(K11 + Kpas1) <= 4%", "--over", "amplitude=2:12", "--json"]
    assert main([*words, "-o", str(out), "--workers", "2", "--figure", str(tmp_path / "a.svg")]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads(json.dumps(found.to_dict()))  # whatever the number of threads
    assert mc.read_study(out).groups["a"].amplitude == (found.design["amplitude"],)
    assert mc.read_study(out).groups["a"].starts == 5


def test_a_target_out_of_reach_is_said_to_be_with_the_bound() -> None:
    found = mc.solve(STUDY, "sd(Kpas1) <= 1%", over="amplitude=4:6", workers=1)
    assert found.design is None
    assert found.interval == {}
    assert 4 <= found.nearest.amplitude <= 6
    assert "is not reached by any allowed design" in found.text().replace("\n", " ")
    assert found.readings[0].bound < found.readings[0].linear
    assert not found.to_dict()["reached"]
    with pytest.raises(InputError, match="no allowed design"):
        found.to_study()


@pytest.mark.parametrize(
    ("state", "code"),
    [
        ({}, Exit.DONE),
        ({"answer": None}, Exit.UNREACHABLE),
        ({"decided": False}, Exit.NOT_REACHED),
        ({"answer": None, "decided": False}, Exit.NOT_REACHED),
    ],
)
def test_a_script_can_tell_an_answer_from_none_and_from_an_uncertain_one(
    found: Any, state: dict[str, Any], code: Exit, tmp_path: Path, monkeypatch: Any, capsys: Any
) -> None:
    """Nothing is written for a design that does not reach the target."""
    monkeypatch.setattr("mcstudy.planning.solve.solve_study", lambda *_, **__: replace(found, **state))
    monkeypatch.setattr("mcstudy.scheduler.compiling.compile_kernels", lambda _: None)
    file, out = tmp_path / "small.toml", tmp_path / "answer.toml"
    file.write_text(STUDY.to_toml(), encoding="utf-8")
    words = ["solve", str(file), "--target", "cv(K11 + Kpas1) <= 4%", "--over", "amplitude=2:12", "-o", str(out)]
    assert main(words) == code
    assert out.exists() == ("answer" not in state)
    assert ("not written" in capsys.readouterr().err) == ("answer" in state)


def test_realizations_follow_from_their_monte_carlo_error(tmp_path: Path) -> None:
    found = mc.solve(STUDY, "mcse(bias(K12)) <= 0.5%", over="realizations", workers=1)
    number = found.design["realizations"]
    fields = STUDY.groups["a"].model_dump(mode="json") | {"realizations": number}
    cells = mc.run(mc.Study("n", seed=9).group("a", **fields), tmp_path / "n.zarr", workers=1)["a"]
    mcse = 100 * cells.mc.bias()["mcse"].sel(parameter="K12").item() / cells["truth"].sel(parameter="K12").item()
    assert mcse == pytest.approx(0.5, rel=0.25)
    low, high = found.interval["realizations"]
    assert low < number < high


def test_a_range_that_is_too_small_names_the_end_that_binds() -> None:
    found = mc.solve(STUDY, "mcse(bias(K12)) <= 0.01%", over="realizations=10:20", workers=1)
    words = found.text().replace("\n", " ")
    assert found.design is None
    assert f"What binds is the largest number of realizations, 20: {found.realizations} are needed." in words
    assert found.realizations > 1000


def test_an_easy_target_is_met_by_the_smallest_design() -> None:
    found = mc.solve(STUDY, "cv(K11 + Kpas1) <= 50%", over=["cycles=3:8"], workers=1)
    assert found.design["cycles"] == 3
    assert "The smallest allowed value of cycles is enough" in found.text().replace("\n", " ")


@pytest.mark.parametrize(
    ("targets", "words"),
    [
        ([], "target: expected at least one"),
        (["cv(Td1)"], "target 'cv(Td1)': expected MEASURE(QUANTITY) <= VALUE"),
        (["cv(Td9) <= 10%"], "target 'cv(Td9) <= 10%': quantity 'Td9': expected names among K11"),
        (["cv(Td1) <= 10"], "target 'cv(Td1) <= 10': expected a value in %, got no unit"),
        (["sd(K11) <= 10 s"], "target 'sd(K11) <= 10 s': expected a value in % or N m/rad, got s"),
        (["sd(K11) <= ten %"], "target 'sd(K11) <= ten %': expected a number"),
        (["sd(K11) <= -1%"], "target 'sd(K11) <= -1%': expected a value above 0"),
        (["mad(K11) <= 1%"], "target 'mad(K11) <= 1%': expected one of cv, sd, bias, rmse"),
        (["cv(Td1) <= 10%", "cv(Td1) <= 5%"], "target 'cv(Td1) <= 5%': contradicts or repeats 'cv(Td1) <= 10%'"),
        (["mcse(cv(Td1) <= 1%"], "target 'mcse(cv(Td1) <= 1%': expected mcse(MEASURE(QUANTITY))"),
        ([None], "target None: expected text, such as 'cv(Td1) <= 10%'"),
        ([f"cv({'+'.join(['K11'] * 3000)}) <= 1%"], f"target 'cv({'+'.join(['K11'] * 14)}+…': quantity"),
    ],
)
def test_a_mistake_in_a_target_is_one_line(targets: list[str], words: str) -> None:
    with pytest.raises(InputError) as error:
        parse_targets(two_segment(), targets)
    assert str(error.value).startswith(words)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 250


@pytest.mark.parametrize(
    ("over", "more", "words"),
    [
        (["kind"], {}, "over: expected axes among cycles, amplitude, fmax, realizations, got 'kind' (not numeric)"),
        (["cycles=1:5"], {}, "over: cycles: expected more than the 1 discarded"),
        (["cycles=5:2"], {}, "over: cycles: expected whole numbers above 0 with LOW < HIGH"),
        (["cycles=2"], {}, "over: cycles: expected LOW:HIGH"),
        (["cycles", "cycles"], {}, "over: expected every axis once"),
        (["fmax"], {}, "over: fmax: the study has one"),
        (["fmax=a/b"], {}, "over: fmax: expected frequencies in Hz"),
        (["fmax=0.08/1.2"], {}, "group.a: with the ranges of --over: "),
        (["realizations"], {}, "over: realizations: varying them requires a target of the form mcse(...)"),
        (["cycles"], {"cost": "time + x"}, "cost 'time + x': expected names among time, cycles"),
        (
            ["cycles"],
            {"cost": "log(0 * time)"},
            "cost 'log(0 * time)': expected a finite number for every",
        ),
        (["cycles"], {"group": "b"}, "group: expected one of a, got 'b'"),
        (["cycles"], {"precision": 2.0}, "precision: expected a fraction"),
        (["cycles"], {"cost": "9**9**9**9*time"}, "cost '9**9**9**9*time': expected a finite number"),
        (["cycles"], {"cost": "+".join(["time"] * 3000)}, "cost 'time+time"),
        (["cycles"], {"budget_fits": 3}, "budget: expected at least 1664 fits"),
    ],
)
def test_a_mistake_in_the_axes_is_one_line(over: list[str], more: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as error:
        mc.solve(STUDY, "cv(Td1) <= 10%", over, workers=1, **more)
    assert str(error.value).startswith(words)


@pytest.mark.parametrize(
    ("cost", "cycles", "amplitude"),
    [
        ("-time", 6, 4.0),
        ("amplitude - cycles", 6, 4.0),
        ("1 / time", 6, 4.0),
        ("cycles - amplitude", 3, 6.0),
        ("-cycles - amplitude", 6, 6.0),
        ("(amplitude - 5) ** 2 + (cycles - 4) ** 2", 4, 5.0),
        ("1e-14 * time - 1e-15 * amplitude", 3, 6.0),
    ],
)
def test_a_cost_may_fall_along_an_axis(cost: str, cycles: int, amplitude: float) -> None:
    """Every allowed design reaches this target, so the cost alone decides."""
    found = mc.solve(STUDY, "cv(K11 + Kpas1) <= 30%", "cycles=3:6,amplitude=4:6", cost=cost, workers=1)
    assert found.decided
    assert (found.design["cycles"], found.design["amplitude"]) == (
        cycles,
        pytest.approx(amplitude, rel=3e-3),
    )  # three digits
    assert found.design["amplitude"] <= 6.0
    assert found.interval["cycles"] == (cycles, cycles)


@pytest.mark.parametrize(
    ("target", "over", "needed"),
    [
        ("cv(Td1) <= 10%", "cycles=2:12", 9 * 128 + 64 * (5 + 3)),
        ("cv(Td1) <= 10%", "cycles=2:12,fmax=0.8/1.2/2", 3 * (9 * 128 + 64 * (5 + 3))),
        ("mcse(bias(B11)) <= 1%", "realizations", 128 + 128 * (5 + 3)),
    ],
)
def test_a_budget_is_never_exceeded_and_one_that_cannot_suffice_is_refused(target, over, needed) -> None:
    """The prediction counts."""
    with pytest.raises(InputError, match=f"budget: expected at least {needed} fits.* got {needed - 1}"):
        mc.solve(STUDY, target, over, workers=1, budget_fits=needed - 1)
    for budget in (needed, needed + 700):
        found = mc.solve(STUDY, target, over, workers=1, budget_fits=budget, precision=0.001)
        assert found.spent.fits <= budget


def test_a_search_of_the_design_leaves_the_fits_that_the_number_of_realizations_needs() -> None:
    targets = ["cv(Td1) <= 30%", "mcse(bias(B11)) <= 1%"]
    found = mc.solve(STUDY, targets, "cycles=2:12,realizations", workers=1, budget_fits=4000, precision=0.001)
    assert found.spent.fits <= 4000
    assert found.answer is not None
    assert found.answer.crossings[-1].axis == "realizations"


def test_values_of_the_bias_may_have_either_sign() -> None:
    (target,) = parse_targets(two_segment(), ["bias(K11 / K22) <= 3%"])
    x = two_segment().truth * np.array([[0.9] * 12, [1.0] * 12])
    np.testing.assert_allclose(target.of(x), [1057 / 201] * 2)
    assert target.unit == "%"


def test_a_formula_makes_another_design_the_cheapest() -> None:
    group = STUDY.groups["a"]
    plain = space_of(group, 43.72, ["cycles=2:9", "amplitude=1:9"])
    other = space_of(group, 43.72, ["cycles=2:9", "amplitude=1:9"], "time * amplitude ** 2")
    cycles, amplitude = plain.grid()
    enough = plain.signal(cycles, amplitude) > 5
    first = {s.formula: next(k for k in s.order(cycles, amplitude, 1.2) if enough[k]) for s in (plain, other)}
    assert cycles[first[None]] == 2
    best = (cycles * 43.72 * amplitude**2)[enough].min()
    k = first["time * amplitude ** 2"]
    assert cycles[k] * 43.72 * amplitude[k] ** 2 == pytest.approx(best)


def test_intervals_of_the_local_model_hold_the_crossing() -> None:
    """Noisy values of a curved function whose crossing is known, with shared and with own random numbers."""
    rng = np.random.default_rng(6)
    u = np.log(np.array([3.0, 4.5, 5.5]))
    inside = 0
    for shared in (True, False) * 100:
        exact = -0.8 * (u - np.log(5.0)) + 0.05 * (u - np.log(5.0)) ** 2
        z = rng.normal(0, 1, (1 if shared else 3, 100)) / 10 * np.ones((3, 1))
        found = []
        for value, noise in zip(exact, z, strict=True):
            ratio = np.exp(value + 0.3 * noise.sum() / 10)
            found.append(Estimate(ratio, np.full(100, 0.3 / 100 * ratio) * np.sign(noise), np.empty(0)))
        # the size of a contribution is known here; its sign ties designs that share their noise
        prediction = Prediction(np.log([1.0, 10.0]), np.log(np.array([5.0, 0.5])), np.zeros((2, 0)), np.zeros(2))
        model = LocalModel(prediction, False, np.stack([u, np.zeros(3)], 1), found, [6, 6, 6] if shared else [1, 2, 3])
        band = model.at(np.array([[np.log(5.0), 0.0]]))
        inside += bool(band.low[0] <= 0 <= band.high[0])
    assert 180 <= inside <= 200  # 95 % of 200 is 190, with a standard deviation of 3


def test_a_candidate_without_excess_is_reached() -> None:
    assert Candidate(3, 5.0, 100.0, 0.0).reached
    assert not Candidate(3, 5.0, 100.0, 0.1).reached


def test_estimates_change_their_unit_with_their_error() -> None:
    e = estimated(Draws(np.arange(1.0, 20.0), 9.0), MEASURES["sd"])
    assert e.times(3.0).error == pytest.approx(3 * e.error)
