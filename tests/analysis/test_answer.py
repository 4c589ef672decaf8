"""The first screen of ``show``: what is determined comes first, in few lines, with the numbers of the tables."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import xarray as xr

from mcstudy.analysis.determined import determined, lost
from mcstudy.analysis.show.answer import answer, best, main_group
from mcstudy.analysis.show.selection import Selection, selected
from mcstudy.analysis.show.tables import Report, report_of
from mcstudy.errors import InputError

Cube = Callable[..., xr.Dataset]


@pytest.fixture(scope="module")
def report(make_cube: Cube) -> Report:
    """A study with a group without noise and one of three Fmax and two amplitudes."""
    root = xr.Dataset(attrs={"title": "invented", "fingerprint": "f" * 64, "seed": 7})
    groups = {
        "theory": make_cube(realizations=1, starts=20, spread=0.0, simulator="none", fmax=(8.0,), amplitude=(5.0,)),
        "accuracy": make_cube(realizations=30, starts=3, spread=0.1),
    }
    return report_of(xr.DataTree.from_dict({"/": root, **groups}))


@pytest.fixture
def cell(report: Report) -> dict[str, Any]:
    """The condition that the screen is about."""
    return best(report.data["groups"]["accuracy"]["cells"])


def test_the_answer_fits_on_one_screen(report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    lines = report.text().splitlines()
    assert len(lines) <= 21
    assert max(map(len, lines)) <= 80


def test_the_finding_counts_the_determined_parameters_of_the_best_condition(
    report: Report, cell: dict[str, Any]
) -> None:
    fitted = [p for p in cell["parameters"] if "at_lower_bound" in p]
    on_bound = [p["at_lower_bound"]["value"] + p["at_upper_bound"]["value"] for p in fitted]
    found = sum(determined(p["cv"]["value"], on) for p, on in zip(fitted, on_bound, strict=True))
    assert f"{found} of 12 parameters are determined" in " ".join(report.text().split())
    errors = [
        sum(p["rmse"]["value"] / abs(p["truth"]) for p in c["parameters"])
        for c in report.data["groups"]["accuracy"]["cells"]
    ]
    assert sum(p["rmse"]["value"] / abs(p["truth"]) for p in cell["parameters"]) == min(errors)


def test_bias_and_cv_are_those_of_the_tables_in_percent(report: Report, cell: dict[str, Any]) -> None:
    k11 = cell["parameters"][0]
    (line,) = [x for x in report.text().splitlines() if x.startswith("K11 ")]
    assert float(line.split()[1]) == pytest.approx(100 * k11["bias"]["value"] / k11["truth"], abs=0.051)
    assert float(line.split()[4]) == pytest.approx(100 * k11["cv"]["value"], rel=0.06)


@pytest.mark.parametrize(
    ("cv", "on_bound", "is_determined", "is_lost"),
    [
        (0.1, 0.0, True, False),
        (0.1, 0.2, False, False),
        (0.3, 0.0, False, False),
        (0.6, 0.0, False, True),
        (0.1, 0.5, False, True),
    ],
)
def test_a_parameter_is_determined_by_the_data_not_by_its_bounds(
    cv: float, on_bound: float, is_determined: bool, is_lost: bool
) -> None:
    assert (determined(cv, on_bound), lost(cv, on_bound)) == (is_determined, is_lost)


def test_a_group_with_noise_answers(report: Report) -> None:
    assert main_group(report.data) == "accuracy"
    alone = selected(report.data, Selection(groups=["theory"]))
    assert "Without noise (group theory) the largest error of a best fit is" in " ".join(answer(alone).split())


def test_a_selection_keeps_what_is_wanted_and_nothing_else(report: Report) -> None:
    wanted = Selection(fmax=[1.2], amplitude=[5.0], parameters=["Kpas1", "K11"])
    (group,) = selected(report.data, wanted)["groups"].values()
    (cell,) = group["cells"]
    assert (cell["fmax"], cell["amplitude"], [p["name"] for p in cell["parameters"]]) == (1.2, 5.0, ["K11", "Kpas1"])
    assert "Kpas1" in Report(selected(report.data, wanted)).groups()


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        (Selection(fmax=[1.3]), "--fmax 1.3: expected one of 0.41, 1.2, 8"),
        (Selection(amplitude=[7.0]), "--amplitude 7: expected one of 3, 5"),
        (Selection(groups=["acuracy"]), "--group acuracy: expected one of theory, accuracy (similar: accuracy)"),
        (Selection(parameters=["k11"]), "(similar: K11)"),
    ],
)
def test_what_a_study_does_not_have_is_refused_with_what_it_has(report: Report, wanted: Selection, said: str) -> None:
    with pytest.raises(InputError, match="expected one of") as refused:
        report.selected(wanted)
    assert said in str(refused.value)


def test_the_table_of_starts_has_every_condition(report: Report) -> None:
    lines = [x for x in report.starts().splitlines() if x.startswith(("theory:", "accuracy:"))]
    assert len(lines) == 7
