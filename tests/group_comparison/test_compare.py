"""Comparison of two groups: the cause is named, the share closed is right, and what is written is valid."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import refused, told
from scipy.optimize import least_squares
from simulated_groups import people

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.files import schema
from mcstudy.group_comparison.changes import DISCREPANCY, NOTHING, Problem, inflation, smooth
from mcstudy.group_comparison.group_model import GroupModel
from mcstudy.group_comparison.sample import sample_of
from mcstudy.spectra.frf_groups import model_points
from mcstudy.spectra.frf_points import group_of


@pytest.fixture(scope="module")
def changed() -> mc.Comparison:
    return mc.compare(people(12, 1), people(12, 2, {"Wprop": 0.7}), names=("controls", "patients"), permutations=199)


def test_a_change_of_the_weight_is_named_with_its_size_and_closes_the_difference(changed: mc.Comparison) -> None:
    best = changed.best
    assert best is not None
    assert best.name == "Wprop"
    assert best.probability > 0.9
    ((_, before, after),) = best.parameters
    assert after / before == pytest.approx(0.7, abs=0.07)
    assert best.closed is not None
    assert best.closed_se is not None
    assert abs(best.closed - 1) < 3 * best.closed_se + 0.1
    assert sum(c.probability for c in changed.causes) == pytest.approx(1)


def test_the_verdict_says_who_where_and_what(changed: mc.Comparison) -> None:
    text = changed.verdict()
    assert text.startswith("patients differs from controls in its mean responses (p of equal means < 0.005, 200 ")
    assert "12 and 12 people)." in text
    assert "Most probable change: Wprop" in text
    assert changed.differs
    assert repr(changed).startswith("Comparison")


@pytest.fixture(scope="module")
def unchanged() -> mc.Comparison:
    return mc.compare(people(5, 1), people(5, 1, again=1), names=("before", "after"))


def test_where_no_difference_is_found_nothing_else_says_there_is_one(unchanged: mc.Comparison) -> None:
    """Before, corrected p-values of regions and a certain cause could stand beside "no difference"."""
    assert not unchanged.differs
    assert unchanged.kind == "same"
    assert unchanged.causes == ()
    assert unchanged.best is None
    assert min(unchanged.detection.p_ratio, *(r.p for r in unchanged.detection.regions)) > 0.05
    assert "%" not in unchanged.text()
    assert "no change of a parameter is named" in unchanged.text()
    document = json.loads(json.dumps(unchanged.to_dict(), allow_nan=False))
    schema.validate("comparison", document, "comparison")
    assert (document["causes"], document["predicted_difference"], document["inflation"]) == ([], None, None)
    assert len(unchanged.plot().axes[0].patches) == 0  # no region is shaded


def test_people_too_few_to_show_a_difference_are_told_so(unchanged: mc.Comparison) -> None:
    assert "the smallest p-value of their relabellings is 0.062, above 0.05" in unchanged.verdict()
    assert "smallest p possible 0.062" in unchanged.text()


def test_every_p_value_says_what_it_tests(changed: mc.Comparison) -> None:
    text = changed.text()
    for words in ("equal means of all points (decides)", "equal ratio of upper to lower body", "equal scatter between"):
        assert words in text
    assert "p of equal means in a region" in text


def test_probabilities_of_causes_are_those_of_a_difference(changed: mc.Comparison) -> None:
    assert NOTHING not in [c.name for c in changed.causes]


def test_what_is_written_fits_the_schema_and_is_drawn(changed: mc.Comparison) -> None:
    document = json.loads(json.dumps(changed.to_dict(), allow_nan=False))
    schema.validate("comparison", document, "comparison")
    figure = changed.plot()
    assert len(figure.axes) == 4
    drawn = [line.get_ydata() for line in figure.axes[0].lines]
    np.testing.assert_allclose(drawn[0], np.abs(changed.mean_a[0]))


def test_the_fits_of_all_hypotheses_are_those_of_scipy() -> None:
    a, b = people(6, 1), people(6, 2, {"K11": 1.2})
    sample, model = sample_of(a, b), GroupModel(a)
    problem = Problem(model, sample, sample.error, sample.mean_error)
    wanted = {NOTHING: (), "K11": ("K11",), "delays": ("Td1", "Td2")}
    start = np.zeros(2 * model.median.size)
    for one in problem.fits(wanted, start):
        differs = np.array([[n in one.parts for n in model.model.names]], dtype=float)
        whiten = problem._whitener(0.0 if one.name == NOTHING else DISCREPANCY)[None]
        reference = least_squares(
            lambda x, d=differs, w=whiten: problem._residuals(x[None], d, w)[0],
            start,
            jac=lambda x, d=differs, w=whiten: problem._slopes(x[None], d, w)[0],
            x_scale="jac",
            ftol=1e-12,
        )
        cost = (problem._residuals(one.x[None], differs, whiten) ** 2).sum()
        assert cost <= 2 * reference.cost * (1 + 1e-6)
        step = 1e-6 * np.eye(start.size)
        numeric = [problem._residuals((one.x + s)[None], differs, whiten)[0] for s in step]
        numeric = (np.array(numeric) - problem._residuals(one.x[None], differs, whiten)).T / 1e-6
        np.testing.assert_allclose(problem._slopes(one.x[None], differs, whiten)[0], numeric, rtol=1e-3, atol=1e-3)


def test_errors_are_inflated_only_where_they_are_too_small() -> None:
    sample = sample_of(people(20, 1), people(20, 2))
    rng = np.random.default_rng(0)
    assert inflation(sample, people(4, 1)["f"].values, rng) < 2
    f, mean = np.array([0.1, 0.2, 0.4]), np.ones((2, 3), dtype=complex)
    np.testing.assert_allclose(np.diag(smooth(mean, f, 0.3)), 0.045)


def test_recordings_become_a_group_whose_points_are_those_of_the_model() -> None:
    settings = {"stimulus": "surface_tilt", "amplitude": 0.01, "cycles": 3, "rate_hz": 50.0, "noise": 0.1}
    recordings = [mc.simulate(seed=k, name=f"person {k}", **settings) for k in range(2)]
    group = group_of(recordings, ["ann", "bob"], fmax=3.0)
    model = GroupModel(group).model
    expected = model_points(model, model.truth, group)
    assert group["frf"].shape[1:] == (1, 2, group.sizes["point"])
    assert group.sizes["point"] <= 12
    found = group["frf"].values[:, 0].mean(axis=0)
    assert np.median(np.abs(found / expected - 1)) < 0.03


def test_cycles_that_are_left_out_of_a_recording_are_told() -> None:
    settings = {"stimulus": "surface_tilt", "amplitude": 0.01, "cycles": 4, "rate_hz": 50.0, "noise": 0.1}
    groups = [[mc.simulate(seed=10 * g + k, name=f"p{g}{k}", **settings) for k in range(4)] for g in range(2)]
    (trial,) = groups[1][2].trials
    theta = trial.theta.copy()
    theta[6000:6030] = 0.0  # 0.6 s of the third cycle
    groups[1][2] = replace(groups[1][2], trials=(replace(trial, theta=theta),))
    found = mc.compare(*groups, paired=False, names=("open", "closed"), fmax=2.0)
    (note,) = found.notes
    assert note.startswith("closed: p12: trial 1: theta1, theta2: is exactly 0 for 0.6 s at t = 120 s")
    assert note.endswith("; these cycles are left out")
    assert " ".join(note.split()) in " ".join(found.text().split())
    schema.validate("comparison", found.to_dict(), "a comparison")


def test_the_command_compares_two_conditions_of_a_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changed: mc.Comparison, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = []
    monkeypatch.setattr("mcstudy.api.compare.compare_groups", lambda *words: given.append(words) or changed)
    rows = ["person,eyes,segment,re_a,re_b,re_c,im_a,im_b,im_c"]
    for eyes, change, again in (("open", None, 0), ("closed", {"Wprop": 1.2}, 1)):
        group = people(5, 1, change, again=again)["frf"].isel(condition=0, point=slice(0, 3))
        for p in group["person"].values:
            for segment in ("lower", "upper"):
                H = group.sel(person=p, segment=segment).values
                rows.append(",".join([p, eyes, segment, *map(str, H.real), *map(str, H.imag)]))
    (tmp_path / "frf.csv").write_text("\n".join(rows))
    sheet = """
