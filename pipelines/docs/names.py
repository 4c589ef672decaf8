"""What docstrings need to read well on the site: links from bare names, one entry per name, absolute values."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.nodes import make_refnode


def link(app: Sphinx, env: BuildEnvironment, node: pending_xref, text: nodes.TextElement) -> nodes.Element | None:
    """The link of a name without its module, if exactly one documented object has it; None leaves it as it is."""
    objects = env.domains.python_domain.objects
    found = [n for n, o in objects.items() if n.rpartition(".")[2] == node["reftarget"] and not o.aliased]
    if node.get("refdomain") != "py" or len(found) != 1:
        return None
    entry = objects[found[0]]
    return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, [text], found[0])


def plain(_app: Sphinx, _what: str, _name: str, _obj: Any, _options: Any, lines: list[str]) -> None:
    """Split ``low, high`` into two entries, which napoleon does for parameters only; keep ``|x|`` as it is written."""
    text = re.sub(
        r"^(\w+(?:, \w+)+)\n((?: {4}.*\n?)+)",
        lambda m: "".join(f"{name}\n{m[2].rstrip()}\n" for name in m[1].split(", ")),
        "\n".join(lines),
        flags=re.MULTILINE,
    )
    lines[:] = re.sub(r"(``.*?``)|\|", lambda m: m[1] or r"\|", text).split("\n")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("autodoc-process-docstring", plain, priority=400)  # before napoleon
    app.connect("missing-reference", link)
    return {"parallel_read_safe": True}
