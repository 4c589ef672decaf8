"""The outcome of a diagnosis as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mcstudy.gap.questions.posterior import Cause
from mcstudy.gap.questions.power import Undetectable

if TYPE_CHECKING:
    from mcstudy.gap.diagnosis import Diagnosis


def words(name: str) -> str:
    """The name of an effect for display, with spaces."""
    return name.replace("_", " ")


def named(cause: Cause) -> str:
    """Names of the effects of a cause, each with the effects that the recording cannot distinguish from it."""
    parts = []
    for effect, group in zip(cause.effects, cause.alternatives, strict=True):
        others = [words(n) for n in group if n != effect]
        parts.append(words(effect) + (f" (cannot be told from {', '.join(others)})" if others else ""))
    return " and ".join(parts)


def where(d: Diagnosis) -> str:
    """The bands of the residual map that exceed their limit, as text."""
    by_angle: dict[str, list[tuple[float, float]]] = {}
    for b in d.detection.bands:
        if b.beyond:
            spans = by_angle.setdefault(b.angle, [])
            if spans and b.low_hz <= spans[-1][1] + 0.1:
                spans[-1] = (spans[-1][0], b.high_hz)
            else:
                spans.append((b.low_hz, b.high_hz))
    name = {"theta1": "the lower body's angle", "theta2": "the hip angle"}
    parts = [
        f"{name.get(a, a)} between " + " and ".join(f"{lo:.2g} and {hi:.2g} Hz" for lo, hi in s)
        for a, s in by_angle.items()
    ]
    return "in " + ", and in ".join(parts) if parts else "no single frequency band stands out"


def p_words(p: float, least: float) -> str:
    """A p-value as text; ``least`` is the smallest one that this number of null samples can give."""
    return f"p < {least:.2g}" if p <= 1.01 * least else f"p = {p:.2g}"


def verdict(d: Diagnosis) -> str:
    """One paragraph: whether there is a gap, where, its cause, how much it closes, and what cannot be ruled out."""
    p = p_words(d.p_value, d.p_least)
    parts = []
    if not d.detected:
        parts.append(f"No gap beyond noise ({p}): the model without further effects describes this recording.")
    else:
        parts.append(f"A gap beyond noise ({p}), {where(d)}.")
        parts += _cause(d)
        if d.closed is not None:
            c = d.closed
            best = words(" and ".join(d.causes[0].effects))
            parts.append(
                (
                    f"The best-fitting effect of the library, {best}, would close"
                    if _unnamed(d)
                    else f"Adding {best} closes"
                )
                + f" {100 * c.fraction:.0f} % "
                f"[{100 * c.low:.0f}, {100 * c.high:.0f}] of the gap"
                + (", down to the noise floor." if c.at_noise_floor else ".")
                + (
                    f" With about {c.trials_needed} such trials in all this share would be known to ±15 percentage "
                    "points."
                    if c.high - c.low > 0.3
                    else ""
                )
            )
    for contrast in d.contrasts:
        if contrast.p_value < 0.01 and contrast.changes:
            largest = max(contrast.changes, key=lambda k: k.log_factor)
            what = "with amplitude" if contrast.kind == "amplitude" else "over the recording"
            parts.append(f"The active gains change {what} by {100 * largest.gain:+.0f} % (± {100 * largest.se:.0f}).")
    missed = [words(u.effect) for u in undetected(d)]
    if missed:
        parts.append(f"These data can neither confirm nor rule out: {', '.join(missed)}.")
    parts += [f"Note: {w}." for w in d.warnings]
    return " ".join(parts)


def _unnamed(d: Diagnosis) -> bool:
    """Whether a cause outside the library is more probable than every named cause."""
    return d.unknown_probability > d.causes[0].probability


def undetected(d: Diagnosis) -> list[Undetectable]:
    """Effects below the detection limit, except those named as causes, which these data do show."""
    said = _said(d) if d.detected else set()
    return [u for u in d.undetectable if u.effect not in said]


def _said(d: Diagnosis) -> set[str]:
    """Effects that the sentences about causes name."""
    causes = [d.causes[0]]
    if not _unnamed(d):
        causes += [d.causes[k] for k in d.credible_set if isinstance(k, int)]
    return {e for c in causes for group in c.alternatives for e in group}


def _cause(d: Diagnosis) -> list[str]:
    first = d.causes[0]
    if _unnamed(d):
        out = [
            f"No effect of the library explains the gap; a cause outside it is more probable "
            f"({100 * d.unknown_probability:.0f} %)."
        ]
        if first.probability > 0.05:
            out.append(f"The nearest named cause is {named(first)} ({100 * first.probability:.0f} %).")
    else:
        sizes = "; ".join(f"{s.name} = {s.estimate:.3g} ± {s.se:.2g} {s.unit}".rstrip() for s in first.sizes)
        out = [f"Most likely cause: {named(first)} ({100 * first.probability:.0f} %; {sizes})."]
        out += [s.advice for s in first.sizes if s.advice]
        others = [
            f"{named(d.causes[k])} ({100 * d.causes[k].probability:.0f} %)"
            for k in d.credible_set
            if isinstance(k, int) and k > 0
        ]
        if "unknown" in d.credible_set:
            others.append(f"a cause outside the library ({100 * d.unknown_probability:.0f} %)")
        if others:
            out.append(f"Also possible: {', '.join(others)}.")
    best = max(d.place, key=lambda k: d.place[k])
    if d.place[best] > 0.5:
        out.append(f"Location: {best} ({100 * d.place[best]:.0f} %).")
    else:
        out.append("Location: uncertain.")
    return out
