"""The frame of every page: one HTML file with its style inside, contents, a way past them for the keyboard."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path

from mcstudy.errors import InputError
from mcstudy.files.durable import replacing
from mcstudy.report.html import escape
from mcstudy.report.style import COLOURS, DARK


def document(title: str, introduction: str, parts: Sequence[tuple[str, str, str]], footer: str) -> str:
    """A page.

    Parameters
    ----------
    title, footer: text. introduction: HTML below the title.
    parts: (id, heading, HTML) of every section; sections without HTML are left out.
    """
    held = [part for part in parts if part[2]]
    contents = "".join(
        f'<li><a href="#{key}">{escape(heading)}</a>{_figures_of(content)}</li>' for key, heading, content in held
    )
    body = "".join(
        f'<section id="{key}" aria-labelledby="{key}-h"><h2 id="{key}-h">{escape(heading)}</h2>{content}</section>'
        for key, heading, content in held
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,">'
        f"<title>{escape(title)} · mcstudy report</title><style>{_style()}</style></head><body>"
        '<a class="skip" href="#main">Skip to the results</a>'
        f"<header><h1>{escape(title)}</h1>{introduction}</header>"
        f'<nav aria-label="Contents"><ul>{contents}</ul></nav><main id="main" tabindex="-1">{body}</main>'
        f"<footer><p>{escape(footer)}</p></footer></body></html>\n"
    )


_FIGURE = re.compile(r'<figure id="([^"]+)"[^>]*><h3[^>]*>(.*?)</h3>')


def _figures_of(content: str) -> str:
    """The figures of a section as a list of links."""
    links = "".join(f'<li><a href="#{key}">{heading}</a></li>' for key, heading in _FIGURE.findall(content))
    return f"<ul>{links}</ul>" if links else ""


def write_page(path: str | Path, text: Callable[[], str]) -> Path:
    """Write the page that ``text`` makes; the file is begun first: nobody should wait for a page that cannot be kept.

    Raises `InputError` for a file that cannot be written.
    """
    file = Path(path)
    place = file.resolve()  # a link stays one
    with contextlib.ExitStack() as stack:
        try:
            if place.exists():
                place.open("ab").close()
            opened = stack.enter_context(replacing(place))
        except OSError as error:
            raise InputError(f"{file}: expected a writable file, got {error.strerror}") from None
        opened.write(text().encode())
    return file


def _style() -> str:
    def variables(palette: dict[str, str]) -> str:
        return "".join(f"--{name}:{value};" for name, value in palette.items())

    text = files("mcstudy.report").joinpath("page.css").read_text(encoding="utf-8")
    return text.replace("/* LIGHT */", variables(COLOURS)).replace("/* DARK */", variables(DARK))
