"""A group in words: tables of means and differences, then sentences."""

from __future__ import annotations

import math

from mcstudy import text_tables
from mcstudy.identification.people.group_record import GroupDifference, GroupMean, GroupRecord, with_interval
from mcstudy.text_tables import ends, number, table

COVERED = (
    "In simulated groups of 10 people (ankle torque, up to 3.1 Hz) 95 % intervals contain the true value in 92.2 to "
    "99.4 % (means), 92.0 to 100 % (differences) and 91.2 to 100 % (standard deviations between people). Too narrow: "
    "the standard deviation and the difference of Td2 (91.2 and 92.0 %)."
)
"""What ``pipelines/validation/group_coverage.py`` found; told of recordings that are like the simulated ones."""

SHOWN = 0.1
"""Spread that is told as a CV only if the mean is larger than this multiple of it."""


def change(d: GroupDifference) -> str:
    """A difference with its interval and p-value."""
    return f"{with_interval(d.difference, d)}, {text_tables.with_sign(p_value(d))}"


def p_value(d: GroupDifference) -> str:
    """To two digits; a dash where a bound ends the interval, which then is no test."""
    if d.verdict != "determined":
        return "-"
    return text_tables.p_value(d.p_value)


def counts(r: GroupRecord) -> str:
    """``10 people; eyes open 10, eyes closed 10 (paired)``."""
    if len(r.conditions) == 1:
        return str(len(r.people))
    each = ", ".join(f"{c} {sum(condition == c for _, condition in r.fits)}" for c in r.conditions)
    return f"{len(r.people)}; {each} ({'paired' if r.paired else 'unpaired'})"


def text(r: GroupRecord) -> str:
    """Tables, then sentences."""
    percent = f"{100 * r.level:g} %"
    parts = [f"people: {counts(r)}"]
    for c in r.conditions:
        header = [
            *("quantity", "unit", "mean", f"{percent} interval"),
            *("SD between people", f"{percent} interval", "CV", ""),
        ]
        rows = [_row(m) for m in r.means if m.condition == c]
        parts += ["", *([f"condition {c}"] if len(r.conditions) > 1 else []), table(header, rows)]
    for c, reference in dict.fromkeys((d.condition, d.reference) for d in r.differences):
        header = ["quantity", "unit", "difference", f"{percent} interval", "p", ""]
        changes = [
            (d.quantity, d.unit, number(d.difference), ends(d.low, d.high), p_value(d), d.verdict)
            for d in r.differences
            if (d.condition, d.reference) == (c, reference)
        ]
        kind = "within people" if r.paired else "between different people"
        parts += ["", f"difference: {c} minus {reference}, {kind}", table(header, changes)]
    return "\n".join([*parts, "", *sentences(r)])


def _row(m: GroupMean) -> tuple[str, ...]:
    none = math.isnan(m.between)
    cv = f"{100 * m.between / abs(m.mean):.0f} %" if not none and abs(m.mean) > SHOWN * m.between else "-"
    high = number(m.between_high) if m.between_high_from == "data" else f"above {number(m.between_high)}"
    return (
        m.quantity,
        m.unit,
        number(m.mean),
        ends(m.low, m.high),
        spread(m),
        f"{number(m.between_low)} to {high}",
        cv,
        m.verdict,
    )


def spread(m: GroupMean) -> str:
    """``0.014``, or ``0 (at most 0.02)`` where errors of the fits explain all scatter of the people."""
    if not math.isnan(m.between):
        return number(m.between)
    limit = number(m.between_high)
    return f"0 (at most {limit})" if m.between_high_from == "data" else "not determined"


def sentences(r: GroupRecord) -> list[str]:
    """What the numbers mean, one sentence each."""
    out = []
    open_ = list(dict.fromkeys(m.quantity for m in r.means if m.verdict != "determined"))
    if open_:
        out.append(
            f"Not determined by these people: {', '.join(open_)}. Bounds of the fits end the intervals of most of "
            "them, or their data hardly tell values apart; averaging does not change that."
        )
    else:
        out.append("All means are determined by the data alone.")
    if len(r.conditions) == 1:
        out.append("There is one condition, so there is no difference to tell.")
    if min(sum(c == condition for _, condition in r.fits) for c in r.conditions) < 3:
        out.append(
            "Two people tell little about the spread between people; their own values are not drawn to the mean."
        )
    tests = sum(d.verdict == "determined" for d in r.differences)
    if tests > 1:
        out.append(f"The p-values are of {tests} single tests; they are not corrected for their number.")
    if any(fitted.coverage is not None for fitted in r.fits.values()):
        out.append(COVERED)
    out += [f"Failed: {person}, {condition}: {why}" for person, condition, why in r.failed]
    return [*out, *r.warnings]
