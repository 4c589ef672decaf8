"""The statements of Pasma et al. (2017) are those of the study's own models, beside it in `show` and `report`."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from mcstudy_pasma2017.comparison import STATEMENTS, provider
from mcstudy_pasma2017.sensitivity import F, Sensitivity

import mcstudy as mc
from mcstudy.analysis.publications import publication
from mcstudy.analysis.view import StudyView
from mcstudy.cli import main
from mcstudy.models.catalogue import read_model
from mcstudy.models.check import response
from mcstudy.report.study.context import Context
from mcstudy.report.study.tables import headline
from mcstudy.study.study_file import parse_study

STUDY = """
[study]
name = "both"
seed = 1
[model]
kind = "independent_channel"
[group.{first}]
simulator = "none"
realizations = 1
starts = 1
fmax = [2.45]
amplitude = [1.0]
[group.space]
simulator = "none"
realizations = 1
starts = 1
fmax = [2.45]
amplitude = [1.0]
model = {{ kind = "independent_channel_visual" }}
"""


def shown(tmp_path: Path, text: str) -> tuple[Path, dict[str, publication.Row]]:
    out = tmp_path / "both.zarr"
    mc.run(parse_study(text), out)
    return out, {row.published.key: row for row in provider.rows(StudyView(mc.open_results(out)))}


def test_both_readings_are_compared_and_the_weight_tells_them_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(publication, "publications", lambda: (provider,))  # whatever else is installed
    out, rows = shown(tmp_path, STUDY.format(first="surface"))
    assert list(rows) == [f"{key}_{reading}" for reading in ("surface", "space") for key in STATEMENTS]
    assert [key for key, row in rows.items() if row.verdict.name != "agrees"] == ["weight_phase_surface"]
    assert rows["weight_phase_space"].ours.value == pytest.approx(1.0, abs=1e-9)  # a factor changes no phase
    assert main(["show", str(out), "--paper"]) == 0
    assert "weight changes no phase, surface" in capsys.readouterr().out
    context = Context(mc.open_results(out))
    assert "Passive torque relative to the surface, or to space" in headline(context)
    assert "9.80 %, 7.63°" in provider.section(context, [])[2]  # the delay at 0.5-0.9 Hz


def test_a_study_with_other_true_values_is_not_compared(tmp_path: Path) -> None:
    changed = STUDY.format(first="own").replace("amplitude = [1.0]\n", "amplitude = [1.0]\nmodel.truth.Kp = 900.0\n", 1)
    _, rows = shown(tmp_path, changed)
    assert {row.group for row in rows.values()} == {"space"}


@pytest.mark.parametrize("name", ["independent_channel", "independent_channel_visual"])
def test_sensitivities_are_differences_of_the_independent_evaluation(name: str) -> None:
    table = read_model(name)
    values = {p.name: p.value for p in table.model().parameters}
    found, step = Sensitivity(table.model()), 1e-6
    for parameter, value in values.items():
        up, down = (response(table, values | {parameter: value * (1 + s)}, F)[:, 0] for s in (step, -step))
        relative = 0.1 * np.log(up / down) / (2 * step)
        np.testing.assert_allclose(found.magnitude(parameter), 100 * relative.real, atol=1e-5)
        np.testing.assert_allclose(found.phase(parameter), np.degrees(relative.imag), atol=1e-5)


def test_the_package_names_its_publication() -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text("utf-8"))["project"]
    assert project["entry-points"][publication.GROUP]["pasma2017"] == "mcstudy_pasma2017.comparison:provider"
