"""What ``show`` says: the paper's rows beside ours, for any study, as text and as validated JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import jsonschema
import numpy as np
import pytest
import xarray as xr
from mcstudy_goodworth2018.paper.rows import Row, rows
from mcstudy_goodworth2018.paper.statements import RESULTS

import mcstudy.analysis.accessor  # noqa: F401 - registers .mc
from mcstudy.analysis import montecarlo
from mcstudy.analysis.publications import sampling
from mcstudy.analysis.publications.verdict_names import DIFFERS
from mcstudy.analysis.show.tables import Report, report_of
from mcstudy.analysis.show.text import within
from mcstudy.analysis.view import StudyView
from mcstudy.files import schema
from mcstudy.fitting.status import Status
from mcstudy.text_tables import number, table, with_error

Cube = Callable[..., xr.Dataset]


def tree(**groups: xr.Dataset) -> xr.DataTree:
    """A cube of named groups as `open_results` gives it."""
    root = xr.Dataset(attrs={"title": "invented", "fingerprint": "f" * 64, "seed": 7})
    return xr.DataTree.from_dict({"/": root, **groups})


@pytest.fixture(scope="module")
def paper_study(make_cube: Cube) -> xr.DataTree:
    """All groups of the paper's study, with invented fits."""
    accuracy = make_cube(realizations=50, starts=3, spread=0.3)
    return tree(
        theory=make_cube(realizations=1, starts=100, spread=0.0, simulator="none", fmax=(8.0,), amplitude=(5.0,)),
        accuracy=accuracy,
        convergence=make_cube(realizations=20, starts=120, fmax=(1.2,)),
        convergence_noise_free=make_cube(realizations=5, starts=120, simulator="none", fmax=(1.2,), amplitude=(5.0,)),
    )


@pytest.fixture(scope="module")
def paper_report(paper_study: xr.DataTree) -> Report:
    """Its report."""
    return report_of(paper_study)


def test_the_tables_of_a_cube_read_in_pieces_are_those_of_one_in_memory(
    make_cube: Cube, monkeypatch: pytest.MonkeyPatch
) -> None:
    cube = make_cube(realizations=230, starts=3, spread=0.3)
    whole = report_of(tree(accuracy=cube)).data
    monkeypatch.setattr(montecarlo, "NUMBERS_A_PIECE", 12 * 6 * 40)
    monkeypatch.setattr(sampling, "BLOCKS_AT_ONCE", 1)
    assert len(montecarlo.pieces(cube["estimate"].isel(start=0))) == 6
    lazy = cube.chunk(amplitude=1, realization=37)
    assert same(report_of(tree(accuracy=lazy)).data, whole) > 1000


