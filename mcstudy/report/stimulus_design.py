"""A designed stimulus as a picture: spectra before and after, and the errors of every parameter side by side."""

from __future__ import annotations

import html

import numpy as np

from mcstudy.report.style import COLOURS
from mcstudy.report.svg_document import svg_document
from mcstudy.stimulus_design.design_record import StimulusDesignRecord

WIDTH, HEIGHT, LEFT, TOP, GAP = 360.0, 250.0, 52.0, 52.0, 72.0
BEFORE, AFTER, AXIS = (COLOURS[name] for name in ("muted", "orange", "muted"))


def stimulus_design_svg(design: StimulusDesignRecord) -> str:
    """Two panels as an SVG document: power of the lines, and coefficients of variation with sequence and design.

    The coefficients of variation are those of the bounded fits where the design was verified, else the predicted ones.
    """
    size = (LEFT + 2 * WIDTH + GAP + 20, TOP + HEIGHT + 52)
    caption = f"{design.designed.file.design.name}. Grey: sequence. Orange: design."
    body = [*_spectra(design, LEFT, TOP), *_errors(design, LEFT + WIDTH + GAP, TOP)]
    return svg_document("A designed stimulus", caption, size, LEFT, body)


def _spectra(design: StimulusDesignRecord, x: float, y: float) -> list[str]:
    """RMS of every odd line over frequency, both on logarithmic axes."""
    d = design.designed
    f, lines = d.f, [np.sqrt(2 * power) for power in (d.before, d.after)]
    level = np.concatenate([v[v > 0] for v in lines])
    low, high = np.floor(np.log10(level.min())), np.ceil(np.log10(level.max()))
    first, last = np.log10(f[0]) - 0.05, np.log10(f[-1]) + 0.05

    def across(hz: float) -> float:
        return x + (np.log10(hz) - first) / (last - first) * WIDTH

    def up(value: float) -> float:
        return y + HEIGHT - (np.log10(value) - low) / (high - low) * HEIGHT

    out = _frame(x, y, "RMS of a line", d.model.stimulus_unit)
    for power in range(int(low), int(high) + 1):
        out += _tick(x, up(10.0**power), f"1e{power}")
    for hz in (0.03, 0.1, 0.3, 1.0, 3.0, 10.0):
        if f[0] <= hz <= f[-1]:
            out.append(f'<text x="{across(hz):.1f}" y="{y + HEIGHT + 14:g}" text-anchor="middle">{hz:g}</text>')
    out.append(f'<text x="{x + WIDTH / 2:g}" y="{y + HEIGHT + 30:g}" text-anchor="middle">frequency (Hz)</text>')
    for values, colour, radius in ((lines[1], AFTER, 2.2), (lines[0], BEFORE, 1.4)):
        out += [
            f'<circle cx="{across(hz):.1f}" cy="{up(v):.1f}" r="{radius}" fill="{colour}"/>'
            for hz, v in zip(f, values, strict=True)
            if v > 0
        ]
    return out


def _errors(design: StimulusDesignRecord, x: float, y: float) -> list[str]:
    """Coefficients of variation by parameter as pairs of bars, on a logarithmic axis."""
    found = bool(design.spreads)
    cv = 100 * (design.spreads_at_fmax.cv if found else design.cv)
    low, high = np.floor(np.log10(cv.min())), np.ceil(np.log10(cv.max()))
    what = f"CV of bounded fits, Fmax {design.spreads_at_fmax.fmax:g} Hz" if found else "predicted CV, no bounds"
    out = _frame(x, y, what, "%")
    step = WIDTH / len(design.names)
    for power in range(int(low), int(high) + 1):
        out += _tick(x, y + HEIGHT - (power - low) / (high - low) * HEIGHT, f"{10.0**power:g}")
    for k, name in enumerate(design.names):
        for j, colour in enumerate((BEFORE, AFTER)):
            tall = (np.log10(cv[j, k]) - low) / (high - low) * HEIGHT
            left = x + (k + 0.12 + 0.38 * j) * step
            out.append(
                f'<rect x="{left:.1f}" y="{y + HEIGHT - tall:.1f}" width="{0.36 * step:.1f}" height="{tall:.1f}" '
                f'fill="{colour}"><title>{html.escape(name)}: {cv[j, k]:.3g} %</title></rect>'
            )
        middle = x + (k + 0.5) * step
        out.append(
            f'<text x="{middle:.1f}" y="{y + HEIGHT + 12:g}" text-anchor="end" '
            f'transform="rotate(-40 {middle:.1f} {y + HEIGHT + 12:g})">{html.escape(name)}</text>'
        )
    return out


def _frame(x: float, y: float, title: str, unit: str) -> list[str]:
    return [
        f'<text x="{x:g}" y="{y - 10:g}">{html.escape(title)} ({html.escape(unit)})</text>',
        f'<path d="M{x:g} {y:g}V{y + HEIGHT:g}H{x + WIDTH:g}" fill="none" stroke="{AXIS}"/>',
    ]


def _tick(x: float, y: float, label: str) -> list[str]:
    return [
        f'<path d="M{x - 4:g} {y:.1f}H{x:g}" stroke="{AXIS}"/>',
        f'<text x="{x - 6:g}" y="{y + 3:.1f}" text-anchor="end">{label}</text>',
    ]
