"""The outcome of a diagnosis in words.

Effects have the names under which the library lists them, so that any of them can be given to ``mcstudy simulate``.
"""

from __future__ import annotations

from mcstudy import text_tables
from mcstudy.effect_library.library import LIBRARY, Library, library_of
from mcstudy.fitting.penalised import Fitted
from mcstudy.gap import nearest_words
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.questions import question
from mcstudy.gap.questions.detection import LEVEL
from mcstudy.gap.questions.parameters import sources
from mcstudy.gap.questions.posterior import Cause
from mcstudy.lines.part_fits import told
from mcstudy.recordings.joint_recording import part_labels
from mcstudy.stance.body import standing
from mcstudy.text_tables import fill, number, with_error

WIDE = 0.3
"""Width of the interval of the share closed from which the number of trials that narrows it is stated."""

NEARLY_ALL = 0.95
"""A gap of which less is closed, at the upper limit, is said to remain in part."""

FAR = 2.0
"""Factor by which a size must lie outside its usual range to be called small or large."""

ON_BOUNDS = 2
"""Number of parameters on bounds from which the fit is said to describe no body."""

MOVED, NAMED = 1.0, 3
"""Standard errors from which a parameter has moved, and the most that are named."""

SHARED = 0.25
"""Probability from which a location is named, if those named have more than half of it together."""


def effects_of(cause: Cause) -> str:
    """The effects of a cause by name."""
    return " and ".join(cause.effects)


def added_name(d: DiagnosisRecord) -> str:
    """What the model with the leading cause is called in tables and figures."""
    if d.leading is None:
        return "with a cause"
    return f"with {d.leading.effects[0]}" if len(d.leading.effects) == 1 else "with both effects"


def named(cause: Cause, known: Library = LIBRARY) -> str:
    """Names of the effects of a cause, each with the effects that the recording cannot distinguish from it.

    ``known``: the library in which they may have words.
    """
    parts = []
    for effect, group in zip(cause.effects, cause.alternatives, strict=True):
        others = [n for n in group if n != effect]
        parts.append(
            known.words(effect) + (f" (indistinguishable from {', '.join(others)} in these data)" if others else "")
        )
    return " and ".join(parts)


def where(d: DiagnosisRecord) -> str:
    """The bands of the residual map that exceed their limit, as text."""
    return nearest_words.where(d.detection.bands) or "no single frequency band stands out"


CAPPED = 0.6
"""A p-value that is cut off at 1 is that of a residual whose own p-value is above this: 1 divided by the margin of
`mcstudy.gap.questions.any_gap` and by the share of the contrasts."""


def p_value(p: float, least: float) -> str:
    """A p-value; ``least`` is the smallest one that this number of null samples can give.

    With its margin the p-value of any gap is an upper limit, cut off at 1. More than a third of the recordings to which
    the model lacks nothing reach it; for them only that the residual is ordinary is known.
    """
    if p >= 1:
        return f"> {CAPPED:g}"
    return text_tables.p_value(p, least)


def p_words(p: float, least: float) -> str:
    """A p-value in a sentence; see `p_value`."""
    return text_tables.with_sign(p_value(p, least))


def verdict(d: DiagnosisRecord) -> str:
    """All sentences as one paragraph."""
    return " ".join(sentences(d))


def wrapped(d: DiagnosisRecord) -> str:
    """The sentences in lines that fit the terminal; each part of the verdict begins a line."""
    return "\n".join(fill(part) for part in sentences(d))


def sentences(d: DiagnosisRecord) -> list[str]:
    """The parts of the verdict: whether there is a gap, where, its cause, how much it closes and leaves."""
    p = p_words(d.p_value, d.p_least)
    if d.detected:
        parts = [f"A gap beyond noise ({p}); {where(d)}."]
    else:
        parts = [f"No gap beyond noise ({p}): the model without further effects describes this recording."]
    if d.leading is not None:
        parts += [
            _cause(d, d.leading),
            unusual(d.leading) if standing(d.base.model) else "",
            share_closed(d),
            nearest(d),
            sway(d),
        ]
    parts.append(not_a_body(d))
    corrected = d.leading is not None and d.leading.advice
    for contrast in d.contrasts if not corrected else ():  # trials that are labelled differently differ
        if contrast.p_value < 0.01 and contrast.changes:
            largest = max(contrast.changes, key=lambda k: k.log_factor)
            what = "with amplitude" if contrast.kind == "amplitude" else "over the recording"
            change = with_error(100 * largest.gain, 100 * largest.se)
            parts.append(f"The active gains change {what} by {change} %.")
    if len(d.detection.parts) > 1:
        parts.append(told(part_labels(d.recording, len(d.detection.parts)), d.detection.parts))
    parts += [answer.sentence() for answer in d.answers]
    parts.append(moved(d))
    parts += [f"Note: {w}." for w in d.warnings]
    return [part for part in parts if part]


