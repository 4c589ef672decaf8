"""Figures of a diagnosis with their captions."""

from __future__ import annotations

from functools import partial

from mcstudy.gap import tables
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.verdict import motion, not_a_body, share_closed, shown_causes, sway
from mcstudy.report.diagnosis import figures, outcome_figures
from mcstudy.report.diagnosis.data import BANDS_PER_DECADE, GapData
from mcstudy.report.diagnosis.traces import SwayTraces
from mcstudy.report.figure import Figure, Missing, Panel, by_angle
from mcstudy.report.labels import with_units
from mcstudy.report.numbers import short
from mcstudy.stance.body import standing
from mcstudy.text_tables import Table

NARROW = 3
"""Most columns of a table that a telephone shows as one."""

WIDE, FLAT = (4.3, 2.8), (4.3, 1.9)


def response_figures(data: GapData) -> list[Figure]:
    """Measured and modelled FRFs, and the same relative to the base model."""
    angles = list(enumerate(data.angles))
    a = data.averages
    rows = [
        [
            f"{n}, {a.f[b]:.3g} Hz",
            *(short(x) for x in (abs(a.ratio[b, k]), a.sd[b, k] / 2**0.5, abs(a.after[b, k]))),
        ]
        for k, n in angles
        for b in range(a.f.size)
    ]
    header = ["angle, centre of band", "measured / base", "SD", f"{data.added_name} / base"]
    added = "" if data.added is None else f" Solid: the model {data.added_name}."
    how = "much the body sways" if standing(data.model) else "large the response is"
    return [
        Figure(
            "frf",
            "Frequency responses",
            [
                f"How {how} (gain), and how late (phase), at each frequency of the stimulus. Circles: "
                f"measured, with a 95 % band. Dashed: the base model.{added}",
                f"Neighbouring lines are averaged in {BANDS_PER_DECADE} bands per decade for display only; every "
                "statistic uses the lines. Phases of all curves of a panel are counted through full turns alike.",
            ],
            by_angle(data, angles, gain=figures.response_gain, phase=figures.response_phase),
            python="diagnosis.plot.response_gain(angle=0)",
        ),
        Figure(
            "misfit",
            "Difference from the base model",
            [
                "Measured response relative to the base model. Where the band excludes the dashed line, the base model "
                f"fails.{added and f'{added} Where it follows the circles, it explains the difference.'}",
                *(t for t in (not_a_body(data.diagnosis),) if t),
            ],
            by_angle(data, angles, gain=figures.misfit_gain, phase=figures.misfit_phase),
            [Table("Measured over modelled gain", header, rows, kind="rows")],
            python="diagnosis.plot.misfit_gain(angle=0)",
        ),
    ]


def z_figure(data: GapData) -> Figure:
    """The map of standardised residuals."""
    d = data.diagnosis.detection
    rows = [
        [
            f"{b.angle.replace('theta', 'θ')}, {b.low_hz:.3g} to {b.high_hz:.3g} Hz",
            short(b.level),
            short(b.limit),
            "beyond" if b.beyond else "within",
        ]
        for b in d.bands
    ]
    return Figure(
        "zmap",
        "Where: standardised residuals",
        [
            "z = residual divided by its standard error after the fit; its RMS is about 1 if the model is right. The "
            f"map shows the RMS of z. Dashed: limit of |z|, {d.z_limit:.2f}, exceeded somewhere in 5 % of recordings "
            "without a gap; a cross on the map marks a line beyond it.",
            "A gap may be certain although no single line stands out, because the test of a gap combines all lines, "
            "weighted by the residuals that the effects of the library would leave (first figure).",
        ],
        [
            Panel("channel by frequency", partial(figures.z_map, data), (4.3, 2.9)),
            *(Panel(f"lines of {n}", partial(figures.z_lines, data, k), (4.3, 2.9)) for k, n in enumerate(data.angles)),
        ],
        [
            Table(
                "Mean |z|² of the base model by band, with its family-wise 95 % limit",
                ["band", "level", "limit", ""],
                rows,
                kind="rows",
            )
        ],
        python="diagnosis.plot.residual_map()",
    )


def page_table(t: Table) -> Table:
    """A table of the diagnosis as a page shows it."""
    return t._replace(kind="rows" if len(t.header) <= NARROW else "wide")


