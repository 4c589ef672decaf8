"""The frame of every page: one HTML file with style and script inside, contents, a way past them for the keyboard."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path

from mcstudy.files.output import write_file
from mcstudy.report.html import escape
from mcstudy.report.style import COLOURS, DARK
from mcstudy.report.typeset import typeset

_FIGURE = re.compile(r'<figure id="([^"]+)".*?<h3[^>]*>(.*?)</h3>', re.DOTALL)


def document(title: str, introduction: str, parts: Sequence[tuple[str, str, str]], footer: str) -> str:
    """A page.

    Parameters
    ----------
    title, footer: text. introduction: HTML below the title.
    parts: (id, heading, HTML) of every section; sections without HTML are left out.
    """
    held = [part for part in parts if part[2]]
    contents = "".join(_entry(*part) for part in held)
    body = "".join(
        f'<section id="{key}" aria-labelledby="{key}-h"><h2 id="{key}-h">{escape(heading)}</h2>{content}</section>'
        for key, heading, content in held
    )
    script = _file("page.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    # Nothing is fetched and no other script runs, whatever a study's texts contain.
    policy = f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'; img-src data: blob:"
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,">'
        f"<title>{escape(title)} · mcstudy report</title><style>{_style()}</style>"
        f"<noscript><style>{_OPEN}</style></noscript></head><body>"
        '<a class="skip" href="#main">Skip to the results</a>'
        f'<nav aria-label="Contents"><details><summary>Contents</summary><ul>{contents}</ul></details></nav>'
        f'<div class="page"><header><h1>{escape(title)}</h1>{typeset(introduction)}</header>'
        f'<main id="main" tabindex="-1">{typeset(body)}</main><footer><p>{escape(footer)}</p></footer></div>'
        f"<script>{script}</script></body></html>\n"
    )


_OPEN = "details::details-content{content-visibility:visible;display:block;block-size:auto}"
"""Without scripts everything is visible."""


def _entry(key: str, heading: str, content: str) -> str:
    """A section in the contents, with its figures."""
    figures = "".join(f'<li><a href="#{k}">{text}</a></li>' for k, text in _FIGURE.findall(content))
    within = f"<ul>{figures}</ul>" if figures else ""
    return f'<li><a href="#{key}">{escape(heading)}</a>{within}</li>'


def write_page(path: str | Path, text: Callable[[], str]) -> Path:
    """Write the page that ``text`` makes, see `mcstudy.files.output.write_file`."""
    return write_file(path, lambda: text().encode("utf-8", "backslashreplace"))


def _style() -> str:
    def variables(palette: dict[str, str]) -> str:
        return "".join(f"--{name}:{value};" for name, value in palette.items())

    text = _file("page.css")
    return text.replace("/* LIGHT */", variables(COLOURS)).replace("/* DARK */", variables(DARK))


def _file(name: str) -> str:
    return files("mcstudy.report").joinpath(name).read_text(encoding="utf-8")


DATA = (".zarr", ".nc", ".toml", ".csv")
"""Endings that a page has .html instead of."""


def page_of(file: Path) -> Path:
    """The page of a cube or a recording when no other is asked for: ``results/a.zarr`` has ``results/a.html``."""
    return file.with_name(f"{file.stem if file.suffix in DATA else file.name}.html")
