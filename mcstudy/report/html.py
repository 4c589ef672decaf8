"""Pieces of pages as HTML. Text is escaped wherever it enters one; what is HTML already is `Markup`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from mcstudy.text_tables import Table


@cache
def templates() -> Any:
    """The macros of ``page.html``, as functions that return `Markup`."""
    text = files("mcstudy.report").joinpath("page.html").read_text(encoding="utf-8")
    known = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return known.from_string(text).module


def html(form: str, *texts: object) -> Markup:
    """HTML with texts in the place of its braces."""
    return Markup(form).format(*texts)


def joined(parts: Iterable[Markup]) -> Markup:
    """Pieces one after the other."""
    return Markup("").join(parts)


def paragraphs(texts: Iterable[str], kind: str = "") -> Markup:
    """A paragraph for every text that is not empty."""
    opening = f'<p class="{kind}">' if kind else "<p>"
    return joined(html(opening + "{}</p>", text) for text in texts if text)


def table(content: Table, kind: str = "") -> Markup:
    """A table with its note, in a box that scrolls when the window is narrow; ``kind``: instead of the table's own."""
    return Markup(templates().table(content, kind or content.kind))


def tiles(entries: Sequence[tuple[str, ...]]) -> Markup:
    """The first numbers of a page: what, number, remark and, where there is more, its id; empty without any."""
    return Markup(templates().tiles(entries))


def code(*lines: str) -> Markup:
    """Commands to copy."""
    return html("<pre><code>{}</code></pre>", "\n".join(lines))


def commands(command: str) -> Markup:
    """The command that makes a page with ``--html`` last, and the one that prints its numbers."""
    return code(f"{command}    # this page", f"{command.split(' --html ')[0]} --json    # every number of it")


def details(summary: str, content: Markup) -> Markup:
    """Content that opens on demand, and in print."""
    return html("<details><summary>{}</summary>{}</details>", summary, content)
