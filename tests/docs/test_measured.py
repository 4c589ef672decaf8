"""Every number of a page that a command measured is the one that the command wrote."""

from __future__ import annotations

import json
import re
import sys
from datetime import date
from pathlib import Path

import pytest

from pipelines import measured

NAMES = sorted(file.stem for file in measured.FOLDER.glob("*.json"))
PAGES = [page.relative_to(measured.ROOT).as_posix() for page in measured.pages()]


@pytest.mark.parametrize("page", PAGES)
def test_no_number_of_a_page_is_stale_or_without_a_result(page: str) -> None:
    assert measured.stale(measured.ROOT / page) == []


def test_a_stale_number_and_a_name_that_no_result_has_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measured, "ROOT", tmp_path)
    monkeypatch.setattr(measured, "FOLDER", tmp_path)
    values = {"share": {"value": 0.5, "unit": "%", "low": 0.25, "high": 0.75}, "rate": {"value": 2, "error": 0.5}}
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "run.py"), "--cases", "3", "--json", "new_result.json"])
    measured.write(tmp_path / "new_result.json", values, {"rows": (("case", "n"), [["a", 1]])})
    assert json.loads((tmp_path / "new_result.json").read_text())["command"] == "python run.py --cases 3"
    page = tmp_path / "page.md"
    page.write_text(
        "A <!--=new_result.share:.2f-->?<!--/--> of <!--=new_result.rate-->?<!--/-->\n\n"
        "<!--=table new_result.rows-->\n<!--/-->\n"
    )
    assert "found 'A <!--=new_result.share" in measured.stale(page)[0]
    page.write_text(measured.shown(page.read_text()))
    assert measured.stale(page) == []
    assert ">0.50 % [0.25, 0.75]<" in page.read_text()
    assert ">2 ± 0.5<" in page.read_text()
    assert "| case | n |\n|---|---:|\n| a | 1 |\n" in page.read_text()
    for name in ("new_result.gone", "nowhere.share"):
        page.write_text(f"<!--={name}-->1<!--/-->")
        assert name.split(".")[0] in measured.stale(page)[0]


@pytest.mark.parametrize("name", NAMES)
def test_a_result_says_what_was_run_and_is_shown_somewhere(name: str) -> None:
    document = measured.load(name)
    assert re.match(r"(python|mcstudy) ", document["command"])
    assert document["version"]
    assert date.fromisoformat(document["date"])
    assert any(re.search(rf"<!--=(table )?{name}\.", (measured.ROOT / p).read_text(encoding="utf-8")) for p in PAGES)


def test_a_program_writes_every_number_of_its_page(tmp_path: Path) -> None:
    from pipelines.validation import until_certain

    until_certain.main(1, 20, tmp_path / "until_certain.json")
    written = json.loads((tmp_path / "until_certain.json").read_text(encoding="utf-8"))["values"]
    text = "".join((measured.ROOT / page).read_text(encoding="utf-8") for page in PAGES)
    named = {key for name, key, *_ in measured.VALUE.findall(text) if name == "until_certain"}
    assert named
    assert named <= set(written)
    assert all(0 <= share["low"] <= share["value"] <= share["high"] <= 100 for share in written.values())
