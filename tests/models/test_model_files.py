"""A model is data: what a file declares is the model, and every mistake is one line that names the field."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import freqs

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import DesignError, ModelError, StoreError
from mcstudy.files import schema
from mcstudy.models.catalogue import checked_table, names, read_model, spelled_out, written
from mcstudy.models.check import check_response, check_stability, response
from mcstudy.models.record import ModelTable, table_of
from mcstudy.stance.body import one_segment, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf

F = np.array([0.05, 0.4, 2.0, 7.0])

PENDULUM: dict[str, Any] = {
    "name": "pendulum",
    "joints": ["ankle"],
    "constants": {"m": 75, "h": "0.83", "g": 9.81, "J": "m*h**2*4/3", "mgh": "m*g*h"},
    "parameter": [
        {"name": "K", "value": "1.5*mgh", "unit": "N m/rad"},
        {"name": "B", "value": 350},
        {"name": "Td", "value": 0.1},
        {"name": "tau", "value": 0.02, "lower": 0.001, "upper": 0.1},
    ],
    "filter": [{"name": "muscle", "numerator": 1, "denominator": "1 + 2*tau*s + (tau*s)**2"}],
    "term": [
        {"order": 2, "coefficient": "J"},
        {"coefficient": "-mgh"},
        {"gain": "K", "delay": "Td", "filter": "muscle", "noisy": True},
        {"gain": "B", "delay": "Td", "filter": "muscle", "order": 1, "noisy": True},
        {"sense": "stimulus"},
    ],
}


def changed(path: str, value: object) -> dict[str, Any]:
    """The pendulum with one value of its table replaced; None takes it away."""
    raw: dict[str, Any] = tomllib.loads(written(checked_table(PENDULUM)))["model"]
    raw.setdefault("derived", [])
    *outer, last = path.split(".")
    place: Any = raw
    for key in outer:
        place = place[int(key)] if key.isdigit() else place.setdefault(key, {})
    if value is None:
        del place[last]
    elif last == "+":
        place.append(value)
    else:
        place[int(last) if last.isdigit() else last] = value
    return raw


def test_the_file_of_a_pendulum_is_its_textbook_transfer_function() -> None:
    model = checked_table(PENDULUM).model()
    m, h, g = 75, 0.83, 9.81
    s = 2j * np.pi * F
    control = (1.5 * m * g * h + 350 * s) * np.exp(-0.1 * s) / (1 + 0.02 * s) ** 2
    expected = 1 / (m * h**2 * 4 / 3 * s**2 - m * g * h + control)
    np.testing.assert_allclose(frf(model, model.truth, F)[:, 0], expected, rtol=1e-12)
    assert dict(zip(model.names, zip(model.lower, model.upper, strict=True), strict=True)) == {
        "K": (0.0, pytest.approx(3 * m * g * h)),
        "B": (0.0, 700.0),
        "Td": (pytest.approx(0.07), pytest.approx(0.13)),
        "tau": (0.001, 0.1),
    }


def test_a_filter_in_a_file_is_that_of_scipy() -> None:
    table = checked_table(PENDULUM)
    (muscle,) = table.model().filters
    value = [sum(x.coefficient * 0.02 ** dict(x.powers).get("tau", 0) * (2j * np.pi * F) ** x.order for x in side)
             for side in (muscle.numerator, muscle.denominator)]  # fmt: skip
    _, expected = freqs([1.0], [0.02**2, 2 * 0.02, 1.0], 2 * np.pi * F)
    np.testing.assert_allclose(value[0] / value[1], expected, rtol=1e-12)


@pytest.mark.parametrize("name", names())
def test_a_printed_model_is_read_back_with_the_same_bits(name: str, tmp_path: Path) -> None:
    first = read_model(name)
    (tmp_path / "printed.toml").write_text(written(first), encoding="utf-8")
    model, again = first.model(), read_model(tmp_path / "printed.toml").model()
    assert replace(again, provenance=model.provenance) == model
    f = np.repeat(F, len(model.stimulus_names))
    np.testing.assert_array_equal(frf(again, again.truth, f), frf(model, model.truth, f))


@pytest.mark.parametrize("name", names())
def test_a_model_file_conforms_to_its_schema(name: str) -> None:
    raw = tomllib.loads(written(read_model(name)))
    schema.validate("model", raw, name)
    with pytest.raises(StoreError, match="name: model"):
        schema.validate("model", {"model": {**raw["model"], "joint": "ankle"}}, "name")


@pytest.mark.parametrize("name", names())
def test_every_model_that_ships_is_sound_and_says_what_it_is(name: str) -> None:
    apart, slopes = check_response(read_model(name))
    assert apart < 1e-12
    assert slopes < 1e-6
    assert check_stability(read_model(name)) < 0


@pytest.mark.parametrize("model", [two_segment(), two_segment(stimulus="surface_tilt"), one_segment()])
def test_a_model_of_the_package_and_its_table_are_one(model: Model) -> None:
    again = ModelTable.of(model).model()
    np.testing.assert_array_equal(frf(again, again.truth, F), frf(model, model.truth, F))
    for array in ("entry", "weight", "noisy", "group_delay"):
        np.testing.assert_array_equal(getattr(again.table, array), getattr(model.table, array))
    assert table_of(again) == table_of(model)


def test_a_model_in_python_needs_no_row_and_no_angle_for_what_it_has_not() -> None:
    model = mc.Model(
        name="elbow",
        angles=("elbow",),
        parameters=[mc.Parameter("K", "N m/rad", 10.0, 0.0, 20.0), mc.Parameter("tau", "s", 0.1, 0.01, 1.0)],
        terms=[
            mc.Term("elbow", "elbow", order=2, coefficient=0.08),
            mc.Term("elbow", "elbow", order=1, coefficient=0.5),
            mc.Term("elbow", "elbow", "K", filters="lag"),
            mc.Term("elbow", "stimulus"),
        ],
        filters=[mc.Filter("lag", "1", "1 + tau*s")],
    )
    s = 2j * np.pi * F
    np.testing.assert_allclose(
        frf(model, model.truth, F)[:, 0], 1 / (0.08 * s**2 + 0.5 * s + 10 / (1 + 0.1 * s)), rtol=1e-12
    )
    assert ModelTable.of(model).joints == ("elbow",)


def test_a_term_may_sense_a_sum_of_joints_with_weights() -> None:
    raw = {
        "name": "two",
        "joints": ["low", "high"],
        "parameter": [{"name": "K", "value": 5.0}, {"name": "C", "value": 3.0}],
        "term": [
            *({"joint": j, "sense": j, "order": k, "coefficient": 1.0} for j in ("low", "high") for k in (1, 2)),
            {"joint": "low", "sense": "low + 0.5*high", "gain": "K"},
            {"joint": "high", "sense": "high - low", "gain": "C"},
            {"joint": "low", "sense": "stimulus"},
        ],
    }
    table = checked_table(raw)
    s = 2j * np.pi * F
    plant = s**2 + s
    loop = np.moveaxis(np.array([[plant + 5, 2.5 + 0 * s], [-3 + 0 * s, plant + 3]]), 2, 0)
    expected = np.linalg.solve(loop, np.array([1.0, 0.0])[:, None])[..., 0]
    model = table.model()
    np.testing.assert_allclose(frf(model, model.truth, F), expected, rtol=1e-12)
    np.testing.assert_allclose(response(table, {"K": 5.0, "C": 3.0}, F), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("joints", [], "model.joints: missing"),
        ("joints", ["a", "b", "c", "d", "e"], "model.joints: expected one to 4 names, got 5"),
        ("joints", ["s"], "model.joint.s: expected a name of its own, got one that is a word of the grammar"),
        ("constants.K", 1, "model.parameter.K: expected a name of its own, got one that is a constant"),
        ("constants.m", "h", None),
        ("constants.m", "J", "model.constants.m: expected no cycle, got one of m, J, mgh"),
        ("constants.m", "mass", "model.constants.m: number 'mass': expected names among"),
        ("constants.m", "__import__('os')", "model.constants.m: number"),
        ("constants.m", "1/0", "model.constants.m: expected a finite number"),
        ("parameter.0.value", "2*K", "model.parameter.K.value: number '2*K': expected names among"),
        ("parameter.0.lower", 2000, "model.parameter.K.lower: expected less than upper, got 2000 and"),
        ("parameter.0.upper", 3, "model.parameter.K.value: expected a value inside its bounds 0 to 3"),
        ("parameter.2.value", 0.01, None),
        ("parameter.0.vaule", 3, "model.parameter.0.vaule: unknown key, expected one of name, unit, value"),
        ("parameter.+", {"name": "K", "value": 1}, "model.parameter.K: expected a name of its own"),
        ("parameter.+", {"name": "Q", "value": 1}, "model.parameter.Q: expected a parameter that a term holds"),
        ("filter.+", {"name": "lag"}, "model.filter.lag: expected a filter that a term passes through"),
        ("filter.0.numerator", "s**3", "model.filter.muscle.numerator: expected at most the power of s of the denom"),
        ("filter.0.denominator", "1 + Tx*s", "model.filter.muscle.denominator: expected one of"),
        ("filter.0.denominator", "exp(-s)", "model.filter.muscle.denominator: polynomial 'exp(-s)': expected sums"),
        ("term.2.delay", "Tx", "model.term.2.delay: expected the name of a parameter, one of B, K, Td, tau, got 'Tx'"),
        ("term.2.delay", 0.1, "model.term.2.delay: expected a list, got 0.1"),
        ("term.2.gain", ["K", "B", "tau"], "model.term.2.gain: expected at most 2 names, got 3"),
        ("term.2.order", 3, "model.term.2.order: expected -1 (integral), 0, 1 (rate) or 2 (acceleration), got 3"),
        ("term.2.joint", "knee", "model.term.2.joint: expected one of ankle, got 'knee'"),
        ("term.2.sense", "knee", "model.term.2.sense: expected stimulus, ankle, or a sum of joints, got 'knee'"),
        ("term.2.filter", "lag", "model.term.2.filter: expected the name of a filter, one of muscle, got 'lag'"),
        ("term.4", None, "model.term: expected one that senses the stimulus"),
        ("angles", ["a", "b"], "model.angles: expected one name for each of 1 joints, got 2"),
        (
            "derived.+",
            {"value": "K + Q"},
            "model.derived.K + Q: derived 'K + Q': expected names among K",
        ),
        (
            "derived.+",
            {"value": "K", "name": "B"},
            "model.derived.B: expected a name of its own, got one",
        ),
        ("derived.+", {"value": "1/(K - 1.5*mgh)", "name": "q"}, "model.derived.q: quantity '1/(K - 1.5*(610.6725))'"),
        (
            "derived.+",
            {"value": "m*g", "name": "q"},
            "model.derived.q: quantity '(75.0)*(9.81)': expected a",
        ),
        ("derived.+", {"value": "__import__('os')"}, "model.derived.__import__('os'): derived"),
        (
            "derived.+",
            {"value": "K + 3", "unit": "N"},
            "model.derived.K + 3.unit: expected N m/rad, that of",
        ),
        ("sensor_filter", {"ankle": "x"}, "model.sensor_filter.ankle: expected one of muscle, got 'x'"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_field(path: str, value: object, line: str | None) -> None:
    raw = changed(path, value) if value is not None else {**PENDULUM, "term": PENDULUM["term"][:4]}
    if line is None:  # beside it, what is no mistake
        if path == "constants.m":
            checked_table(raw)
            return
        line = "model.parameter.Td.lower: expected"
    with pytest.raises(DesignError) as refused:
        checked_table(raw)
    assert str(refused.value).startswith(line)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("parameter.0.value", 300, "parameter: expected a stable closed loop at the true values, got growth rate +"),
        ("term.0", {"order": 1, "coefficient": 10}, "parameter: expected a stable closed loop at the true values"),
        ("term.0", {"order": 2, "coefficient": 10, "delay": "Td"}, "term: expected a proper closed loop, got a"),
        ("term.+", {"order": 2, "coefficient": 100, "delay": "Td"}, "parameter: expected a stable closed loop"),
    ],
)
def test_a_loop_that_falls_or_is_improper_is_refused(path: str, value: object, line: str) -> None:
    with pytest.raises(DesignError) as refused:
        check_stability(checked_table(changed(path, value)))
    assert str(refused.value).startswith(line)
    assert "\n" not in str(refused.value)


def test_a_stimulus_that_leaves_a_joint_at_rest_and_a_parameter_that_moves_nothing_are_refused() -> None:
    joints = [{"joint": j, "sense": j, "order": k, "coefficient": 1.0} for j in ("low", "high") for k in (0, 1, 2)]
    spring = {"joint": "low", "sense": "low", "gain": "K"}
    drive = {"joint": "low", "sense": "stimulus"}
    raw = {"joints": ["low", "high"], "parameter": [{"name": "K", "value": 5.0}], "term": [*joints, spring, drive]}
    with pytest.raises(DesignError, match="expected a stimulus that moves every output, got no response of high"):
        check_response(checked_table(raw))
    coupled = [*joints, {**spring, "joint": "high"}, drive, {"joint": "high", "sense": "low", "coefficient": 1.0}]
    check_response(checked_table({**raw, "term": coupled}))
    both = [*coupled, {"joint": "low", "sense": "low", "gain": ["Q", "Z"]}]
    still = [*raw["parameter"], {"name": "Q", "value": 2.0}, {"name": "Z", "value": 0.0, "lower": 0.0, "upper": 1.0}]
    with pytest.raises(DesignError, match=r"parameter\.Q: expected a parameter that moves the response"):
        check_response(checked_table({**raw, "parameter": still, "term": both}))


def test_a_table_that_is_not_what_the_file_says_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    table, right = checked_table(PENDULUM), ModelTable.model

    def wrong(self: ModelTable) -> Model:
        model = right(self)
        return replace(model, terms=(replace(model.terms[0], coefficient=70.0), *model.terms[1:]))

    monkeypatch.setattr(ModelTable, "model", wrong)
    with pytest.raises(DesignError, match="expected the independent evaluation of the closed loop"):
        check_response(table)


def test_models_are_found_by_name_or_file_and_never_by_chance(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(written(checked_table(PENDULUM)), encoding="utf-8")
    (tmp_path / "empty.toml").write_text("[study]\nname = 'x'\n", encoding="utf-8")
    assert read_model("mine.toml", tmp_path).name == "pendulum"
    assert spelled_out("mine.toml", tmp_path)["kind"] == "declared"
    assert spelled_out("two_segment") == {"kind": "two_segment"}
    for name, line in (
        ("mine.toml", "mine.toml: expected a readable model file"),
        (str(tmp_path / "empty.toml"), f"{tmp_path}/empty.toml: model: missing, expected a table [model]"),
        ("elbo", "expected a model file (.toml) or one of two_segment, one_segment, "),
    ):
        with pytest.raises(DesignError) as refused:
            read_model(name)
        assert str(refused.value).startswith(line)
    assert str(refused.value).endswith(", got 'elbo' (similar: elbow)")


def test_a_set_of_several_stimuli_is_no_table() -> None:
    from mcstudy.stance.feedback import Block

    with pytest.raises(ModelError, match="expected stimuli that share their lines"):
        table_of(replace(two_segment(), blocks=(Block("N m", 3), Block("N m", 3))))


def test_a_checked_model_is_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(written(checked_table(changed("term.4", {"sense": "stimulus", "gain": "K"}))), encoding="utf-8")
    assert main(["models", str(file), "--check", "--diagram", str(tmp_path / "loop.svg")]) == 0
    *_, first, second, third = capsys.readouterr().out.splitlines()
    assert first == "every parameter moves the response"
    assert (second, third) == (
        "ankle: K u -> (+) -> body -> ankle",
        "  (-) <- delay Td <- K muscle + B s muscle <- ankle + noise",
    )
    drawn = (tmp_path / "loop.svg").read_text(encoding="utf-8")
    assert [text for text in ("body", "muscle", "delay T", "noise 1") if text not in drawn] == []
    assert main(["models", "--diagram", "loop.svg"]) == 2
    assert main(["models", str(file), "--diagram", str(tmp_path / "loop.png")]) == 2
    assert "expected a name ending in .svg" in capsys.readouterr().err
