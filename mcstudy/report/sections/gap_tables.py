"""Tables of a diagnosis: causes, parameters, what amplitude and time say, what the data cannot show."""

from __future__ import annotations

from mcstudy.gap.diagnosis import SOURCES_EXPLAINED, Diagnosis
from mcstudy.gap.verdict import named, words
from mcstudy.report.context import short
from mcstudy.report.html import Table, escape, table

MOST_CAUSES = 8


def numbers(d: Diagnosis) -> str:
    """All tables; those without rows are left out."""
    tables = [_causes(d), _parameters(d), _contrasts(d), _undetectable(d)]
    warnings = "".join(f"<li>{escape(w)}</li>" for w in d.warnings)
    groups = "; ".join(", ".join(words(n) for n in g) for g in d.groups if len(g) > 1)
    return (
        "".join(table(t) for t in tables if t.rows)
        + f"<p>{escape(SOURCES_EXPLAINED[0].upper() + SOURCES_EXPLAINED[1:])}</p>"
        + (f"<p>Effects this recording cannot tell apart: {escape(groups)}.</p>" if groups else "")
        + (f"<h3>Data quality warnings</h3><ul>{warnings}</ul>" if warnings else "")
    )


def _causes(d: Diagnosis) -> Table:
    rows = [
        [
            named(c),
            f"{c.probability:.3f}",
            "; ".join(f"{s.name} = {s.estimate:.3g} ± {s.se:.2g} {s.unit}".rstrip() for s in c.sizes),
            "yes" if k in d.credible_set else "",
        ]
        for k, c in enumerate(d.causes[:MOST_CAUSES])
    ]
    rows.append(["outside the library", f"{d.unknown_probability:.3f}", "", "yes" * ("unknown" in d.credible_set)])
    rows.append(["no missing effect", f"{d.none_probability:.3f}", "", "yes" * ("none" in d.credible_set)])
    return Table("Causes", ["cause", "probability", "size ± SE", "in the 95 % set"], rows)


def _parameters(d: Diagnosis) -> Table:
    rows = [
        [
            s.name,
            f"{s.without:.4g} ± {s.without_se:.2g}",
            "" if s.added is None or s.added_se is None else f"{s.added:.4g} ± {s.added_se:.2g}",
            "" if s.added is None else f"{s.added - s.without:+.3g}",
            s.unit,
            s.source,
        ]
        for s in d.shifts
    ]
    header = ["parameter", "base model ± SE", "with the leading cause ± SE", "change", "unit", "value from"]
    return Table("Parameters without and with the leading cause", header, rows)


def _contrasts(d: Diagnosis) -> Table:
    rows = [
        [
            f"{c.kind}, {words(k.effect)}",
            f"{100 * k.gain:+.1f} ± {100 * k.se:.1f}",
            f"{k.z:.2f}",
            f"{c.p_value:.2g}",
        ]
        for c in d.contrasts
        for k in c.changes
    ]
    return Table(
        "Between amplitudes and over time: change of the active gains",
        ["contrast, effect", "change (% ± SE)", "z", "p"],
        rows,
    )


def _undetectable(d: Diagnosis) -> Table:
    rows = [
        [
            words(u.effect),
            u.reason,
            "-" if u.size_needed is None else f"{short(u.size_needed)} {u.unit}".rstrip(),
            "-" if u.trials_needed is None else str(u.trials_needed),
        ]
        for u in d.undetectable
    ]
    header = ["effect", "why", "smallest size found here", "trials for its published size"]
    return Table("Effects below the detection limit of these data", header, rows)
