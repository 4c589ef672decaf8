"""Comparison of the groups of one study with the same noise, and published claims about such changes."""

from __future__ import annotations

from typing import Any

from markupsafe import Markup

from mcstudy.analysis.compare import MEASURES
from mcstudy.report.html import html, joined, paragraphs, table
from mcstudy.report.study.context import Context, stat
from mcstudy.text_tables import Table


def comparison_html(context: Context) -> Markup:
    """A table of differences and a list of verdicts; empty when no two groups can be compared."""
    comparisons = context.data["comparisons"]
    if not comparisons:
        return Markup("")
    reference, measures = comparisons[0]["reference"], MEASURES.values()
    rows = [
        [f"{c['group']}, {cell['fmax']:g} Hz", *(stat(cell[key]) for key in MEASURES)]
        for c in comparisons
        for cell in c["cells"]
    ]
    meaning = (
        f"The other group minus group {reference}, paired by realization, mean over amplitudes, ± MCSE of the "
        f"difference. {'; '.join(f'{m.head}: {m.meaning}' for m in measures)}."
    )
    changes = (f"{c['group']}: {'; '.join(c['differences'])}; {c['realizations']} realizations" for c in comparisons)
    return (
        paragraphs([meaning])
        + table(Table(f"Difference from group {reference}", ["group", *(m.head for m in measures)], rows))
        + html("<ul>{}</ul>", joined(html("<li>{}</li>", text) for text in changes))
        + joined(_claims(c) for c in comparisons if c["claims"])
    )


def _claims(comparison: dict[str, Any]) -> Markup:
    lines = joined(
        html(
            "<li>{} ({}): {} {} at {:g} Hz: ours {}, <strong>{}</strong></li>",
            *(v["claim"], v["where"], MEASURES[v["measure"]].head, v["expected"], v["fmax"], stat(v), v["verdict"]),
        )
        for v in comparison["claims"]
    )
    return html("<h3>Published claims about group {}</h3><ul>{}</ul>", comparison["group"], lines)
