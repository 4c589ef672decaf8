"""One small study of the paper's design and one of everything else, run once for the tests of the report."""

from __future__ import annotations

from pathlib import Path

import pytest
import xarray as xr
from mcstudy_goodworth2018.alternatives.files import write_alternative

from mcstudy import open_results
from mcstudy.cli import main
from mcstudy.exits import Exit

PAPER_LIKE = """
[study]
name = "paperlike"
seed = 5
description = "Paper & <b>miniature</b>"

[group.theory]
simulator = "none"
realizations = 1
starts = 60
fmax = [8.0]
amplitude = [5.0]

[group.accuracy]
realizations = 5
starts = 5
fmax = [0.41, 1.2, 8.0]
amplitude = [3.0, 5.0]
"""

OTHER = """
[study]
name = "other"
seed = 5

[group.single]
realizations = 5
starts = 1
fmax = [1.2]
amplitude = [4.0]

[group.single.model]
kind = "one_segment"

[group.ml]
realizations = 5
starts = 3
fmax = [2.0]
amplitude = [4.0]

[group.ml.fit]
cost = "ml"

[group.ml.stimulus]
kind = "hip_torque"
"""


def _run(folder: Path, text: str) -> Path:
    study, out = folder / "study.toml", folder / "out.zarr"
    study.write_text(text)
    assert main(["run", str(study), "-o", str(out), "--workers", "1"]) == Exit.DONE
    return out


@pytest.fixture(scope="session")
def paper_cube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _run(tmp_path_factory.mktemp("paperlike"), PAPER_LIKE)


@pytest.fixture(scope="session")
def other_cube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _run(tmp_path_factory.mktemp("other"), OTHER)


@pytest.fixture(scope="session")
def paper_tree(paper_cube: Path) -> xr.DataTree:
    return open_results(paper_cube)


@pytest.fixture(scope="session")
def other_page(other_cube: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("page") / "other.html"
    assert main(["report", str(other_cube), "-o", str(file)]) == Exit.DONE
    return file


TWO_STIMULI = {
    "kind": "two_stimuli",
    "command": "python two_stimuli.py -o two.json",
    "settings": {"realizations": 3, "sensor noise": "the paper's"},
    "frequency": [0.1, 0.3, 1.0],
    "estimators": [
        {
            "name": name,
            "stimuli": stimuli,
            "controllers": {
                c: {"off": [off, off, off], "chance": [2.0, 2.5, 3.0], "single": [20.0, 25.0, 30.0]}
                for c in ("T11", "T21", "T12", "T22")
            },
        }
        for name, stimuli, off in (("two <stimuli>", 2, 2.25), ("one stimulus", 1, 150.0))
    ],
}
POPULATION = {
    "kind": "population",
    "command": "python population.py -o population.json",
    "settings": {"populations": 4},
    "rows": [
        {
            "name": name,
            "mean_of_fits": {"bias": 1.0, "mcse": 0.5, "sd": 2.0},
            "fit_to_mean": {"bias": 1.0 + off, "mcse": 1.0, "sd": 5.0},
            "difference": {"value": off, "mcse": 1.0},
        }
        for name, off in (("K11", 2.5), ("Kpas1", 170.0))
    ],
}


@pytest.fixture(scope="session")
def alternatives(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Files of the examples with numbers that are easy to find again."""
    folder = tmp_path_factory.mktemp("alternatives")
    files = [folder / "two.json", folder / "population.json"]
    for file, content in zip(files, (TWO_STIMULI, POPULATION), strict=True):
        write_alternative(file, content)
    return files


@pytest.fixture(scope="session")
def paper_page(
    paper_cube: Path, other_cube: Path, alternatives: list[Path], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The page of the paper's study with everything there is beside it."""
    file = tmp_path_factory.mktemp("page") / "paper.html"
    beside = ["--beside", str(other_cube), *map(str, alternatives)]
    assert main(["report", str(paper_cube), *beside, "-o", str(file)]) == Exit.DONE
    return file


@pytest.fixture(scope="session")
def lagging_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A body whose hip angle is measured late."""
    file = tmp_path_factory.mktemp("recording") / "lagging.nc"
    words = ["--effect", "sensor_lag_theta2=0.03", "--cycles", "4", "--rate", "100", "--seed", "2"]
    assert main(["simulate", "-o", str(file), *words]) == Exit.DONE
    return file


@pytest.fixture(scope="session")
def gap_page(lagging_recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("page") / "gap.html"
    assert main(["gap", "report", str(lagging_recording), "--fast", "-o", str(file)]) == Exit.DONE
    return file


@pytest.fixture(scope="session")
def fit_page(lagging_recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("page") / "fit.html"
    words = ["--fmax", "2", "--with", "sensor_lag_theta2", "--html", str(file)]
    assert main(["fit", str(lagging_recording), *words]) == Exit.DONE
    return file
