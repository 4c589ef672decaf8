"""Comparison of the groups of one study with the same noise, and the paper's claims about such changes."""

from __future__ import annotations

from typing import Any

from mcstudy.analysis.compare import MEASURES
from mcstudy.report.html import Table, escape, table
from mcstudy.report.study.context import Context, stat


def comparison_html(context: Context) -> str:
    """A table of differences and a list of verdicts; empty when no two groups can be compared."""
    comparisons = context.data["comparisons"]
    if not comparisons:
        return ""
    reference = comparisons[0]["reference"]
    rows = [
        [f"{c['group']}, {cell['fmax']:g} Hz", *(stat(cell[key]) for key in MEASURES)]
        for c in comparisons
        for cell in c["cells"]
    ]
    meanings = "; ".join(f"{m.head}: {m.meaning}" for m in MEASURES.values())
    changes = "".join(
        f"<li>{escape(c['group'])}: {escape('; '.join(c['differences']))}; {c['realizations']} realizations</li>"
        for c in comparisons
    )
    return (
        f"<p>The other group minus group {escape(reference)}, paired by realization, mean over amplitudes, ± MCSE of "
        f"the difference. {escape(meanings)}.</p>"
        + table(Table(f"Difference from group {reference}", ["group", *(m.head for m in MEASURES.values())], rows))
        + f"<ul>{changes}</ul>"
        + "".join(_claims(c) for c in comparisons if c["claims"])
    )


def _claims(comparison: dict[str, Any]) -> str:
    lines = "".join(
        f"<li>{escape(v['claim'])} ({escape(v['where'])}): {escape(MEASURES[v['measure']].head)} {v['expected']} at "
        f"{v['fmax']:g} Hz: ours {escape(stat(v))}, <strong>{escape(v['verdict'])}</strong></li>"
        for v in comparison["claims"]
    )
    return f"<h3>What the paper says about group {escape(comparison['group'])}</h3><ul>{lines}</ul>"
