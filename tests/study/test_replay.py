"""One stored fit, run again: its whole path, and whether it ends where it is stored to have ended."""

from __future__ import annotations

import itertools
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from commands import told

from mcstudy.cli import main
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube.store import Cube
from mcstudy.study.replay import replay
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study, read_study

OTHERS = """
[group.reference]
realizations = 1
starts = 2
fmax = [1.2]
amplitude = [5.0]
fit.solver = "trf"

[group.emulated]
realizations = 2
starts = 3
fmax = [1.2]
amplitude = [5.0]
fit = { solver = "interior_point", max_iterations = 40 }

[group.data]
realizations = 2
starts = 2
fmax = [1.2]
amplitude = [5.0]
fit.starts = "linearised"
"""

CELL = ["--group", "noisy", "--realization", "3", "--start", "2", "--fmax", "1.2", "--amplitude", "5"]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory, tiny: str) -> Path:
    out = tmp_path_factory.mktemp("replay") / "out.zarr"
    run_study(parse_study(tiny + OTHERS), out, ClusterOptions(workers=1))
    return out


@pytest.fixture
def copy(tmp_path: Path, sound: Path) -> Path:
    return shutil.copytree(sound, tmp_path / "out.zarr")


@pytest.mark.parametrize(
    ("group", "realization", "start"),
    [("noisy", 4, 5), ("noisy", 0, 0), ("ideal", 1, 3), ("reference", 0, 1), ("data", 1, 1)],
)
def test_the_path_goes_down_from_the_stored_start_to_the_stored_estimate(
    sound: Path, group: str, realization: int, start: int
) -> None:
    store = Cube.open(sound).groups[group]
    fmax, amplitude = store.layout.group.fmax[-1], 5.0
    again = replay(sound, group=group, amplitude=amplitude, fmax=fmax, realization=realization, start=start)
    assert again.differ == ()
    assert again.status is again.stored_status
    (chunk,) = [c for c in store.layout.chunks if realization in store.layout.realizations(c)][-1:]
    data, place = store.existing(chunk), (0, -1, realization, start)
    first, last = again.path[0], again.path[-1]
    assert len(again.path) == data["iterations"][place] + 1
    assert first.theta.tobytes() == data["initial"][place].tobytes()
    assert last.theta.tobytes() == data["estimate"][place].tobytes()
    assert last.cost == data["cost"][place]
    costs = [p.cost for p in again.path]
    assert all(b <= a * (1 + 1e-12) for a, b in itertools.pairwise(costs))
    assert np.allclose(first.theta + sum(p.step for p in again.path), last.theta)


def test_the_path_of_the_emulated_solver_leads_to_the_stored_estimate(sound: Path) -> None:
    """Its merit falls, not its cost: the barrier pushes away from the bounds at first."""
    store = Cube.open(sound).groups["emulated"]
    again = replay(sound, group="emulated", realization=1, start=2)
    assert again.differ == ()
    assert len(again.path) == 41
    stored = store.read("estimate", store.layout.chunks[-1])
    np.testing.assert_array_equal(again.path[-1].theta, stored[0, 0, -1, 2])
    assert again.path[-1].cost < again.path[0].cost


def test_the_command_prints_the_path_and_says_that_it_is_equal(sound: Path) -> None:
    printed = told("replay", str(sound), *CELL)
    assert "equal to the stored fit, bit for bit" in printed
    assert printed.count("\n") >= 5


@pytest.mark.parametrize("name", ["estimate", "cost", "iterations", "frf", "growth_rate"])
def test_one_changed_bit_is_found(copy: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    store = Cube.open(copy).groups["noisy"]
    for chunk in store.layout.chunks:
        data = store.existing(chunk)
        bits = data[name].view(np.uint8)
        bits.reshape(-1)[:: data[name].dtype.itemsize] ^= 1
        store.write(chunk, data)
    assert main(["replay", str(copy), *CELL]) == Exit.DIFFERS
    assert f"differs from the stored fit ({name}" in capsys.readouterr().out


def test_the_command_in_the_documentation_chooses_one_fit_of_the_papers_study(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (command,) = re.findall(
        r"`mcstudy (replay OUT [^`]*)`", (Path(__file__).parents[2] / "pipelines/docs/command_line.md").read_text()
    )
    out = Cube.create(tmp_path / "paper.zarr", read_study("goodworth2018")).path
    assert main(command.replace("OUT", str(out)).split()) == Exit.BAD_INPUT
    assert "expected a finished fit, but this one has not been run yet" in capsys.readouterr().err


def test_what_there_is_only_one_of_need_not_be_given(sound: Path) -> None:
    assert replay(sound, group="data", realization=1, start=1).differ == ()


def test_a_fit_that_was_not_run_and_a_cell_that_does_not_exist_are_one_line(copy: Path, tiny: str) -> None:
    new = Cube.create(copy.with_name("new.zarr"), parse_study(tiny)).path
    with pytest.raises(InputError, match="has not been run yet"):
        replay(new, group="noisy", amplitude=5.0, fmax=1.2, realization=0, start=0)
    for where, expected in (
        (
            (None, 5.0, 1.2, 0, 0),
            r"group: needed to choose one fit \(group noisy: amplitude 3, 5",
        ),
        ((None, None, None, 0, 0), "group, amplitude, fmax: needed"),
        (
            ("noisy", None, None, 0, 0),
            r"amplitude, fmax: needed.*\(group noisy: amplitude 3, 5, fmax 0.41, 1.2\)",
        ),
        (("loud", 5.0, 1.2, 0, 0), "group: expected one of noisy"),
        (("noisy", 4.0, 1.2, 0, 0), "amplitude: expected one of 3, 5, got 4"),
        (("noisy", 5.0, 1.3, 0, 0), "fmax: expected one of"),
        (("noisy", 5.0, 1.2, 5, 0), "realization: expected 0 to 4"),
        (("noisy", 5.0, 1.2, 0, -1), "start: expected 0 to 5"),
    ):
        with pytest.raises(InputError, match=expected):
            replay(copy, **dict(zip(("group", "amplitude", "fmax", "realization", "start"), where, strict=True)))
