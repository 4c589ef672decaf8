"""A fit as a page: what came out, estimates, profiles, whether to believe the model, what would help."""

from __future__ import annotations

from functools import partial

from markupsafe import Markup

from mcstudy.identification import averaged_words, words
from mcstudy.identification.estimate import Estimate, interval
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.tables import estimates, help_needed, relative
from mcstudy.report.document import document
from mcstudy.report.figure import Figure, Panel, by_angle, figures, of_part
from mcstudy.report.figures.pairs import WRITTEN
from mcstudy.report.html import code, html, paragraphs, table, tiles
from mcstudy.report.origin import recording_rows
from mcstudy.report.person import figures as drawings
from mcstudy.report.person import responses
from mcstudy.text_tables import Table, number, p_words

SMALL, WIDE = (3.4, 2.6), (6.4, 4.6)

TILES = 4
"""Quantities on the first screen: those that the data determine best."""


def fit_page(fit: FitRecord, command: str = "mcstudy fit REC --html page.html") -> str:
    """The page of a fit; ``command``: the command that makes this page, as displayed on it."""
    parts = [
        *_averaged(fit),
        (
            "estimates",
            "Estimates and intervals",
            table(estimates(fit), "wide") + figures([_intervals(fit), *_coverage(fit)], command),
        ),
        ("profiles", "What the data determine", paragraphs(_open(fit)) + figures(_profiles(fit), command)),
        ("model", "Model adequacy", paragraphs(_belief(fit)) + figures(_model(fit), command)),
        ("help", "What would help", figures([_information(fit)], command)),
        ("search", "How the estimate was found", figures([_waterfall(fit)], command)),
        ("made", "Provenance", _provenance(fit, command)),
    ]
    return document(
        f"Parameters of {fit.name}",
        _introduction(fit),
        parts,
        f"Intervals are profile likelihood intervals of {100 * fit.level:g} %; no prior is used. How often such "
        "intervals contain the true value in simulations: mcstudy/identification/README.md.",
    )


def _averaged(fit: FitRecord) -> list[tuple[str, str, Markup]]:
    """What the model may lack, and the parameters averaged over it; nothing without an average."""
    if fit.averaged is None:
        return []
    content = paragraphs([averaged_words.finding(fit.averaged)]) + table(averaged_words.table(fit.averaged, fit.level))
    return [("averaged", "Averaged over causes", content)]


def _introduction(fit: FitRecord) -> Markup:
    kinds = [e.verdict for e in fit.estimates]
    determined = kinds.count("identifiable")
    question = (
        f"Asked: which values of the {len(fit.model.names)} parameters of the {fit.model.name.replace('_', ' ')} model "
        f"agree with {_what(fit)} at {len(fit.lines)} lines from "
        f"{fit.lines.f.min():.2g} to {fit.lines.f.max():.2g} Hz"
    )
    added = fit.method.effects
    question += f", with {' and '.join(added)} added to it?" if added else "?"
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
                f"{number(e.estimate)} {e.unit}",
                f"{interval(e)} ({relative(e, (e.high - e.low) / 2)}).",
                "intervals",
            )
            for e in _best(fit)
        ),
        (
            "Goodness of fit",
            p_words(fit.p_value),
            f"squared residual {fit.chi2:.0f}, expected {fit.expected_chi2:.0f}.",
            "model",
        ),
    ]
    if fit.gap is not None:
        answer = "a gap beyond noise" if words.gap_found(fit) else "no gap beyond noise"
        entries.append(("Test for a gap", answer, f"{words.gap_p(fit)}.", "model"))
    if fit.stability is not None:
        state = "over all intervals" if fit.stability.stable else "not over all intervals"
        root = f"{words.rightmost_root(fit)}; stable {state}."
        entries.append(("Closed loop", "stable" if fit.growth_rate < 0 else "unstable", root, "model"))
    warning = html('<div class="truth"><p>{}</p></div>', words.belief(fit)) if words.doubtful(fit) else ""
    return paragraphs([question]) + warning + tiles(entries)


def _what(fit: FitRecord) -> str:
    if len(fit.parts) > 1:
        return f"these {len(fit.parts)} recordings together"
    return "these lines" if fit.recording is None else "this recording"


def _best(fit: FitRecord) -> list[Estimate]:
    known = [e for e in fit.estimates if e.verdict == "identifiable" and e.estimate]
    return sorted(known, key=lambda e: (e.high - e.low) / abs(e.estimate))[:TILES]


def _intervals(fit: FitRecord) -> Figure:
    return Figure(
        "intervals",
        "All quantities",
        [
            "Each quantity relative to the value that is typical of a body of this weight. Thick line: the profile "
            "interval; a hollow end is a bound of the fit and says nothing about the person. Dashed: the symmetric "
            "Gauss-Newton interval (Wald), which ignores bounds and other minima. Cross: the estimate under the cost "
            "of Goodworth & Peterka (2018).",
        ],
        [Panel("intervals", partial(drawings.intervals, fit), WIDE)],
        python="fit.plot.intervals()",
    )


