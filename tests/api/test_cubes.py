"""What the verbs of a results cube do is a function of `mcstudy`, with the same answer."""

from __future__ import annotations

import inspect
import json
from pathlib import Path

import pytest

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import DesignError, InputError
from mcstudy.exits import Exit
from mcstudy.files import schema
from mcstudy.study.store import Cube


def printed(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(list(words)) == Exit.DONE
    return capsys.readouterr().out


def test_the_status_of_a_cube_is_what_the_verb_prints(tiny_cube: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status = mc.status(str(tiny_cube))
    assert json.loads(printed(capsys, "status", str(tiny_cube), "--json")) == status.to_dict()
    schema.validate("status", status.to_dict(), "status")
    assert (status.study, status.seed, status.complete, status.failed) == ("tiny", 7, True, ())
    assert {name: sum(counts.values()) for name, counts in status.groups.items()} == {"noisy": 120, "ideal": 8}
    assert status.fingerprint in printed(capsys, "status", str(tiny_cube))


def test_a_study_that_has_not_run_is_not_complete(tmp_path: Path, tiny_file: Path) -> None:
    cube = Cube.create(tmp_path / "new.zarr", mc.read_study(tiny_file))
    status = mc.status(cube.path)
    assert not status.complete
    assert status.groups["ideal"]["pending"] == 8


def test_verify_finds_what_the_verb_finds(tiny_copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = mc.verify(tiny_copy, cells=2)
    assert (found.damage, found.beyond, found.pending) == ([], [], 0)
    assert json.loads(printed(capsys, "verify", str(tiny_copy), "--cells", "2", "--json")) == found.to_dict()
    chunk = min(tiny_copy.glob("noisy/cost/c.*"))
    chunk.write_bytes(chunk.read_bytes()[:-1])
    assert any(str(chunk) in line for line in mc.verify(tiny_copy, cells=1).damage)


def test_a_replayed_fit_is_the_stored_one(tiny_cube: Path, capsys: pytest.CaptureFixture[str]) -> None:
    again = mc.replay(tiny_cube, group="noisy", amplitude=5.0, fmax=1.2, realization=3, start=2)
    stored = mc.open_results(tiny_cube)["noisy"].sel(amplitude=5.0, fmax=1.2, realization=3, start=2)
    assert again.reproduced
    assert again.path[-1].cost == float(stored["cost"])
    words = ["--group", "noisy", "--amplitude", "5", "--fmax", "1.2", "--realization", "3", "--start", "2"]
    assert f"{again.path[-1].cost:.16g}" in printed(capsys, "replay", str(tiny_cube), *words)


def test_extend_adds_what_is_asked_for_and_the_same_call_has_nothing_to_do(tiny_copy: Path) -> None:
    added = mc.extend(tiny_copy, realizations=6, groups=["noisy"], workers=1)
    assert (added.fits, added.skipped, added.failed_blocks) == (24, 128, [])
    assert mc.open_results(tiny_copy)["noisy"].sizes["realization"] == 6
    assert mc.extend(str(tiny_copy), realizations=6, groups=["noisy"], workers=1).fits == 0


def test_run_until_says_what_was_reached_and_what_it_took(tiny_file: Path, tmp_path: Path) -> None:
    said: list[str] = []
    grown = mc.run_until(tiny_file, tmp_path / "a.zarr", "bias=1e5%", 300, workers=1, say=said.append)
    assert grown.reached
    assert grown.steps == said
    assert grown.statement.startswith("reached: largest MCSE of bias")
    assert mc.status(tmp_path / "a.zarr").complete
    spent = mc.run_until(tiny_file, tmp_path / "a.zarr", "bias=0.001%", 130, workers=1)
    assert not spent.reached
    assert "the budget of 130 fits is spent" in spent.statement


def test_the_page_of_a_cube_is_the_verbs(tiny_copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    page = mc.write_report(str(tiny_copy))
    assert page == tiny_copy.with_suffix(".html")
    text = page.read_text(encoding="utf-8")
    assert "tiny" in text
    printed(capsys, "report", str(tiny_copy), "-o", str(tiny_copy.parent / "b.html"))
    assert (tiny_copy.parent / "b.html").read_text(encoding="utf-8") == text


def test_a_mistake_names_the_argument_in_python_and_the_option_on_the_command_line(
    tiny_cube: Path, tiny_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new = str(tmp_path / "new.zarr")
    for call, error, line, words in (
        (
            lambda: mc.replay(tiny_cube, realization=0, start=0),
            InputError,
            "group, amplitude, fmax: needed to choose one fit",
            ["replay", str(tiny_cube), "--realization", "0", "--start", "0"],
        ),
        (
            lambda: mc.extend(tiny_cube, starts=9, groups=["loud"]),
            DesignError,
            "group: expected one of noisy, ideal",
            ["extend", str(tiny_cube), "--starts", "9", "--group", "loud"],
        ),
        (
            lambda: mc.run_until(tiny_file, new, "bias", 500),
            InputError,
            "until: expected bias=PERCENT%",
            ["run", str(tiny_file), "-o", new, "--until-mcse", "bias", "--budget-fits", "500"],
        ),
        (
            lambda: mc.run_until(tiny_file, new, "bias=1%", 9),
            InputError,
            "budget_fits: expected at least 128",
            ["run", str(tiny_file), "-o", new, "--until-mcse", "bias=1%", "--budget-fits", "9"],
        ),
    ):
        with pytest.raises(error) as refused:
            call()
        assert str(refused.value).startswith(line)
        assert main(words) == Exit.BAD_INPUT
        said = capsys.readouterr().err
        options = {"until": "--until-mcse", "budget_fits": "--budget-fits"}
        names = [options.get(name, f"--{name}") for name in line.partition(": ")[0].split(", ")]
        assert said.startswith(f"mcstudy: {', '.join(names)}: {line.partition(': ')[2]}")
    assert not Path(new).exists()


def test_every_function_of_a_cube_says_what_it_takes_returns_and_raises() -> None:
    for name in ("status", "extend", "run_until", "verify", "replay", "write_report"):
        text = inspect.getdoc(getattr(mc, name)) or ""
        for heading in ("Parameters\n---", "Returns\n---", "Raises\n---"):
            assert heading in text, (name, heading)