def differing_tests(d: DiagnosisRecord) -> str:
    """Both tests of the mean response by name, if only one of them finds a gap; empty otherwise."""
    t = d.detection
    if (t.p_value < LEVEL) == (t.fit_p_value < LEVEL):
        return ""
    least = 1 / (1 + t.draws)
    shape, lines = p_words(t.p_value, least), p_words(t.fit_p_value, least)
    if t.p_value < LEVEL:
        why = "The second adds the noise of every line, in which a gap of one shape can be lost."
    else:
        why = "The first looks only along shapes that effects of the library or a smooth unknown torque would leave."
    return (
        f"Two tests of the mean response differ: deviations of known shape, {shape}; residual of all lines, {lines}. "
        f"{why} The p-value of any gap ({p_words(d.p_value, d.p_least)}) combines all tests, with a margin for noise "
        "of another colour."
    )


def shown_causes(d: DiagnosisRecord) -> list[Cause]:
    """The leading cause and the other named ones of the 95 % set."""
    return question.shown_causes(d.causes, d.credible_set, d.leading)


def nearest(d: DiagnosisRecord) -> str:
    """The nearest mechanism, how much of the gap it predicts at left-out lines, and what it leaves."""
    if d.leading is None or not d.asked.nearest:
        return ""
    if d.nearest is None:  # a gap only between amplitudes or in time has no mechanism to be compared with
        plausible = "a physiologically plausible size" if standing(d.base.model) else "a size inside its bounds"
        said = f"No mechanism in the library fits with {plausible}."
        return said if d.detection.p_value < LEVEL else ""
    said = nearest_words.resembles(d.nearest, named(d.nearest.cause, library_of(d.base.model)))
    if d.leading.advice:
        return f"{said} This would be so if the recording were labelled right."
    return f"{said} {nearest_words.leaves(d.nearest, d.detection.chi2_noise)}"


def motion(d: DiagnosisRecord) -> str:
    """What is predicted, in one word."""
    return "sway" if standing(d.base.model) else "motion"


def sway(d: DiagnosisRecord) -> str:
    """What adding the leading cause does to the error of predicted sway, compared with noise; empty without numbers."""
    before, after, noise = d.sway_rms_deg["before"], d.sway_rms_deg["after"], d.sway_noise_deg
    if d.leading is None or d.added is None or before is None or after is None or noise is None:
        return ""
    low, high = (number(x, 2) for x in noise)
    what = f"The error of predicted {motion(d)} is {number(before)} deg RMS with the base model and {number(after)} deg"
    what += f" with {effects_of(d.leading)}; noise alone leaves {low} to {high} deg in 95 % of recordings."
    if after > noise[1]:
        return f"{what} Even then, predicted {motion(d)} is worse than noise allows."
    if before <= noise[1]:
        return f"{what} Both are within noise: this error is too coarse to show the gap."
    if d.closed is not None and d.closed.high < NEARLY_ALL:
        return (
            f"{what} Predicted {motion(d)} is then within noise; this error is too coarse to show the rest of the gap."
        )
    return f"{what} Predicted {motion(d)} is then as good as noise allows."


def moved(d: DiagnosisRecord) -> str:
    """What leaving out the leading cause does to the parameters; empty without a gap in the mean response."""
    if not d.detected or d.leading is None or d.added is None or d.leading.advice:
        return ""
    sized = [((s.added - s.without) / s.without_se, s) for s in d.shifts if s.added is not None and s.without_se > 0]
    far = sorted((x for x in sized if abs(x[0]) >= MOVED), key=lambda x: -abs(x[0]))
    if not far:
        return f"Without {effects_of(d.leading)} no parameter moves by more than its standard error."
    told = [f"{s.name} {number(s.without)} instead of {number(s.added)} {s.unit}".rstrip() for _, s in far[:NAMED]]
    more = f", and {len(far) - NAMED} more move by more than their standard error" if len(far) > NAMED else ""
    return (
        f"Without {effects_of(d.leading)} a fit finds {', '.join(told)}{more}; `mcstudy fit` averages parameters over "
        "the causes."
    )


def not_a_body(d: DiagnosisRecord) -> str:
    """A warning about each model with several parameters on their bounds; empty when there is none."""
    parts = [_not_a_body(d.base, "The base model", d.base.theta.size)]
    if d.leading is not None and d.added is not None:
        parts.append(_not_a_body(d.added, f"The model with {effects_of(d.leading)}", d.base.theta.size))
    said = " ".join(part for part in parts if part)
    why = "These values make up for what the model lacks; do" if d.detected else "Do"
    of = "this person's" if standing(d.base.model) else "estimates"
    return said and f"{said} {why} not read them as {of}."


def _not_a_body(fitted: Fitted, model: str, n: int) -> str:
    """What is wrong with one fit, from its first ``n`` parameters, those of the base model; empty if nothing is."""
    parameters = list(zip(fitted.model.parameters, fitted.theta, sources(fitted), strict=True))[:n]
    on_bound = [p.name for p, _, source in parameters if source == "bound"]
    if len(on_bound) < ON_BOUNDS:
        return ""
    negative = [p.name for p, x, _ in parameters if x < 0 < p.value]
    also = f", and {_and(negative)} {'is' if len(negative) == 1 else 'are'} negative" if negative else ""
    if not standing(fitted.model):
        return f"{model} fit ends on bounds that the model declares: {_and(on_bound)}."
    return f"{model} fit is not physiological: {_and(on_bound)} are at their bounds{also}."


