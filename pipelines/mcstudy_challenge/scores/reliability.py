"""The reliability diagrams of a challenge: what answers state, against how often it came true."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import Any

from mcstudy.report.style import COLOURS
from mcstudy.report.svg_document import svg_document
from mcstudy_challenge.scores.score import LEADING
from mcstudy_challenge.scores.table import OVERALL

SIDE, LEFT, TOP, GAP, COUNTS = 220.0, 48.0, 56.0, 64.0, 44.0
AXIS, FOUND, LINE = (COLOURS[name] for name in ("muted", "blue", "orange"))


def reliability_svg(score: Mapping[str, Any]) -> str:
    """Panels of a score (`challenge_score.json`) as an SVG document: dots with Wilson's 95 % interval, bars of cases.

    Calibrated probabilities lie on the diagonal, but for chance.
    """
    shown = score["calibration"][:OVERALL]
    size = (LEFT + len(shown) * (SIDE + GAP), TOP + SIDE + COUNTS + 52)
    caption = f"{score['challenge']}, {score['cases']} cases. Dots: came true, with 95 % interval. Line: calibrated."
    body: list[str] = []
    for k, one in enumerate(shown):
        body += _panel(one, LEFT + k * (SIDE + GAP), TOP)
    return svg_document("Reliability of stated probabilities", caption, size, LEFT, body)


def _panel(one: Mapping[str, Any], x: float, y: float) -> list[str]:
    """Elements of one diagram with its upper left corner at (x, y), and below it the cases of every bin."""
    name, foot = str(one["statement"]), y + SIDE + COUNTS
    most = max((b["right"]["n"] for b in one["bins"]), default=1)
    out = [
        f'<text x="{x:g}" y="{y - 10:g}">{html.escape(name if name == LEADING else f"that {name}")}</text>',
        f'<path d="M{x:g} {y:g}V{y + SIDE:g}H{x + SIDE:g}" fill="none" stroke="{AXIS}"/>',
        f'<path d="M{x:g} {y + SIDE:g}L{x + SIDE:g} {y:g}" stroke="{LINE}"/>',
    ]
    for share in (0.0, 0.5, 1.0):
        place, up = x + share * SIDE, y + (1 - share) * SIDE
        out += [
            f'<text x="{x - 6:g}" y="{up + 3:g}" text-anchor="end">{100 * share:g}</text>',
            f'<text x="{place:g}" y="{foot + 14:g}" text-anchor="middle">{100 * share:g}</text>',
        ]
    for b in one["bins"]:
        right = b["right"]
        tall = right["n"] / most * (COUNTS - 12)
        left, across = x + b["low"] * SIDE, x + b["stated"] * SIDE
        ends = [y + (1 - right[end]) * SIDE for end in ("low", "high")]
        told = f"{100 * b['stated']:.1f} % stated, {100 * right['value']:.1f} % came true, {right['n']} cases"
        out += [
            f'<rect x="{left + 1:.1f}" y="{foot - tall:.1f}" width="{(b["high"] - b["low"]) * SIDE - 2:.1f}" '
            f'height="{tall:.1f}" fill="{AXIS}" fill-opacity="0.4"><title>{right["n"]} cases</title></rect>',
            f'<path d="M{across:.1f} {ends[0]:.1f}V{ends[1]:.1f}" stroke="{FOUND}" stroke-width="1.4"/>',
            f'<circle cx="{across:.1f}" cy="{y + (1 - right["value"]) * SIDE:.1f}" r="3" fill="{FOUND}">'
            f"<title>{html.escape(told)}</title></circle>",
        ]
    out.append(f'<text x="{x + SIDE / 2:g}" y="{foot + 30:g}" text-anchor="middle">stated probability (%)</text>')
    if one["error"] is not None:
        chance = f"calibration error {100 * one['error']:.1f} %, calibrated {100 * one['by_chance']:.1f} %"
        out.append(f'<text x="{x + SIDE:g}" y="{foot + 44:g}" text-anchor="end">{chance}</text>')
    out.append(
        f'<text x="{x - 30:g}" y="{y + SIDE / 2:g}" text-anchor="middle" '
        f'transform="rotate(-90 {x - 30:g} {y + SIDE / 2:g})">came true (%)</text>'
    )
    return out
