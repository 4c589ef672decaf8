"""Run the code blocks of pages while the site is built, and show below each what it prints and draws.

Pages stay plain Markdown: a `python` block, one namespace per page; a `bash` block, a shell; a `toml` block that begins
with `# NAME.toml`, a file of that name; all in a scratch folder that has `pipelines/` as in a clone. The tests run the
same blocks (`tests/docs/test_code_blocks.py`).
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.errors import SphinxError
from sphinx.transforms import SphinxTransform

WIDEST = 120
"""Characters of a line of output; a wider one is a paragraph, which is wrapped."""


class Executed(SphinxTransform):
    """Output below every executed block of one page."""

    default_priority = 400  # any will do: nothing else changes code blocks

    def apply(self, **_: Any) -> None:
        """Run the blocks in order. Raises `SphinxError` that names page and line for a block that fails."""
        page, root = self.env.docname, Path(self.env.srcdir)
        if not page.startswith(tuple(self.config.executed_pages)):
            return
        blocks = [b for b in self.document.findall(nodes.literal_block) if _is_run(b)]
        if not blocks:
            return
        namespace: dict[str, Any] = {"__name__": "__main__"}
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            shutil.copytree(root / "pipelines", "pipelines", ignore=shutil.ignore_patterns("__pycache__"))
            for number, block in enumerate(blocks):
                where = f"{page}.md, line {block.line}"
                try:
                    printed = _run(block, where, namespace)
                except Exception as error:
                    raise SphinxError(f"{where}: {type(error).__name__}: {error}") from error
                shown: list[nodes.Node] = []
                if printed.strip():
                    classes = ["output", *(["wrapped"] if max(map(len, printed.splitlines())) > WIDEST else [])]
                    shown.append(nodes.literal_block(printed, printed, language="text", classes=classes))
                shown += _figures(f"{page.replace('/', '-')}-{number}")
                at = block.parent.index(block) + 1
                block.parent[at:at] = shown


def _is_run(block: nodes.Element) -> bool:
    """Whether it is code, without the comment above it that the tests know too."""
    above = block.parent[max(block.parent.index(block) - 1, 0)]
    return block.get("language") in ("python", "bash", "toml") and "<!-- Not run" not in above.astext()


def _run(block: nodes.Element, where: str, namespace: dict[str, Any]) -> str:
    """Run or write one block; returns what it prints."""
    if block["language"] == "bash":
        return _bash(block)
    if block["language"] == "python":
        return _python(block, where, namespace)
    if name := re.match(r"# (\w+\.toml)\n", block.astext()):
        Path(name[1]).write_text(block.astext(), encoding="utf-8")
    return ""


def _python(block: nodes.Element, where: str, namespace: dict[str, Any]) -> str:
    """Run it; returns what it prints."""
    from mcstudy.report.axes import styled

    with styled(), contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(block.astext(), where, "exec"), namespace)
    return printed.getvalue()


def _bash(block: nodes.Element) -> str:
    """Run it with this Python's commands; returns what it prints."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    command = ["bash", "-euo", "pipefail", "-c", block.astext()]
    done = subprocess.run(command, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"exit code {done.returncode}: {done.stderr.strip()}")
    return done.stdout


def _figures(key: str) -> list[nodes.Node]:
    """All open figures as inline SVG in the site's colours, light and dark; they are closed."""
    import matplotlib.pyplot as plt

    from mcstudy.report.axes import styled
    from mcstudy.report.svg import inline

    shown = []
    for number in plt.get_fignums():
        figure, text = plt.figure(number), io.StringIO()
        what = "; ".join(f"{ax.get_ylabel()} against {ax.get_xlabel()}" for ax in figure.axes)
        with styled():
            figure.savefig(text, format="svg", bbox_inches="tight")
        drawing = inline(text.getvalue(), f"{key}-{number}", what, what)
        points = drawing.split('viewBox="0 0 ')[1].split()[0]
        shown.append(f'<div style="max-width: {points}pt">{drawing}</div>')
    plt.close("all")
    return [nodes.raw("", f'<div class="figures">{"".join(shown)}</div>', format="html")] if shown else []


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the transform with Sphinx."""
    import matplotlib

    matplotlib.use("Agg")
    app.add_config_value("executed_pages", [], "env", [list])
    app.add_transform(Executed)
    return {"parallel_read_safe": False}  # blocks change the folder of the process
