"""A fit in sentences: whether to believe the model, what the data determine, and what they do not."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from mcstudy.fitting.status import WANTED
from mcstudy.gap import verdict
from mcstudy.gap.questions.detection import LEVEL
from mcstudy.identification import averaged_words
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.minimum import SEARCHES, TOLD
from mcstudy.identification.tables import estimates, help_needed, relative
from mcstudy.identification.trades import Combination, Valley
from mcstudy.lines.part_fits import told
from mcstudy.text_tables import ends, fill, number, p_words, with_error

CORRELATED = 0.9
"""Correlation of errors from which a pair is named."""

STRONG, WEAK = 5.0, 1.0
"""ln Bayes factors from which evidence is called strong, and below which it decides nothing."""

CLEAR = 2.0
"""Difference of unseen cycles, in standard errors, from which it counts."""

COVERED = (
    ("wider than needed", "a bound holds a parameter that trades for them"),
    ("too narrow", "publish them with this remark"),
)
"""What is said about intervals that hold the truth too often, and too rarely."""

FOUND_FROM = {
    "linear": "the start from the linear structure of the equations",
    "across": "starts from the ends of the parameters' ranges around a minimum nearly as low",
}
"""What found a lowest minimum in which no random start ended."""

SWAY_SD = 2.0
"""Distance of measured from predicted sway, in standard errors beyond its range, from which they differ."""


def text(r: FitRecord) -> str:
    """Tables, then sentences."""
    tables = [t.text() for t in (estimates(r), help_needed(r)) if t is not None]
    heading = f"{r.name}: {len(r.lines)} {r.lines.unit}s up to {r.lines.f.max():.3g} Hz"
    if r.averaged is not None:
        tables[:0] = [fill(averaged_words.finding(r.averaged)), averaged_words.table(r.averaged, r.level).text()]
        tables[2] = f"Of the model as it is:\n\n{tables[2]}"
    return "\n\n".join([heading, *tables, "\n".join(sentences(r))])


def sentences(r: FitRecord) -> list[str]:
    """What the numbers mean, one entry per topic."""
    first = [belief(r), by_recording(r), added(r), loop(r), sway(r), undetermined(r), coverage(r)]
    parts = [*first, *valleys(r), help_words(r), correlated(r), search_words(r)]
    return [*(part for part in parts if part), *r.warnings]


def belief(r: FitRecord) -> str:
    """Whether the model fits, and whether a gap was found."""
    fits = "consistent with noise" if r.p_value >= LEVEL else "larger than expected from noise"
    out = f"The squared residual is {fits}: {r.chi2:.0f}, expected {r.expected_chi2:.0f} ({p_words(r.p_value)})."
    added = r.method.effects
    if r.gap is not None:
        finds = "a gap" if gap_found(r) else "no gap"
        by = "`mcstudy gap diagnose --fast` finds"
        by = f"Without the added effects, {by[0].lower()}{by[1:]}" if added else by
        out += f" {by} {finds} beyond noise ({gap_p(r)})."
    if doubtful(r):
        out += " The intervals hold only if the model is right"
        out += "; `mcstudy gap diagnose` says what it may lack."
    return out


def by_recording(r: FitRecord) -> str:
    """Goodness of fit of each recording of a joint set; empty for one recording."""
    return told(r.labels, r.part_fits) if r.part_fits else ""


def gap_p(r: FitRecord) -> str:
    """P-value of the test for a gap, of a fit that has one."""
    assert r.gap is not None
    return verdict.p_words(r.gap.p_value, r.gap.p_least)


def gap_found(r: FitRecord) -> bool:
    """Whether the test for a gap found one."""
    return r.gap is not None and r.gap.p_value < LEVEL


def doubtful(r: FitRecord) -> bool:
    """Whether this model is not to be believed: too large a residual, or a gap that no added effect was to close."""
    return r.p_value < LEVEL or (gap_found(r) and not r.method.effects)


def added(r: FitRecord) -> str:
    """What the added effects change; empty without one."""
    if r.without_chi2 is None:
        return ""
    names = " and ".join(r.method.effects)
    out = f"With {names} the squared residual falls from {r.without_chi2:.0f} to {r.chi2:.0f}."
    c = r.comparison
    if c is None:
        return out
    kind = (
        "decides nothing"
        if abs(c.log_bayes_factor) < WEAK
        else f"is {'strong' if abs(c.log_bayes_factor) >= STRONG else 'weak'} "
        f"{'for' if c.log_bayes_factor > 0 else 'against'} {names}"
    )
    out += f" The evidence {kind} (ln Bayes factor {number(c.log_bayes_factor)})."
    if c.unseen is not None and c.unseen_se is not None:
        clear = abs(c.unseen) > CLEAR * c.unseen_se
        better = ("better" if c.unseen > 0 else "worse") if clear else "neither better nor worse"
        out += (
            f" It predicts held-out cycles {better}: their squared residual decreases by "
            f"{with_error(c.unseen, c.unseen_se)}."
        )
    return out


def rightmost_root(r: FitRecord) -> str:
    """Growth rate at the estimate; a loop without dynamics has none."""
    return "no dynamics" if r.growth_rate == -math.inf else f"rightmost root {number(r.growth_rate)} 1/s"


def loop(r: FitRecord) -> str:
    """Stability at the estimate and over the intervals."""
    state = "stable" if r.growth_rate < 0 else "unstable"
    out = f"The closed loop is {state} at the estimate ({rightmost_root(r)})"
    s = r.stability
    if s is None:
        return f"{out}."
    if s.high == -math.inf:
        return f"{out}, as over all intervals."
    span = f"{ends(s.low, s.high)} 1/s"
    if s.stable:
        return f"{out} and over all intervals ({span})."
    part = [x for x in s.ranges if not x.whole]
    limits = ", ".join(f"{x.name} {ends(x.low, x.high)}" for x in part[:4])
    more = f" and {len(part) - 4} more" if len(part) > 4 else ""
    return f"{out}, but not over all intervals ({span}). Stable bodies that fit as well have {limits}{more}."


def sway(r: FitRecord) -> str:
    """Predicted and measured sway."""
    if r.sway is None:
        return ""
    out = []
    for a in r.sway.angles:
        low, high = a.stimulus_low - SWAY_SD * a.measured_se, a.stimulus_high + SWAY_SD * a.measured_se
        agree = "" if low <= a.measured <= high else ", which disagrees"
        out.append(
            f"{a.angle} {number(a.stimulus)} ({ends(a.stimulus_low, a.stimulus_high)}), measured "
            f"{with_error(a.measured, a.measured_se)}{agree}"
        )
    unit = ", ".join(dict.fromkeys(a.unit for a in r.sway.angles))
    text = f"Predicted sway evoked by the stimulus ({unit} RMS, range over the intervals): {'; '.join(out)}."
    if r.sway.noise_levels is not None:
        noise = [
            f"{a.angle} {number(a.noise)} ({ends(a.noise_low, a.noise_high)}), measured {number(a.noise_measured)}"
            for a in r.sway.angles
        ]
        text += f" Evoked by sensor noise of fitted level: {'; '.join(noise)}."
    return text


def undetermined(r: FitRecord) -> str:
    """Which quantities the data leave open, on which side."""
    if all(e.verdict == "identifiable" for e in r.estimates):
        return "All quantities are determined by the data alone."
    kinds = ("not identifiable", "lower limit only", "upper limit only")
    named = {k: [e.name for e in r.estimates if e.verdict == k] for k in kinds}
    parts = [f"{k.capitalize()}: {', '.join(names)}." for k, names in named.items() if names]
    return f"{' '.join(parts)} Their other limits are bounds of the fit, not findings."


def coverage(r: FitRecord) -> str:
    """How often simulated intervals hold the truth, and which are wider than needed or too narrow; empty if unknown."""
    c = r.coverage
    if c is None:
        return ""
    percent = [x.percent for x in c.quantities.values()]
    out = (
        f"In simulated recordings ({c.condition}; {c.realizations} of three bodies) {100 * r.level:g} % intervals hold "
        f"the truth in {sum(percent) / len(percent):.1f} % on average."
    )
    for remark, why in COVERED:
        if names := c.with_remark(remark):
            told = ", ".join(f"{n} ({c.quantities[n].percent:.1f} %)" for n in names)
            out += f" {remark.capitalize()}: {told}; {why}."
    return out


def valleys(r: FitRecord) -> list[str]:
    """What trades for what, and what is determined nevertheless."""
    out = []
    for v in r.valleys:
        known = [_combination(c) for c in v.combinations]
        ends = (_body(v, v.first), _body(v, v.second))
        out.append(
            f"{_and(v.names)} trade for each other: a body with {ends[0]} fits as well as one with {ends[1]}."
            + "".join(f" {k}" for k in known)
        )
    return out


def _combination(c: Combination) -> str:
    half = (c.high - c.low) / 2 / abs(c.estimate) if c.estimate else math.inf
    share = f" (±{number(100 * half, 2)} %)" if half < 1 else ""
    return (
        f"Only {c.name} is determined: {ends(c.low, c.high)} {c.unit}{share}; {c.opposite} is not "
        f"({ends(c.opposite_low, c.opposite_high)})."
    )


def _body(v: Valley, values: Iterable[float]) -> str:
    return ", ".join(f"{n} {number(x)}" for n, x in zip(v.names, values, strict=True))


def help_words(r: FitRecord) -> str:
    """What would narrow the worst of the intervals that the data end."""
    firm = [(e, f) for e, f in zip(r.estimates, r.forecasts, strict=False) if not f.rough and e.estimate]
    if not firm:
        return ""
    e, f = max(firm, key=lambda p: p[1].now / abs(p[0].estimate))
    more = "" if f.fmax is None else f", {relative(e, f.fmax)} with lines up to {f.fmax_hz:.2g} Hz"
    return (
        f"The widest interval with a firm forecast, {e.name} ({relative(e, f.now)}), would be "
        f"{relative(e, f.cycles)} with twice the cycles, {relative(e, f.amplitude)} with twice the amplitude{more}, "
        f"and at best {relative(e, f.with_known)} if {f.known} were known."
    )


def correlated(r: FitRecord) -> str:
    """Pairs of strongly correlated errors."""
    names = r.model.names
    pairs = [
        (abs(r.correlation[i, j]), f"{names[i]} and {names[j]} ({r.correlation[i, j]:+.2f})")
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True)
        if abs(r.correlation[i, j]) >= CORRELATED
    ]
    if not pairs:
        return ""
    told = ", ".join(pair for _, pair in sorted(pairs, reverse=True)[:6])
    return f"Strongly correlated errors near the estimate: {told}."


def search_words(r: FitRecord) -> str:
    """How the lowest minimum was found."""
    m = r.minima
    others = int((m.chi2[1:] - m.chi2[0] < TOLD).sum())
    if m.missed_lowest is None:
        out = f"No random start of {m.starts} ended in the lowest minimum; {FOUND_FROM[m.lowest_from]} found it."
    else:
        known = m.missed_lowest >= WANTED  # hits in a higher minimum are no better evidence
        chance = f"of {100 * m.missed_lowest:.1f} %" if known else f"below {100 * WANTED:g} %"
        out = (
            f"Of {m.starts} random starts, {m.hits[0]} ended in the lowest minimum; as many new ones alone would miss "
            f"it with a chance {chance}."
        )
    out += (
        f" The next random start would end in a minimum not seen yet with an expected chance of {100 * m.missed:.1f} %."
    )
    if r.coverage is not None:
        most = 1 - (1 - r.level) ** (1 / SEARCHES)
        out += (
            f" In {SEARCHES} simulated recordings ten times the random starts found no lower minimum than this search "
            f"(chance of a miss below {100 * most:.1f} %)."
        )
    if others:
        fit = "minimum fits" if others == 1 else "minima fit"
        out += f" {others} other {fit} almost as well (squared residual at most {TOLD:g} higher)."
    return out


def _and(names: Iterable[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last
