"""A figure that cannot be written is refused before anything is computed."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcstudy.cli import main
from mcstudy.exits import Exit

VERBS = {
    "design": ["design", "design", "-o", "out", "--figure"],
    "solve": ["solve", "quick", "--target", "cv(Td1) <= 10%", "--over", "cycles", "--figure"],
    "infer": ["infer", "table_one", "-o", "out", "--figure"],
    "trade-offs": ["infer", "table_one", "-o", "out", "--trade-offs"],
    "score": ["gap", "challenge", "score", "data", "--key", "key.json", "--answers", "answers.json", "--figure"],
}


@pytest.mark.parametrize("verb", VERBS)
def test_a_figure_that_cannot_be_written_is_refused_first(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    for name, expected in (
        ("picture.txt", "mcstudy: picture.txt: expected a name ending in .svg, .png, .pdf"),
        ("file/picture.svg", f"mcstudy: file/picture.svg: cannot be written: {tmp_path / 'file'} is not a folder"),
    ):
        assert main([*VERBS[verb], name]) == Exit.BAD_INPUT
        assert capsys.readouterr().err.strip() == expected
        assert [path.name for path in tmp_path.iterdir()] == ["file"]
