"""A diagnosis as a page, in the style of a study's: verdict, responses, where, which, how far, sway in time."""

from __future__ import annotations

from collections.abc import Sequence

from mcstudy.errors import InputError
from mcstudy.gap.diagnosis import Diagnosis
from mcstudy.gap.frf_only import FrfRecording
from mcstudy.gap.recording import Recording
from mcstudy.gap.verdict import words
from mcstudy.report.document import document
from mcstudy.report.figure import Figure, Missing, figure, missing
from mcstudy.report.gap_data import GapData
from mcstudy.report.html import Table, details, escape, table
from mcstudy.report.sections.gap_figures import response_figures, time_figure, which_figures, z_figure
from mcstudy.report.sections.gap_tables import numbers
from mcstudy.report.sway_traces import SwayTraces
from mcstudy.stance.feedback import Model


def gap_page(
    diagnosis: Diagnosis,
    recording: Recording | FrfRecording | Sequence[Recording],
    *,
    model: Model | None = None,
    command: str = "mcstudy gap report REC -o page.html",
) -> str:
    """The page of a diagnosis.

    Parameters
    ----------
    recording, model: what `mcstudy.gap.diagnose.diagnose` was given.
    command: what makes this page, as it is to be shown.

    Raises `InputError` when the recording is not the one that was diagnosed.
    """
    data = GapData.of(diagnosis, recording, model)
    printed = _diagnose_command(command)
    where = [*response_figures(data), z_figure(data)]
    parts = [
        ("responses", "Measured and modelled responses", _figures(where, command)),
        ("which", "Which effect, where, and how far", _figures(which_figures(diagnosis), command)),
        ("sway", "Sway", _figures([_time(data)], command)),
        ("numbers", "In numbers", numbers(diagnosis) + f'<p class="how">Made by <code>{escape(printed)}</code></p>'),
        ("made", "How this was made", _provenance(data, command)),
    ]
    return document(
        f"Diagnosis of {diagnosis.name}",
        _introduction(data),
        parts,
        "Bands and intervals hold 95 %; ± is one standard error. Probabilities are those of the library's effects, "
        "of a cause outside it and of none, given this recording.",
    )


def _time(data: GapData) -> Figure | Missing:
    try:
        return time_figure(data, SwayTraces.of(data))
    except InputError as error:
        return Missing("", "Sway in time", str(error))


def _introduction(data: GapData) -> str:
    d = data.diagnosis
    leading = data.leading
    if leading is None:
        after = "No gap was detected, so nothing was added: figures show the base model only."
    elif data.added is None:
        after = (
            f"The leading cause, {' and '.join(words(e) for e in leading.effects)}, shows between amplitudes or over "
            "time and not in the mean response, so figures show the base model only."
        )
    else:
        after = f"With the cause: the base model with {' and '.join(words(e) for e in leading.effects)}, refitted."
    return (
        f'<p class="truth"><strong>Verdict.</strong> {escape(d.verdict())}</p>'
        f"<p>Base model: {escape(data.model.name.replace('_', ' '))}, fitted to this recording. {escape(after)}</p>"
    )


def _figures(items: Sequence[Figure | Missing], command: str) -> str:
    shown = "".join(figure(f, "", command) for f in items if isinstance(f, Figure))
    return shown + missing(f for f in items if isinstance(f, Missing))


def _diagnose_command(command: str) -> str:
    """The command that prints the numbers of the page that ``command`` makes."""
    return command.replace("gap report", "gap diagnose").split(" -o ")[0] + " --json"


def _provenance(data: GapData, command: str) -> str:
    d, r = data.diagnosis, data.recording
    rows = [["recording", r.name], ["where it is from", r.provenance or "not stated"], ["stimulus", r.stimulus]]
    if isinstance(r, Recording):
        peaks = ", ".join(f"{a:.3g}" for a in r.amplitudes)
        rows += [
            ["trials", f"{len(r.trials)}, {r.duration_s:.0f} s together at {r.rate_hz:g} Hz"],
            ["amplitudes (peak)", f"{peaks} {r.stimulus_unit}"],
            ["period", "none" if r.period_s is None else f"{r.period_s:g} s"],
        ]
    rows += [["lines", f"{len(data.lines)}, {data.lines.f[0]:.3g} to {data.lines.f[-1]:.3g} Hz"]]
    rows += [[k, str(v)] for k, v in d.method.items()]
    commands = "\n".join(
        [
            f"{command}    # this page",
            f"{_diagnose_command(command)}    # every number of it",
            "python    # any figure of it",
            ">>> from mcstudy.gap.diagnose import diagnose",
            ">>> from mcstudy.gap.read import read_recording",
            ">>> from mcstudy.report.figures import gap, gap_outcome",
            ">>> from mcstudy.report.gap_data import GapData",
            ">>> from mcstudy.report.sway_traces import SwayTraces",
            '>>> recording = read_recording("REC")',
            ">>> diagnosis = diagnose(recording)",
            ">>> data = GapData.of(diagnosis, recording)",
        ]
    )
    return (
        f"<pre><code>{escape(commands)}</code></pre>"
        + table(Table("This recording and diagnosis", ["", ""], rows), "facts")
        + details("Effects that were looked for", "<p><code>mcstudy gap effects</code> lists them with equations.</p>")
    )
