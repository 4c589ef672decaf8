"""Figures of a diagnosis with their words."""

from __future__ import annotations

from mcstudy.gap.diagnosis import Diagnosis
from mcstudy.report.context import short
from mcstudy.report.figure import Figure, Missing, Panel
from mcstudy.report.figures import gap, gap_outcome
from mcstudy.report.gap_data import BANDS_A_DECADE, GapData
from mcstudy.report.html import Table
from mcstudy.report.sway_traces import SwayTraces

WIDE, FLAT = (4.3, 2.8), (4.3, 1.9)


def response_figures(data: GapData) -> list[Figure]:
    """Measured and modelled FRFs, and the same relative to the model before."""
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
                f"Responses of the angles to the stimulus. Neighbouring lines are averaged in {BANDS_A_DECADE} bands "
                "per decade for display only; every statistic uses the lines. Circles: measured, with a 95 % band.",
                "Dashed: the base model. Solid: the model with the leading cause.",
            ],
            [
                panel
                for k, n in angles
                for panel in (
                    Panel(f"gain of {n}", lambda ax, k=k: gap.response_gain(data, k, ax)),  # type: ignore[misc]
                    Panel(f"phase of {n}", lambda ax, k=k: gap.response_phase(data, k, ax)),  # type: ignore[misc]
                )
            ],
            python="gap.response_gain(data, angle=0)",
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
                    Panel(f"gain of {n}", lambda ax, k=k: gap.misfit_gain(data, k, ax)),  # type: ignore[misc]
                    Panel(f"phase of {n}", lambda ax, k=k: gap.misfit_phase(data, k, ax)),  # type: ignore[misc]
                )
            ],
            [Table("Measured over modelled gain", header, rows)],
            python="gap.misfit_gain(data, angle=0)",
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
            "A gap may be certain although no single line stands out: the test weighs all lines by what the effects of "
            "the library would leave.",
        ],
        [
            Panel("channel by frequency", lambda ax: gap.z_map(data, ax), (4.3, 2.9)),
            *(
                Panel(f"lines of {n}", lambda ax, k=k: gap.z_lines(data, k, ax), (4.3, 2.9))  # type: ignore[misc]
                for k, n in enumerate(data.angles)
            ),
        ],
        [
            Table(
                "Mean |z|² of the base model by band, with its family-wise 95 % limit",
                ["band", "level", "limit", ""],
                rows,
            )
        ],
        python="gap.z_map(data)",
    )


def which_figures(d: Diagnosis) -> list[Figure | Missing]:
    """Place, cause, share closed, error of sway."""
    out: list[Figure | Missing] = [
        Figure(
            "causes",
            "",
            "Location and cause",
            [
                "Probabilities given this recording. Effects that it cannot tell apart are one bar, named after the "
                "most probable one. “Outside the library” is a cause that no effect of the library describes; “no "
                "location” is what cannot be located.",
                ""
                if d.detected
                else "No gap was detected at the 5 % level: these are what the priors and this recording leave open.",
            ],
            [
                Panel("location", lambda ax: gap_outcome.place_bars(d, ax)),
                Panel("cause", lambda ax: gap_outcome.cause_bars(d, ax), (4.3, 4.4)),
            ],
            python="gap_outcome.cause_bars(diagnosis)",
        )
    ]
    closed, held = d.closed, d.sway_rms_deg["before"] is not None
    panels = []
    if closed is not None:
        panels.append(Panel("share of the gap closed", lambda ax: gap_outcome.closed_bar(d, ax), FLAT))
    if held:
        panels.append(Panel("error of predicted sway", lambda ax: gap_outcome.sway_error_bars(d, ax), FLAT))
    if not panels:
        return [*out, Missing("", "Gap closed", "no gap was detected, and the recording has no time series")]
    rows = (
        []
        if closed is None
        else [
            ["share closed", f"{closed.fraction:.3f}", f"{closed.low:.3f} to {closed.high:.3f}"],
            ["energy of the gap before, noise taken out", short(closed.before), ""],
            ["energy after", short(closed.after), ""],
            ["trials to know the share to ±15 %", str(closed.trials_needed), ""],
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


_CLOSED = "gap_outcome.closed_bar(diagnosis)"


def time_figure(data: GapData, traces: SwayTraces) -> Figure:
    """Sway before and after."""
    angles = list(enumerate(data.angles))
    return Figure(
        "traces",
        "",
        "Sway in time",
        [
            f"Measured sway ({traces.what}, peak of the stimulus {traces.amplitude:.3g} {data.model.stimulus_unit}, "
            f"between {data.lines.f[0]:.2g} and {data.lines.f[-1]:.2g} Hz) and what the models predict from the "
            "stimulus alone.",
            "Then what they leave. The grey band is 95 % of the noise of the mean cycle."
            if traces.error[0] == traces.error[0]
            else "Then what they leave, noise included, since nothing is averaged here.",
        ],
        [
            *(
                Panel(f"sway {n}", lambda ax, k=k: gap_outcome.sway_trace(traces, k, ax), WIDE)  # type: ignore[misc]
                for k, n in angles
            ),
            *(
                Panel(f"left over {n}", lambda ax, k=k: gap_outcome.sway_left(traces, k, ax), WIDE)  # type: ignore[misc]
                for k, n in angles
            ),
        ],
        python="gap_outcome.sway_trace(SwayTraces.of(data), angle=0)",
    )
