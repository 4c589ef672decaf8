"""The tables of a diagnosis, defined once for the terminal, a notebook and the HTML page."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, NamedTuple

from mcstudy import text_tables
from mcstudy.gap.questions.parameters import SOURCES_EXPLAINED
from mcstudy.gap.verdict import named, undetected, words
from mcstudy.text_tables import number, with_error

if TYPE_CHECKING:
    from mcstudy.gap.diagnosis import Diagnosis

SHOWN = 0.01
"""Causes with a probability below this share one row."""


class Table(NamedTuple):
    """One table; the first column names its rows. ``note``: explanation of entries that need one."""

    title: str
    header: list[str]
    rows: list[list[str]]
    note: str = ""


def tables(d: Diagnosis) -> list[Table]:
    """The tables of a diagnosis that are not empty."""
    found = [_causes(d), _locations(d), _gap(d), _parameters(d), _contrasts(d), _undetectable(d)]
    return [t for t in found if t.rows]


def text(d: Diagnosis) -> str:
    """All tables as plain text."""
    return "\n\n".join(text_tables.table(t.header, t.rows) + (f"\n{t.note}" if t.note else "") for t in tables(d))


def html(d: Diagnosis) -> str:
    """All tables as an HTML fragment, for a notebook."""

    def row(cells: list[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(c)}</{tag}>" for c in cells) + "</tr>"

    return "".join(
        f"<table><caption>{escape(t.title)}</caption><thead>{row(t.header, 'th')}</thead>"
        f"<tbody>{''.join(row(r, 'td') for r in t.rows)}</tbody></table>"
        + (f"<p>{escape(t.note)}</p>" if t.note else "")
        for t in tables(d)
    )


def _causes(d: Diagnosis) -> Table:
    def yes(cause: int | str) -> str:
        return "yes" if cause in d.credible_set else ""

    rows = []
    for k, c in enumerate(d.causes):
        if c.probability >= SHOWN:
            sizes = "; ".join(f"{s.name} {with_error(s.estimate, s.se)} {s.unit}".rstrip() for s in c.sizes)
            rows.append((c.probability, [named(c), f"{c.probability:.3f}", sizes, yes(k)]))
    rows += [
        (d.none_probability, ["no missing effect", f"{d.none_probability:.3f}", "", yes("none")]),
        (
            d.unknown_probability,
            ["a cause outside the library", f"{d.unknown_probability:.3f}", "", yes("unknown")],
        ),
    ]
    lines = [cells for _, cells in sorted(rows, key=lambda row: -row[0])]
    others = sum(c.probability for c in d.causes if c.probability < SHOWN)
    lines.append(["all other causes", f"{others:.3f}", "", ""])
    return Table("Causes", ["cause", "probability", "size ± standard error", "in the 95 % credible set"], lines)


def _locations(d: Diagnosis) -> Table:
    rows = [[place, f"{p:.3f}"] for place, p in sorted(d.place.items(), key=lambda item: -item[1])]
    return Table("Location", ["location", "probability"], [*rows, ["no single location", f"{d.place_abstained:.3f}"]])


def _gap(d: Diagnosis) -> Table:
    t = d.detection
    rows = [
        ["squared residual, expected from noise alone", f"{t.chi2:.0f}, {t.expected_chi2:.0f}"],
        ["p-value of the whole residual (goodness of fit)", number(t.fit_p_value, 2)],
        ["p-value of any gap", number(d.p_value, 2)],
    ]
    if d.closed is not None:
        c = d.closed
        share = f"{100 * c.fraction:.0f} % [{100 * c.low:.0f}, {100 * c.high:.0f}]"
        rows.append([f"closed by {words(' and '.join(d.causes[0].effects))}", share])
    for key, name in (("before", "base model"), ("after", "with the leading cause"), ("floor", "noise floor")):
        value = d.sway_rms_deg[key]
        if value is not None:
            rows.append([f"error of predicted sway (RMS), {name}", f"{value:.3g} deg"])
    return Table("Size of the gap", ["gap", ""], rows)


def _parameters(d: Diagnosis) -> Table:
    header = ["parameter", "base model", "with the leading cause", "unit", "value from"]
    rows = [
        [
            s.name,
            with_error(s.without, s.without_se),
            "-" if s.added is None else with_error(s.added, s.added_se),
            s.unit,
            s.source,
        ]
        for s in d.shifts
    ]
    title = "Parameters without and with the leading cause, ± standard error"
    if not any(s.source for s in d.shifts):
        return Table(title, header[:-1], [row[:-1] for row in rows])
    return Table(title, header, rows, SOURCES_EXPLAINED)


def _contrasts(d: Diagnosis) -> Table:
    rows = [
        [
            f"{c.kind}, {words(k.effect)}",
            with_error(100 * k.gain, 100 * k.se),
            f"{k.z:.2f}",
            number(c.p_value, 2),
        ]
        for c in d.contrasts
        for k in c.changes
    ]
    return Table(
        "Change of the active gains between amplitudes and over time",
        ["contrast, effect", "change of gain (%)", "z", "p-value"],
        rows,
    )


def _undetectable(d: Diagnosis) -> Table:
    rows = [
        [
            words(u.effect),
            "-" if u.size_needed is None else f"{number(u.size_needed, 2)} {u.unit}".rstrip(),
            "-" if u.trials_needed is None else str(u.trials_needed),
            u.reason,
        ]
        for u in undetected(d)
    ]
    return Table(
        "Effects below the detection limit of these data",
        ["below the detection limit", "size needed", "trials needed (in all)", "expected detectability"],
        rows,
    )
