"""A diagnosis as a page, in the style of a study's: verdict, responses, where, which, how far, sway in time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from markupsafe import Markup

from mcstudy.effect_library.library import library_of, size_text
from mcstudy.errors import InputError
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.tables import closing, evidence, tables
from mcstudy.gap.trial_planning.next_trial import NextTrialRecord
from mcstudy.gap.verdict import added_name, differing_tests, effects_of, motion, sentences
from mcstudy.recordings.joint_recording import part_labels
from mcstudy.report.diagnosis.data import GapData
from mcstudy.report.diagnosis.next_trial import next_figure
from mcstudy.report.diagnosis.sections import (
    evidence_figure,
    page_table,
    response_figures,
    time_figure,
    which_figures,
    z_figure,
)
from mcstudy.report.diagnosis.traces import SwayTraces
from mcstudy.report.document import document
from mcstudy.report.figure import Figure, Missing, figures, of_part
from mcstudy.report.html import code, details, html, joined, paragraphs, table
from mcstudy.report.origin import recording_rows
from mcstudy.stance.feedback import Model
from mcstudy.text_tables import Table


def gap_page(
    diagnosis: DiagnosisRecord,
    command: str = "mcstudy gap report REC -o page.html",
    planned: NextTrialRecord | None = None,
) -> str:
    """The page of a diagnosis; ``command``: the command that makes this page, as displayed on it.

    ``planned``: possible next trials, which then have a section.
    """
    data = GapData(diagnosis)
    printed = _diagnose_command(command)
    parts = [GapData(part) for part in diagnosis.parts]
    where = [*response_figures(data), z_figure(data)] if len(parts) == 1 else _of_parts(diagnosis, parts)
    sections = [
        ("gap", "Test for a mismatch", figures([evidence_figure(diagnosis)], command)),
        ("responses", "Measured and modelled responses", figures(where, command)),
        ("which", "Which effect, where, and how far", figures(which_figures(diagnosis), command)),
        ("next", "Which trial next", figures([] if planned is None else [next_figure(planned)], command)),
        ("sway", motion(diagnosis).capitalize(), figures(_times(diagnosis, parts), command)),
        ("numbers", "In numbers", _numbers(diagnosis) + html('<p class="how">Made by <code>{}</code></p>', printed)),
        ("made", "Provenance", _provenance(data, command)),
    ]
    return document(
        f"Diagnosis of {diagnosis.name}",
        _introduction(data),
        sections,
        "Bands and intervals cover 95 %; ± is one standard error. Probabilities are posterior probabilities given "
        "this recording: of the effects of the library, of a cause outside it, and of no missing effect.",
    )


def _of_parts(diagnosis: DiagnosisRecord, parts: Sequence[GapData]) -> list[Figure]:
    """Responses and residuals of every recording."""
    labels = part_labels(diagnosis.recording, len(parts))
    return [
        of_part(shown, k, label, "diagnosis")
        for k, (data, label) in enumerate(zip(parts, labels, strict=True))
        for shown in (*response_figures(data), z_figure(data))
    ]


def _times(diagnosis: DiagnosisRecord, parts: Sequence[GapData]) -> list[Figure | Missing]:
    """Sway of every recording."""
    shown = [_time(data) for data in parts]
    if len(parts) == 1:
        return shown
    labels = part_labels(diagnosis.recording, len(parts))
    return [
        of_part(s, k, label, "diagnosis") if isinstance(s, Figure) else replace(s, title=f"{s.title}: {label}")
        for k, (s, label) in enumerate(zip(shown, labels, strict=True))
    ]


def _time(data: GapData) -> Figure | Missing:
    try:
        return time_figure(data, SwayTraces.of(data))
    except InputError as error:
        return Missing(f"{motion(data.diagnosis).capitalize()} in time", str(error), "traces")


def _introduction(data: GapData) -> Markup:
    d = data.diagnosis
    if d.leading is None:
        after = "No gap was detected, so no effect was added and the figures show the base model only."
    elif d.leading.advice:
        after = "The recording seems to be mislabelled, so the figures show the base model only."
    elif d.added is None:
        after = (
            f"The leading cause, {effects_of(d.leading)}, changes the response with amplitude or over time but not the "
            "mean response, so the figures show the base model only."
        )
    else:
        after = f"{added_name(d).capitalize()}: the base model with {effects_of(d.leading)}, refitted."
    first, *others = sentences(d)
    verdict = paragraphs([first, differing_tests(d), *others])
    base = f"Base model: {data.model.name.replace('_', ' ')}, fitted to this recording. {after}"
    return html('<div class="truth"><p><strong>Verdict</strong></p>{}</div>', verdict) + paragraphs([base])


def _numbers(d: DiagnosisRecord) -> Markup:
    """The tables that are not those of a figure, indistinguishable effects, and data quality warnings."""
    shown = {evidence(d).title, closing(d).title}
    groups = "; ".join(", ".join(g) for g in d.groups if len(g) > 1)
    warnings = joined(html("<li>{}</li>", warning) for warning in d.warnings)
    return (
        joined(table(page_table(t)) for t in tables(d) if t.title not in shown)
        + paragraphs([f"Effects that this recording cannot distinguish: {groups}." if groups else ""])
        + (warnings and html("<h3>Data quality warnings</h3><ul>{}</ul>", warnings))
    )


def _diagnose_command(command: str) -> str:
    """The command that prints the numbers of the page that ``command`` makes."""
    return command.replace("gap report", "gap diagnose").split(" -o ")[0] + " --json"


def _provenance(data: GapData, command: str) -> Markup:
    d = data.diagnosis
    rows = recording_rows(d.name, d.recording)
    rows += [["lines", f"{len(data.lines)}, {data.lines.f.min():.3g} to {data.lines.f.max():.3g} Hz"]]
    rows += [[k, str(v)] for k, v in d.method.to_dict().items()]
    return (
        code(
            f"{command}    # this page",
            f"{_diagnose_command(command)}    # every number of it",
            "python    # any figure of it",
            ">>> import mcstudy as mc",
            '>>> diagnosis = mc.diagnose(mc.read_recording("REC"))',
        )
        + table(Table("This recording and diagnosis", ["", ""], rows), "facts")
        + details("Effects of the library, with the sources of their sizes", table(_library(data.model), "wide"))
    )


def _library(model: Model) -> Table:
    """The effects as ``mcstudy gap effects`` lists them."""
    known = library_of(model).values()
    rows = [[e.name, ", ".join(e.place), size_text(e.size), e.equation, e.source] for e in known]
    header = ["effect", "location", "usual size", "equation", "source of the size"]
    return Table("Effects (mcstudy gap effects)", header, rows)
