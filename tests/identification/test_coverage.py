"""The coverage study draws recordings that are like simulated ones, and counts rightly."""

from __future__ import annotations

import csv
import runpy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mcstudy.effect_library.library import apply
from mcstudy.errors import InputError
from mcstudy.fitting.penalised import Fitter, whiten
from mcstudy.fitting.problem import Data
from mcstudy.identification.bounds import bounded
from mcstudy.identification.minimum import without_prior
from mcstudy.models.quantities import quantities
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf
from mcstudy.stance.stability import growth_rate
from mcstudy.streams import stream
from pipelines.validation import coverage
from pipelines.validation.at_truth import judged, starts
from pipelines.validation.coverage import JUDGED, Condition, Source, body, truths

VALIDATION = Path(__file__).parents[2] / "pipelines" / "validation"


@pytest.fixture(scope="module")
def example() -> dict[str, Any]:
    return runpy.run_path(str(VALIDATION / "interval_coverage.py"))


def test_drawn_lines_scatter_as_their_covariance_says() -> None:
    """Errors of drawn lines, whitened by the estimated covariance, have the variance that its uncertainty implies."""
    source, model = Source(Condition(0, 6, 3.1)), two_segment()
    H = frf(model, model.truth, source(stream(0, "a test")).f)
    ratio = []
    for r in range(40):
        lines = source(stream(r, "a test"))
        white = np.einsum("nij,nj->ni", lines.noise.whitener, lines.y - H)
        ratio.append(np.mean(np.abs(white) ** 2, axis=0))  # 2 for the inverse of an unbiased precision
    np.testing.assert_allclose(np.mean(ratio, axis=0), 2.0, rtol=0.15)


def test_a_true_model_is_not_rejected_too_often_up_to_a_low_frequency() -> None:
    """The deviance of the truth has the mean of its null distribution; a covariance of few lines made it 9 % higher."""
    source, model = Source(Condition(0, 6, 1.2)), two_segment()
    drawn = [source(stream(r, "a test")) for r in range(150)]
    H = frf(model, model.truth, drawn[0].f)
    deviance = [(whiten(x.noise.whitener, x.y - H) ** 2).sum() for x in drawn]
    null = (drawn[0].noise.draw(np.random.default_rng(0), 2000) ** 2).sum(axis=0)
    assert np.mean(deviance) == pytest.approx(null.mean(), rel=0.05)  # three standard errors


def test_drawn_lines_are_those_of_a_simulated_recording() -> None:
    import mcstudy as mc

    condition = Condition(1, 3, 2.0)
    drawn = Source(condition)(stream(0, "a test"))
    lines = measure(mc.simulate(parameters=body(1), cycles=3), 8.0).below(2.0)
    np.testing.assert_allclose(drawn.f, lines.f)
    np.testing.assert_allclose(drawn.noise.dof, lines.noise.dof)
    np.testing.assert_allclose(drawn.power, lines.power, rtol=1e-6)
    assert np.exp(np.log(drawn.noise.variance / lines.noise.variance).mean()) == pytest.approx(1, abs=0.35)


def test_a_stopped_study_goes_on_and_counts_every_test(example: dict[str, Any], tmp_path: Path) -> None:
    settings = {"realizations": 3, "truths": [0], "cycles": [3], "amplitude": [5.0], "fmax": [1.2, 3.1], "block": 2}
    jobs = [(0, 3, 5.0, 0, 2), (0, 3, 5.0, 2, 3)]
    assert example["block"](jobs[0], settings["fmax"], tmp_path, "judged") > 0
    assert example["block"](jobs[0], settings["fmax"], tmp_path, "judged") == 0.0  # it is there
    example["block"](jobs[1], settings["fmax"], tmp_path, "judged")
    data = example["collect"](settings, tmp_path, jobs, "judged")
    whole = coverage.judgements(0, 3, settings["fmax"], 0, 3)[3.1]
    np.testing.assert_array_equal(data.rise.sel(fmax=3.1).values[0, 0, 0], whole[:, :, JUDGED.index("rise")])
    row = next(line for line in example["table"](data).splitlines() if line.startswith("mean"))
    assert float(row.split()[3]) == pytest.approx(100 * float(data.contained.sel(fmax=3.1).mean()), abs=0.06)
    example["write_csv"](data, tmp_path / "coverage.csv")
    rows = list(csv.DictReader((tmp_path / "coverage.csv").read_text().splitlines()))
    assert len(rows) == 2 * data.sizes["quantity"]
    last = 100 * float(data.contained.isel(fmax=-1, quantity=-1).mean())
    assert [float(rows[-1][c]) for c in ("percent", "lowest", "highest")] == pytest.approx([last] * 3, abs=0.01)
    assert rows[-1]["quantity"] == data.quantity.values[-1]


