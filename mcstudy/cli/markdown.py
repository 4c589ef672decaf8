"""A page of the documentation (Markdown) as text that fits the terminal."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence

from mcstudy.text_tables import fill, table, terminal_width

_COMMENT = re.compile(r"<!--.*?-->")
_LINK = re.compile(r"!?\[([^\]]*)\]\(([^)\s]*)\)")
_ITEM = re.compile(r"(\s*)([-*]|\d+\.)\s+")
_RULE = re.compile(r"\|[-:|\s]*\|")
_BREAK = re.compile(r"\s*(#|>|```|([-*]|\d+\.)\s)")


def as_text(page: str) -> str:
    """The page with paragraphs, lists and tables folded to the terminal; as it is where the output is no terminal.

    Links become their words, web addresses stay. Code is never folded; comments and directives of the site
    are left out.
    """
    width = terminal_width()
    return page if width is None else "\n".join(_lines(page.split("\n"), width))


def _lines(lines: Sequence[str], width: int) -> Iterator[str]:
    i = 0
    while i < len(lines):
        line = lines[i]
        if line.lstrip().startswith("```"):
            end = next((k for k in range(i + 1, len(lines)) if lines[k].lstrip().startswith("```")), len(lines) - 1)
            if not line.lstrip().startswith("```{"):  # a directive of the site
                yield from lines[i : end + 1]
            i = end + 1
        elif line.startswith("<!--"):
            i = next((k for k in range(i, len(lines)) if "-->" in lines[k]), len(lines)) + 1
        elif line.startswith("|") and _RULE.fullmatch("".join(lines[i + 1 : i + 2])):
            rows = list(itertools.takewhile(lambda text: text.startswith("|"), lines[i:]))
            yield _table([_cells(row) for row in rows], width)
            i += len(rows)
        elif not line.strip() or line.startswith(("#", "    ")):
            yield line
            i += 1
        else:
            rest = list(itertools.takewhile(lambda text: text.strip() and not _BREAK.match(text), lines[i + 1 :]))
            item = _ITEM.match(line)
            lead, hanging = (item.group(1), " " * item.end()) if item else ("", "")
            yield fill(lead + _plain(" ".join(text.strip() for text in (line, *rest))), hanging)
            i += 1 + len(rest)


def _plain(text: str) -> str:
    """Text without comments, its links replaced by their words, and by their address where it is on the web."""
    return _LINK.sub(lambda m: f"{m[1]} ({m[2]})" if m[2].startswith("http") else m[1], _COMMENT.sub("", text))


def _cells(row: str) -> list[str]:
    cells = re.split(r"(?<!\\)\|", row.strip().strip("|"))
    return [_plain(cell.strip().replace("\\|", "|")) for cell in cells]


def _table(rows: list[list[str]], width: int) -> str:
    """A table, or one paragraph per row where its columns have no room."""
    header, body = rows[0], [row for row in rows[1:] if not all(re.fullmatch(r":?-+:?", cell) for cell in row)]
    body = [(row + [""] * len(header))[: len(header)] for row in body]
    text = table(header, body, of_text=True)
    if max(map(len, text.split("\n"))) <= width and "\n\n" not in text:
        return text
    return "\n".join(
        "\n".join(
            fill(f"    {name}: {cell}" if i and name else "    " * (i > 0) + cell, "      " if i else "    ")
            for i, (name, cell) in enumerate(zip(header, row, strict=True))
            if cell
        )
        for row in body
    )