stimulus = "surface_tilt"
upper_body = "space"
units = {angle = "deg", stimulus = "deg"}
body = {reference = "goodworth2018"}
[frf_group]
file = "frf.csv"
conditions = ["eyes"]
real = "re_*"
imaginary = "im_*"
period_s = 20.0
points = [[1], [2], [3, 4]]
prts_state_s = 0.25
"""
    file = tmp_path / "group.toml"
    file.write_text(sheet)
    command = ["gap", "compare", str(file), "--condition", "open", "--with-condition", "closed", "--permutations", "99"]
    document = json.loads(told(*command, "--json"))
    assert document["schema"] == "mcstudy:comparison:1.0.0"
    assert document["people"] == [12, 12]
    a, b, paired, permutations, seed, names = given.pop()
    assert [str(g["condition"].values) for g in (a, b)] == ["open", "closed"]
    assert (paired, permutations, seed, names) == (None, 99, 0, ("open", "closed"))
    assert main([*command, "--unpaired", "--figure", str(tmp_path / "groups.svg")]) == Exit.DONE
    assert given.pop()[2] is False
    assert capsys.readouterr().out.startswith("patients differs from controls")
    assert (tmp_path / "groups.svg").read_text().count("<svg") == 1
    for words, line in (
        (command[:-4], "--with-condition: expected a condition of"),
        ([*command[:-4], "--with-condition", "shut"], "open; closed; got 'shut'"),
        ([*command[:-2], "--permutations", "3"], "permutations: expected a number from 19"),
        ([*command, "--figure", str(tmp_path / "x.txt")], "expected a name ending in .svg, .png, .pdf"),
        ([*command, "--with", "nothing.nc"], "expected one description of FRFs for each group, or recordings for both"),
    ):
        assert line in refused(*words)


def test_a_group_is_checked_before_it_is_compared() -> None:
    with pytest.raises(InputError, match="a: expected a group of FRFs or a list of recordings"):
        mc.compare("group.toml", [])  # type: ignore[arg-type]
    with pytest.raises(InputError, match="a: expected what read_frf_group returns, average missing"):
        mc.compare(people(4, 1).drop_vars("average"), people(4, 2))
