"""Figures of a diagnosis with their captions."""

from __future__ import annotations

from functools import partial

from mcstudy.gap.diagnosis import Diagnosis
from mcstudy.report.context import short
from mcstudy.report.diagnosis import figures, outcome_figures
from mcstudy.report.diagnosis.data import BANDS_PER_DECADE, GapData
from mcstudy.report.diagnosis.traces import SwayTraces
from mcstudy.report.figure import Figure, Missing, Panel
from mcstudy.report.html import Table

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
    header = ["angle, centre of band", "measured / base", "SD", "with the cause / base"]
    return [
        Figure(
            "frf",
            "",
            "Frequency responses",
            [
                f"Responses of the angles to the stimulus. Neighbouring lines are averaged in {BANDS_PER_DECADE} bands "
                "per decade for display only; every statistic uses the lines. Circles: measured, with a 95 % band.",
                "Dashed: the base model. Solid: the model with the leading cause.",
            ],
            [
                panel
                for k, n in angles
                for panel in (
                    Panel(f"gain of {n}", partial(figures.response_gain, data, k)),
                    Panel(f"phase of {n}", partial(figures.response_phase, data, k)),
                )
            ],
            python="diagnosis.plot.response_gain(angle=0)",
        ),
        Figure(
            "misfit",
            "",
            "Difference from the base model",
            [
                "Measured response relative to the base model. Where the band excludes the dashed line, the base model "
                "fails. Solid: how much of that the leading cause explains."
            ],
            [
                panel
                for k, n in angles
                for panel in (
                    Panel(f"gain of {n}", partial(figures.misfit_gain, data, k)),
                    Panel(f"phase of {n}", partial(figures.misfit_phase, data, k)),
                )
            ],
            [Table("Measured over modelled gain", header, rows)],
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
        "",
        "Where: standardised residuals",
        [
            "z = residual divided by its standard error after the fit; its RMS is about 1 if the model is right. The "
            f"map shows the RMS of z. Cross: |z| above {d.z_limit:.2f}, exceeded somewhere in 5 % of recordings "
            "without a gap.",
            "A gap may be certain although no single line stands out, because the test combines all lines, weighted by "
            "the residuals that the effects of the library would leave.",
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
            )
        ],
        python="diagnosis.plot.residual_map()",
    )


def which_figures(d: Diagnosis) -> list[Figure | Missing]:
    """Location, cause, share of the gap closed, error of predicted sway."""
    out: list[Figure | Missing] = [
        Figure(
            "causes",
            "",
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
    ]
    closed, has_sway = d.closed, d.sway_rms_deg["before"] is not None
    panels = []
    if closed is not None:
        panels.append(Panel("share of the gap closed", partial(outcome_figures.closed_bar, d), FLAT))
    if has_sway:
        panels.append(Panel("error of predicted sway", partial(outcome_figures.sway_error_bars, d), FLAT))
    if not panels:
        return [*out, Missing("", "Gap closed", "no gap was detected, and the recording has no time series")]
    rows = (
        []
        if closed is None
        else [
            ["share closed", f"{closed.fraction:.3f}", f"{closed.low:.3f} to {closed.high:.3f}"],
            ["energy of the gap, base model, noise subtracted", short(closed.before), ""],
            ["energy of the gap, with the cause", short(closed.after), ""],
            ["trials needed to know the share to ±15 percentage points (in all)", str(closed.trials_needed), ""],
        ]
    )
    rows += [[f"sway error {k} (° RMS)", "-" if v is None else f"{v:.4g}", ""] for k, v in d.sway_rms_deg.items()]
    text = (
        "First: share of the misfit (noise subtracted) that the leading cause removes. The 95 % interval includes the "
        "chance that the cause is another one. Second: error of the predicted sway, and the mean it would have if only "
        "noise were left. One recording scatters around that mean, and low frequencies, where sway is largest, "
        "dominate."
    )
    none = "Nothing was added, since no gap was detected. Error of the predicted sway, and its noise floor."
    numbers = [Table("Gap closed", ["", "estimate", "95 % interval"], rows)]
    title = "How far the gap shrinks"
    return [
        *out,
        Figure("closed", "", title, [none if closed is None else text], panels, numbers, python=_CLOSED),
    ]


_CLOSED = "diagnosis.plot.gap_closed()"


def time_figure(data: GapData, traces: SwayTraces) -> Figure:
    """Measured and predicted sway in time."""
    angles = list(enumerate(data.angles))
    return Figure(
        "traces",
        "",
        "Sway in time",
        [
            f"Measured sway ({traces.what}, peak of the stimulus {traces.amplitude:.3g} {data.model.stimulus_unit}, "
            f"between {data.lines.f[0]:.2g} and {data.lines.f[-1]:.2g} Hz) and what the models predict from the "
            "stimulus alone.",
            "Below: measured minus predicted sway. The grey band covers 95 % of the noise of the mean cycle."
            if traces.error[0] == traces.error[0]
            else "Below: measured minus predicted sway. It includes the noise, because nothing is averaged here.",
        ],
        [
            *(Panel(f"sway {n}", partial(outcome_figures.sway_trace, traces, k), WIDE) for k, n in angles),
            *(Panel(f"residual sway {n}", partial(outcome_figures.sway_left, traces, k), WIDE) for k, n in angles),
        ],
        python="diagnosis.plot.sway(angle=0)",
    )