def _and(names: list[str]) -> str:
    return " and ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)


def _unnamed(d: DiagnosisRecord) -> bool:
    """Whether a cause outside the library is more probable than every named cause."""
    return d.unknown_probability > d.causes[0].probability


def unusual(cause: Cause) -> str:
    """A warning about each effect of a cause whose size is far from those in people; empty when there is none.

    Such a size is known well: its whole 95 % interval lies below half or above twice the usual range. Mass under the
    feet, for example, acts like a loose head of 1 kg.
    """
    known = [e for e in cause.effects if e in LIBRARY and not cause.advice]  # one may be registered no more
    effect_of = {LIBRARY[e].size.name: e for e in known}
    parts = []
    for s in cause.sizes:
        usual = LIBRARY.usual_size(s.name) if s.name in effect_of else None
        if usual is None:
            continue
        most = max(abs(s.low), abs(s.high))
        least = 0.0 if s.low < 0 < s.high else min(abs(s.low), abs(s.high))
        if most < usual[0] / FAR or least > usual[1] * FAR:
            value, side = f"{number(s.estimate)} {s.unit}".strip(), "small" if most < usual[0] / FAR else "large"
            parts.append(
                f"{s.name} = {value} is {side} for {effect_of[s.name]} (usual size {usual[0]:.3g} to {usual[1]:.3g}): "
                "another mechanism may act like it."
            )
    return " ".join(parts)


def share_closed(d: DiagnosisRecord) -> str:
    """The share of the gap that the leading cause closes, with its interval; empty without a gap."""
    c, leading = d.closed, d.leading
    if leading is not None and leading.advice:
        return _corrected(d, leading)
    if leading is not None and d.added is None and d.asked.closed:
        return (
            f"{effects_of(leading)} changes the response with amplitude or over time, not the mean response, so no "
            f"share of the gap closed and no better prediction of {motion(d)} is stated."
        )
    if c is None or leading is None:
        return ""
    best = f"The best-fitting effect{'s' if len(leading.effects) > 1 else ''} of the library, {{}}, would close"
    adding = best if _unnamed(d) else "Adding {} closes"
    share = f"{adding.format(effects_of(leading))} {100 * c.fraction:.0f} % [{100 * c.low:.0f}, {100 * c.high:.0f}]"
    share += f" of the gap{', down to the noise floor' if c.at_noise_floor else ''}."
    if c.high - c.low > WIDE:
        trials = d.method.trials
        share += (
            f" With about {c.trials_needed} such trials in all (this recording has {trials}) this share would be known "
            "to ±15 percentage points."
        )
    return share


def _corrected(d: DiagnosisRecord, leading: Cause) -> str:
    """What remains when the labels are corrected."""
    low, high = d.detection.chi2_noise
    return (
        f"With this corrected, the squared residual is {number(leading.fitted.chi2, 4)} instead of "
        f"{number(d.detection.chi2, 4)} (noise alone: {low:.0f} to {high:.0f}). Correct the recording and diagnose it "
        "again: a missing effect may remain."
    )


def _cause(d: DiagnosisRecord, first: Cause) -> str:
    known = library_of(d.base.model)
    if _unnamed(d):
        out = [
            f"No effect of the library explains the gap; a cause outside it is more probable "
            f"({nearest_words.chance(d.unknown_probability)})."
        ]
        if first.probability > 0.05:
            out.append(
                f"The most probable named cause is {named(first, known)} ({nearest_words.chance(first.probability)})."
            )
    else:
        sizes = [f"{s.name} = {with_error(s.estimate, s.se)} {s.unit}".rstrip() for s in first.sizes]
        what = f"a mislabelled recording, {named(first, known)}" if first.advice else named(first, known)
        out = [f"Most likely cause: {what} ({'; '.join([nearest_words.chance(first.probability), *sizes])})."]
        out += [first.advice] if first.advice else []
        others = [
            f"{named(d.causes[k], known)} ({nearest_words.chance(d.causes[k].probability)})"
            for k in d.credible_set
            if isinstance(k, int) and k > 0
        ]
        if "unknown" in d.credible_set:
            others.append(f"a cause outside the library ({nearest_words.chance(d.unknown_probability)})")
        if others:
            out.append(f"Also possible: {', '.join(others)}.")
    return " ".join([*out, _location(d)])


def _location(d: DiagnosisRecord) -> str:
    likely = sorted(((p, place) for place, p in d.place.items() if p >= SHARED), reverse=True)
    if sum(p for p, _ in likely) <= 0.5:
        return "Location: uncertain."
    return f"Location: {', '.join(f'{place} ({nearest_words.chance(p)})' for p, place in likely)}."
