"""Description of a study and tables of its page: the comparison with a publication, and all groups in numbers."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from typing import Any

from mcstudy.analysis.published.verdict_names import AGREES, CANNOT_TELL, DIFFERS
from mcstudy.analysis.show.missed import missed_words
from mcstudy.analysis.show.text import incomplete, ours, verdict
from mcstudy.analysis.statistics import CELL_STATISTICS, CellStatistic
from mcstudy.fitting.certainty import MISSED
from mcstudy.report.html import Table, escape, table
from mcstudy.report.labels import cell_label, with_units
from mcstudy.report.numbers import short
from mcstudy.report.study.context import Context, stat
from mcstudy.study.instability import warning
from mcstudy.text_tables import counted, number

CLASS = {AGREES: "yes", DIFFERS: "no", CANNOT_TELL: "none", None: "none"}


def introduction(context: Context) -> str:
    """Description of the study, origin of its true values, meaning of its amplitudes."""
    description = _study_field(context, "description")
    truths = dict.fromkeys(view.provenance for view in context.study.groups.values())
    conventions = dict.fromkeys(v.group.stimulus.convention.replace("_", " ") for v in context.study.groups.values())
    text = f"<p>{escape(description)}</p>" if description else ""
    falls = {name: view.instability for name, view in context.study.groups.items() if view.instability}
    text += "".join(
        f'<p class="truth"><strong>Warning:</strong> group {escape(name)}: {escape(warning(what))}.</p>'
        for name, what in falls.items()
    )
    text += "".join(f'<p class="truth"><strong>True values:</strong> {escape(t)}.</p>' for t in truths)
    return text + f"<p>Amplitudes of the stimulus are {escape(' and '.join(conventions))} values.</p>"


def _study_field(context: Context, field: str) -> str:
    try:
        study = tomllib.loads(str(context.tree.attrs.get("study", "")))
    except tomllib.TOMLDecodeError:
        return ""
    return str(study.get("study", {}).get(field, ""))


def headline(context: Context) -> str:
    """The table *paper | ours ± MCSE | agrees?*, or a sentence where no number of the paper is about this study."""
    left = incomplete(context.data)
    return (f"<p><strong>{escape(left)}</strong></p>" if left else "") + _headline(context)


def _headline(context: Context) -> str:
    rows = list(context.published.values())
    if not rows:
        return (
            f"<p>The paper has no numbers for the groups of this study, so there is nothing to compare. "
            f"{escape(context.publication.needs)} <code>mcstudy show OUT</code> prints the numbers of this study.</p>"
        )
    counts = {name: sum(r["verdict"] == name for r in rows) for name in (AGREES, DIFFERS, CANNOT_TELL)}
    notes = list(dict.fromkeys(r["explanation"] for r in rows if r["explanation"]))
    head = "".join(f'<th scope="col">{h}</th>' for h in ("What", "Verdict", "Paper", "Ours ± MCSE", "z", "Where"))
    body = "".join(_headline_row(r, notes) for r in rows)
    listed = "".join(f'<li id="note-{i}">{escape(with_units(n))}</li>' for i, n in enumerate(notes, 1))
    return (
        f"<p>Of {sum(counts.values())} published statements, {counts[AGREES]} agree with ours, {counts[DIFFERS]} "
        f"differ, and {counts[CANNOT_TELL]} are inconclusive ({escape(context.data['paper']['reference'])}).</p>"
        + _as_published(context)
        + '<div class="scroll tall" role="region" tabindex="0" aria-label="All published statements">'
        '<table class="stack"><caption><span>All published statements</span></caption>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
        + (f'<p>Why ours differs:</p><ol class="notes">{listed}</ol>' if notes else "")
        + "".join(f"<p>{escape(text)}</p>" for text in context.publication.reading)
        + "<p>Floor: mean |bias| expected from chance alone, for unbiased estimates from 50 realizations. "
        "<code>mcstudy show OUT</code> prints these numbers.</p>"
    )


def _as_published(context: Context) -> str:
    """Rows laid out as the publication does."""
    found = context.publication.table(context.published)
    return "" if found is None else table(Table(*found))


def _headline_row(row: dict[str, Any], notes: Sequence[str]) -> str:
    floor = f" (floor {number(row['floor'], 2)})" if row["floor"] is not None else ""
    detail = f"<br> <small>{escape(row['detail'])}</small>" if row["detail"] else ""
    note = notes.index(row["explanation"]) + 1 if row["explanation"] else 0
    why = f' <a href="#note-{note}">[{note}]</a>' if note else ""
    cells = [
        (escape(verdict(row)) + why, CLASS[row["verdict"]]),
        (escape(_paper(row)), ""),
        (f"{escape(ours(row))}{escape(floor)}{detail}", ""),
        (number(row["distance"], 2), ""),
        (f"<small>{escape(row['where'])}</small>", ""),
    ]
    return (
        f'<tr><th scope="row">{escape(with_units(row["label"]))}</th>'
        + "".join(f'<td class="{kind}">{text}</td>' for text, kind in cells)
        + "</tr>"
    )


def _paper(row: dict[str, Any]) -> str:
    return str(row["paper_text"]) if row["criterion"] in ("at least", "none") else _with_unit(row["paper_text"], row)


def _with_unit(text: str, row: dict[str, Any]) -> str:
    """The unit follows numbers only."""
    return text if row["unit"] in ("1", "starts") or not text[-1:].isdigit() else f"{text} {row['unit']}"


def beside(context: Context, keys: Sequence[str]) -> str:
    """The paper's numbers that belong to a figure, by key, as a list."""
    rows = [context.published[key] for key in keys if key in context.published]
    if not rows:
        return ""
    lines = "".join(
        f"<li>{escape(with_units(r['label']))}: paper {escape(_paper(r))}, ours {escape(ours(r))}"
        + (f' <span class="{CLASS[r["verdict"]]}">{escape(verdict(r))}</span></li>' if r["verdict"] else "</li>")
        for r in rows
    )
    return f'<ul class="beside">{lines}</ul>'


def _columns(statistic: CellStatistic, entry: dict[str, Any]) -> list[str]:
    floor = short(statistic.factor * (entry.get("floor") or float("nan")), 2)
    return [stat(entry, statistic.factor), *[floor] * statistic.floor]


def group_overviews(context: Context) -> str:
    """Every group: its size, what became of its fits, and the quality of its best fits by condition."""
    parts = []
    for name, view in context.study.groups.items():
        g, data = view.group, context.data["groups"][name]
        fits = ", ".join(f"{n} {k.replace('_', ' ')}" for k, n in data["fits"].items() if n)
        size = f"{counted(g.realizations, 'realization' if view.noisy else 'pool')} of {g.starts_in_words}"
        columns = [s for s in CELL_STATISTICS if s.page]
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
        parts.append(
            f"<h3>{escape(name)}</h3><p>{escape(size)}; "
            f"model {escape(g.model.title)}, "
            f"cost {escape(g.fit.cost)}, solver {escape(g.fit.solver)}. Fits: {escape(fits)}.</p>"
            + table(Table(f"Group {name}: best fits, ± MCSE", ["condition", "used", *heads, f"{MISSED} (%)"], rows))
            + (
                f"<p>Differs from {view.reference} in: " + escape("; ".join(view.differences)) + ".</p>"
                if view.differences
                else ""
            )
            + "".join(f"<p>{escape(with_units(note))}</p>" for note in data["notes"])
        )
    return "".join(parts)
