"""The trade-offs of an inference of the lost table: how far a missed number is, against how many others are missed."""

from __future__ import annotations

import html
import math

import numpy as np
import xarray as xr

from mcstudy.report.style import COLOURS
from mcstudy.report.svg_document import svg_document
from mcstudy_goodworth2018.lost_table.checks import LIMIT

COLUMNS, WIDTH, HEIGHT, GAP, LEFT, TOP = 3, 220.0, 150.0, 62.0, 36.0, 40.0
DOT, BEST = COLOURS["muted"], COLOURS["orange"]
FURTHEST = 15.0
"""Distances beyond this are drawn at it."""


def trade_offs_svg(result: xr.Dataset) -> str:
    """One panel per missed number as an SVG document: a dot per simulated study, and a line of the best."""
    missed = [str(k) for k in result["missed"].values]
    rows = max(math.ceil(len(missed) / COLUMNS), 1)
    width, height = LEFT + COLUMNS * (WIDTH + LEFT), TOP + rows * (HEIGHT + GAP)
    status = str(result.attrs["status"])
    caption = f"Dots: simulated studies. Line: none is better in both. Dashed: {LIMIT:g} errors. {status.capitalize()}."
    body: list[str] = []
    for k, key in enumerate(missed):
        x, y = LEFT + (k % COLUMNS) * (WIDTH + LEFT), TOP + (k // COLUMNS) * (HEIGHT + GAP)
        body += _panel(result, key, x, y)
    return svg_document(f"Trade-offs between printed numbers: {status}", caption, (width, height), LEFT, body)


def _panel(result: xr.Dataset, key: str, x: float, y: float) -> list[str]:
    """Elements of the panel of one number with its upper left corner at (x, y)."""
    used = result["kind"].values != "told"
    distance = np.abs(result["bank_distance"].values)
    own = distance[:, list(result["row"].values).index(key)]
    others = (distance[:, used] > LIMIT).sum(axis=1) - (own > LIMIT)
    most = max(int(others.max()), 1)

    def place(d: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return x + np.minimum(d, FURTHEST) / FURTHEST * WIDTH, y + HEIGHT - n / most * (HEIGHT - 16)

    left, top = place(own, others)
    curve = result["trade_off_others"].sel(missed=key)
    steps = place(*(curve.sel(of=name).values for name in ("missed", "other")))
    limit = x + LIMIT / FURTHEST * WIDTH
    label = str(result["label"].sel(row=key).values)
    line = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(*steps, strict=True))
    return [
        f'<text x="{x:g}" y="{y:g}">{html.escape(label)}</text>',
        *(
            f'<circle cx="{a:.1f}" cy="{b:.1f}" r="1.8" fill="{DOT}" fill-opacity="0.45"/>'
            for a, b in zip(left, top, strict=True)
        ),
        f'<line x1="{limit:.1f}" x2="{limit:.1f}" y1="{y + 8:g}" y2="{y + HEIGHT:g}" stroke="{DOT}" '
        'stroke-dasharray="4 3"/>',
        f'<polyline points="{line}" fill="none" stroke="{BEST}" stroke-width="1.6"/>',
        f'<line x1="{x:g}" x2="{x + WIDTH:g}" y1="{y + HEIGHT:g}" y2="{y + HEIGHT:g}" stroke="{DOT}"/>',
        f'<line x1="{x:g}" x2="{x:g}" y1="{y + 8:g}" y2="{y + HEIGHT:g}" stroke="{DOT}"/>',
        f'<text x="{x:g}" y="{y + HEIGHT + 12:g}">0</text>',
        f'<text x="{x + WIDTH:g}" y="{y + HEIGHT + 12:g}" text-anchor="end">{FURTHEST:g} or more</text>',
        f'<text x="{x + WIDTH / 2:g}" y="{y + HEIGHT + 12:g}" text-anchor="middle">distance, errors</text>',
        f'<text x="{x - 4:g}" y="{y + HEIGHT:g}" text-anchor="end">0</text>',
        f'<text x="{x - 4:g}" y="{y + 20:g}" text-anchor="end">{most}</text>',
        f'<text x="{x - 4:g}" y="{y + HEIGHT / 2:g}" text-anchor="middle" '
        f'transform="rotate(-90 {x - 8:g} {y + HEIGHT / 2:g})">others missed</text>',
    ]
