"""The tables of a diagnosis, defined once for the terminal, a notebook and the HTML page."""

from __future__ import annotations

import math

from mcstudy.effect_library.library import library_of
from mcstudy.gap import nearest_words
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.prior import MEANINGS
from mcstudy.gap.questions.contrasts import DRAWS
from mcstudy.gap.questions.parameters import DECLARED_EXPLAINED, PRIOR_EXPLAINED, SOURCES, SOURCES_EXPLAINED
from mcstudy.gap.questions.posterior import Cause
from mcstudy.gap.verdict import added_name, effects_of, motion, not_a_body, p_value, shown_causes
from mcstudy.stance.body import standing
from mcstudy.text_tables import Table, number, with_error

SHOWN = 0.01
"""Causes with a probability below this share one row."""

FACTOR_SHOWN = 6 * math.log(10)
"""ln of the largest Bayes factor, and of the reciprocal of the smallest, that is written out: evidence is no better."""

MEASURES_EXPLAINED = (
    "The share counts every line by its precision, minus the noise. The error of predicted sway counts every line by "
    "its sway, so the lowest frequencies, where sway and its noise are largest, dominate it; it shows a gap only when "
    "it leaves the range that noise alone gives. Floor: root of the mean square that noise alone gives."
)


LIKENESS_EXPLAINED = (
    "likeness: share of the gap that the cause predicts at lines that were left out of its fit, with its 95 % interval."
)

REMAINING_EXPLAINED = (
    "A torque G(s) x that restores like a stiffness where G is positive. Intervals include the uncertainty of all "
    "other parameters and of the number of poles; a stiffness or damping that is a parameter of the model is not "
    "counted."
)

RESPONSES_HZ = (0.1, 0.3, 1.0, 3.0)
"""Frequencies at which a transfer function is tabulated."""


def tables(d: DiagnosisRecord) -> list[Table]:
    """The tables of a diagnosis that are not empty."""
    usual = [evidence(d), _causes(d), _sizes(d), _locations(d), closing(d), _nearest(d), _parameters(d), _contrasts(d)]
    answered = [table for answer in d.answers if (table := answer.table()) is not None]
    return [t for t in (*usual, *answered) if t.rows]


def text(d: DiagnosisRecord) -> str:
    """All tables as plain text."""
    return "\n\n".join(t.text() for t in tables(d))


def html(d: DiagnosisRecord) -> str:
    """All tables as an HTML fragment, for a notebook."""
    return "".join(t.html() for t in tables(d))


def _causes(d: DiagnosisRecord) -> Table:
    def yes(cause: int | str) -> str:
        return "yes" if cause in d.credible_set else ""

    notes: list[str] = []
    rows = []
    near = None if d.nearest is None else d.nearest.effects
    for k, c in enumerate(d.causes):
        if c.probability >= SHOWN or c.effects == near:
            like = "-" if c.likeness is None else nearest_words.percent(c.likeness)
            rows.append((c.probability, [_marked(c, notes), share(c.probability), yes(k), like]))
    rows += [
        (d.none_probability, ["no missing effect", share(d.none_probability), yes("none"), "-"]),
        (d.unknown_probability, ["a cause outside the library", share(d.unknown_probability), yes("unknown"), "-"]),
    ]
    lines = [cells for _, cells in sorted(rows, key=lambda row: -row[0])]
    others = sum(c.probability for c in d.causes if c.probability < SHOWN and c.effects != near)
    lines.append(["all other causes", share(others), "", "-"])
    note = " ".join(
        [*(f"[{i}] indistinguishable from {others} in these data." for i, others in enumerate(notes, 1)), _prior(d)]
    )
    header = ["cause", "probability", "in the 95 % set", "likeness"]
    if near is None:
        return Table("Causes", header[:3], [row[:3] for row in lines], note)
    return Table("Causes", header, lines, f"{note} {LIKENESS_EXPLAINED}".strip())


LEAST_SHARE = 0.001
"""Probability nearer to 0 or 1 than which none is stated: models and priors are not known so well."""


def share(p: float) -> str:
    """A probability for a table, or the limit beyond which it is not known."""
    if p < LEAST_SHARE:
        return f"< {LEAST_SHARE:g}"
    return f"{p:.3f}" if p <= 1 - LEAST_SHARE else f"> {1 - LEAST_SHARE:g}"


def _prior(d: DiagnosisRecord) -> str:
    """What the probabilities take for granted, and what the data alone say."""
    shares = ", ".join(f"{MEANINGS[name]} {number(100 * p, 2)} %" for name, p in d.prior.items())
    return (
        f"Prior probabilities: {shares}; --prior-none P sets the first. Bayes factor of no missing "
        f"effect against all others: {_factor(d.none_log_factor)}; its odds are this factor times P / (1 - P)."
    )


