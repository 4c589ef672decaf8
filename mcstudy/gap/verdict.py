"""A diagnosis in words and as a page fragment."""

from __future__ import annotations

from html import escape

from mcstudy.gap.diagnosis import SOURCES_EXPLAINED, Diagnosis
from mcstudy.gap.explain import Cause


def words(name: str) -> str:
    """An effect's name for people."""
    return name.replace("_", " ")


def named(cause: Cause) -> str:
    """Names of a cause's effects with what they cannot be told from."""
    parts = []
    for effect, group in zip(cause.effects, cause.alternatives, strict=True):
        others = [words(n) for n in group if n != effect]
        parts.append(words(effect) + (f" (cannot be told from {', '.join(others)})" if others else ""))
    return " and ".join(parts)


def where(d: Diagnosis) -> str:
    """Bands of the residual map beyond their limit, in words."""
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
    """A p-value as text, not smaller than the draws can say."""
    return f"p < {least:.2g}" if p <= 1.01 * least else f"p = {p:.2g}"


def verdict(d: Diagnosis) -> str:
    """One paragraph: whether, where, which, how far, and what cannot be excluded."""
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
    said = _said(d) if d.detected else set()
    missed = [words(u.effect) for u in d.undetectable if u.effect not in said]
    if missed:
        parts.append(f"These data can neither confirm nor rule out: {', '.join(missed)}.")
    parts += [f"Note: {w}." for w in d.warnings]
    return " ".join(parts)


def _unnamed(d: Diagnosis) -> bool:
    """Whether a cause outside the library is more probable than any in it."""
    return d.unknown_probability > d.causes[0].probability


def _said(d: Diagnosis) -> set[str]:
    """Effects that the sentences on causes name."""
    causes = [d.causes[0]]
    if not _unnamed(d):
        causes += [d.causes[k] for k in d.credible_set if isinstance(k, int)]
    return {e for c in causes for group in c.alternatives for e in group}


def _cause(d: Diagnosis) -> list[str]:
    first = d.causes[0]
    if _unnamed(d):
        out = [
            f"No effect of the library explains it: the cause is something else ({100 * d.unknown_probability:.0f} %)."
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


def html(d: Diagnosis) -> str:
    """The verdict and the tables."""
    rows = "".join(
        f"<tr><td>{escape(named(c))}</td><td>{c.probability:.3f}</td><td>"
        + escape("; ".join(f"{s.name} = {s.estimate:.3g} ± {s.se:.2g} {s.unit}" for s in c.sizes))
        + "</td></tr>"
        for c in d.causes[:8]
    )
    rows += f"<tr><td>outside the library</td><td>{d.unknown_probability:.3f}</td><td></td></tr>"
    rows += f"<tr><td>no missing effect</td><td>{d.none_probability:.3f}</td><td></td></tr>"
    shifts = "".join(
        f"<tr><td>{s.name}</td><td>{s.without:.4g} ± {s.without_se:.2g}</td><td>"
        + ("" if s.added is None else f"{s.added:.4g} ± {s.added_se:.2g}")
        + f"</td><td>{escape(s.unit)}</td><td>{escape(s.source)}</td></tr>"
        for s in d.shifts
    )
    return (
        f"<h3>{escape(d.name)}</h3><p>{escape(d.verdict())}</p>"
        "<table><thead><tr><th>cause</th><th>probability</th><th>size</th></tr></thead>"
        f"<tbody>{rows}</tbody></table>"
        "<table><thead><tr><th>parameter</th><th>base model</th><th>with the leading cause</th><th>unit</th>"
        f"<th>value from</th></tr></thead><tbody>{shifts}</tbody></table><p>{escape(SOURCES_EXPLAINED)}</p>"
    )
