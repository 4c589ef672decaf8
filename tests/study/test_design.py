"""A study built in Python is the study of the file that says the same."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import told

from mcstudy.analysis.show.tables import show
from mcstudy.cli import main
from mcstudy.errors import DesignError
from mcstudy.exits import Exit
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube.store import Cube
from mcstudy.study.design import FitSection, Group, ModelSection, NoiseSection, Study, StudySection
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study

TEXT = """
[study]
name = "built"
seed = 7
[noise]
psd = [1e-4, 7e-5]
[group.noisy]
realizations = 3
starts = 2
fmax = [0.41, 1.2]
amplitude = [3.0, 5.0]
[group.noisy.model.truth]
K11 = 1100.0
[group.ideal]
simulator = "none"
realizations = 1
starts = 2
fmax = [8.0]
amplitude = [5.0]
"""


def built() -> Study:
    noise = NoiseSection(psd=np.array([1e-4, 7e-5]))  # type: ignore[arg-type]
    return Study(
        study=StudySection(name="built", seed=np.int64(7)),  # type: ignore[arg-type]
        group={
            "noisy": Group(
                realizations=np.int32(3),  # type: ignore[arg-type]
                starts=2,
                fmax=[1.2, 0.41],  # type: ignore[arg-type]
                amplitude=np.array([3, 5]),  # type: ignore[arg-type]
                noise=noise,
                model=ModelSection(truth={"K11": np.float64(1100.0)}),
            ),
            "ideal": Group(realizations=1, starts=2, fmax=(8.0,), amplitude=(5.0,), simulator="none", noise=noise),
        },
    )


def test_it_is_the_study_of_the_file() -> None:
    study, read = built(), parse_study(TEXT)
    assert study == read
    assert study.fingerprint == read.fingerprint
    assert study.to_toml() == read.to_toml()
    assert Study.from_json(study.to_json()) == study
    assert Study(study=read.study, group=read.groups) == read


def test_its_cube_opens_shows_and_verifies(tmp_path: Path) -> None:
    out = tmp_path / "built.zarr"
    run_study(built(), out, ClusterOptions(workers=1))
    assert Cube.open(out).study == parse_study(TEXT)
    assert "Group noisy" in show(out).details()
    for verb in ("status", "verify", "show"):
        assert main([verb, str(out)]) == Exit.DONE
    file = tmp_path / "built.toml"
    file.write_text(TEXT)
    assert "complete: nothing to run" in told("run", str(file), "-o", str(out), "--workers", "1")


def group(**changes: Any) -> dict[str, Any]:
    return {"realizations": 1, "starts": 1, "fmax": [1.2], "amplitude": [5.0], **changes}


HEAD = {"name": "x", "seed": 1}

MISTAKES: list[tuple[Callable[[], object], str]] = [
    (
        lambda: Study(study=HEAD, group={"g": group(fmax="100")}),  # type: ignore[arg-type]
        "group.g.fmax: expected a list, got '100'",
    ),
    (
        lambda: Study(study=HEAD, group={"g": group(fmax=[100.0])}),  # type: ignore[arg-type]
        "group.g.fmax: expected at most 8.005 Hz, the last frequency, got 100.0",
    ),
    (
        lambda: Study(study=HEAD, group={"g": group(model={"truth": {"K99": 1.0}})}),  # type: ignore[arg-type]
        "group.g.model.truth.K99: unknown parameter",
    ),
    (
        lambda: Study(study=HEAD, group={"../x": group()}),  # type: ignore[arg-type]
        "group.../x: expected text matching pattern",
    ),
    (lambda: Study(study=HEAD, group={}), "group: expected a table with at least 1 item"),  # type: ignore[arg-type]
    (lambda: Group(**group(realizations=0)), "realizations: expected at least 1, got 0"),
    (lambda: Group(**group(realizations=2.5)), "realizations: expected a whole number, got 2.5"),
    (lambda: Group(**group(amplitude=[1e308])), "amplitude.0: expected a number from 1e-06 to 1e+06, got 1e+308"),
    (lambda: Group(**group(strats=1)), "strats: unknown key, expected one of realizations, starts"),
    (lambda: NoiseSection(psd=(np.nan, 1.0)), "psd.0: expected a finite number, got nan"),
    (lambda: FitSection(cost="magic"), "cost: expected 'paper' or 'ml', got 'magic'"),  # type: ignore[arg-type]
    (lambda: StudySection(name="x"), "seed: missing"),  # type: ignore[call-arg]
    (lambda: StudySection(name="\ud800", seed=1), "StudySection: expected text that UTF-8 can hold"),
    (lambda: StudySection(name="x", seed=object()), "StudySection: expected numbers, text, lists"),  # type: ignore[arg-type]
]


@pytest.mark.parametrize(("build", "line"), MISTAKES, ids=[m[1][:40] for m in MISTAKES])
def test_a_mistake_is_the_line_that_a_file_gets(build: Callable[[], object], line: str) -> None:
    with pytest.raises(DesignError) as refused:
        build()
    assert str(refused.value).startswith(line)
    assert "\n" not in str(refused.value)
    assert "pydantic" not in str(refused.value)
