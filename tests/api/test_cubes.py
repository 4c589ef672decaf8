"""What the verbs print of a cube is what the functions return."""

from __future__ import annotations

import inspect
import json
from pathlib import Path

import pytest
from tiny_studies import EIGHT_FITS

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import DesignError, InputError
from mcstudy.exits import Exit


@pytest.fixture(scope="module")
def cube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished cube of eight fits."""
    folder = tmp_path_factory.mktemp("cubes")
    (folder / "study.toml").write_text(EIGHT_FITS, encoding="utf-8")
    mc.run(folder / "study.toml", folder / "a.zarr", workers=1)
    return folder / "a.zarr"


def test_the_status_of_a_cube_is_what_the_verb_prints(cube: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["status", str(cube), "--json"])
    found = mc.status(cube)
    assert found.to_dict() == json.loads(capsys.readouterr().out)
    assert sum(sum(counts.values()) for counts in found.groups.values()) == 8
    assert found.pending == 0
    assert found.failed == []


def test_a_sound_cube_is_verified_and_a_damaged_one_is_not(cube: Path) -> None:
    found = mc.verify(cube, cells=2)
    assert found.damage == []
    assert found.recomputed >= 2
    chunk = next(p for p in sorted(cube.glob("*/cost/**/*")) if p.is_file() and p.suffix != ".json")
    whole = chunk.read_bytes()
    chunk.write_bytes(whole[:-1])
    try:
        assert mc.verify(cube, cells=0).damage
    finally:
        chunk.write_bytes(whole)


def test_one_fit_is_repeated(cube: Path) -> None:
    again = mc.replay(cube, realization=0, start=0)
    assert again.reproduced
    assert again.path[0].iteration == 0


def test_a_cube_grows_and_keeps_what_it_has(cube: Path) -> None:
    before = mc.open_results(cube)
    name = next(iter(before.children))
    old = before[name]["cost"].values
    n = old.shape[list(before[name]["cost"].dims).index("realization")]
    larger = mc.extend(cube, realizations=n + 1, workers=1)[name]["cost"]
    assert larger.sizes["realization"] == n + 1
    assert (larger.isel(realization=slice(n)).values == old).all()


def test_a_study_grows_until_its_error_is_small_or_its_budget_is_spent(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(EIGHT_FITS, encoding="utf-8")
    until = mc.run_until(tmp_path / "study.toml", tmp_path / "b.zarr", "bias=0.001%", 40, workers=1)
    assert not until.reached
    counts = mc.status(tmp_path / "b.zarr").groups.values()
    assert 8 < sum(sum(c.values()) for c in counts) <= 40


def test_the_page_of_a_study_is_written_beside_it(cube: Path) -> None:
    page = mc.write_report(cube)
    assert page == cube.with_suffix(".html")
    assert "<!doctype html>" in page.read_text(encoding="utf-8").lower()


def test_a_mistake_names_the_argument_in_python_and_the_option_on_the_command_line(
    tiny_cube: Path, tiny_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new, cube = str(tmp_path / "new.zarr"), str(tiny_cube)
    run = ["run", str(tiny_file), "-o", new]
    options = {"target": "until-mcse", "budget_fits": "budget-fits"}
    for call, error, line, words in (
        (
            lambda: mc.replay(cube, realization=0, start=0),
            InputError,
            "group, amplitude, fmax: needed to choose one fit",
            ["replay", cube, "--realization", "0", "--start", "0"],
        ),
        (
            lambda: mc.extend(cube, starts=9, groups=("loud",)),
            DesignError,
            "group: expected one of noisy, ideal",
            ["extend", cube, "--starts", "9", "--group", "loud"],
        ),
        (
            lambda: mc.run_until(tiny_file, new, "bias", 500),
            InputError,
            "target: expected bias=PERCENT%",
            [*run, "--until-mcse", "bias", "--budget-fits", "500"],
        ),
        (
            lambda: mc.run_until(tiny_file, new, "bias=1%", 9),
            InputError,
            "budget_fits: expected at least 128",
            [*run, "--until-mcse", "bias=1%", "--budget-fits", "9"],
        ),
    ):
        with pytest.raises(error) as refused:
            call()
        assert str(refused.value).startswith(line)
        assert main(words) == Exit.BAD_INPUT
        names, _, rest = line.partition(": ")
        named = ", ".join(f"--{options.get(name, name)}" for name in names.split(", "))
        assert capsys.readouterr().err.startswith(f"mcstudy: {named}: {rest}")
    assert not Path(new).exists()


def test_every_function_of_a_cube_says_what_it_takes_returns_and_raises() -> None:
    for name in ("status", "extend", "run_until", "verify", "replay", "write_report"):
        text = inspect.getdoc(getattr(mc, name)) or ""
        for heading in ("Parameters", "Returns", "Raises"):
            assert f"{heading}\n---" in text, (name, heading)
