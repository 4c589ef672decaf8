"""Numbers and columns as plain text, folded to the width of the terminal."""

from __future__ import annotations

import contextlib
import math
import os
import re
import shutil
import sys
import textwrap
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from contextvars import ContextVar
from html import escape
from typing import NamedTuple

PROSE = 118
"""Longest line of prose, in characters."""

NARROWEST = 16
"""Words are wrapped into columns of at least this width, or of their longest word."""

GAP = "  "
"""Between two columns."""


class Table(NamedTuple):
    """One table; the first column names its rows.

    Attributes
    ----------
    title, header, rows: as text. note: explanation of entries that need one.
    kind: how a page shows it: "numbers"; "facts"; "rows" and "wide", whose long cells are wrapped; "stack", for many
        rows, which scrolls.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    kind: str = "numbers"

    def text(self, *, titled: bool = False) -> str:
        """The table with its note below, and with its title above if ``titled``."""
        parts = [self.title] * titled + [table(self.header, self.rows)] + [fill(self.note)] * bool(self.note)
        return "\n".join(parts)

    def html(self) -> str:
        """Title, columns and note for a notebook."""
        head = "".join(f"<th scope='col'>{escape(cell)}</th>" for cell in self.header)
        body = "".join(
            f"<tr><th scope='row'>{escape(first)}</th>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
            for first, *cells in self.rows
        )
        caption = f"<caption>{escape(self.title)}</caption>" if self.title else ""
        heads = f"<thead><tr>{head}</tr></thead>" if head else ""
        note = f"<p>{escape(self.note)}</p>" if self.note else ""
        return f"<table>{caption}{heads}<tbody>{body}</tbody></table>{note}"


_folds: ContextVar[bool] = ContextVar("folds", default=True)


def terminal_width() -> int | None:
    """Columns of the terminal, or of the variable COLUMNS; None for a file or a pipe, for which nothing is folded."""
    if not _folds.get() or not (os.environ.get("COLUMNS", "").isdigit() or (sys.stdout and sys.stdout.isatty())):
        return None
    return max(shutil.get_terminal_size().columns, 40)


@contextlib.contextmanager
def unfolded() -> Iterator[None]:
    """Text that goes to a file, whatever the terminal."""
    token = _folds.set(False)
    try:
        yield
    finally:
        _folds.reset(token)


def escaped(text: str) -> str:
    """A text of others as it may be shown: characters that control a terminal are written as their codes.

    So are halves of characters, which stand for bytes of a file name that are not UTF-8. Line breaks stay.
    """
    if text.isprintable():
        return text
    return "".join(c if c == "\n" or _shown(c) else c.encode("unicode_escape").decode("ascii") for c in text)


def _shown(character: str) -> bool:
    return character.isprintable() or unicodedata.category(character) == "Zs"  # blanks of any width


def fill(text: str, indent: str = "") -> str:
    """Prose in lines that fit the terminal, at most `PROSE` long; ``indent`` is in front of all but the first.

    Numbers with their errors and percent signs stay whole.
    """
    width = min(terminal_width() or PROSE, PROSE)
    whole = escaped(text).replace(" %", "\xa0%").replace(" ± ", "\xa0±\xa0")
    lines = textwrap.fill(whole, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return lines.replace("\xa0", " ")


def folded(text: str) -> str:
    """Text whose lines are broken where the terminal ends; without a terminal as it is."""
    width, text = terminal_width(), escaped(text)
    if width is None:
        return text
    return "\n".join(fill(line, _indent(line)) if len(line) > width else line for line in text.split("\n"))


def _indent(line: str) -> str:
    return " " * (len(line) - len(line.lstrip()) + 2)


def number(value: float | None, digits: int = 3) -> str:
    """A number to ``digits`` significant digits, or a dash."""
    if value is None:
        return "-"
    if value != 0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.{digits - 1}e}"
    decimals = digits - 1 - (math.floor(math.log10(abs(value))) if value else 0)
    return f"{round(value, decimals):.{max(decimals, 0)}f}"


def ends(low: float | None, high: float | None) -> str:
    """An interval by its ends: ``586 to 1309``."""
    return f"{number(low)} to {number(high)}"


ROUNDING = 1e-12
"""Share of a value below which its error is rounding."""


def with_error(value: float | None, mcse: float | None) -> str:
    """``value ± mcse``, both to the second digit of the error; NaN, and an error that is rounding, are none."""
    value, mcse = (None if x is None or math.isnan(x) else x for x in (value, mcse))
    if value is None or mcse is None or mcse <= ROUNDING * abs(value):
        return number(value)
    if not 1e-3 <= max(abs(value), mcse) < 1e5:
        return f"{number(value, 2)} ± {number(mcse, 2)}"
    decimals = max(1 - math.floor(math.log10(mcse)), 0)
    if decimals > 5:
        return f"{number(value)} ± {number(mcse, 2)}"
    return f"{round(value, decimals) + 0.0:.{decimals}f} ± {mcse:.{decimals}f}"  # + 0.0: not -0


LEAST_P = 1e-4
"""P-values below this are not told apart."""


def p_value(p: float, least: float = LEAST_P) -> str:
    """A p-value to two digits: ``0.012``, ``< 0.0001``, ``> 0.99``. ``least``: the smallest that its test can give."""
    return f"< {least:.2g}" if p <= 1.01 * least else "> 0.99" if p > 0.99 else f"{p:.2g}"


def p_words(p: float, least: float = LEAST_P, name: str = "p") -> str:
    """A p-value in a sentence: ``p = 0.012``, ``p < 0.0001``."""
    return with_sign(p_value(p, least), name)


def with_sign(value: str, name: str = "p") -> str:
    """``p = 0.012`` for the p-value ``0.012``, ``p < 0.0001`` for ``< 0.0001``."""
    return f"{name} {value}" if value.startswith(("<", ">")) else f"{name} = {value}"


def starts_in_words(starts: int, until_certain: bool) -> str:
    """Number of starts of a fit; the largest number where they are drawn until certain."""
    return f"at most {counted(starts, 'start')}, until certain" if until_certain else counted(starts, "start")


def printable(text: str, most: int | None = None) -> str:
    """Text of others in one line of at most ``most`` characters, without characters that control a terminal."""
    line = escaped(" ".join(text.split()))
    return line if most is None or len(line) <= most else f"{line[: most - 3]}..."


def counted(n: int, what: str) -> str:
    """``1 start``, ``2 starts``."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def similar(name: str, known: Iterable[str]) -> str:
    """The known name that is most like one that is not known, or differs in case, in brackets; empty where none is."""
    import difflib  # needed for mistakes only

    names = list(known)
    near = difflib.get_close_matches(name, names, n=1) or [k for k in names if k.lower() == name.lower()]
    return f" (similar: {near[0]})" if near else ""


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, of_text: bool = False, ruled: bool = True) -> str:
    """A text table with columns of minimal width; the first is left-aligned, the others are right-aligned.

    Where the terminal is narrower, headings and then words are wrapped inside their columns, never numbers. Columns
    that still have no room follow below, behind the first column again.

    ``of_text``: all columns are left-aligned, with one rule under all headings. ``ruled``: whether there is a rule.
    """
    lines, room = [[escaped(c) for c in line] for line in (header, *rows)], terminal_width()
    natural = [max(len(line[i]) for line in lines) for i in range(len(header))]
    if room is None or _total(natural) <= room:
        return _block(lines, natural, of_text, ruled)
    words = [max(map(len, h.split()), default=0) for h in lines[0]]
    words[0] += len(GAP) * (" " in lines[0][0])  # what is wrapped in the first column is indented
    calm = [max(words[i], *(len(row[i]) for row in lines[1:])) if rows else words[i] for i in range(len(header))]
    least = [max(words[i], *(_least(row[i]) for row in lines[1:])) if rows else words[i] for i in range(len(header))]
    least[0] = min(least[0], room // 2)
    blocks, columns = [], [0]
    for i in range(1, len(header)):
        if len(columns) > 1 and _total([least[k] for k in (*columns, i)]) > room:
            blocks.append(columns)
            columns = [0]
        columns.append(i)
    return "\n\n".join(
        _block(
            [[line[k] for k in block] for line in lines],
            _narrowed(
                _narrowed([natural[k] for k in block], [calm[k] for k in block], room), [least[k] for k in block], room
            ),
            of_text,
            ruled,
        )
        for block in (*blocks, columns)
    )


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + len(GAP) * (len(widths) - 1)


_NUMBER = re.compile(r"[-+±<>≥≤]?\s?\d|-$")


def _least(cell: str) -> int:
    """Width below which a cell is not wrapped: numbers with their errors and units stay in one line."""
    if _NUMBER.match(cell):
        return len(cell)
    return min(len(cell), max(NARROWEST, *map(len, cell.split()))) if cell else 0


def _narrowed(widths: list[int], least: list[int], room: int) -> list[int]:
    """Widths that share the room, none below its least: the widest give way first."""
    widths = list(widths)
    while _total(widths) > room:
        spare = [(w, j) for j, w in enumerate(widths) if w > least[j]]
        if not spare:
            break
        widths[max(spare)[1]] -= 1
    return widths


def _block(lines: list[list[str]], widths: list[int], of_text: bool, ruled: bool) -> str:
    """Lines of cells, the first of them the header, as text."""

    def line(cells: Sequence[str]) -> list[str]:
        wrapped = [
            textwrap.wrap(c, w, subsequent_indent=GAP if i == 0 else "", break_on_hyphens=False) or [""]
            if len(c) > w
            else [c]
            for i, (c, w) in enumerate(zip(cells, widths, strict=True))
        ]
        rows = []
        for k in range(max(map(len, wrapped))):
            parts = [part[k] if k < len(part) else "" for part in wrapped]
            aligned = [
                c.ljust(w) if of_text or i == 0 else c.rjust(w)
                for i, (c, w) in enumerate(zip(parts, widths, strict=True))
            ]
            rows.append(GAP.join(aligned).rstrip())
        return rows

    first, *rest = (line(cells) for cells in lines)
    rule = "-" * max(len(text) for row in (first, *rest) for text in row)
    if not of_text:
        (rule,) = line(["-" * w for w in widths])
    return "\n".join([*first, *[rule] * ruled, *(text for row in rest for text in row)])
