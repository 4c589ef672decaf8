"""The tables under a verdict: causes, place, share closed, parameters, what is below the detection limit."""

from __future__ import annotations

from mcstudy.analysis.cells import number, table, with_error
from mcstudy.gap.diagnosis import SOURCES_EXPLAINED, Diagnosis
from mcstudy.gap.verdict import named, words

SHOWN = 0.01
"""Causes less probable than this are summed into one row."""


def text(d: Diagnosis) -> str:
    """All tables of a diagnosis, plain text."""
    parts = [_causes(d), _places(d), _gap(d), _parameters(d)]
    if d.undetectable:
        parts.append(_undetectable(d))
    return "\n\n".join(parts)


def _causes(d: Diagnosis) -> str:
    rows = []
    for c in d.causes:
        if c.probability >= SHOWN:
            sizes = "; ".join(f"{s.name} {with_error(s.estimate, s.se)} {s.unit}".rstrip() for s in c.sizes)
            rows.append((c.probability, [named(c), f"{c.probability:.3f}", sizes]))
    rows += [
        (d.none_probability, ["no missing effect", f"{d.none_probability:.3f}", ""]),
        (d.unknown_probability, ["a cause outside the library", f"{d.unknown_probability:.3f}", ""]),
    ]
    lines = [cells for _, cells in sorted(rows, key=lambda row: -row[0])]
    others = sum(c.probability for c in d.causes if c.probability < SHOWN)
    lines.append(["all others together", f"{others:.3f}", ""])
    return table(["cause", "probability", "size ± standard error"], lines)


def _places(d: Diagnosis) -> str:
    rows = [[place, f"{p:.3f}"] for place, p in sorted(d.place.items(), key=lambda item: -item[1])]
    return table(["location", "probability"], [*rows, ["none of them", f"{d.place_abstained:.3f}"]])


def _gap(d: Diagnosis) -> str:
    t = d.detection
    rows = [
        ["squared residual, noise alone expects", f"{t.chi2:.0f}, {t.expected_chi2:.0f}"],
        ["p-value of the whole residual", number(t.fit_p_value, 2)],
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
    return table(["gap", ""], rows)


def _parameters(d: Diagnosis) -> str:
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
    if not any(s.source for s in d.shifts):
        return table(["parameter", "base model", "with the leading cause", "unit"], [row[:-1] for row in rows])
    shown = table(["parameter", "base model", "with the leading cause", "unit", "value from"], rows)
    return f"{shown}\n{SOURCES_EXPLAINED}"


def _undetectable(d: Diagnosis) -> str:
    rows = [
        [
            words(u.effect),
            "-" if u.size_needed is None else f"{number(u.size_needed, 2)} {u.unit}".rstrip(),
            "-" if u.trials_needed is None else str(u.trials_needed),
            u.reason,
        ]
        for u in d.undetectable
    ]
    return table(["below the detection limit", "size needed", "trials needed (in all)", "expected detectability"], rows)
