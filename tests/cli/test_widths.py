"""Every table fits the terminal it is printed on; for a file or a pipe nothing is folded."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from commands import told
from tiny_studies import EIGHT_FITS

from mcstudy.cli import main
from mcstudy.cli.markdown import as_text
from mcstudy.cli.verbs.help import TOPICS, page
from mcstudy.exits import Exit
from mcstudy.study import environment
from mcstudy.text_tables import table, with_error

NARROW, WIDE = 80, 120
HEADER = ["", "ours ± MCSE", "what it means in words", "equation"]
ROWS = [
    [
        "mean |bias|, stiffness combined",
        "6.2e-13 ± 2.2e-13 %",
        "one word after another and so on",
        "K (theta - theta0)",
    ],
    ["short", "-85 ± 95 %", "", "-"],
]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study file, its cube, and a recording."""
    folder = tmp_path_factory.mktemp("widths")
    (folder / "study.toml").write_text(EIGHT_FITS.replace("realizations = 2", "realizations = 3"))
    assert main(["run", str(folder / "study.toml"), "-o", str(folder / "cube.zarr")]) == Exit.DONE
    effect = ["--effect", "passive_damping_ankle=40", "--seed", "4", "--rate", "100"]
    assert main(["simulate", "-o", str(folder / "recording.nc"), *effect]) == Exit.DONE
    return folder


@pytest.mark.parametrize("width", [NARROW, WIDE])
@pytest.mark.parametrize(
    "words",
    [
        ["plan", "study.toml"],
        ["show", "cube.zarr"],
        ["show", "cube.zarr", "--all"],
        ["show", "cube.zarr", "--starts"],
        ["show", "cube.zarr", "--fmax", "1.2", "--parameter", "K11"],
        ["show", "cube.zarr", "--compare", "cube.zarr"],
        ["status", "cube.zarr"],
        ["verify", "cube.zarr", "--cells", "1"],
        ["replay", "cube.zarr", "--realization", "0", "--start", "0", "--fmax", "1.2", "--amplitude", "5"],
        ["gap", "effects"],
        ["gap", "diagnose", "recording.nc", "--fast"],
        ["studies"],
        ["help"],
    ],
    ids=lambda words: "_".join(words[:2]),
)
def test_what_a_verb_prints_fits_the_terminal(
    words: list[str],
    width: int,
    files: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(files)
    monkeypatch.setenv("COLUMNS", str(width))
    capsys.readouterr()
    printed = told(*words)
    assert max(map(len, printed.splitlines())) <= width


def test_a_note_of_another_environment_fits_the_terminal(
    files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = environment.environment()
    monkeypatch.setattr(environment, "environment", lambda: {**now, "source": "0" * 64, "cpu": "a name " * 12})
    monkeypatch.chdir(files)
    monkeypatch.setenv("COLUMNS", str(NARROW))
    capsys.readouterr()
    printed = told("verify", "cube.zarr", "--cells", "0")
    assert f"source: {now['source'][:12]} -> 000000000000;" in " ".join(printed.split())
    assert "a name a name" in printed
    assert max(map(len, printed.splitlines())) <= NARROW


@pytest.mark.parametrize("width", [NARROW, 100, 160])
@pytest.mark.parametrize("topic", TOPICS)
def test_a_page_of_the_documentation_fits_the_terminal_except_for_its_code(
    topic: str, width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    written = page(topic).read_text(encoding="utf-8")
    verbatim = {line for line in written.split("\n") if not line.startswith("|")}
    shown = as_text(written).split("\n")
    wide = [line for line in shown if len(line) > width and line not in verbatim]
    assert not wide
    assert not [line for line in shown if line.startswith("| ")]


def test_a_page_keeps_every_word_of_its_tables_and_paragraphs(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "One [link](a.md) and\nno <!--=a.b-->more<!--/-->.\n\n"
    text += "| field | meaning |\n|---|---:|\n| `a` | b \\| c |\n\n1. first\n   item\n"
    monkeypatch.setenv("COLUMNS", "80")
    assert as_text(text).split("\n") == [
        "One link and no more.",
        "",
        "field  meaning",
        "--------------",
        "`a`    b | c",
        "",
        "1. first item",
        "",
    ]
    monkeypatch.delenv("COLUMNS")
    assert as_text(text) == text  # a file or a pipe gets the page as it is written


def numbers(text: str) -> list[str]:
    return re.findall(r"-?\d\S* ± \S+ %", text)


@pytest.mark.parametrize("of_text", [False, True])
@pytest.mark.parametrize("width", range(40, 130, 6))
def test_a_table_keeps_its_numbers_and_words_at_any_width(
    width: int, of_text: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    whole = table(HEADER, ROWS, of_text=of_text)
    monkeypatch.setenv("COLUMNS", str(width))
    folded = table(HEADER, ROWS, of_text=of_text)
    assert max(map(len, folded.splitlines())) <= width
    assert numbers(folded) == numbers(whole)
    assert set(whole.replace("-", " ").split()) <= set(folded.replace("-", " ").split())
    if width >= max(map(len, whole.splitlines())):
        assert folded == whole


def test_columns_without_room_follow_below_behind_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    folded = table(["iteration", *(f"column{i}" for i in range(6))], [["7", *("1.23456789",) * 6]])
    blocks = folded.split("\n\n")
    assert len(blocks) == 3
    assert all(block.startswith("iteration") and block.splitlines()[-1].startswith("7 ") for block in blocks)
    assert folded.count("1.23456789") == 6


def test_a_file_is_not_folded_whatever_the_terminal(
    files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    written = []
    for width in ("60", "200"):
        monkeypatch.setenv("COLUMNS", width)
        assert (
            main(["gap", "diagnose", str(files / "recording.nc"), "--fast", "-o", str(tmp_path / width)]) == Exit.DONE
        )
        written.append((tmp_path / width / "diagnosis.txt").read_text())
    assert written[0] == written[1]
    assert written[1].splitlines()[0] in capsys.readouterr().out.replace("\n  ", " ")


def test_an_error_that_is_rounding_is_not_printed() -> None:
    assert with_error(-8.33, 5.8e-15) == "-8.33"
    assert with_error(-8.33, 0.02) == "-8.330 ± 0.020"
