"""Description of a study and tables of its page: the comparison with a publication, and all groups in numbers."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from typing import Any

from markupsafe import Markup

from mcstudy.analysis.publications.verdict_names import AGREES, CANNOT_TELL, DIFFERS
from mcstudy.analysis.show.missed_minimum import missed_words
from mcstudy.analysis.show.text import incomplete, ours, verdict
from mcstudy.analysis.statistics import CELL_STATISTICS, CellStatistic
from mcstudy.fitting.certainty import MISSED
from mcstudy.report.html import html, joined, paragraphs, table
from mcstudy.report.labels import cell_label
from mcstudy.report.numbers import short
from mcstudy.report.study.context import Context, stat
from mcstudy.study.instability import warning
from mcstudy.text_tables import Table, counted, number

CLASS = {AGREES: "yes", DIFFERS: "no", CANNOT_TELL: "none", None: "none"}

STATEMENT = ["What", "Verdict", "Paper", "Ours ± MCSE", "z", "Where"]
"""Columns of the table of published statements."""


def introduction(context: Context) -> Markup:
    """Description of the study, origin of its true values, what is pending, meaning of its amplitudes."""
    views = context.study.groups
    falls = [("Warning", f"group {name}: {warning(v.instability)}") for name, v in views.items() if v.instability]
    truths = [("True values", text) for text in dict.fromkeys(view.provenance for view in views.values())]
    marked = joined(html('<p class="truth"><strong>{}:</strong> {}.</p>', *pair) for pair in [*falls, *truths])
    if left := incomplete(context.data):
        marked += html("<p><strong>{}</strong></p>", left)
    conventions = dict.fromkeys(v.group.stimulus.convention.replace("_", " ") for v in views.values())
    amplitudes = f"Amplitudes of the stimulus are {' and '.join(conventions)} values."
    return paragraphs([_study_field(context, "description")]) + marked + paragraphs([amplitudes])


def _study_field(context: Context, field: str) -> str:
    try:
        study = tomllib.loads(str(context.tree.attrs.get("study", "")))
    except tomllib.TOMLDecodeError:
        return ""
    return str(study.get("study", {}).get(field, ""))


def headline(context: Context) -> Markup:
    """The published statements beside our numbers; empty where none is about this study."""
    rows = list(context.published.values())
    if not rows:
        return Markup("")
    counts = {name: sum(r["verdict"] == name for r in rows) for name in (AGREES, DIFFERS, CANNOT_TELL)}
    notes = list(dict.fromkeys(r["explanation"] for r in rows if r["explanation"]))
    why = html('<p>Why ours differs:</p><ol class="notes">{}</ol>', _items(notes, "note-")) if notes else Markup("")
    laid_out = context.publication.table(context.published)
    return (
        html(
            "<p>Of {} published statements, {} agree with ours, {} differ, and {} are inconclusive ({}).</p>",
            *(sum(counts.values()), *counts.values(), context.data["paper"]["reference"]),
        )
        + (Markup("") if laid_out is None else table(laid_out))
        + table(Table("All published statements", STATEMENT, [_statement(r, notes) for r in rows], kind="stack"))
        + why
        + paragraphs(context.publication.reading)
        + html(
            "<p>Floor: mean |bias| expected from chance alone, for unbiased estimates from as many realizations as "
            "published. <code>mcstudy show OUT</code> prints these numbers.</p>"
        )
    )


def _items(texts: Sequence[str], key: str) -> Markup:
    return joined(html('<li id="{}{}">{}</li>', key, i, text) for i, text in enumerate(texts, 1))


def _statement(row: dict[str, Any], notes: Sequence[str]) -> list[str]:
    """Cells of a row under `STATEMENT`; the verdict links to its explanation."""
    link = html(' <a href="#note-{0}">[{0}]</a>', notes.index(row["explanation"]) + 1) if row["explanation"] else ""
    value = ours(row) + (f" (floor {number(row['floor'], 2)})" if row["floor"] is not None else "")
    return [
        row["label"],
        _verdict(row) + link,
        _paper(row),
        value + (html("<br> <small>{}</small>", row["detail"]) if row["detail"] else ""),
        number(row["distance"], 2),
        html("<small>{}</small>", row["where"]),
    ]


def _verdict(row: dict[str, Any]) -> Markup:
    return html('<span class="{}">{}</span>', CLASS[row["verdict"]], verdict(row))


def _paper(row: dict[str, Any]) -> str:
    """The published number; a unit follows numbers only."""
    text, unit = str(row["paper_text"]), row["unit"]
    alone = row["criterion"] in ("at least", "none") or unit in ("1", "starts") or not text[-1:].isdigit()
    return text if alone else f"{text} {unit}"


def published_beside(context: Context, keys: Sequence[str]) -> Markup:
    """The published numbers that belong to a figure, by key, as a list."""
    lines = joined(
        html("<li>{}: paper {}, ours {}", row["label"], _paper(row), ours(row))
        + (" " + _verdict(row) if row["verdict"] else "")
        + html("</li>")
        for row in (context.published[key] for key in keys if key in context.published)
    )
    return lines and html('<ul class="beside">{}</ul>', lines)


def _columns(statistic: CellStatistic, entry: dict[str, Any]) -> list[str]:
    floor = short(statistic.factor * (entry.get("floor") or float("nan")), 2)
    return [stat(entry, statistic.factor), *[floor] * statistic.floor]


def group_overviews(context: Context) -> Markup:
    """Every group: its size, what became of its fits, and the quality of its best fits by condition."""
    views = context.study.groups.items()
    return joined(_group_overview(context, name) for name, view in views if view.group.cell is None)


def _group_overview(context: Context, name: str) -> Markup:
    view, data = context.study.groups[name], context.data["groups"][name]
    g, columns = view.group, [s for s in CELL_STATISTICS if s.page]
    fits = ", ".join(f"{n} {k.replace('_', ' ')}" for k, n in data["fits"].items() if n)
    size = f"{counted(g.realizations, 'realization' if view.noisy else 'pool')} of {g.starts_in_words}"
    heads = [head for s in columns for head in (s.page, *["floor"] * s.floor)]
    rows = [
        [
            cell_label(view, c["amplitude"], c["fmax"]),
            f"{c['realizations']['used']}/{sum(c['realizations'].values())}",
            *(text for s in columns for text in _columns(s, c[s.key])),
            missed_words(c, error=True),
        ]
        for c in data["cells"]
    ]
    differs = f"Differs from the default settings in: {'; '.join(view.differences)}."
    return (
        html("<h3>{}</h3>", name)
        + paragraphs([f"{size}; model {g.model.title}, cost {g.fit.cost}, solver {g.fit.solver}. Fits: {fits}."])
        + table(Table(f"Group {name}: best fits, ± MCSE", ["condition", "used", *heads, f"{MISSED} (%)"], rows))
        + paragraphs([differs if view.differences else "", *data["notes"]])
    )
