"""Possible next trials as a page: what is still possible, what a trial would decide, effects that look alike."""

from __future__ import annotations

from dataclasses import replace

from markupsafe import Markup

from mcstudy.gap.trial_planning.next_trial import NextTrialRecord
from mcstudy.gap.trial_planning.recommendation import NOTE, described, expected
from mcstudy.report.diagnosis.next_trial import next_figure
from mcstudy.report.document import document
from mcstudy.report.figure import figure
from mcstudy.report.html import commands, joined, paragraphs, table, tiles
from mcstudy.text_tables import Table, number

PYTHON = "found.to_html('page.html')"


def next_page(trial: NextTrialRecord, command: str = "mcstudy gap next REC --html page.html") -> str:
    """The page of possible next trials; ``command``: the command that makes this page, as displayed on it."""
    drawn = next_figure(trial)
    rows = [[name, f"{100 * p:.0f} %"] for name, p in trial.causes]
    parts = [
        ("causes", "What is still possible", table(Table("Possible causes", ["cause", "probability"], rows), "rows")),
        ("next", "Possible trials", joined(map(table, drawn.tables))),
        ("alike", "Effects that look alike", figure(replace(drawn, tables=(), python=PYTHON), command)),
        ("made", "Provenance", commands(command)),
    ]
    return document(f"Which trial next: {trial.name}", _introduction(trial), parts, NOTE)


def _introduction(trial: NextTrialRecord) -> Markup:
    best = trial.best
    remark = "" if trial.open else "The cause is known: no further trial is needed to name it."
    entries = [
        ("Open before", f"{number(best.told.entropy, 2)} bits", "entropy over the causes."),
        ("Expected information", f"{number(best.told.bits, 2)} bits", "of the recommended trial."),
        (
            "Expected P(true)",
            expected(best.told.probability_low, best.told.probability),
            "after the recommended trial.",
        ),
        ("Effects with a twin", f"{trial.before.count} → {trial.after.count}", "before and with it."),
    ]
    return paragraphs([remark, f"Recommended: {described(best.plan)}."]) + tiles(entries)
