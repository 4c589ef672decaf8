"""A second publication attaches as a package of its own: no file of mcstudy changes."""

from __future__ import annotations

from pathlib import Path

from changes import Copy
from tiny_studies import EIGHT_FITS

PUBLICATION = """
from mcstudy.analysis.publications.publication import Publication, Row
from mcstudy.analysis.publications.sampling import Value
from mcstudy.analysis.publications.statement import Published
from mcstudy.analysis.publications.verdict import judge

STATEMENT = Published("n", "fits of every study", "1", 8.0, "8", "Table 1", margin=1.0, n=0)


def rows(study):
    view = next(iter(study.groups.values()))
    fits = float(view.cube["cost"].size)
    ours = Value(fits, 0.0, 0.0, 1, 1)
    return [Row(STATEMENT, ours, view.name, judge(STATEMENT, ours))]


provider = Publication("Somebody 2030, J Made Up 1:1", rows=rows, reading=("Read it with care.",))
"""

LOOK = """
import json, os, subprocess, sys
import mcstudy as mc
from mcstudy.cli import main

tree = mc.run("study.toml", "out.zarr", workers=1)
main(["show", "out.zarr", "--all"])
main(["report", "out.zarr", "-o", "page.html"])
print("Somebody 2030" in open("page.html").read() and "fits of every study" in open("page.html").read())
"""


def test_a_second_publication_is_one_package_and_its_rows_are_shown(tmp_path: Path) -> None:
    copy = Copy(tmp_path / "copy")
    copy.add("second_paper.py", PUBLICATION)
    (copy.folder / "second_paper-1.dist-info").mkdir()
    copy.add("second_paper-1.dist-info/METADATA", "Metadata-Version: 2.1\nName: second-paper\nVersion: 1\n")
    copy.add("second_paper-1.dist-info/entry_points.txt", "[mcstudy.comparisons]\nsecond = second_paper:provider\n")
    (copy.folder / "study.toml").write_text(EIGHT_FITS, encoding="utf-8")
    shown = copy.run(LOOK)
    assert "Somebody 2030, J Made Up 1:1" in shown
    assert "fits of every study" in shown
    assert "Read it with care." in shown
    assert shown.rstrip().endswith("True")
    assert len(copy.touched) == 3
    assert not any(file.startswith("mcstudy/") for file in copy.touched)
