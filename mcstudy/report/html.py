"""Pieces of the page as HTML text; everything that comes from a study is escaped here and nowhere else."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """A table; the first column names its rows. ``kind``: its class on the page, see `table`."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    kind: str = "numbers"


def escape(text: object) -> str:
    """Text for an element or an attribute."""
    return html.escape(str(text))


def table(content: Table, kind: str = "") -> str:
    """A table in a box of its own that scrolls when the window is narrow.

    ``kind``: its class instead of the table's own. Tables of kinds "rows" and "wide" wrap long cells.
    """
    kind = kind or content.kind
    kind += " broad" if len(content.header) > 8 else ""
    head = "".join(f'<th scope="col">{escape(h)}</th>' for h in content.header)
    body = "".join(
        f'<tr><th scope="row">{escape(row[0])}</th>' + "".join(f"<td>{escape(text)}</td>" for text in row[1:]) + "</tr>"
        for row in content.rows
    )
    return (
        f'<div class="scroll" role="region" tabindex="0" aria-label="{escape(content.caption)}">'
        f'<table class="{kind}"><caption><span>{escape(content.caption)}</span></caption>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def tiles(entries: Iterable[tuple[str, ...]]) -> str:
    """The first numbers of a page: what, number, remark and, where there is more, its id; empty without any."""
    boxes = "".join(
        f"<li><span>{escape(what)}</span><strong>{escape(value)}</strong><small>{escape(remark)}"
        + "".join(f' <a href="#{key}">more</a>' for key in more)
        + "</small></li>"
        for what, value, remark, *more in entries
    )
    return boxes and f'<ul class="tiles">{boxes}</ul>'


def commands(command: str) -> str:
    """The command that makes a page with ``--html`` last, and the one that prints its numbers."""
    page, numbers = escape(command), escape(command.split(" --html ")[0])
    return f"<pre><code>{page}    # this page\n{numbers} --json    # every number of it</code></pre>"


def details(summary: str, content: str) -> str:
    """Content that opens on demand, and in print."""
    return f"<details><summary>{escape(summary)}</summary>{content}</details>"
