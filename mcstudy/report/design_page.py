"""A designed stimulus as a page: its spectrum beside that of the sequence, the errors of every parameter, its sizes."""

from __future__ import annotations

from functools import partial

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture

from mcstudy.report.axes import axes, log_axis, picture
from mcstudy.report.document import document
from mcstudy.report.figure import Figure, Panel, figure
from mcstudy.report.html import code, paragraphs, table, tiles
from mcstudy.report.labels import with_units
from mcstudy.report.style import COLOURS, HATCHES
from mcstudy.stimulus_design import words
from mcstudy.stimulus_design.design_record import StimulusDesignRecord, geometric_mean
from mcstudy.text_tables import Table, number, with_error

SEQUENCE, DESIGN = COLOURS["muted"], COLOURS["orange"]
LEGEND = [("muted", "sequence"), ("orange hatched", "design")]


def design_page(design: StimulusDesignRecord, command: str = "mcstudy design FILE -o DIR --html page.html") -> str:
    """The page of a design; ``command``: the command that makes this page, as displayed on it."""
    made = code(f"{command}    # this page; every number of it is in design.json")
    parts = [
        ("stimulus", "The stimulus", _stimulus(design, command)),
        (
            "difference",
            "The difference of the models",
            table(words.distances(design)) if design.distances.size else Markup(""),
        ),
        ("errors", "Errors of the parameters", _errors(design, command)),
        ("bodies", "Other bodies", _bodies(design)),
        ("made", "Provenance", made),
    ]
    footer = "The errors hold for the model, the noise and the range of bodies of the design file."
    return document(f"Stimulus {design.designed.file.design.name}", _introduction(design), parts, footer)


def _introduction(design: StimulusDesignRecord) -> Markup:
    kept = geometric_mean(design.bounded_cv[0] / design.bounded_cv[1])
    sequence, designed = design.sizes
    entries = [("Predicted SD lower by", f"×{kept:.3g}", "geometric mean, with the bounds of the fit.")]
    if design.spreads:
        s = design.spreads_at_fmax
        remark = f"bounded fits up to {s.fmax:g} Hz, {s.n} realizations, ± one MCSE."
        entries.append(("Found SD lower by", f"×{with_error(s.mean, s.mean_error)}", remark))
    entries += [
        ("RMS of the stimulus", f"×{number(designed.rms / sequence.rms)}", "of the sequence's."),
        ("Evoked sway", f"×{number(np.max(designed.sway / sequence.sway))}", "of the sequence's, the larger angle."),
        ("Crest factor", number(designed.crest_factor), f"the sequence has {number(sequence.crest_factor)}."),
    ]
    return paragraphs([words.heading(design)]) + tiles(entries)


def _stimulus(design: StimulusDesignRecord, command: str) -> Markup:
    drawn = Figure(
        "spectrum",
        "Spectrum and waveform",
        ["RMS of every line of the sequence (dots) and of the design (squares), and one cycle of the design."],
        [Panel("spectrum", partial(spectrum, design)), Panel("waveform", partial(waveform, design))],
        python="design.to_html('page.html')",
        legend=[("muted", "sequence"), ("orange", "design")],
    )
    return figure(drawn, command) + table(words.sizes(design), "rows") + paragraphs([words.limits_used(design)])


def _bodies(design: StimulusDesignRecord) -> Markup:
    return paragraphs([words.sway_words(design), words.bodies_words(design) if design.bodies else ""])


def spectrum(design: StimulusDesignRecord, ax: Axes | None = None) -> Axes:
    """RMS of every odd line over frequency, of sequence and design."""
    ax, d = axes(ax), design.designed
    for power, label, color, marker, fill in (
        (d.before, "sequence", SEQUENCE, ".", SEQUENCE),
        (d.after, "design", DESIGN, "s", "none"),  # differs in grey
    ):
        used = power > 0
        (points,) = ax.plot(d.f[used], np.sqrt(2 * power[used]), color=color, label=label, ls="none", markersize=4.0)
        points.set(marker=marker, markerfacecolor=fill)
    ax.set_xlabel("frequency (Hz)")
    ax.set_ylabel(f"RMS of a line ({with_units(d.model.stimulus_unit)})")
    log_axis(ax.xaxis)
    log_axis(ax.yaxis)
    return ax


