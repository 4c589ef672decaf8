"""From a design file to a stimulus, its files and its verification."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import refused

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import DesignError, InputError
from mcstudy.exits import Exit
from mcstudy.files import schema
from mcstudy.report.design_page import cv_bars, design_page, design_picture
from mcstudy.stance.body import STIMULI
from mcstudy.stance.information import expected_line_covariance
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.stability import growth_rate
from mcstudy.stimulus_design.bodies import drawn, equivalent, factors, model_of
from mcstudy.stimulus_design.design_file import parse_design, read_design
from mcstudy.stimulus_design.spectrum import predicted, size_of
from mcstudy.stimulus_design.verify import bodies_of, compared
from mcstudy.streams import stream
from mcstudy.study.study_file import read_study
from mcstudy.text_tables import with_error

SMALL: dict[str, Any] = {
    "design": {"name": "small", "seed": 3, "phase_starts": 2, "detection": 0.25, "waveform_rate_hz": 100.0},
    "limits": {"rms": 1.1, "sway": 1.0, "rate": 5.0, "bodies_within": 0.0},
    "prior": {"bodies": 2},
    "stimulus": {"stages": 6},
    "verify": {"realizations": 16, "bodies": 1, "body_realizations": 4, "starts": 1, "fmax": [8.0]},
}


def with_fields(**tables: dict[str, Any]) -> dict[str, Any]:
    return {**SMALL, **{name: {**SMALL.get(name, {}), **fields} for name, fields in tables.items()}}


@pytest.fixture(scope="module")
def found() -> Any:
    return mc.design(SMALL)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder of a verified design of the command, and its figure."""
    folder = tmp_path_factory.mktemp("design")
    file = folder / "small.toml"
    rows = [f"[{t}]\n" + "\n".join(f"{k} = {json.dumps(v)}" for k, v in fields.items()) for t, fields in SMALL.items()]
    file.write_text("\n".join(rows), encoding="utf-8")
    figure = folder / "small.svg"
    assert main(["design", str(file), "-o", str(folder / "out"), "--workers", "1", "--figure", str(figure)]) == 0
    return folder / "out", figure.read_text(encoding="utf-8")


def test_a_design_stays_within_its_limits_and_keeps_what_it_shall(found: Any) -> None:
    d = found.designed
    one, other = found.sizes
    assert other.rms <= 1.1 * one.rms * (1 + 1e-6)
    assert other.rate <= 5.0 * one.rate * (1 + 1e-6)
    assert (other.sway <= one.sway * (1 + 1e-6)).all()
    assert (d.after[~d.empty] >= 0.5 * d.before[~d.empty] * (1 - 1e-6)).all()
    assert (d.after[d.empty] == 0).all()
    assert d.empty.sum() == 14  # one of four of 58
    assert max(d.limits.values()) > 0.99  # nothing is given away
    c = np.abs(d.stimulus.coefficients()[np.round(d.f * d.stimulus.period_s).astype(int)]) ** 2
    np.testing.assert_allclose(c, d.after, rtol=1e-6)


def test_the_predicted_errors_are_those_of_linear_least_squares_on_noisy_responses(found: Any) -> None:
    """Weighted least squares by NumPy on drawn errors, without this project's information."""
    d, model = found.designed, found.designed.model
    k = np.flatnonzero(~d.empty)
    f, drive = d.f[k], np.sqrt(d.after[k])
    C = expected_line_covariance(model, model.truth, SensorNoise(), f, drive, 5 * 14.56)
    root, step = np.linalg.cholesky(C), 1e-6 * model.truth
    slope = np.stack([(frf(model, model.truth + h, f) - frf(model, model.truth - h, f)) / 2 for h in np.diag(step)], -1)
    rng = np.random.default_rng(5)
    z = (rng.standard_normal((400, f.size, 2)) + 1j * rng.standard_normal((400, f.size, 2))) / np.sqrt(2)
    white = np.linalg.solve(root, slope).reshape(-1, model.truth.size)
    design = np.concatenate([white.real, white.imag])
    data = np.concatenate([z.reshape(400, -1).real, z.reshape(400, -1).imag], axis=1)
    estimates = np.linalg.lstsq(design, data.T, rcond=None)[0] * 1e-6  # relative errors
    np.testing.assert_allclose(estimates.std(axis=1, ddof=1), found.cv[1], rtol=0.12)


