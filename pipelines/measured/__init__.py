"""Measured numbers: small JSON files that commands write, and the pages that show them.

A command that measures writes ``pipelines/measured/NAME.json`` (`write`): what was run, when, with which version, and
values and tables by key. A page shows them between comments that no reader sees:

    <!--=NAME.KEY-->97.5 %<!--/-->           a value, not at the start of a line; <!--=NAME.KEY:.2f--> with a format
    <!--=table NAME.KEY-->...<!--/-->        a table, on lines of its own

``python -m pipelines.docs --numbers`` writes what the files say into the pages, and the build of the site and a test
refuse a page that says anything else, or names what no file has.
"""

from __future__ import annotations

import datetime
import json
import re
import shlex
import sys
from argparse import ArgumentParser
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
PAGES = ("README.md", "results_schema/*.md", "pipelines/**/*.md", "mcstudy/**/*.md")

VALUE = re.compile(r"<!--=([\w-]+)\.(\w+)(?::([^>]*?))?-->(.*?)<!--/-->", re.DOTALL)
TABLE = re.compile(r"<!--=table ([\w-]+)\.(\w+)-->\n.*?<!--/-->", re.DOTALL)

Value = Mapping[str, Any]
"""``value``, and optionally ``unit``, ``error`` (a standard error), or ``low`` and ``high`` (of a 95 % interval)."""


class UnknownNumberError(LookupError):
    """A page names a number that no result has."""


def pages() -> list[Path]:
    """All pages of the repository."""
    return sorted({page for place in PAGES for page in ROOT.glob(place)})


def add_option(parser: ArgumentParser) -> None:
    """``--json FILE`` of a command that measures."""
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the numbers of its page to FILE")


def write(
    file: Path | None,
    values: Mapping[str, Value] | None = None,
    tables: Mapping[str, tuple[Sequence[str], Sequence[Sequence[object]]]] | None = None,
) -> None:
    """Write what the running command has measured.

    Parameters
    ----------
    file:
        Usually of `FOLDER`; None writes nothing.
    values:
        Numbers by key.
    tables:
        By key, the names of the columns and the rows; cells are numbers or text as a page shall show it.
    """
    if file is None:
        return
    document = {
        "command": shlex.join(["python", *_words()]),
        "date": datetime.date.today().isoformat(),
        "version": version("mcstudy"),
        "values": dict(values or {}),
        "tables": {key: {"columns": columns, "rows": rows} for key, (columns, rows) in (tables or {}).items()},
    }
    file.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _words() -> list[str]:
    """Arguments of this process without ``--json FILE``; its program as seen from the repository."""
    program = Path(sys.argv[0])
    words = [program.relative_to(ROOT).as_posix() if program.is_relative_to(ROOT) else program.as_posix()]
    skip = False
    for word in sys.argv[1:]:
        if not skip and word != "--json" and not word.startswith("--json="):
            words.append(word)
        skip = word == "--json"
    return words


@cache
def load(name: str) -> dict[str, Any]:
    """The file ``name``; raises `UnknownNumberError` where there is none."""
    file = FOLDER / f"{name}.json"
    if not file.exists():
        raise UnknownNumberError(f"{name}: no file {file.relative_to(ROOT)}")
    return dict(json.loads(file.read_text(encoding="utf-8")))


def shown(page: str) -> str:
    """The text of a page with the numbers that the files have; raises `UnknownNumberError`."""
    return VALUE.sub(_value, TABLE.sub(_table, page))


def stale(page: Path) -> list[str]:
    """What is wrong with the numbers of a page, a line each."""
    text = page.read_text(encoding="utf-8")
    try:
        right = shown(text)
    except UnknownNumberError as error:
        return [f"{page.relative_to(ROOT)}: {error}"]
    if starts := re.findall(r"^<!--=\w[\w.:-]*-->.*", text, re.MULTILINE):  # which Markdown takes for a block of HTML
        return [f"{page.relative_to(ROOT)}: expected a word before the number on its line, found {starts[0]!r}"]
    lines = zip(text.splitlines(), right.splitlines(), strict=False)
    wrong = next((f"found {a.strip()!r}, measured {b.strip()!r}" for a, b in lines if a != b), "lines are missing")
    return [] if text == right else [f"{page.relative_to(ROOT)}: {wrong}; python -m pipelines.docs --numbers"]


def _entry(kind: str, name: str, key: str) -> dict[str, Any]:
    entries = load(name)[kind]
    if key not in entries:
        raise UnknownNumberError(f"{name}.{key}: not among the {kind} {', '.join(entries) or '(none)'}")
    return dict(entries[key])


def _value(match: re.Match[str]) -> str:
    name, key, spec, _ = match.groups()
    entry = _entry("values", name, key)
    number = {k: format(entry[k], spec or "") for k in ("value", "error", "low", "high") if k in entry}
    text = number["value"] + (f" ± {number['error']}" if "error" in number else "")
    text += f" {entry['unit']}" if entry.get("unit") else ""
    text += f" [{number['low']}, {number['high']}]" if "low" in number else ""
    return f"<!--={name}.{key}{f':{spec}' if spec else ''}-->{text}<!--/-->"


def _table(match: re.Match[str]) -> str:
    name, key = match.groups()
    table = _entry("tables", name, key)
    columns, rows = table["columns"], table["rows"]
    rule = "|".join(["", "---", *["---:"] * (len(columns) - 1), ""])
    head, *body = ("| " + " | ".join(map(str, row)) + " |" for row in (columns, *rows))
    lines = [head, rule, *body]
    return "\n".join([f"<!--=table {name}.{key}-->", "", *lines, "", "<!--/-->"])
