"""A fit in words: the table, what is determined, and what is not."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mcstudy.text_tables import number, table

if TYPE_CHECKING:
    from mcstudy.identification.result import Estimate, FitResult

REACH = 10.0
"""Increase of the deviance up to which other minima are told."""

TRADED = 0.9
"""Correlation from which two parameters count as traded for each other."""

SHARPER = 3.0
"""A sum counts as better determined than its terms if its relative interval is narrower by this factor."""


def interval(e: Estimate) -> str:
    """``815 [586, 1309] N m/rad``, with the ends that bounds set in words."""
    low, high = number(e.low), number(e.high)
    low = low if e.low_from == "data" else f"bound {low}"
    high = high if e.high_from == "data" else f"bound {high}"
    return f"{number(e.estimate)} [{low}, {high}] {e.unit}".rstrip()


def text(r: FitResult) -> str:
    """Table, then sentences."""
    percent = f"{100 * r.level:g} %"
    header = ("quantity", "unit", "estimate", f"{percent} interval", "Wald, for comparison", "")
    rows = [
        (
            e.name,
            e.unit,
            number(e.estimate),
            f"{number(e.low)} to {number(e.high)}",
            f"{number(e.wald_low)} to {number(e.wald_high)}" if math.isfinite(e.wald_low) else "at a bound",
            e.verdict,
        )
        for e in r.estimates
    ]
    return "\n".join(
        [f"{r.name}: {len(r.lines)} lines up to {r.lines.f[-1]:.3g} Hz", "", table(header, rows), "", *sentences(r)]
    )


def sentences(r: FitResult) -> list[str]:
    """What the numbers mean, one sentence each."""
    fits = "fits" if r.p_value >= 0.05 else "does not fit"
    out = [
        f"The model {fits} the recording: squared residual {r.chi2:.0f}, noise alone gives {r.expected_chi2:.0f} "
        f"(p = {r.p_value:.2g})."
    ]
    if r.p_value < 0.05:
        out.append("The intervals hold only if the model is right; `mcstudy gap diagnose` says what it may lack.")
    if r.without_chi2 is not None:
        added = ", ".join(r.method["effects"])
        out.append(f"With {added} the squared residual falls from {r.without_chi2:.0f} to {r.chi2:.0f}.")
    state = "stable" if r.growth_rate < 0 else "unstable"
    out.append(f"The closed loop is {state} at the estimate (slowest mode {r.growth_rate:.2g} 1/s).")
    out += _undetermined(r)
    out += _sums(r)
    out += _traded(r)
    m = r.minima
    others = int((m.chi2[1:] - m.chi2[0] < REACH).sum())
    out.append(
        f"Of {m.starts} random starts, {m.hits[0]} ended in the lowest minimum; a further start would find a new one "
        f"with a chance of {100 * m.missed:.1f} %."
        + (f" {others} other minima fit almost as well (squared residual at most {REACH:g} higher)." if others else "")
    )
    return [*out, *r.warnings]


def _undetermined(r: FitResult) -> list[str]:
    names = [e.name for e in r.estimates if e.verdict != "identifiable"]
    if not names:
        return ["All quantities are determined by the data alone."]
    return [
        f"Not determined by the data alone: {', '.join(names)}. A limit of their intervals is a bound of the fit, "
        "not a finding."
    ]


def _relative(e: Estimate) -> float:
    """Half-width of an interval relative to the estimate."""
    return (e.high - e.low) / 2 / abs(e.estimate) if e.estimate else math.inf


def _sums(r: FitResult) -> list[str]:
    out = []
    for e in r.estimates:
        terms = e.name.split(" + ")
        if len(terms) != 2 or not set(terms) <= set(r.model.names):
            continue
        single = min(_relative(r[t]) for t in terms)
        if _relative(e) * SHARPER < single:
            out.append(
                f"Only the sum {e.name} is well determined (±{100 * _relative(e):.0f} %); its terms trade for each "
                "other."
            )
    return out


def _traded(r: FitResult) -> list[str]:
    pairs = [
        (abs(r.correlation[i, j]), f"{r.model.names[i]} and {r.model.names[j]} ({r.correlation[i, j]:+.2f})")
        for i, j in zip(*np.triu_indices(len(r.model.names), 1), strict=True)
        if abs(r.correlation[i, j]) >= TRADED
    ]
    if not pairs:
        return []
    return [
        "Errors that are strongly correlated: " + ", ".join(text for _, text in sorted(pairs, reverse=True)[:6]) + "."
    ]