def test_the_criterion_for_one_parameter_serves_it_best(found: Any) -> None:
    aimed = mc.design(with_fields(design={"criterion": "c", "parameter": "Kpas1"}))
    k = found.names.index("Kpas1")
    assert aimed.cv[1, k] < 0.95 * found.cv[1, k]
    assert "optimal for Kpas1" in aimed.text().replace("\n", " ")


@pytest.mark.parametrize("kind", [kind for kind in STIMULI if kind != "ankle_torque"])
def test_every_kind_of_stimulus_can_be_designed(kind: str) -> None:
    found = mc.design(with_fields(stimulus={"kind": kind}, design={"amplitude": 0.02}, prior={"bodies": 0}))
    assert np.exp(np.log(found.predicted_ratio).mean()) > 1.5
    assert found.study.groups["design_ml"].stimulus.kind == kind


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"limits": {"rms": 0.5}}, "limits.rms: what is kept of the sequence alone is 1.34 times this limit"),
        ({"limits": {"sway": 0.6}}, "limits.sway: what is kept of the sequence alone is"),
        ({"limits": {"rate": 0.3}}, "limits.rate: what is kept of the sequence alone is"),
        ({"limits": {"crest_factor": 1.1}}, "limits.crest_factor: the lowest found in 2 starts is"),
        ({"limits": {"peak": 1.0}}, "limits.peak: what is kept of the sequence alone is"),
        ({"limits": {"duration_s": 20.0}}, "limits.duration_s: expected room for 2 cycles"),
        ({"design": {"criterion": "c"}}, "design.parameter: expected a parameter for criterion 'c'"),
        ({"design": {"criterion": "c", "parameter": "K99"}}, "design.parameter: expected one of K11"),
        ({"design": {"keep": 1.0}}, "design.keep: expected less than 1"),
        ({"noise": {"psd": [0.0, 0.0]}}, "noise.psd: expected noise on all outputs"),
        ({"design": {"waveform_rate_hz": 12.0}}, "design.waveform_rate_hz: expected more than twice design.fmax"),
        ({"verify": {"fmax": [9.0]}}, "verify.fmax: expected at most design.fmax"),
        ({"model": {"truth": {"Kpas1": 0.0}, "bounds": {"absolute": {"Kpas1": [0.0, 10.0]}}}}, "model.truth.Kpas1"),
    ],
)
def test_what_allows_no_stimulus_is_named_in_one_line(tables: dict[str, Any], words: str) -> None:
    with pytest.raises(DesignError) as error:
        mc.design(with_fields(**{"prior": {"bodies": 0}, **tables}))
    assert str(error.value).startswith(words)
    assert "\n" not in str(error.value)


def test_a_limit_of_the_peak_holds() -> None:
    loose = mc.design(with_fields(prior={"bodies": 0})).sizes[1].peak
    tight = mc.design(with_fields(prior={"bodies": 0}, limits={"peak": 0.9 * loose})).sizes[1].peak
    assert 0.8 * loose < tight <= 0.9 * loose


def test_bodies_of_the_verification_are_not_those_of_the_design(found: Any) -> None:
    file = found.designed.file
    design = [b.truth["K11"] for b in drawn(file, 2, stream(file.design.seed, "design_prior"))]
    assert not set(design) & {b.truth["K11"] for b in bodies_of(found.designed)}
    assert all(abs(v / 1057.0 - 1) <= 0.2 for v in design)


