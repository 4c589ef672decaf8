"""Every code block of the documentation runs as it is printed, in order, in a directory of its own.

- ``bash`` blocks run in a shell, ``python`` blocks of a page share one namespace; both start where a clone's root is.
  Lines of nothing but ``mcstudy ...`` and ``python FILE ...`` are run in the process of the tests, which has
  everything imported.
- The study files they name are cut down to a few groups, realizations and starts, so that a page takes seconds.
- A ``toml`` block whose first line is ``# NAME.toml`` is written to that file.
- The build of the site (`test_site.py`) runs the blocks of `pipelines/docs/`, too. Where it is among the tests,
  ``MCSTUDY_TEST_SITE=1`` says so, and they are not run here (.ci/run).
- A block is left out only below a comment ``<!-- Not run by the tests: REASON. -->``: it is for us, not for readers.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from code_blocks import PAGES, ROOT, blocks, run_page

BUILT = "pipelines/docs/" if "MCSTUDY_TEST_SITE" in os.environ else None
"""Folder of the pages whose blocks the build of the site runs."""


@pytest.mark.parametrize("page", PAGES)
def test_every_block_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if BUILT and page.startswith(BUILT):
        pytest.skip("the build of the site runs them (tests/docs/test_site.py)")
    run_page(page, tmp_path, monkeypatch)


@pytest.mark.parametrize("page", PAGES)
def test_links_between_pages_lead_somewhere(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", text):
        assert ((ROOT / page).parent / target).exists(), f"{page}: {target}"


@pytest.mark.parametrize("page", PAGES)
def test_python_that_is_not_run_is_at_least_python(page: str) -> None:
    for block in blocks(page):
        if block.language == "python":
            compile(block.text, f"{page}:{block.line}", "exec")
