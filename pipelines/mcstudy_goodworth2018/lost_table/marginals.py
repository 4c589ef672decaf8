"""The marginals of an inference of the lost table: what was known before, and what the printed numbers add."""

from __future__ import annotations

import html
import math

import numpy as np
import xarray as xr

from mcstudy.report.style import COLOURS
from mcstudy.report.svg_document import svg_document
from mcstudy_goodworth2018.lost_table.unknowns import UNKNOWNS, Unknown

COLUMNS, WIDTH, HEIGHT, GAP = 4, 190.0, 96.0, 34.0
BINS = 16
TOP = 34.0
PRIOR, POSTERIOR, MARK, AXIS = (COLOURS[name] for name in ("grid", "blue", "orange", "muted"))


def marginals_svg(result: xr.Dataset) -> str:
    """One panel per unknown as an SVG document: prior flat and grey, posterior as bars, best and stand-in as lines."""
    rows = math.ceil(len(UNKNOWNS) / COLUMNS)
    width, height = COLUMNS * (WIDTH + 20) + 20, TOP + rows * (HEIGHT + GAP) + 6
    status = str(result.attrs["status"])
    caption = f"Bars: posterior. Grey: prior. Solid line: best configuration. Dashed: stand-in. {status.capitalize()}."
    body: list[str] = []
    for k, unknown in enumerate(UNKNOWNS):
        x, y = 20 + (k % COLUMNS) * (WIDTH + 20), TOP + (k // COLUMNS) * (HEIGHT + GAP)
        body += _panel(unknown, result.sel(unknown=unknown.name), x, y)
    return svg_document(f"Posterior of the lost true values: {status}", caption, (width, height), 20, body)


def _panel(unknown: Unknown, one: xr.Dataset, x: float, y: float) -> list[str]:
    """Elements of one panel with its upper left corner at (x, y)."""
    values = one["posterior"].values
    if unknown.choices:
        bins = len(unknown.choices)
        share = np.bincount(values.astype(int), minlength=bins) / values.size
        ends, marks = unknown.choices, [(float(one[n]) + 0.5) / bins for n in ("best", "stand_in")]
    else:
        bins = BINS
        low, high = unknown.low, unknown.high

        def at(v: np.ndarray) -> np.ndarray:
            return np.asarray(np.log(v / low) / np.log(high / low))

        share = np.histogram(np.clip(at(values), 0, 1), bins=bins, range=(0, 1))[0] / values.size
        ends = (f"{low:g}", f"{high:g}")
        marks = [float(at(np.asarray(float(one[n])))) for n in ("best", "stand_in")]
    scale = HEIGHT / max(float(share.max()), 1.0 / bins)
    flat = scale / bins
    unit = f" ({unknown.unit})" if unknown.unit not in ("", "1") else ""
    out = [
        f'<text x="{x:g}" y="{y - 3:g}">{html.escape(unknown.name + unit)}</text>',
        f'<rect x="{x:g}" y="{y + HEIGHT - flat:.1f}" width="{WIDTH:g}" height="{flat:.1f}" fill="{PRIOR}"/>',
    ]
    step = WIDTH / bins
    for i, s in enumerate(share):
        if s > 0:
            out.append(
                f'<rect x="{x + i * step + 1:.1f}" y="{y + HEIGHT - s * scale:.1f}" width="{step - 2:.1f}" '
                f'height="{s * scale:.1f}" fill="{POSTERIOR}" fill-opacity="0.75"/>'
            )
    for place, dash in zip(marks, ("", ' stroke-dasharray="4 3"'), strict=True):
        at_x = x + np.clip(place, 0, 1) * WIDTH
        out.append(
            f'<line x1="{at_x:.1f}" x2="{at_x:.1f}" y1="{y:g}" y2="{y + HEIGHT:g}" '
            f'stroke="{MARK}" stroke-width="1.4"{dash}/>'
        )
    out.append(f'<line x1="{x:g}" x2="{x + WIDTH:g}" y1="{y + HEIGHT:g}" y2="{y + HEIGHT:g}" stroke="{AXIS}"/>')
    if unknown.choices:
        out += [
            f'<text x="{x + (i + 0.5) * step:.1f}" y="{y + HEIGHT + 12:g}" text-anchor="middle">{html.escape(c)}</text>'
            for i, c in enumerate(ends)
        ]
    else:
        out += [
            f'<text x="{x:g}" y="{y + HEIGHT + 12:g}">{ends[0]}</text>',
            f'<text x="{x + WIDTH:g}" y="{y + HEIGHT + 12:g}" text-anchor="end">{ends[1]}</text>',
        ]
    return out