def same(found: Any, expected: Any) -> int:
    """Number of values compared; numbers are equal to rounding, everything else is the same."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        return sum(same(found[key], value) for key, value in expected.items())
    if isinstance(expected, list):
        assert len(found) == len(expected)
        return sum(same(*pair) for pair in zip(found, expected, strict=True))
    assert found == (pytest.approx(expected, rel=1e-9, abs=1e-12) if isinstance(expected, float) else expected)
    return 1


def row_of(cube: xr.Dataset, key: str) -> Row:
    """One row of a study of a single group."""
    return next(r for r in rows(StudyView(tree(a=cube))) if r.published.key == key)


def test_every_published_statement_has_a_row_in_the_papers_own_study(paper_study: xr.DataTree) -> None:
    found = rows(StudyView(paper_study))
    assert [r.published.key for r in found] == list(RESULTS)
    for row in found:
        # invented fits without noise are exact: errors that are rounding have no ranking
        assert np.isfinite(row.ours.value) == (row.published.key not in ("theory_worst", "theory_relation"))
        assert row.published.where
        assert bool(row.note) == (row.verdict.name == DIFFERS), row.published.key


def test_a_row_differs_beyond_three_errors_of_both_studies(make_cube: Cube) -> None:
    cube = make_cube(realizations=50, starts=1, spread=0.3)
    row = row_of(cube, "spread_amplitude_8")
    assert row.verdict.error == pytest.approx(np.sqrt(2) * row.ours.mcse)
    beyond = max(abs(row.ours.value - 9.4) - 0.05, 0)
    assert abs(row.verdict.distance) == pytest.approx(beyond / row.verdict.error)
    # half the spread at 5 N m: 50 % lower, far from the paper's 9.4
    halved = cube.copy()
    halved["estimate"] = (
        halved["estimate"]
        .where(halved["amplitude"] == 3.0, 0.5 * (halved["estimate"] + halved["truth"]))
        .transpose(*cube["estimate"].dims)
    )
    row = row_of(halved, "spread_amplitude_8")
    assert 30 < row.ours.value < 65
    assert row.verdict.name == DIFFERS
    assert "stand-in" in row.note


def test_bias_rows_average_over_both_amplitudes_and_carry_their_floor(make_cube: Cube) -> None:
    cube = make_cube(realizations=50, starts=1, spread=0.3)
    row = row_of(cube, "bias_12_1.2")
    x = cube["estimate"].sel(fmax=1.2).isel(start=0)
    expected = 100 * abs(x.mean("realization") / cube["truth"] - 1).mean()
    assert row.ours.value == pytest.approx(float(expected))
    assert row.floor == pytest.approx(100 * 0.3 / np.sqrt(50) * np.sqrt(2 / np.pi), rel=0.1)


def test_the_starts_to_the_asymptote_range_over_tolerances(paper_study: xr.DataTree) -> None:
    found = {r.published.key: r for r in rows(StudyView(paper_study))}
    for key in ("starts_noise_free", "starts_5", "starts_3"):
        ours = found[key].ours
        assert ours.low <= ours.high
        assert "of single starts reach the minimum" in ours.detail
    assert "at 1e-6 excess" in found["starts_3"].ours.detail
    # without noise one start in two ends at zero: the last of them decides how small the mean must get
    assert "at 1e-11 J" in found["starts_noise_free"].ours.detail
    assert found["starts_noise_free"].ours.low < found["starts_noise_free"].ours.high


@pytest.mark.parametrize(
    "settings",
    [
        {"fmax": (1.0, 2.0)},
        {"amplitude": (1.0,)},
        {"fit": {"cost": "ml"}},
        {"model": {"kind": "one_segment"}},
        {"stimulus": {"kind": "hip_torque"}},
    ],
)
def test_a_study_the_paper_says_nothing_about_has_no_accuracy_rows(make_cube: Cube, settings: dict[str, Any]) -> None:
    report = report_of(tree(mine=make_cube(**settings)))
    keys = {r["key"] for r in report.data["paper"]["rows"]}
    assert not {k for k in keys if k.startswith(("bias", "spread_fmax", "spread_amplitude", "lowest", "starts"))}
    text = report.details()
    assert "Group mine" in text
    assert "stand-in" in text


def test_what_differs_from_the_default_settings_is_said(make_cube: Cube) -> None:
    bounds = {"bounds": {"lower": 0.5}}
    report = report_of(tree(a=make_cube(model=bounds), b=make_cube()))
    assert report.data["groups"]["a"]["differences"] == ["model.bounds.lower = 0.5"]
    assert report.data["groups"]["b"]["differences"] == []
    assert "Differs from the default settings in: model.bounds.lower = 0.5" in report.details()


def test_json_conforms_to_its_schema_and_holds_no_nan(paper_report: Report) -> None:
    document = json.loads(paper_report.json(), parse_constant=lambda name: pytest.fail(f"{name} in the JSON"))
    definition = schema.load("show")
    jsonschema.Draft202012Validator.check_schema(definition)
    jsonschema.Draft202012Validator(definition).validate(document)
    assert document["schema"] == definition["$id"]


def test_the_schema_refuses_what_it_does_not_know(paper_report: Report) -> None:
    data = json.loads(paper_report.json())
    data["groups"]["accuracy"]["cells"][0]["bias"] = 1
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft202012Validator(schema.load("show")).validate(data)


def test_numbers_of_the_tables_are_those_of_the_accessor(make_cube: Cube) -> None:
    cube = make_cube(realizations=10)
    cell = report_of(tree(g=cube)).data["groups"]["g"]["cells"][4]
    where = {"amplitude": cell["amplitude"], "fmax": cell["fmax"]}
    assert (cell["amplitude"], cell["fmax"]) == (5.0, 1.2)
    entry = next(p for p in cell["parameters"] if p["name"] == "B12")
    for measure in ("bias", "sd", "cv", "rmse"):
        there = getattr(cube.mc, measure)().sel(where).sel(parameter="B12")
        assert entry[measure]["value"] == pytest.approx(float(there["value"]))
        assert entry[measure]["mcse"] == pytest.approx(float(there["mcse"]))
    assert cell["parameters"][-2]["name"] == "K11+Kpas1"


@pytest.mark.parametrize("left", [0, 1])
def test_an_unfinished_cube_shows_what_it_has(make_cube: Cube, left: int) -> None:
    cube = make_cube(realizations=4)
    cube["status"][:, :, left:] = Status.PENDING
    for name in ("estimate", "cost", "growth_rate", "initial"):
        cube[name][:, :, left:] = np.nan
    cube["noise_covariance"][:, left:] = np.nan
    report = report_of(tree(g=cube))
    assert report.data["groups"]["g"]["cells"][0]["realizations"] == {
        "used": left, "not_run": 4 - left, "non_finite": 0, "diverged": 0, "failed": 0,
    }  # fmt: skip
    assert f"{left}/4" in report.details()
    assert "pending" in report.details()


def test_a_failed_fit_is_named_in_the_text(make_cube: Cube) -> None:
    cube = make_cube()
    cube["status"][0, 0, 0, 0] = Status.SOLVER_ERROR
    assert "1 solver error" in report_of(tree(g=cube)).details()


def test_efficiency_is_that_within_the_box_where_bounds_are_active(make_cube: Cube) -> None:
    cube = make_cube(realizations=4, fmax=(1.2,), amplitude=(3.0,))
    assert "efficiency 'b'" not in report_of(tree(g=cube)).details()
    cube["at_bound"][..., 0] = 1
    report = report_of(tree(g=cube))
    assert "efficiency 'b': the Cramér-Rao bound does not apply" in report.details()
    line, of_bounds = [x for x in report.details().splitlines() if x.startswith("K11 ")]
    assert line.endswith(" b")
    assert " to " in of_bounds
    entry = report.data["groups"]["g"]["cells"][0]["parameters"][0]
    assert entry["median_bias"]["value"] == pytest.approx(float(cube.mc.median_bias()["value"][0, 0, 0]))
    assert entry["quantile_95"]["value"] == pytest.approx(float(cube.mc.quantiles((0.95,))["value"][0, 0, 0, 0]))
    found = report.data["groups"]["g"]["cells"][0]["parameters"][0]["efficiency"]
    assert found["box"] == pytest.approx(float(cube.mc.efficiency()["box"][0, 0, 0]))


def test_efficiency_is_marked_and_withheld_where_another_parameters_bound_lends_the_information(
    make_cube: Cube,
) -> None:
    cube = make_cube(realizations=20, fmax=(1.2,), amplitude=(3.0, 5.0))
    kpas1 = [str(n) for n in cube["parameter"].values].index("Kpas1")
    cube["at_bound"][0, :, :, :, kpas1] = 1
    report = report_of(tree(g=cube))
    bounded, free = report.data["groups"]["g"]["cells"]
    for cell, applies in ((bounded, False), (free, True)):
        for entry in cell["parameters"]:
            found = entry["efficiency"]
            assert found["applies"] is applies, entry["name"]
            assert (found["value"] is not None) is applies, entry["name"]
            assert (found["mcse"] is not None) is applies, entry["name"]
    assert [p["name"] for p in free["parameters"]][-2:] == ["K11+Kpas1", "K22+Kpas2"]
    text = report.details()
    (line,) = [x for x in text.splitlines() if x.startswith("K11 ")]
    assert line.split().count("b") == 1


def test_text_fits_a_terminal(paper_report: Report) -> None:
    text = paper_report.details()
    head = text[: text.index("Group theory")]
    assert max(map(len, head.splitlines())) <= 118
    assert not any(line.endswith(" ") for line in text.splitlines())


@pytest.mark.parametrize(
    ("value", "mcse", "expected"),
    [
        (5.8123, 0.4567, "5.81 ± 0.46"),
        (-21.5, 12.3, "-22 ± 12"),
        (1234.6, 250.0, "1235 ± 250"),
        (0.0732, 0.0061, "0.0732 ± 0.0061"),
        (3.2e-13, 1e-13, "3.2e-13 ± 1.0e-13"),
        (4.0, 0.0, "4.00"),
        (None, 1.0, "-"),
        (2.5, None, "2.50"),
    ],
)
def test_a_number_is_printed_to_the_second_digit_of_its_error(value: Any, mcse: Any, expected: str) -> None:
    assert with_error(value, mcse) == expected


@pytest.mark.parametrize(
    ("value", "expected"), [(0.0, "0.00"), (999.96, "1000"), (0.041, "0.0410"), (1e-11, "1.00e-11")]
)
def test_plain_numbers(value: float, expected: str) -> None:
    assert number(value) == expected


def test_the_count_of_near_rows_leaves_out_what_cannot_be_compared_and_judges_exact_rows_by_their_verdict() -> None:
    rows = [
        {"verdict": "agrees", "distance": None},
        {"verdict": "differs", "distance": None},
        {"verdict": "cannot tell", "distance": -2.9},
        {"verdict": "cannot tell", "distance": 3.1},
        {"verdict": "differs", "distance": -8.0},
        {"verdict": None, "distance": None},
    ]
    assert within(rows) == "Within 3 standard errors of both studies: 2 of 5 rows."


def test_a_table_aligns_its_columns() -> None:
    assert table(["", "paper"], [["bias", "5.8"], ["a longer name", "-"]]).splitlines() == [
        "               paper",
        "-------------  -----",
        "bias             5.8",
        "a longer name      -",
    ]


def test_a_report_is_its_data() -> None:
    assert json.loads(Report({"a": 1}).json()) == {"a": 1}