def evidence_figure(d: DiagnosisRecord) -> Figure:
    """What the decision that there is a gap, or none, rests on."""
    numbers = tables.evidence(d)
    panels = [
        Panel("test for deviations of known shape", partial(outcome_figures.null_statistic, d)),
        Panel("residual of all lines", partial(outcome_figures.null_residual, d)),
    ]
    text = [
        "Bars: what recordings without a gap would give, simulated with the noise of this one. Thick line: this "
        "recording. The further it lies to the right of the bars, the stronger the evidence. First: the test for "
        "deviations of known shape. Second: the residual of all lines (goodness of fit).",
    ]
    if d.leading is not None and any(c.sizes for c in shown_causes(d)):
        panels.append(Panel("sizes of the causes", partial(outcome_figures.effect_sizes, d)))
        text[0] += (
            " Third: sizes of the leading cause and of those in the 95 % set, with 95 % intervals, in standard errors "
            "from zero."
        )
    title = "Evidence for a gap"
    return Figure("evidence", title, text, panels, [page_table(numbers)], "diagnosis.plot.evidence()")


def which_figures(d: DiagnosisRecord) -> list[Figure | Missing]:
    """Location, cause, share of the gap closed, error of predicted sway."""
    causes = Figure(
        "causes",
        "Location and cause",
        [
            "Probabilities given this recording. Effects that it cannot distinguish are one bar, named after the "
            "most probable one. “Outside the library” is a cause that no effect of the library describes; “no "
            "single location” is the probability that cannot be assigned to one location.",
            ""
            if d.detected
            else "No gap was detected at the 5 % level; these are the posterior probabilities nevertheless.",
        ],
        [
            Panel("location", partial(outcome_figures.place_bars, d)),
            Panel("cause", partial(outcome_figures.cause_bars, d), (4.3, 4.4)),
        ],
        python="diagnosis.plot.causes()",
    )
    return [causes, _closing_figure(d)]


def _closing_figure(d: DiagnosisRecord) -> Figure | Missing:
    """The share of the gap closed beside the error of predicted sway."""
    title, numbers, panels, text, call = "How much of the mismatch is explained", tables.closing(d), [], [], ""
    if d.closed is not None:
        panels.append(Panel("share of the gap closed", partial(outcome_figures.closed_bar, d), FLAT))
        text.append(
            "First: share of the misfit (noise subtracted) that the leading cause removes. The 95 % interval includes "
            "the chance that the cause is another one."
        )
        call = "diagnosis.plot.gap_closed()"
    if d.sway_noise_deg is not None:
        panels.append(Panel(f"error of predicted {motion(d)}", partial(outcome_figures.sway_error_bars, d), FLAT))
        text.append(
            f"Error of the {motion(d)} that each model predicts from the stimulus. Grey: the range that noise alone "
            f"gives in 95 % of recordings. {sway(d)}".rstrip()
        )
        call = call or "diagnosis.plot.sway_error()"
    if not panels:
        return Missing(title, "no cause was added to the model, and the recording has no time series", "closed")
    if not numbers.note:
        text.append(share_closed(d) or "No gap was detected, so no effect was added to the model.")
    return Figure("closed", title, text, panels, [page_table(numbers)], python=call)


def time_figure(data: GapData, traces: SwayTraces) -> Figure:
    """Measured and predicted sway in time."""
    angles, what = list(enumerate(data.angles)), motion(data.diagnosis)
    return Figure(
        "traces",
        f"{what.capitalize()} in time",
        [
            f"Measured {what} ({traces.what}, peak of the stimulus {traces.amplitude:.3g} "
            f"{with_units(data.model.stimulus_unit)}, {data.lines.f[0]:.2g} to {data.lines.f[-1]:.2g} Hz) "
            "and what the models predict from the stimulus alone.",
            f"Last panels: measured minus predicted {what}. The grey band covers 95 % of the noise of the mean cycle."
            if traces.error[0] == traces.error[0]
            else f"Last panels: measured minus predicted {what}. It includes the noise, because nothing is averaged.",
        ],
        [
            *(Panel(f"{what} {n}", partial(outcome_figures.sway_trace, traces, k), WIDE) for k, n in angles),
            *(Panel(f"residual {what} {n}", partial(outcome_figures.sway_left, traces, k), WIDE) for k, n in angles),
        ],
        python="diagnosis.plot.sway(angle=0)",
    )