def _factor(log: float) -> str:
    """A Bayes factor of which only its logarithm may be representable."""
    if abs(log) < FACTOR_SHOWN:
        return number(math.exp(log), 2)
    return f"below {math.exp(-FACTOR_SHOWN):.0e}" if log < 0 else f"above {math.exp(FACTOR_SHOWN):.0e}"


def _marked(cause: Cause, notes: list[str]) -> str:
    """The effects of a cause; a number refers to the indistinguishable effects, which are added to ``notes``."""
    parts = []
    for effect, group in zip(cause.effects, cause.alternatives, strict=True):
        others = ", ".join(n for n in group if n != effect)
        if others and others not in notes:
            notes.append(others)
        parts.append(f"{effect} [{notes.index(others) + 1}]" if others else effect)
    return " and ".join(parts)


def _sizes(d: DiagnosisRecord) -> Table:
    """Sizes of the causes that are shown."""
    rows, known = [], library_of(d.base.model)
    for cause in shown_causes(d):
        effects = [known[e] for e in cause.effects if not cause.advice]
        owner = {n: e.name for e in effects for n in (*e.parameters, *e.nominal_form)}
        for s in cause.sizes:
            usual = known.usual_size(s.name)
            rows.append(
                [
                    s.name,
                    with_error(s.estimate, s.se),
                    f"{number(s.low)} to {number(s.high)}",
                    "-" if usual is None else f"{usual[0]:.3g} to {usual[1]:.3g}",
                    s.unit,
                    # the change of gains of a nonlinear effect is no parameter of its declaration
                    owner.get(s.name, cause.effects[-1]) + (" (in a pair)" if len(cause.effects) > 1 else ""),
                ]
            )
    header = ["parameter", "size ± SE", "95 % interval", "usual size", "unit", "of"]
    note = "SE: standard error. usual size: " + (
        "magnitude in people; mcstudy gap effects states where each comes from."
        if standing(d.base.model)
        else "3 to 30 % of what the model has itself, an assumption."
    )
    return Table("Sizes of the leading cause and of those in the 95 % set", header, rows, note)


def _locations(d: DiagnosisRecord) -> Table:
    rows = [[place, share(p)] for place, p in sorted(d.place.items(), key=lambda item: -item[1])]
    return Table("Location", ["location", "probability"], [*rows, ["no single location", share(d.place_abstained)]])


def evidence(d: DiagnosisRecord) -> Table:
    """What the decision that there is a gap, or none, rests on."""
    t = d.detection
    least = 1 / (1 + t.draws)
    low, high = t.chi2_noise
    rows = [
        [
            "deviations of known shape (ln Bayes factor)",
            number(t.statistic),
            f"below {number(t.statistic_limit, 2)}",
            p_value(t.p_value, least),
        ],
        [
            "squared residual of all lines",
            f"{t.chi2:.0f}",
            f"{low:.0f} to {high:.0f}, mean {t.expected_chi2:.0f}",
            p_value(t.fit_p_value, least),
        ],
    ]
    for c in d.contrasts:
        if c.changes:
            name = "change of gains with amplitude" if c.kind == "amplitude" else "change of gains over the recording"
            rows.append([name, "", "", p_value(c.p_value, 1 / (1 + DRAWS))])
    rows.append(["any gap", "", "", p_value(d.p_value, d.p_least)])
    return Table("Test for a mismatch", ["test", "observed", "noise alone, 95 %", "p-value"], rows, _why(d))


def _why(d: DiagnosisRecord) -> str:
    t = d.detection
    note = (
        "The squared residual of all lines is a goodness of fit: it adds the noise of every line, in which a gap of "
        "one shape can be lost. The first test looks only along the deviations that effects of the library or a smooth "
        "unknown torque would leave, so it finds much smaller gaps. “Any gap” combines all tests, with a margin for "
        "noise of another colour."
    )
    if d.detected and t.p_value > d.p_value:
        return f"{note} Here the change of gains decides: the residual of the mean response shows nothing."
    if d.leading is None or d.added is None:
        return note
    fall, parameters = d.base.chi2 - d.added.chi2, d.added.theta.size - d.base.theta.size
    return (
        f"{note} Here, adding {effects_of(d.leading)} lowers the squared residual by {number(fall)}, where noise alone "
        f"would lower it by about {parameters}; the sum over all lines scatters by ± {t.null_chi2.std():.0f} (SD)."
    )