def waveform(design: StimulusDesignRecord, ax: Axes | None = None) -> Axes:
    """One cycle of the design."""
    ax, (t, u) = axes(ax), design.waveform()
    step = max(1, t.size // 2000)
    ax.plot(t[::step], u[::step], color=DESIGN, linewidth=0.8)
    ax.set_xlabel("time (s)")
    ax.set_ylabel(f"stimulus ({with_units(design.designed.model.stimulus_unit)})")
    return ax


def _errors(design: StimulusDesignRecord, command: str) -> Markup:
    spreads = design.spreads_at_fmax if design.spreads else None
    drawings = [("predicted, with the bounds of the fit", design.bounded_cv)]
    if spreads is not None:
        drawings.append((f"bounded fits up to {spreads.fmax:g} Hz", spreads.cv))
    panels = [Panel(title, partial(cv_bars, design, cv, title=title), (4.3, 5.0), "x") for title, cv in drawings]
    cvs = [*design.bounded_cv, *(spreads.cv if spreads is not None else ())]
    header = ["", "predicted: sequence", "design", "lower by"]
    rows = [
        [name, *words.compared(sequence, other, "×")]
        for name, sequence, other in zip(design.names, *cvs[:2], strict=True)
    ]
    if spreads is not None:
        header += ["fits: sequence", "design", "lower by (± MCSE)"]
        for k, row in enumerate(rows):
            row += [words.percent(cv[k]) for cv in spreads.cv]
            row.append(f"×{with_error(spreads.ratio[k], spreads.ratio_error[k])}")
    drawn = Figure(
        "cv",
        "Coefficients of variation",
        [
            "Standard deviation over the mean, in percent, on a logarithmic axis. The prediction is the Cramér-Rao "
            "bound with what the bounds of the fit add."
        ],
        panels,
        python="design.to_html('page.html')",
        legend=LEGEND,
    )
    return figure(drawn, command) + table(Table("Coefficients of variation", header, rows))


def cv_bars(design: StimulusDesignRecord, cv: np.ndarray, ax: Axes | None = None, title: str = "") -> Axes:
    """Coefficients of variation (2, P) of sequence and design as pairs of bars."""
    ax, at = axes(ax, (4.3, 5.0)), np.arange(len(design.names))
    low = 10 ** np.floor(np.log10(100 * cv.min()))
    for k, (colour, hatch, label) in enumerate(((SEQUENCE, HATCHES[0], "sequence"), (DESIGN, HATCHES[1], "design"))):
        where = at + 0.4 * (k - 0.5)
        ax.barh(where, 100 * cv[k] - low, 0.38, left=low, color=colour, hatch=hatch, edgecolor="white", label=label)
    ax.set_xlim(low, 1.3 * 100 * cv.max())
    ax.set_yticks(at, design.names)
    ax.set_ylim(at.size - 0.4, -0.6)
    ax.set_title(title)
    ax.set_xlabel("CV (%)")
    log_axis(ax.xaxis)
    return ax


def design_picture(design: StimulusDesignRecord) -> Picture:
    """Spectra, and coefficients of variation: of bounded fits where the design was verified, else as predicted."""
    fits = design.spreads_at_fmax if design.spreads else None
    cv, title = (
        (design.cv, "predicted CV, no bounds") if fits is None else (fits.cv, f"CV of fits up to {fits.fmax:g} Hz")
    )
    drawings = [partial(spectrum, design), partial(cv_bars, design, cv, title=title)]
    return picture(drawings, f"{design.designed.file.design.name}. Grey: sequence. Orange: design.")
