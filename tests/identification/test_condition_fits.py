"""One person in several conditions, fitted at once: parameters are shared or have a value in each condition."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import InputError, RecordingError
from mcstudy.exits import Exit
from mcstudy.files import schema
from mcstudy.recordings.columns import model_of
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import copies, joined, members, split
from mcstudy.stance.response import frf, frf_jacobian
from mcstudy.stance.stability import growth_rate

F = 0.05 * np.arange(1, 50, 2)
INERTIA, LOAD = 90.0, 755.0
TRUTH = {"Kp": 1019.25, "Kd": 354.85, "tau": 0.151, "Kt": 1.38e-4}
WEIGHTS = {"small": 0.7, "middle": 0.5, "large": 0.3}


def declared(visual: bool = False) -> Model:
    model = model_of("sensorimotor_integration_visual" if visual else "sensorimotor_integration")
    assert model is not None
    return model


def closed_form(Kp: float, Kd: float, tau: float, Kt: float, weight: float, f: np.ndarray = F) -> np.ndarray:
    """Sway per tilt from the equations of the model, written out, with the exact delay."""
    s = 2j * np.pi * f
    late = (Kp + Kd * s) * np.exp(-tau * s)
    active = late / (1 - Kt / s * late)
    return weight * active / (INERTIA * s**2 - LOAD + active)


def measured(
    name: str, weight: float, seed: int, noise: float = 0.05, visual: bool = False, **other: float
) -> mc.FrfRecording:
    """Responses of one condition with independent errors of ``noise`` times their gain."""
    y = closed_form(**{**TRUTH, **other}, weight=weight)
    sd, rng = noise * np.abs(y), np.random.default_rng(seed)
    y = y + sd * (np.array([1, 1j]) @ rng.standard_normal((2, F.size))) / np.sqrt(2)
    return mc.FrfRecording(F, y[:, None], (sd**2)[:, None, None].astype(complex), name=name, model=declared(visual))


def person(seed: int, **other: float) -> list[mc.FrfRecording]:
    return [measured(name, w, 10 * seed + k, **other) for k, (name, w) in enumerate(WEIGHTS.items())]


@pytest.fixture(scope="module")
def recordings() -> list[mc.FrfRecording]:
    return person(1)


@pytest.fixture(scope="module")
def fitted(recordings: list[mc.FrfRecording]) -> mc.ConditionsResult:
    return mc.fit_conditions(recordings)


def test_the_minimum_is_that_of_another_optimiser_on_equations_written_by_hand(
    recordings: Sequence[mc.FrfRecording], fitted: mc.ConditionsResult
) -> None:
    start = np.array([*TRUTH.values(), *WEIGHTS.values()])

    def residual(x: np.ndarray) -> np.ndarray:
        p = x * start
        parts = [
            (closed_form(*p[:4], weight) - r.y[:, 0]) / np.sqrt(r.C[:, 0, 0].real / 2)
            for weight, r in zip(p[4:], recordings, strict=True)
        ]
        return np.concatenate([part for z in parts for part in (z.real, z.imag)])

    other = least_squares(residual, np.ones(start.size), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    mine = [fitted[name].estimate for name in TRUTH] + [fitted["Wp", name].estimate for name in WEIGHTS]
    np.testing.assert_allclose(mine, other.x * start, rtol=1e-4)
    assert fitted.fit.chi2 == pytest.approx(2 * other.cost, rel=1e-5)
    sd = np.sqrt(np.diag(np.linalg.inv(other.jac.T @ other.jac))) * start
    half = [fitted["tau"].half_width, fitted["Wp", "small"].half_width]
    np.testing.assert_allclose(half, 1.96 * sd[[2, 4]], rtol=0.1)


def test_the_model_is_that_of_published_start_values() -> None:
    """Responses of the closed form at 0.05 and 0.85 Hz, and its rightmost root, computed elsewhere."""
    model = declared()
    expected = [0.9146096 + 1.0336159j, -0.7550400 - 0.5068905j]
    np.testing.assert_allclose(frf(model, model.truth, np.array([0.05, 0.85]))[:, 0], expected, rtol=1e-6)
    assert growth_rate(model, model.truth) == pytest.approx(-0.531554, rel=1e-5)
    np.testing.assert_allclose(frf(model, model.truth, F)[:, 0], closed_form(**TRUTH, weight=0.534), rtol=1e-10)


def test_each_sharing_is_tested_with_its_own_degrees_of_freedom(
    recordings: Sequence[mc.FrfRecording], fitted: mc.ConditionsResult
) -> None:
    """Against the deviances of two whole fits and, since the covariance is known, the chi-squared distribution."""
    apart = mc.fit_conditions(recordings, per=["Wp", "tau"])
    tau = fitted.sharing("tau")
    assert tau.ratio == pytest.approx(fitted.fit.chi2 - apart.fit.chi2, abs=1e-4)
    worse = max(1.0, apart.fit.chi2 / apart.fit.expected_chi2)
    assert tau.p_value == pytest.approx(chi2.sf(tau.ratio / worse, 2), rel=0.03)
    np.testing.assert_allclose(tau.values, [apart["tau", name].estimate for name in WEIGHTS], rtol=1e-4)
    assert apart.sharing("tau").p_value == pytest.approx(tau.p_value, rel=1e-3)
    assert fitted.sharing("Wp").p_value < 1e-10
    assert tau.unseen is None  # responses without cycles


def test_a_delay_that_changes_is_found_and_told() -> None:
    changed = [measured(name, w, k, tau=0.151 - 0.012 * k) for k, (name, w) in enumerate(WEIGHTS.items())]
    fit = mc.fit_conditions(changed)
    assert fit.sharing("tau").p_value < 1e-4
    assert "One value of tau does not hold (p < 0.0001)" in " ".join(fit.text().split())


def test_surface_and_scene_are_conditions_of_one_body() -> None:
    both = [measured("surface", 0.5, 1), measured("scene", 0.2, 2, visual=True)]
    fit = mc.fit_conditions(both, quantities=["1 - Wp - Wv"])
    assert [s.name for s in fit.sharings] == list(TRUTH)  # each weight is of one condition
    assert fit["1 - Wp - Wv"].low < 0.3 < fit["1 - Wp - Wv"].high


@pytest.mark.parametrize(
    ("options", "separate"),
    [
        ({}, ("Wp",)),
        ({"per": ["tau"]}, ("tau",)),
        ({"shared": ["Kp", "Kd", "tau"]}, ("Kt", "Wp")),
        ({"shared": ["Kp"], "per": ["tau", "Wp"]}, ("tau", "Wp")),
        ({"shared": ["all"]}, ()),
    ],
)
def test_what_is_not_named_is_shared_unless_only_the_shared_are_named(
    recordings: list[mc.FrfRecording], options: dict[str, list[str]], separate: tuple[str, ...]
) -> None:
    assert mc.fit_conditions(recordings[:2], **options).separate == separate


def test_the_screen_begins_with_the_answer(fitted: mc.ConditionsResult) -> None:
    lines = fitted.text().splitlines()
    assert len(lines) <= 20
    assert lines[0].startswith("small | middle | large: one person, 75 lines")
    assert lines[2].startswith("Wp differs between conditions (p < 0.0001): small 0.7")
    assert "One value for all conditions is consistent with the recordings for Kp" in fitted.text()
    assert "random starts" not in fitted.text()
    assert "random starts" in fitted.text(details=True)


def test_the_command_writes_what_python_returns(
    recordings: list[mc.FrfRecording], fitted: mc.ConditionsResult, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = []
    for r in recordings:
        columns = np.column_stack([r.f, r.y.real, r.y.imag, np.sqrt(r.C[:, 0, 0].real)])
        header = "f,re_sway,im_sway,sd_sway"
        np.savetxt(tmp_path / f"{r.name}.csv", columns, delimiter=",", header=header, comments="", fmt="%.17g")
        text = f'model = "sensorimotor_integration"\nfrf = {{file = "{r.name}.csv"}}\n'
        (tmp_path / f"{r.name}.toml").write_text(text)
        files.append(str(tmp_path / f"{r.name}.toml"))
    assert (
        main(["fit", *files, "--shared", "Kp,Kd,tau,Kt", "--per", "condition", "Wp", "-o", str(tmp_path)]) == Exit.DONE
    )
    assert "Wp differs between conditions" in capsys.readouterr().out
    document = json.loads((tmp_path / "conditions.json").read_text())
    schema.validate("conditions", document, "conditions")
    estimates = {q["name"]: q["estimate"] for q in document["fit"]["quantities"]}
    assert estimates["Wp_small"] == pytest.approx(fitted["Wp", "small"].estimate, rel=1e-6)
    assert document["separate"] == ["Wp"]


def test_a_file_lists_conditions_with_models_of_their_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for r in (measured("surface", 0.5, 1), measured("scene", 0.2, 2, visual=True)):
        columns = np.column_stack([r.f, r.y.real, r.y.imag, np.sqrt(r.C[:, 0, 0].real)])
        np.savetxt(tmp_path / f"{r.name}.csv", columns, delimiter=",", header="f,re_sway,im_sway,sd_sway", comments="")
        text = f'model = "{r.model.name}"\nfrf = {{file = "{r.name}.csv"}}\n'  # type: ignore[union-attr]
        (tmp_path / f"{r.name}.toml").write_text(text)
    sheet = tmp_path / "person.toml"
    body = '[[condition]]\nname = "surface tilt"\nfiles = ["surface.toml"]\n[[condition]]\nname = "scene"\n'
    sheet.write_text(f'per = ["tau"]\n{body}files = ["scene.toml"]\n')
    assert main(["fit", "--conditions", str(sheet)]) == Exit.DONE
    shown = capsys.readouterr().out
    assert "surface tilt | scene: one person, 50 lines" in shown
    assert "tau, surface tilt" in shown
    sheet.write_text(f"{body}filse = []\n")
    assert main(["fit", "--conditions", str(sheet)]) == Exit.BAD_INPUT
    assert f"{sheet}: condition.1.filse" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"per": ["Wpp"]}, r"per: expected parameters of the model \(Kp, .*\), got 'Wpp' \(similar: Wp\)"),
        ({"per": ["tau"], "shared": ["tau"]}, "tau: expected shared or per condition, got both"),
        ({"conditions": ["a", "a", "a"]}, "conditions: expected at least two, got a"),
        ({"conditions": ["a", "b"]}, "conditions: expected one name per recording, 3 in all"),
        ({"conditions": ["a 1", "a-1", "b"]}, "expected names that differ in their letters and digits"),
    ],
)
def test_wrong_conditions_are_refused_in_one_line(
    recordings: list[mc.FrfRecording], options: dict[str, list[str]], line: str
) -> None:
    with pytest.raises(InputError, match=line) as refused:
        mc.fit_conditions(recordings, **options)
    assert "\n" not in str(refused.value)


def test_loops_that_differ_are_refused_in_one_line(recordings: list[mc.FrfRecording]) -> None:
    other = replace(recordings[1], model=model_of("independent_channel"))
    with pytest.raises(RecordingError, match="independent_channel: expected the same body and feedback"):
        mc.fit_conditions([recordings[0], other])


def test_a_split_model_is_in_each_block_the_model_of_that_condition() -> None:
    models = [model_of(name) for name in ("independent_channel", "independent_channel", "independent_channel_visual")]
    each = [m for m in models if m is not None]
    joint = joined(each, [F.size] * 3)
    joint = replace(joint, blocks=tuple(replace(b, name=n) for b, n in zip(joint.blocks, "abc", strict=True)))
    names = ["Wp", "tau", "w0", "Wv", "Kf"]
    model, known = split(joint, names), copies(joint, names)
    assert model.names[:6] == ("K", "B", "w0_a", "w0_b", "w0_c", "beta")
    assert "Wv" in model.names  # one condition alone holds it
    theta = model.truth * (1 + 0.1 * np.random.default_rng(1).standard_normal(len(model.names)))
    H, slopes = frf_jacobian(model, theta, np.tile(F, 3))
    for k, (alone, part) in enumerate(zip(each, members(model), strict=True)):
        own = np.array([theta[model.names.index(known.get(n, {}).get(k, n))] for n in alone.names])
        here = slice(k * F.size, (k + 1) * F.size)
        np.testing.assert_allclose(H[here], frf(alone, own, F), rtol=1e-12)
        assert growth_rate(part, theta) == pytest.approx(float(growth_rate(alone, own)), rel=1e-9)
        assert not slopes[here][..., [model.names.index(f"tau_{n}") for n in "abc" if n != "abc"[k]]].any()
    assert growth_rate(model, theta) == max(growth_rate(m, theta) for m in members(model))


def test_the_standing_body_has_a_value_in_each_condition_too() -> None:
    """Two tilts of different size, with cycles: the weight differs, and unseen cycles say so."""
    stated = {"small": (1.0, 0.8), "large": (2.0, 0.5)}
    recorded = [
        mc.simulate(
            stimulus="surface_tilt", amplitude=np.radians(a), parameters={"Wprop": w}, cycles=5, rate_hz=50, seed=k
        )
        for k, (a, w) in enumerate(stated.values())
    ]
    fit = mc.fit_conditions(recorded, conditions=list(stated), fmax=1.2)
    assert fit.separate == ("Wprop",)
    for name, (_, weight) in stated.items():
        assert fit["Wprop", name].low < weight < fit["Wprop", name].high
    weight = fit.sharing("Wprop")
    assert weight.p_value < 1e-6
    assert weight.unseen is not None
    assert weight.unseen_se is not None
    assert weight.unseen > 3 * weight.unseen_se
    assert fit.sharing("Td1").p_value > 0.001


def test_people_in_several_conditions_have_means_of_what_differs() -> None:
    """Five people whose stiffness scatters by 60 N m/rad; the weights are those of everybody."""
    rng = np.random.default_rng(4)
    recordings = [
        replace(r, name=f"{who} {r.name}") for who in "abcde" for r in person(ord(who), Kp=1019.25 + rng.normal(0, 60))
    ]
    who, condition = zip(*(r.name.split() for r in recordings), strict=True)
    group = mc.fit_group(recordings, person=who, condition=condition, per=["Wp"], quantities=["Wp_small - Wp_large"])
    assert set(group.fits) == {(name, "all") for name in "abcde"}
    for name, weight in WEIGHTS.items():
        assert group[f"Wp_{name}", "all"].mean == pytest.approx(weight, abs=0.02)
    change = group["Wp_small - Wp_large", "all"]
    assert change.low < 0.4 < change.high
    assert 30 < group["Kp", "all"].between < 150
