"""The documentation site: it builds, its links lead somewhere, and its reference and gallery are complete.

The build runs every code block of `pipelines/docs/`, which takes minutes: it is asked for by ``MCSTUDY_TEST_SITE=1``
(.ci/run). It needs the extra ``docs`` and is skipped, visibly, without it.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from inspect import signature
from pathlib import Path

import pytest

import mcstudy
from mcstudy.analysis.accessor import MonteCarlo
from mcstudy.cli.verbs import verbs
from mcstudy.report import figures
from mcstudy.report.diagnosis.plots import Plots
from pipelines.docs.links import Page, broken, external, pages

ROOT = Path(__file__).parents[2]
GALLERY = (ROOT / "pipelines" / "docs" / "gallery.md").read_text(encoding="utf-8")


def public(kind: type) -> list[str]:
    return [name for name in vars(kind) if not name.startswith("_")]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Page]:
    """The built pages by their path within the site."""
    if "MCSTUDY_TEST_SITE" not in os.environ:
        pytest.skip("built where MCSTUDY_TEST_SITE=1 asks for it (.ci/run)")
    for needed in ("sphinx", "myst_parser", "furo"):
        pytest.importorskip(needed, reason="the site needs the extra docs: pip install -e '.[docs]'")
    out = tmp_path_factory.mktemp("docs")
    command = [sys.executable, "-m", "pipelines.docs", "-o", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return {path.relative_to(out / "site").as_posix(): page for path, page in pages(out / "site").items()}


def test_the_site_has_every_page_of_the_repository(site: dict[str, Page]) -> None:
    places = (
        "README.md",
        "results_schema/*.md",
        "pipelines/**/*.md",
        "mcstudy/**/*.md",
    )
    sources = {path.relative_to(ROOT).with_suffix(".html").as_posix() for place in places for path in ROOT.glob(place)}
    assert sources - set(site) == set()


def test_the_reference_has_every_public_name_and_every_statistic_and_figure_of_a_diagnosis(
    site: dict[str, Page],
) -> None:
    ids = {i for name, page in site.items() if name.startswith("pipelines/docs/reference/") for i in page.ids}
    names = [f"mcstudy.{n}" for n in mcstudy.__all__ if not n.startswith("_")]
    names += [f"{kind.__module__}.{kind.__name__}.{n}" for kind in (MonteCarlo, Plots) for n in public(kind)]
    assert [n for n in names if n not in ids] == []


def test_the_reference_has_every_command(site: dict[str, Page]) -> None:
    ids = site["pipelines/docs/command_line.html"].ids
    assert [verb for verb in verbs() if f"mcstudy-{verb}" not in ids] == []


def test_the_gallery_draws_every_figure() -> None:
    drawn = [f"figures.{n}(" for n in figures.__all__ if "ax" in signature(getattr(figures, n)).parameters]
    drawn += [f"diagnosis.plot.{n}(" for n in public(Plots)]
    assert [call for call in drawn if call not in GALLERY] == []


def test_every_figure_of_the_gallery_is_on_its_page(site: dict[str, Page]) -> None:
    calls = re.findall(r"^(?:(?:figures|alternatives)\.[a-z]\w*|diagnosis\.plot\.\w+)\(", GALLERY, re.MULTILINE)
    text = site["pipelines/docs/gallery.html"].path.read_text(encoding="utf-8")
    assert text.count('<svg class="plot"') == len(calls)


def test_a_link_to_nowhere_is_found(tmp_path: Path) -> None:
    (tmp_path / "b.html").write_text('<p id="here"></p>', encoding="utf-8")
    (tmp_path / "a.html").write_text(
        '<a href="b.html#here"></a><a href="b.html#gone"></a><a href="c.html"></a><a href="#gone"></a>'
        '<a href="https://example.org/x"></a><script src="https://example.org/y"></script>',
        encoding="utf-8",
    )
    found = pages(tmp_path)
    faults = [re.sub(r"^.*a\.html: ", "", fault) for fault in broken(found)]
    assert faults == [
        "loads https://example.org/y, which is on another site",
        "links to b.html#gone, which does not exist",
        "links to c.html, which does not exist",
        "links to #gone, which does not exist",
    ]
    assert external(found) == ["https://example.org/x"]