def test_intervals_contain_the_truth_where_the_test_at_the_truth_says_so(
    example: dict[str, Any], tmp_path: Path
) -> None:
    """Two ways to the same answer: both ends of an interval, and one fit with the quantity at its true value."""
    settings = {"realizations": 4, "truths": [0], "cycles": [6], "amplitude": [5.0], "fmax": [3.1], "block": 4}
    example["block"]((0, 6, 5.0, 0, 4), settings["fmax"], tmp_path, "ends")
    data = example["collect"](settings, tmp_path, [(0, 6, 5.0, 0, 4)], "ends")
    held = (data.low <= data.true_value) & (data.true_value <= data.high)
    np.testing.assert_array_equal(data.contained, held)
    found = example["table"](data)
    assert "the interval holds the truth and the test does not: 0.00 %; the reverse: 0.00 %" in found
    row = next(line for line in found.splitlines() if line.startswith("mean"))
    assert float(row.split()[1]) == pytest.approx(100 * float(held.mean()), abs=0.06)


def test_the_deviance_at_the_truth_is_that_of_another_optimiser() -> None:
    """The rise of the deviance with a quantity held, and the lowest minimum, by scipy's bounded least squares."""
    oracle = runpy.run_path(str(VALIDATION / "interval_oracle.py"))["Constrained"]
    held = runpy.run_path(str(VALIDATION / "interval_threshold.py"))["held"]
    model, theta = bounded(two_segment(), two_segment(), {}), np.array(list(body(0).values()))
    source = Source(Condition(0, 6, 3.1))
    lines, wanted = source(stream(0, "a test")), quantities(model)
    fitter = Fitter(model, without_prior(model, two_segment()), lines.f)
    further = starts(fitter, [0], 4)
    found, exact = (judged(fitter, [lines], wanted, theta, source.draws(), 0.95, further, x) for x in (False, True))
    minimum = found.minima[0].chi2[0]
    for k, name in ((1, "K12"), (12, "K11 + Kpas1")):
        other = oracle(SimpleNamespace(model=model, lines=lines), name)
        least, _ = other.least(wanted[k].value(theta), np.array([theta, found.minima[0].theta[0]]))
        tolerance = 1e-4 if found.rise[0, k] > 3.84 else 0.02  # below the ceiling the fit stops early
        assert found.rise[0, k] == pytest.approx(least - minimum, abs=tolerance)
        assert exact.rise[0, k] == pytest.approx(least - minimum, abs=1e-4)
        there = held(fitter, Data.of(lines), wanted[k], wanted[k].value(theta), theta[None])
        assert wanted[k].value(there) == pytest.approx(wanted[k].value(theta), rel=1e-6)
        residual = whiten(Data.of(lines).weight, lines.y - frf(model, there, lines.f))
        assert residual @ residual == pytest.approx(least, abs=1e-4)


def test_the_study_with_wide_bounds_lets_estimates_leave_those_of_a_fit() -> None:
    estimate, P = JUDGED.index("estimate"), 12
    inside, wide = (coverage.judgements(0, 3, [1.2], 0, 4, b)[1.2][:, :P, estimate] for b in (None, coverage.opened()))
    model = bounded(two_segment(), two_segment(), {})
    assert ((inside >= model.lower) & (inside <= model.upper)).all()
    assert (wide < model.lower).any()


def test_the_bodies_differ_lie_within_their_spread_and_stand() -> None:
    nominal = two_segment()
    ratio = np.array([np.array(list(body(k).values())) / nominal.truth for k in range(4)])
    np.testing.assert_array_equal(ratio[0], 1)
    assert (np.abs(ratio[1:] - 1).max(axis=1) > 0.05).all()
    assert (np.abs(ratio - 1) <= 0.2).all()
    assert len(np.unique(ratio[:, 0])) == 4
    assert (growth_rate(nominal, ratio * nominal.truth) < 0).all()


def test_an_effect_of_the_body_is_a_quantity_like_the_others() -> None:
    effects = {"passive_damping_ankle": 60.0}
    names = [q.name for q in quantities(apply(two_segment(), *effects))]
    assert truths(1, names, effects)[names.index("Bpas1")] == 60.0
    found = coverage.judgements(0, 3, [1.2], 0, 2, effects=effects)[1.2]
    assert found.shape == (2, len(names), len(JUDGED))
    with_effect, without = (Source(Condition(0, 3, 3.1), effects=e)(stream(0, "a test")).y for e in (effects, None))
    assert np.abs(with_effect / without - 1).max() > 0.05


def test_true_values_of_sums_are_sums() -> None:
    values = body(2)
    np.testing.assert_allclose(truths(2, ["K11", "K11 + Kpas1"]), [values["K11"], values["K11"] + values["Kpas1"]])


def test_a_wrong_settings_file_is_one_line(example: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text("realizations = 5\n")
    with pytest.raises(InputError, match=r"wrong.toml: expected the fields realizations, truths"):
        example["read"](file)
