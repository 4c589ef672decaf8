"""The directive ``{effects}``: a table of the library of effects, with the source of every published size."""

from __future__ import annotations

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from mcstudy.effect_library.library import LIBRARY


class Effects(SphinxDirective):
    """One entry per effect: where it acts, its equation, and the published range of every parameter."""

    def run(self) -> list[nodes.Node]:
        """The entries."""
        text = []
        for e in LIBRARY.values():
            sizes = []
            for s in e.sizes:
                low, high = s.published
                sizes.append(f"`{s.name}`: {s.meaning}, {'±' if s.signed else ''}{low:.3g} to {high:.3g} {s.unit}")
            facts = [f"{', '.join(e.place)}: `{e.equation}`", *(size.strip() for size in sizes), f"source: {e.source}"]
            text += [f"`{e.name}`", ": " + "\n\n  ".join(facts), ""]
        return self.parse_text_to_nodes("\n".join(text))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive with Sphinx."""
    app.add_directive("effects", Effects)
    return {"parallel_read_safe": True}
