"""The paper as mcstudy compares studies with it: six statements of its abstract, in our words, in two readings.

Whether passive torque acts relative to the surface could not be read in the paper. A group of a study is one of the two
readings by its model, and is compared where it has the true values of the paper's Table 1, as the shipped model has.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcstudy.analysis.publications.publication import Publication, Row
from mcstudy.analysis.publications.statement import Published
from mcstudy.text_tables import Table

if TYPE_CHECKING:
    from mcstudy.analysis.view import StudyView
    from mcstudy.report.document import Section
    from mcstudy.report.study.context import Context
    from mcstudy_pasma2017.sensitivity import Sensitivity

PAPER = "Pasma et al. 2017, Front Comput Neurosci 11:99"

READINGS = {"independent_channel": "surface", "independent_channel_visual": "space"}
"""What passive torque is relative to, by the name of the model."""

STATEMENTS = {
    "Kp": ("Kp shapes the magnitude at 0.1-1 Hz", "%", "there against elsewhere"),
    "Kd": ("Kd shapes the magnitude at 0.5-0.9 Hz", "%", "there against elsewhere"),
    "delay": ("delay shapes the phase above 0.6 Hz", "deg", "there against below"),
    "weight_magnitude": ("weight changes the whole magnitude", "%", "least against a tenth of the largest"),
    "weight_phase": ("weight changes no phase", "deg", "1 deg against the largest"),
    "little": (
        "force feedback and K matter little",
        "% + deg",
        "least of Kp, Kd, delay, weight against most of Kf, Tf, K",
    ),
}
"""By key: the statement, the unit of the two numbers that decide it, and what these are."""

_READING = (
    "Each statement of the abstract, in our words. It holds if the first number is larger than the second; ours is the "
    "difference. Numbers are root mean squares over the frequencies of what 10 % more of a parameter changes in the "
    "response to a tilt, 0.05-2.5 Hz: percent of the magnitude, degrees of the phase. Derivatives are exact.",
    "surface, space: passive torque acts relative to the surface, or to space. The paper's could not be read.",
)


def readings(study: StudyView) -> Iterator[tuple[str, str, Sensitivity]]:
    """The reading, the group and the sensitivity, of the first group with each of the paper's models."""
    from mcstudy.models.catalogue import read_model
    from mcstudy_pasma2017.sensitivity import Sensitivity

    seen = set()
    for name, view in study.groups.items():
        model = view.model
        if model.name not in READINGS or model.name in seen:
            continue
        paper = read_model(model.name).model()
        if model.names == paper.names and (model.truth == paper.truth).all():
            seen.add(model.name)
            yield READINGS[model.name], name, Sensitivity(model)


def _rows(study: StudyView) -> list[Row]:
    from mcstudy.analysis.publications.sampling import exact
    from mcstudy.analysis.publications.verdict import judge

    rows = []
    for reading, group, sensitivity in readings(study):
        for key, (first, second) in sensitivity.statements().items():
            label, unit, what = STATEMENTS[key]
            stated = Published(f"{key}_{reading}", f"{label}, {reading}", unit, 0.0, "> 0", "Abstract", "at least", n=0)
            ours = exact(first - second, f"{first:.2f} {unit} against {second:.2f} ({what})")
            rows.append(Row(stated, ours, group, judge(stated, ours)))
    return rows


def _side_by_side(published: Mapping[str, dict[str, Any]]) -> Table | None:
    """The statements with both readings."""
    found = [r for r in READINGS.values() if any(key.endswith(f"_{r}") for key in published)]
    lines = []
    for key, (label, _, what) in STATEMENTS.items():
        rows = [published[f"{key}_{reading}"] for reading in found]
        lines.append([label, *(f"{r['verdict']}: {r['detail'].partition(' (')[0]}" for r in rows), what])
    header = ["statement", *found, "what is compared"]
    return Table("Passive torque relative to the surface, or to space", header, lines, kind="wide") if found else None


def _section(context: Context, _: Sequence[tuple[Path, Context | None]]) -> Section | None:
    """What 10 % more of each parameter does to the response."""
    from mcstudy.report.html import joined, paragraphs, table
    from mcstudy_pasma2017.sensitivity import BANDS

    header = ["10 % more of", *(f"{low:g}-{high:g} Hz" for low, high in BANDS)]
    tables = [
        table(Table(f"Passive torque relative to {reading}", header, sensitivity.rows()))
        for reading, _, sensitivity in readings(context.study)
    ]
    if not tables:
        return None
    text = "Root mean square over each band of what changes: the magnitude of the response, and its phase."
    return "sensitivity", "Sensitivity of the response", paragraphs([text]) + joined(tables)


provider = Publication(
    reference=PAPER, name="Pasma et al. (2017)", rows=_rows, reading=_READING, table=_side_by_side, section=_section
)
"""Functions import what they need: tables of a study whose numbers are kept are printed without loading NumPy."""