def test_the_files_hold_one_design(written: tuple[Path, str]) -> None:
    folder, figure = written
    result = json.loads((folder / "design.json").read_text(encoding="utf-8"))
    schema.validate("stimulus_design", result, "design.json")
    assert [(v["cost"], v["realizations"]) for v in result["verification"]] == [("ml", 16)]
    assert [b["found"]["realizations"] for b in result["bodies"]] == [4]
    study = read_study(folder / "study.toml")
    lines = study.groups["design_ml"].stimulus.lines
    assert list(lines.harmonic) == result["lines"]["harmonic"]
    with (folder / "waveform.csv").open(encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert header == ["time (s)", "stimulus (N m)"]
    t, u = np.array(rows, dtype=float).T
    assert t.size == 1456  # 14.56 s at 100 Hz
    k = np.array(lines.harmonic)
    c = np.fft.rfft(u)[k] / u.size
    np.testing.assert_allclose(
        2 * np.abs(c) ** 2 / (2 * np.abs(c[0]) ** 2), (np.array(lines.weight) / lines.weight[0]) ** 2, atol=1e-6
    )
    assert figure.rstrip().endswith("</svg>")


@pytest.mark.parametrize("verified", [True, False])
def test_another_design_is_refused_before_it_replaces_a_verified_one(written: tuple[Path, str], verified: bool) -> None:
    folder, _ = written
    other = folder.parent / "other.toml"
    text = (folder.parent / "small.toml").read_text(encoding="utf-8")
    other.write_text(text.replace("seed = 3", "seed = 4"), encoding="utf-8")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert "was made with another study file" in refused(
        "design", str(other), "-o", str(folder), *([] if verified else ["--no-verify"])
    )
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_bounded_fits_find_the_design_better_and_near_its_prediction(written: tuple[Path, str]) -> None:
    result = json.loads((written[0] / "design.json").read_text(encoding="utf-8"))
    ml = result["verification"][0]
    assert ml["mean_ratio"] - 2 * ml["mean_ratio_error"] > 1.0
    promised, got = (np.array(v["design"]) for v in (result["predicted_cv_with_bounds"], ml["cv"]))
    assert 0.7 < np.exp(np.log(got / promised).mean()) < 1.4


def test_a_parameter_whose_fits_but_one_lie_on_a_bound_has_a_ratio_without_an_error() -> None:
    x = np.random.default_rng(1).standard_normal((2, 4, 2))
    x[:, :, 1] = [0.0, 0.0, 0.0, 2.0]
    ratio, error, mean, mean_error = compared(x)
    assert ratio[1] == 1.0
    assert np.isfinite(error[0])
    assert np.isnan([error[1], mean_error]).all()
    assert "±" not in with_error(mean, mean_error)
    assert with_error(float("nan"), 1.0) == "-"


def test_the_ratio_and_its_error_are_those_of_known_spreads() -> None:
    rng = np.random.default_rng(2)
    runs = [compared(rng.standard_normal((2, 60, 3)) * np.array([[[3.0]], [[1.0]]])) for _ in range(200)]
    means, errors = np.array([r[2] for r in runs]), np.array([r[3] for r in runs])
    assert np.exp(np.log(means).mean()) == pytest.approx(3.0, rel=0.02)
    assert means.std() == pytest.approx(errors.mean(), rel=0.15)


def test_the_shipped_design_is_read_by_its_name_and_its_mistakes_name_the_file(tmp_path: Path) -> None:
    file = read_design("design")
    assert (file.design.criterion, file.verify.bodies, file.prior.spread) == ("D", 20, 0.2)
    bad = tmp_path / "bad.toml"
    bad.write_text("[design]\nname = 'a'\nseed = 1\nkeeep = 2\n", encoding="utf-8")
    with pytest.raises(DesignError, match=r"bad\.toml: design\.keeep: unknown key"):
        read_design(bad)
    assert main(["design", str(bad), "-o", str(tmp_path / "out")]) == Exit.BAD_INPUT
    assert parse_design({"design": {"name": "a", "seed": 1}}).limits.rate == 5.0


def test_fewer_cycles_give_larger_errors_as_their_number_says() -> None:
    file = parse_design(with_fields(limits={"duration_s": 4 * 14.56}))
    assert file.cycles == 4
    model = model_of(file, file.model)
    f, power = np.arange(1, 350, 2) / 43.72, np.full(175, 1e-3)
    few, many = (predicted(x, model, f, power) for x in (file, parse_design(SMALL)))
    np.testing.assert_allclose(few / many, np.sqrt(5 / 3), rtol=1e-6)


def test_a_picture_of_a_prediction_says_so(found: Any) -> None:
    assert design_picture(found).axes[1].get_title() == "predicted CV, no bounds"


def test_the_page_shows_both_spectra_and_the_errors_side_by_side(found: Any) -> None:
    page = design_page(found)
    assert all(f'id="{key}"' in page for key in ("spectrum", "cv"))
    ratio = found.bounded_cv[0] / found.bounded_cv[1]
    assert all(f"×{r:.3g}" in page for r in ratio)
    assert ("lower by (± MCSE)" in page) == bool(found.spreads)


def test_the_picture_of_the_errors_says_whether_they_are_predicted_or_found(found: Any) -> None:
    assert cv_bars(found, found.bounded_cv, title="predicted").get_title() == "predicted"
    assert ">predicted, with the bounds of the fit<" in design_page(found)


def test_a_waveform_at_an_unsuitable_rate_is_refused(found: Any) -> None:
    assert found.waveform(200.0)[1].max() == pytest.approx(found.stimulus.waveform().max(), rel=1e-9)
    for rate in (12.0, 100.01):
        with pytest.raises(InputError, match="rate_hz: expected a whole number of samples"):
            found.waveform(rate)


@pytest.fixture(scope="module")
def for_most() -> Any:
    return mc.design(with_fields(limits={"bodies_within": 0.95}))


def test_bodies_that_nobody_knew_keep_the_limit_of_the_sway_as_often_as_was_asked(found: Any, for_most: Any) -> None:
    """Counted with models of their own inertia, drawn one by one, and all lines of both stimuli."""
    d = for_most.designed
    share = []
    for design in (found, for_most):
        models = [model_of(d.file, section) for section in drawn(d.file, 150, np.random.default_rng(77))]
        pairs = [(size_of(m, design.stimulus).sway, size_of(m, d.sequence).sway) for m in models]
        share.append(np.mean([(one <= 1.0 * other * (1 + 1e-6)).all() for one, other in pairs]))
    assert share[0] < 0.8
    assert share[1] > 0.95 - 2.5 * np.sqrt(0.95 * 0.05 / 150)
    assert for_most.others.low <= 0.97
    assert for_most.others.within >= 0.94
    assert for_most.others.percentile_95 <= 1.02
    assert found.others.within == pytest.approx(share[0], abs=0.12)
    assert for_most.predicted_ratio.mean() < found.predicted_ratio.mean()  # which has its price
    text = " ".join(for_most.text().split())
    assert "Sway: 95 % of the bodies shall sway at most 1 times as much as with the sequence. Of 2,000 other" in text
    assert f"largest {for_most.others.largest:.3g} times" in " ".join(design_page(for_most).split())


def test_the_limit_holds_for_the_body_of_the_file_in_any_case(for_most: Any) -> None:
    one, other = for_most.sizes
    assert (other.sway <= one.sway * (1 + 1e-6)).all()
    assert for_most.designed.limits["limits.sway"] <= 1.0
    assert max(for_most.designed.limits.values()) > 0.98  # nothing is given away


def test_an_equivalent_body_is_as_stable_and_sways_as_much_as_the_drawn_one() -> None:
    """One mass divides the gains, in place of a body of its own; for a torque and for a motion of the platform."""
    for kind in ("ankle_torque", "platform_translation", "surface_tilt"):
        file = parse_design(with_fields(stimulus={"kind": kind}, design={"amplitude": 0.02}))
        base = model_of(file, file.model)
        sections = drawn(file, 8, np.random.default_rng(3))
        theta = equivalent(base, factors(file, base, 8, np.random.default_rng(3)))
        f = np.array([0.07, 0.3, 0.9, 2.5])
        for section, instead in zip(sections, theta, strict=True):
            body = model_of(file, section)
            assert growth_rate(base, instead) == pytest.approx(float(growth_rate(body, body.truth)), rel=1e-6)
            ratio = np.abs(frf(base, instead, f) / frf(body, body.truth, f))
            np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-9)


def test_a_share_of_bodies_that_no_stimulus_allows_is_refused_in_one_line() -> None:
    with pytest.raises(DesignError, match=r"^limits\.(bodies_within|sway): ") as error:
        mc.design(with_fields(design={"keep": 0.95}, limits={"sway": 0.985, "bodies_within": 0.95}))
    assert "\n" not in str(error.value)