def _coverage(fit: FitRecord) -> list[Figure]:
    if fit.coverage is None:
        return []
    drawn = Figure(
        "coverage",
        "Coverage of these intervals in simulation",
        [
            words.coverage(fit),
            "Diamond: all simulated recordings. Line: from the body with the fewest to that with the most. Grey: the "
            "goal. The simulated condition is the nearest one in number of cycles and highest frequency.",
        ],
        [Panel("coverage", partial(drawings.coverage, fit), WIDE)],
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
        "Profiles",
        [
            "How much the squared residual rises above the lowest one when a quantity is held at a value and all other "
            "parameters are fitted again. The interval holds the values below the threshold. Dashed: what the "
            "curvature at the estimate alone would give (Wald). Points above the lower edge belong to higher minima.",
        ],
        [Panel(e.name, partial(drawings.profile, fit, e.name), SMALL) for e in fit.estimates],
        [Table("What moves with it from the lower to the upper end", ("quantity", "moves"), rows, kind="rows")],
        python=f'fit.plot.profile("{fit.estimates[0].name}")',
        legend=[("blue", "profile and interval"), ("muted", "threshold"), ("orange", "Wald"), ("ink", "estimate")],
    )
    near = Figure(
        "correlations",
        "Correlations near the estimate",
        [
            "Correlations of the Gauss-Newton errors. Disc: positive. Square: negative. Area: size. Upper half: "
            f"100 r where |r| is at least {WRITTEN:g}. Parameters on a bound are left out.",
            words.correlated(fit),
        ],
        [Panel("correlations", partial(drawings.correlations, fit), (4.3, 4.3))],
        python="fit.plot.correlations()",
    )
    return [drawn, near]


def _model(fit: FitRecord) -> list[Figure]:
    drawn = [_frf(part) for part in fit.parts]
    if len(drawn) > 1:
        drawn = [of_part(f, k, label, "fit") for k, (f, label) in enumerate(zip(drawn, fit.labels, strict=True))]
    return [*drawn, *_sway(fit)]


def _frf(fit: FitRecord) -> Figure:
    angles = [(k, name.replace("theta", "θ")) for k, name in enumerate(fit.model.output_names)]
    return Figure(
        "frf",
        "Frequency responses",
        [
            "How much the body sways (gain), and how late (phase), at each frequency of the stimulus. Circles: "
            "measured, neighbouring lines averaged, with a 95 % noise band. Line: the fit; around it the range of all "
            "bodies that fit as well.",
        ],
        by_angle(fit, angles, gain=responses.response_gain, phase=responses.response_phase),
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
        "Predicted sway",
        [
            "Sway at the frequencies of the fit. Stimulus: predicted from the stimulus alone, measured as the mean "
            "response less its noise. Noise: predicted for sensor noise of the shape that Goodworth & Peterka (2018) "
            "assume, its two levels fitted to the measured noise. The fit does not use this noise: it tests the body.",
        ],
        [Panel("sway", partial(drawings.sway, fit), (4.3, 2.9))],
        [Table("Predicted and measured sway", header, rows, kind="rows")],
        python="fit.plot.sway()",
    )
    return [sway]


def _information(fit: FitRecord) -> Figure:
    t = help_needed(fit)
    return Figure(
        "information",
        "Where the information is, and what would narrow the intervals",
        ["Share of the information on each quantity by band of frequencies."],
        [Panel("information", partial(drawings.information, fit), WIDE)],
        [] if t is None else [t._replace(kind="wide")],
        python="fit.plot.information()",
    )


def _waterfall(fit: FitRecord) -> Figure:
    return Figure(
        "waterfall",
        "Minima",
        [
            "Squared residuals at which the random starts ended. A step is a minimum. Minima below the dotted line fit "
            "as well as the lowest one, and the intervals cover those in which the closed loop is stable.",
            words.search_words(fit),
        ],
        [Panel("starts", partial(drawings.waterfall, fit))],
        python="fit.plot.waterfall()",
    )


def _open(fit: FitRecord) -> list[str]:
    return [words.undetermined(fit), *words.valleys(fit), words.help_words(fit)]


def _belief(fit: FitRecord) -> list[str]:
    statements = (words.belief, words.by_recording, words.added, words.loop, words.sway)
    return [*(sentence(fit) for sentence in statements), *fit.warnings]


def _provenance(fit: FitRecord, command: str) -> Markup:
    rows = recording_rows(fit.name, fit.recording)
    rows += [[k, ", ".join(v) if isinstance(v, list) else str(v)] for k, v in fit.method.to_dict().items() if v != []]
    rows += [[f"bounds of {p.name}", f"{number(p.lower)} to {number(p.upper)} {p.unit}"] for p in fit.model.parameters]
    made = code(
        f"{command}    # this page",
        f"{command.split(' --html ')[0]} --json    # every number of it",
        "python    # any figure of it",
        ">>> import mcstudy as mc",
        '>>> fit = mc.fit("REC")',
    )
    return made + table(Table("This recording and fit", ["", ""], rows), "facts")
