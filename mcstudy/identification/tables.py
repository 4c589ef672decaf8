"""The tables of a fit: estimates and intervals, and what would make the intervals narrower."""

from __future__ import annotations

import math
from itertools import pairwise

from mcstudy.identification.estimate import AT_LEAST, AT_MOST, BANDS_HZ, Estimate, interval
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.forecast import Forecast
from mcstudy.text_tables import Table, ends, number

LEANS = "*"
"""Behind an end of an interval at which another parameter lies on its bound."""

ROUGH = "~"
"""In front of a rough forecast."""


def marked(r: FitRecord, e: Estimate) -> str:
    """The interval, with `LEANS` behind an end that the data set only together with a bound of another parameter."""
    return interval(e, *(LEANS if names else "" for names in r.leaning(e.name)))


def wald(e: Estimate) -> str:
    """The Gauss-Newton interval."""
    return ends(e.wald_low, e.wald_high) if math.isfinite(e.wald_low) else "-"


def estimates(r: FitRecord) -> Table:
    """Estimates, intervals, whether the data determine them, and two comparisons."""
    header = ["quantity", "unit", "estimate", f"{100 * r.level:g} % interval", "determined", "Wald"]
    rows = []
    for e in r.estimates:
        estimate = number(e.estimate) + (" (bound)" if r.on_bound(e.name) else "")
        rows.append([e.name, e.unit, estimate, marked(r, e), e.verdict, wald(e)])
    note = (
        "Everything comes from the data, but for what is marked “bound”: there a bound of the fit decides. No prior is "
        f"used.{_leaning(r)}{_not_reached(r)} Wald: symmetric Gauss-Newton interval, for comparison only; - where a "
        "bound holds the estimate."
    )
    if r.paper is not None:
        header.append("paper's cost")
        for row, e in zip(rows, r.estimates, strict=True):
            value = r.paper_value(e.name)
            row.append("" if value is None else number(value))
        note += (
            " paper's cost: estimate under the cost function of Goodworth & Peterka (2018), for comparison; it has no "
            "likelihood, so no interval."
        )
    return Table("Estimates", header, rows, note)


def _leaning(r: FitRecord) -> str:
    """What `LEANS` means, and which bounds these ends lean on; empty without one."""
    bounds = sorted({n for e in r.estimates for side in r.leaning(e.name) for n in side})
    if not bounds:
        return ""
    return f" {LEANS} set by the data together with a bound of another parameter ({', '.join(bounds)})."


def _not_reached(r: FitRecord) -> str:
    """What `AT_MOST` and `AT_LEAST` mean; empty where the search reached every end."""
    if not any("steps" in (e.low_from, e.high_from) for e in r.estimates):
        return ""
    return f" {AT_MOST} {AT_LEAST} the search for this end did not converge: the interval extends at least to there."


def help_needed(r: FitRecord) -> Table | None:
    """Where the information comes from, and what would narrow the intervals; None for lines alone."""
    if not r.forecasts:
        return None
    fmax_hz, bands = r.forecasts[0].fmax_hz, band_names(r)
    higher = [] if fmax_hz is None else [f"up to {fmax_hz:.2g} Hz"]
    header = ["quantity", *bands, "half-width", "cycles × 2", "amplitude × 2", *higher, "if known"]
    rows = []
    for e, f in zip(r.estimates, r.forecasts, strict=True):
        share = [f"{100 * s:.0f}" if math.isfinite(s) else "-" for s in e.information[: len(bands)]]
        changes = [predicted(e, f, width) for width in (f.cycles, f.amplitude, f.fmax) if width is not None]
        known = f"{f.known}: {predicted(e, f, f.with_known)}"
        rows.append([e.name, *share, half(e, f.now), *changes, known])
    note = (
        "First columns: share of the information on the quantity in each band (%). Then: half-width of its interval "
        "relative to the estimate, now and as the Fisher information predicts it after a change (if known: at best, "
        "with the value of this parameter from elsewhere). "
        f"{ROUGH} rough, because a bound ends the interval or the likelihood is far from quadratic; open: still no "
        "interval that the data end."
    )
    return Table("What carries the information, and what would help", header, rows, note)


def band_names(r: FitRecord) -> tuple[str, ...]:
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
