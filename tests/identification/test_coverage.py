"""The coverage study draws recordings that are like simulated ones, and counts rightly."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mcstudy.errors import InputError
from mcstudy.identification.coverage import COLUMNS, Condition, Source, body, intervals, truths
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf
from mcstudy.streams import stream

EXAMPLES = Path(__file__).parents[2] / "pipelines" / "examples"


@pytest.fixture(scope="module")
def example() -> dict[str, Any]:
    return runpy.run_path(str(EXAMPLES / "interval_coverage.py"))


def test_drawn_lines_scatter_as_their_covariance_says() -> None:
    """Errors of drawn lines, whitened by the estimated covariance, have the variance that its uncertainty implies."""
    source, model = Source(Condition(0, 6, 3.1)), two_segment()
    H = frf(model, model.truth, source.f)
    ratio = []
    for r in range(40):
        lines = source(stream(r, "a test"))
        white = np.einsum("nij,nj->ni", lines.noise.whitener, lines.y - H)
        ratio.append(np.mean(np.abs(white) ** 2, axis=0))  # 2 for the inverse of an unbiased precision
    np.testing.assert_allclose(np.mean(ratio, axis=0), 2.0, rtol=0.15)


def test_drawn_lines_are_those_of_a_simulated_recording() -> None:
    import mcstudy as mc

    condition = Condition(1, 3, 2.0)
    drawn = Source(condition)(stream(0, "a test"))
    lines = measure(mc.simulate(parameters=body(1), cycles=3), 2.0)
    np.testing.assert_allclose(drawn.f, lines.f)
    np.testing.assert_allclose(drawn.noise.dof, lines.noise.dof)
    np.testing.assert_allclose(drawn.power, lines.power, rtol=1e-6)
    assert np.exp(np.log(drawn.noise.variance / lines.noise.variance).mean()) == pytest.approx(1, abs=0.35)


def test_a_stopped_study_goes_on_and_counts_every_interval(example: dict[str, Any], tmp_path: Path) -> None:
    settings = {"realizations": 3, "truths": [0], "cycles": [3], "fmax": [1.2], "block": 2}
    jobs = [(Condition(0, 3, 1.2), 0, 2), (Condition(0, 3, 1.2), 2, 3)]
    assert example["block"](jobs[0], tmp_path, False) > 0
    assert example["block"](jobs[0], tmp_path, False) == 0.0  # it is there
    example["block"](jobs[1], tmp_path, False)
    data = example["collect"](settings, tmp_path, jobs)
    whole = intervals(Condition(0, 3, 1.2), 0, 3)["intervals"]
    np.testing.assert_array_equal(data.low.values[0, 0, 0], whole[:, :, COLUMNS.index("low")])
    held = (data.low <= data.true_value) & (data.true_value <= data.high)
    row = next(line for line in example["table"](data).splitlines() if line.startswith("mean"))
    assert float(row.split()[1]) == pytest.approx(100 * float(held.mean()), abs=0.06)


def test_true_values_of_sums_are_sums() -> None:
    values = body(2)
    np.testing.assert_allclose(truths(2, ["K11", "K11 + Kpas1"]), [values["K11"], values["K11"] + values["Kpas1"]])


def test_a_wrong_settings_file_is_one_line(example: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text("realizations = 5\n")
    with pytest.raises(InputError, match=r"wrong.toml: expected the fields realizations, truths"):
        example["read"](file)
