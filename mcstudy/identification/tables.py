"""The tables of a fit: estimates and intervals, and what would make the intervals narrower."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from mcstudy.text_tables import Table, fill, number, table

if TYPE_CHECKING:
    from mcstudy.identification.forecast import Forecast
    from mcstudy.identification.result import Estimate, FitResult

BANDS_HZ = (0.0, 0.3, 1.0, 3.0, np.inf)
"""Edges of the bands by which the information on a quantity is told."""

ENDED = {
    "data": "",
    "bound": " (bound)",
    "not finite": " (not defined beyond)",
    "steps": "",
}
"""What is printed behind an end of an interval, by what ends it."""

AT_MOST, AT_LEAST = "≤", "≥"
"""In front of a lower and an upper end that the search did not reach: the interval extends at least to there."""

LEANS = "*"
"""Behind an end of an interval at which another parameter lies on its bound."""

ROUGH = "~"
"""In front of a rough forecast."""


def interval(e: Estimate) -> str:
    """``586 to 1309``, with what ends it where that is not the data."""
    return _interval(e, "", "")


def marked(r: FitResult, e: Estimate) -> str:
    """The interval, with `LEANS` behind an end that the data set only together with a bound of another parameter."""
    low, high = (LEANS if names else "" for names in r.leaning(e.name))
    return _interval(e, low, high)


def _interval(e: Estimate, low: str, high: str) -> str:
    before, after = (AT_MOST if e.low_from == "steps" else ""), (AT_LEAST if e.high_from == "steps" else "")
    return f"{before}{number(e.low)}{ENDED[e.low_from]}{low} to {after}{number(e.high)}{ENDED[e.high_from]}{high}"


def estimate(r: FitResult, e: Estimate) -> str:
    """The estimate, and whether it lies on a bound."""
    return number(e.estimate) + (" (bound)" if on_bound(r, e) else "")


def on_bound(r: FitResult, e: Estimate) -> bool:
    """Whether the estimate of a parameter lies on one of its bounds."""
    if e.name not in r.model.names:
        return False
    k = r.model.names.index(e.name)
    return bool(r.theta[k] <= r.model.lower[k] or r.theta[k] >= r.model.upper[k])


def wald(e: Estimate) -> str:
    """The Gauss-Newton interval."""
    return f"{number(e.wald_low)} to {number(e.wald_high)}" if math.isfinite(e.wald_low) else "-"


def estimates(r: FitResult) -> Table:
    """Estimates, intervals, whether the data determine them, and two comparisons."""
    header: tuple[str, ...] = (
        "quantity",
        "unit",
        "estimate",
        f"{100 * r.level:g} % interval",
        "determined",
        "Wald",
    )
    rows: list[tuple[str, ...]] = [
        (e.name, e.unit, estimate(r, e), marked(r, e), e.verdict, wald(e)) for e in r.estimates
    ]
    note = (
        "Everything comes from the data, but for what is marked “bound”: there a bound of the fit decides. No prior is "
        f"used.{_leaning(r)}{_not_reached(r)} Wald: symmetric Gauss-Newton interval, for comparison only; - where a "
        "bound holds the estimate."
    )
    if r.paper is not None:
        header = (*header, "paper's cost")
        rows = [(*row, _paper(r, e)) for row, e in zip(rows, r.estimates, strict=True)]
        note += (
            " paper's cost: estimate under the cost function of Goodworth & Peterka (2018), for comparison; it has no "
            "likelihood, so no interval."
        )
    return Table("Estimates", header, rows, note)


def _leaning(r: FitResult) -> str:
    """What `LEANS` means, and which bounds these ends lean on; empty without one."""
    bounds = sorted({n for e in r.estimates for side in r.leaning(e.name) for n in side})
    if not bounds:
        return ""
    return f" {LEANS} set by the data together with a bound of another parameter ({', '.join(bounds)})."


def _not_reached(r: FitResult) -> str:
    """What `AT_MOST` and `AT_LEAST` mean; empty where the search reached every end."""
    if not any("steps" in (e.low_from, e.high_from) for e in r.estimates):
        return ""
    return f" {AT_MOST} {AT_LEAST} the search for this end did not converge: the interval extends at least to there."


def _paper(r: FitResult, e: Estimate) -> str:
    value = r.paper_value(e.name)
    return "" if value is None else number(value)


def help_needed(r: FitResult) -> Table | None:
    """Where the information comes from, and what would narrow the intervals; None for lines alone."""
    if not r.forecasts:
        return None
    f = r.forecasts[0]
    header = ("quantity", *band_names(r), "half-width", "cycles × 2", "amplitude × 2")
    header = (*header, *(() if f.fmax_hz is None else (f"up to {f.fmax_hz:.2g} Hz",)), "if known")
    rows = []
    for e, f in zip(r.estimates, r.forecasts, strict=True):
        share = [f"{100 * s:.0f}" if math.isfinite(s) else "-" for s in e.information[: len(band_names(r))]]
        changes = [f.cycles, f.amplitude] + ([] if f.fmax is None else [f.fmax])
        known = f"{f.known}: {predicted(e, f, f.with_known)}"
        rows.append((e.name, *share, half(e, f.now), *(predicted(e, f, x) for x in changes), known))
    note = (
        "First columns: share of the information on the quantity in each band (%). Then: half-width of its interval "
        "relative to the estimate, now and as the Fisher information predicts it after a change (if known: at best, "
        "with the value of this parameter from elsewhere). "
        f"{ROUGH} rough, because a bound ends the interval or the likelihood is far from quadratic; open: still no "
        "interval that the data end."
    )
    return Table("What carries the information, and what would help", header, rows, note)


def band_names(r: FitResult) -> tuple[str, ...]:
    """The bands that hold lines, in words."""
    return tuple(_band(low, high) for low, high in pairwise(BANDS_HZ) if low < r.lines.f.max())


def _band(low: float, high: float) -> str:
    if low == 0:
        return f"below {high:g} Hz"
    return f"above {low:g} Hz" if math.isinf(high) else f"{low:g}-{high:g} Hz"


def half(e: Estimate, value: float) -> str:
    """A half-width relative to the estimate; "open" where the data do not end the interval."""
    if e.verdict != "identifiable":
        return "open"
    return relative(e, value)


def relative(e: Estimate, value: float) -> str:
    """A half-width in percent of the estimate, in its unit where that is nearly zero."""
    share = 100 * value / abs(e.estimate) if e.estimate else math.inf
    return f"±{number(share, 2)} %" if share < 1000 else f"±{number(value, 2)}"


def predicted(e: Estimate, f: Forecast, value: float) -> str:
    """A predicted half-width."""
    if e.verdict != "identifiable" and value >= f.now:
        return "open"
    return (ROUGH if f.rough else "") + relative(e, value)


def as_text(t: Table) -> str:
    """A table with its note as text."""
    return f"{table(t.header, t.rows)}\n{fill(t.note)}"
