"""The frame of every page: one HTML file with style and script inside, contents, a way past them for the keyboard."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path

from markupsafe import Markup

from mcstudy.files.output import write_file
from mcstudy.report.html import html, joined, templates
from mcstudy.report.style import COLOURS, DARK
from mcstudy.report.typeset import typeset

_FIGURE = re.compile(r'<figure id="([^"]+)".*?<h3[^>]*>(.*?)</h3>', re.DOTALL)

Section = tuple[str, str, Markup]
"""Id, heading and content."""


def document(title: str, introduction: Markup, parts: Sequence[Section], footer: str) -> str:
    """A page.

    Parameters
    ----------
    title, footer: text. introduction: what is below the title. parts: the sections; those without content are left out.
    """
    held = [part for part in parts if part[2]]
    body = joined(
        html('<section id="{0}" aria-labelledby="{0}-h"><h2 id="{0}-h">{1}</h2>{2}</section>', *part) for part in held
    )
    contents = [(key, heading, [(k, Markup(h)) for k, h in _FIGURE.findall(c)]) for key, heading, c in held]
    script = Markup(_file("page.js"))
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    # Nothing is fetched and no other script runs, whatever a study's texts contain.
    policy = f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'; img-src data: blob:"
    shown = (Markup(typeset(x)) for x in (introduction, body))
    return str(templates().document(title, *shown, contents, footer, _style(), script, Markup(policy)))


def write_page(path: str | Path, text: Callable[[], str]) -> Path:
    """Write the page that ``text`` makes, see `mcstudy.files.output.write_file`."""
    return write_file(path, lambda: text().encode("utf-8", "backslashreplace"))


def _style() -> Markup:
    text = _file("page.css")
    for place, palette in (("/* LIGHT */", COLOURS), ("/* DARK */", DARK)):
        text = text.replace(place, "".join(f"--{name}:{value};" for name, value in palette.items()))
    return Markup(text)


def _file(name: str) -> str:
    return files("mcstudy.report").joinpath(name).read_text(encoding="utf-8")


DATA = (".zarr", ".nc", ".toml", ".csv")
"""Endings that a page has .html instead of."""


def page_of(file: Path) -> Path:
    """The page of a cube or a recording when no other is asked for: ``results/a.zarr`` has ``results/a.html``."""
    return file.with_name(f"{file.stem if file.suffix in DATA else file.name}.html")
