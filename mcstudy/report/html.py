"""Pieces of the page as HTML text; everything that comes from a study is escaped here and nowhere else."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """A table; the first column names its rows."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


def escape(text: object) -> str:
    """Text for an element or an attribute."""
    return html.escape(str(text))


def table(content: Table, kind: str = "numbers") -> str:
    """A table in a box of its own that scrolls when the window is narrow."""
    kind += " broad" if len(content.header) > 8 else ""
    head = "".join(f'<th scope="col">{escape(h)}</th>' for h in content.header)
    body = "".join(
        f'<tr><th scope="row">{escape(row[0])}</th>' + "".join(f"<td>{escape(c)}</td>" for c in row[1:]) + "</tr>"
        for row in content.rows
    )
    return (
        f'<div class="scroll" role="region" tabindex="0" aria-label="{escape(content.caption)}">'
        f'<table class="{kind}"><caption>{escape(content.caption)}</caption>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def details(summary: str, content: str) -> str:
    """Content that opens on demand, and in print."""
    return f"<details><summary>{escape(summary)}</summary>{content}</details>"