def closing(d: DiagnosisRecord) -> Table:
    """Both measures of how far the leading cause closes the gap, with what noise alone leaves of each."""
    low, high = d.detection.chi2_noise
    noise = f"{low:.0f} to {high:.0f}, mean {d.detection.expected_chi2:.0f}"
    rows = [["squared residual of all lines", f"{d.base.chi2:.0f}", "", noise]]
    if d.sway_noise_deg is not None:
        low, high = d.sway_noise_deg
        noise = f"{number(low, 2)} to {number(high, 2)}, floor {number(d.sway_rms_deg['floor'])}"
        rows.append([f"error of predicted {motion(d)} (deg RMS)", number(d.sway_rms_deg["before"]), "", noise])
    title, header = (
        "How much of the mismatch is explained",
        ["measure", "base model", added_name(d), "noise alone, 95 %"],
    )
    if d.added is None:
        return Table(title, header[:2] + header[3:], [[*row[:2], row[3]] for row in rows])
    for row, value in zip(rows, (f"{d.added.chi2:.0f}", number(d.sway_rms_deg["after"])), strict=False):
        row[2] = value
    if d.closed is not None:
        c = d.closed
        share = f"{100 * c.fraction:.0f} % [{100 * c.low:.0f}, {100 * c.high:.0f}]"
        rows.append(["share of the gap closed", "0 %", share, "-"])
    return Table(title, header, rows, "" if d.sway_noise_deg is None else MEASURES_EXPLAINED.replace("sway", motion(d)))


def _nearest(d: DiagnosisRecord) -> Table:
    """The torque that the nearest mechanism leaves; no rows where none is found."""
    title, header = "What the nearest mechanism leaves, as a torque", ["quantity", "value [95 %]"]
    if d.nearest is None or not d.nearest.remaining.found:
        return Table(title, header, [])
    left = d.nearest.remaining
    rows = [
        ["mechanism", " and ".join(d.nearest.effects)],
        ["acts at, depends on", f"{left.row}, {left.sense} ({100 * left.path_probability:.0f} %)"],
        *([] if left.share is None else [["share of the active torque", nearest_words.percent(left.share)]]),
        *([] if left.rms is None else [[f"RMS ({left.unit.split('/')[0]})", nearest_words.bracketed(left.rms)]]),
        ["poles", ", ".join(f"{k} ({100 * p:.0f} %)" for k, p in enumerate(left.poles_weight) if p >= SHOWN)],
        [f"G(s) ({left.unit})", nearest_words.formula(left)],
    ]
    for f in RESPONSES_HZ:
        if left.f[0] <= f <= left.f[-1]:
            gain, phase = left.at(f)
            rows.append([f"|G| at {f:g} Hz ({left.unit})", nearest_words.bracketed(gain)])
            rows.append([f"phase at {f:g} Hz (deg)", f"{phase.estimate:.0f} [{phase.low:.0f}, {phase.high:.0f}]"])
    return Table(title, header, rows, REMAINING_EXPLAINED)


def _parameters(d: DiagnosisRecord) -> Table:
    rows = [
        [
            s.name,
            _value(s.without, s.without_se, s.without_from),
            *([] if d.added is None else [_value(s.added, s.added_se, s.added_from)]),
            s.unit,
        ]
        for s in d.shifts
    ]
    header = ["parameter", "base model", *([] if d.added is None else [added_name(d)]), "unit"]
    origins = {origin for s in d.shifts for origin in (s.without_from, s.added_from)}
    about = PRIOR_EXPLAINED if standing(d.base.model) else DECLARED_EXPLAINED
    explained = [text for origin, text in SOURCES_EXPLAINED.items() if origin in origins]
    note = " ".join(part for part in (*explained, about, not_a_body(d)) if part)
    return Table("Parameters ± standard error", header, rows, note)


def _value(value: float | None, se: float | None, source: str | None) -> str:
    """A parameter with what its value comes from; no standard error on a bound."""
    shown = number(value) if source == "bound" else with_error(value, se)
    return f"{shown} {SOURCES.get(source or '', '')}".rstrip()


def _contrasts(d: DiagnosisRecord) -> Table:
    rows = [
        [f"{c.kind}, {k.effect}", with_error(100 * k.gain, 100 * k.se), f"{k.z:.2f}", number(c.p_value, 2)]
        for c in d.contrasts
        for k in c.changes
    ]
    return Table(
        "Change of the active gains between amplitudes and over time",
        ["contrast, effect", "change of gain (%)", "z", "p-value"],
        rows,
    )
