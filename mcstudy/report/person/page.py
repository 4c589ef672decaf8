"""A fit as a page: what came out, estimates, profiles, whether to believe the model, what would help."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from mcstudy import text_tables
from mcstudy.identification import words
from mcstudy.identification.estimate import Estimate, interval
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.tables import estimates, help_needed, relative
from mcstudy.report.document import document
from mcstudy.report.figure import Figure, Panel, figure, of_part
from mcstudy.report.figures.pairs import WRITTEN
from mcstudy.report.html import Table, escape, table, tiles
from mcstudy.report.origin import recording_rows
from mcstudy.report.person import figures, responses
from mcstudy.text_tables import number, p_words

SMALL, WIDE = (3.4, 2.6), (6.4, 4.6)

TILES = 4
"""Quantities on the first screen: those that the data determine best."""


def fit_page(fit: FitRecord, command: str = "mcstudy fit REC --html page.html") -> str:
    """The page of a fit; ``command``: the command that makes this page, as displayed on it."""
    parts = [
        ("estimates", "Estimates and intervals", _table(fit) + _shown([_intervals(fit), *_coverage(fit)], command)),
        ("profiles", "What the data determine", _listed(_open(fit)) + _shown(_profiles(fit), command)),
        ("model", "Model adequacy", _listed(_belief(fit)) + _shown(_model(fit), command)),
        ("help", "What would help", _shown([_information(fit)], command)),
        ("search", "How the estimate was found", _shown([_waterfall(fit)], command)),
        ("made", "Provenance", _provenance(fit, command)),
    ]
    return document(
        f"Parameters of {fit.name}",
        _introduction(fit),
        parts,
        f"Intervals are profile likelihood intervals of {100 * fit.level:g} %; no prior is used. How often such "
        "intervals contain the true value in simulations: mcstudy/identification/README.md.",
    )


def _introduction(fit: FitRecord) -> str:
    kinds = [e.verdict for e in fit.estimates]
    determined = kinds.count("identifiable")
    asked = (
        f"Asked: which values of the {len(fit.model.names)} parameters of the {fit.model.name.replace('_', ' ')} model "
        f"agree with {_what(fit)} at {len(fit.lines)} lines from "
        f"{fit.lines.f.min():.2g} to {fit.lines.f.max():.2g} Hz"
    )
    added = fit.method.effects
    asked += f", with {' and '.join(added)} added to it?" if added else "?"
    entries = [
        (
            "Determined by the data",
            f"{determined} of {len(kinds)}",
            "quantities have an interval that the data end on both sides.",
            "profiles",
        ),
        *(
            (
                e.name,
                f"{number(e.estimate)} {e.unit}".replace("N m", "N·m"),
                f"{interval(e)} ({_share(e)}).",
                "intervals",
            )
            for e in _best(fit)
        ),
        ("Goodness of fit", p_words(fit.p_value), _goodness(fit), "model"),
    ]
    if fit.gap is not None:
        found = "a gap beyond noise" if words.gap_found(fit) else "no gap beyond noise"
        entries.append(("Test for a gap", found, f"{words.gap_p(fit)}.", "model"))
    if fit.stability is not None:
        state = "over all intervals" if fit.stability.stable else "not over all intervals"
        root = f"rightmost root {number(fit.growth_rate)} 1/s; stable {state}."
        entries.append(("Closed loop", "stable" if fit.growth_rate < 0 else "unstable", root, "model"))
    warning = f'<div class="truth"><p>{escape(words.belief(fit))}</p></div>' if words.doubtful(fit) else ""
    return f"<p>{escape(asked)}</p>{warning}{tiles(entries)}"


def _what(fit: FitRecord) -> str:
    if len(fit.parts) > 1:
        return f"these {len(fit.parts)} recordings together"
    return "these lines" if fit.recording is None else "this recording"


def _best(fit: FitRecord) -> list[Estimate]:
    known = [e for e in fit.estimates if e.verdict == "identifiable" and e.estimate]
    return sorted(known, key=lambda e: (e.high - e.low) / abs(e.estimate))[:TILES]


def _share(e: Estimate) -> str:
    return relative(e, e.half_width)


def _goodness(fit: FitRecord) -> str:
    return f"squared residual {fit.chi2:.0f}, expected {fit.expected_chi2:.0f}."


def _page_table(t: text_tables.Table) -> Table:
    return Table(t.title, t.header, t.rows, "wide")


def _table(fit: FitRecord) -> str:
    t = estimates(fit)
    return table(_page_table(t)) + _listed([t.note])


def _intervals(fit: FitRecord) -> Figure:
    return Figure(
        "intervals",
        "",
        "All quantities",
        [
            "Each quantity relative to the value that is typical of a body of this weight. Thick line: the profile "
            "interval; a hollow end is a bound of the fit and says nothing about the person. Dashed: the symmetric "
            "Gauss-Newton interval (Wald), which ignores bounds and other minima. Cross: the estimate under the cost "
            "of Goodworth & Peterka (2018).",
        ],
        [Panel("intervals", partial(figures.intervals, fit), WIDE)],
        python="fit.plot.intervals()",
    )


def _coverage(fit: FitRecord) -> list[Figure]:
    if fit.coverage is None:
        return []
    drawn = Figure(
        "coverage",
        "",
        "Coverage of these intervals in simulation",
        [
            words.coverage(fit),
            "Diamond: all simulated recordings. Line: from the body with the fewest to that with the most. Grey: the "
            "goal. The simulated condition is the nearest one in number of cycles and highest frequency.",
        ],
        [Panel("coverage", partial(figures.coverage, fit), WIDE)],
        python="fit.plot.coverage()",
    )
    return [drawn]


def _profiles(fit: FitRecord) -> list[Figure]:
    rows = [
        (e.name, ", ".join(f"{n} {number(a)} to {number(b)}" for n, (a, b) in fit.moving(e.name).items()) or "nothing")
        for e in fit.estimates
    ]
    drawn = Figure(
        "profile",
        "",
        "Profiles",
        [
            "How much the squared residual rises above the lowest one when a quantity is held at a value and all other "
            "parameters are fitted again. The interval holds the values below the threshold. Dashed: what the "
            "curvature at the estimate alone would give (Wald). Points above the lower edge belong to higher minima.",
        ],
        [Panel(e.name, partial(figures.profile, fit, e.name), SMALL) for e in fit.estimates],
        [Table("What moves with it from the lower to the upper end", ("quantity", "moves"), rows, "rows")],
        python=f'fit.plot.profile("{fit.estimates[0].name}")',
        legend=[("blue", "profile and interval"), ("muted", "threshold"), ("orange", "Wald"), ("ink", "estimate")],
    )
    near = Figure(
        "correlations",
        "",
        "Correlations near the estimate",
        [
            "Correlations of the Gauss-Newton errors. Disc: positive. Square: negative. Area: size. Upper half: "
            f"100 r where |r| is at least {WRITTEN:g}. Parameters on a bound are left out.",
            words.correlated(fit),
        ],
        [Panel("correlations", partial(figures.correlations, fit), (4.3, 4.3))],
        python="fit.plot.correlations()",
    )
    return [drawn, near]


def _model(fit: FitRecord) -> list[Figure]:
    drawn = [_frf(part) for part in fit.parts]
    if len(drawn) > 1:
        drawn = [of_part(f, k, label, "fit") for k, (f, label) in enumerate(zip(drawn, fit.labels, strict=True))]
    return [*drawn, *_sway(fit)]


def _frf(fit: FitRecord) -> Figure:
    shown = responses.angles(fit)
    return Figure(
        "frf",
        "",
        "Frequency responses",
        [
            "How much the body sways (gain), and how late (phase), at each frequency of the stimulus. Circles: "
            "measured, neighbouring lines averaged, with a 95 % noise band. Line: the fit; around it the range of all "
            "bodies that fit as well.",
        ],
        [
            panel
            for k in shown
            for panel in (
                Panel(f"gain of θ{k + 1}", partial(responses.response_gain, fit, k)),
                Panel(f"phase of θ{k + 1}", partial(responses.response_phase, fit, k)),
            )
        ],
        python="fit.plot.response_gain(angle=0)",
    )


def _sway(fit: FitRecord) -> list[Figure]:
    if fit.sway is None:
        return []
    header = ("sway (° RMS)", "predicted", "range over the intervals", "measured")
    rows = []
    for a in fit.sway.angles:
        low, high = number(a.stimulus_low), number(a.stimulus_high)
        rows.append((f"{a.angle}, stimulus", number(a.stimulus), f"{low} to {high}", number(a.measured)))
        if a.noise is not None:
            low, high = number(a.noise_low), number(a.noise_high)
            rows.append((f"{a.angle}, noise", number(a.noise), f"{low} to {high}", number(a.noise_measured)))
    sway = Figure(
        "sway",
        "",
        "Predicted sway",
        [
            "Sway at the frequencies of the fit. Stimulus: predicted from the stimulus alone, measured as the mean "
            "response less its noise. Noise: predicted for sensor noise of the shape that Goodworth & Peterka (2018) "
            "assume, its two levels fitted to the measured noise. The fit does not use this noise: it tests the body.",
        ],
        [Panel("sway", partial(figures.sway, fit), (4.3, 2.9))],
        [Table("Predicted and measured sway", header, rows, "rows")],
        python="fit.plot.sway()",
    )
    return [sway]


def _information(fit: FitRecord) -> Figure:
    t = help_needed(fit)
    return Figure(
        "information",
        "",
        "Where the information is, and what would narrow the intervals",
        ["Share of the information on each quantity by band of frequencies.", *([] if t is None else [t.note])],
        [Panel("information", partial(figures.information, fit), WIDE)],
        [] if t is None else [_page_table(t)],
        python="fit.plot.information()",
    )


def _waterfall(fit: FitRecord) -> Figure:
    return Figure(
        "waterfall",
        "",
        "Minima",
        [
            "Squared residuals at which the random starts ended. A step is a minimum. Minima below the dotted line fit "
            "as well as the lowest one, and the intervals cover those in which the closed loop is stable.",
            words.search_words(fit),
        ],
        [Panel("starts", partial(figures.waterfall, fit))],
        python="fit.plot.waterfall()",
    )


def _open(fit: FitRecord) -> list[str]:
    return [words.undetermined(fit), *words.valleys(fit), *([h] if (h := words.help_words(fit)) else [])]


def _belief(fit: FitRecord) -> list[str]:
    parts = [
        words.belief(fit),
        words.by_recording(fit),
        words.added(fit),
        words.loop(fit),
        words.sway(fit),
        *fit.warnings,
    ]
    return [part for part in parts if part]


def _listed(sentences: Sequence[str]) -> str:
    return "".join(f"<p>{escape(s)}</p>" for s in sentences)


def _shown(items: Sequence[Figure], command: str) -> str:
    return "".join(figure(f, "", command) for f in items)


def _provenance(fit: FitRecord, command: str) -> str:
    rows = recording_rows(fit.name, fit.recording)
    rows += [[k, ", ".join(v) if isinstance(v, list) else str(v)] for k, v in fit.method.to_dict().items() if v != []]
    rows += [[f"bounds of {p.name}", f"{number(p.lower)} to {number(p.upper)} {p.unit}"] for p in fit.model.parameters]
    printed = command.split(" --html ")[0] + " --json"
    commands = "\n".join(
        [
            f"{command}    # this page",
            f"{printed}    # every number of it",
            "python    # any figure of it",
            ">>> import mcstudy as mc",
            '>>> fit = mc.fit("REC")',
        ]
    )
    return f"<pre><code>{escape(commands)}</code></pre>" + table(
        Table("This recording and fit", ["", ""], rows), "facts"
    )
