"""A model's block diagram, drawn from its table of terms (`mcstudy.stance.feedback`), and the same as text."""

from __future__ import annotations

import re
from dataclasses import replace

from markupsafe import escape

from mcstudy.report.study.paths import Loop, is_symbol, split, written
from mcstudy.report.style import COLOURS
from mcstudy.stance.feedback import Model, Term

_TOP, _STEP, _GAP = 34.0, 42.0, 34.0  # pt
_CHARACTER = 7.5  # pt, width of one
_SHORT = 12
"""Characters of what drives a joint beside its arrow; more are written above it."""
_WIDTH, _BODY, _DELAY, _FEEDBACK = 680.0, (275.0, 150.0), (185.0, 90.0), (320.0, 130.0)


def sketch(model: Model) -> str:
    """The block diagram as lines of text, one for each joint and each path back to it."""
    loop = Loop.of(model)
    out = []
    for row in loop.rows(model):
        drives = " + ".join(_drive(t, loop) for t in loop.drives if t.row == row)
        joint = model.angles[model.rows[::-1].index(row)]
        out.append(f"{row}: {drives or '0'} -> (+) -> body -> {joint}")
        for p in (p for p in loop.paths if p.row == row):
            gains = " + ".join(written(t) or "1" for t in p.terms)
            late = "".join(f" <- delay {name}" for name in p.delays)
            tilt = f" - {p.tilted}" if p.tilt else ""
            out.append(f"  (-){late} <- {gains} <- {p.sense}{tilt}{' + noise' if p.noisy else ''}")
    return "\n".join(out)


def standalone(model: Model) -> str:
    """The block diagram as an SVG document of its own, in light colours."""
    colours = ";".join(f"--{name}:{COLOURS[name]}" for name in ("ink", "panel", "blue"))
    drawing = diagram(model, f"Block diagram of {model.name}", "")
    start = f'<svg style="{colours};background:{COLOURS["panel"]}" font-family="sans-serif" '
    return drawing.replace(' aria-describedby=""', "").replace("<svg ", start, 1)


def diagram(model: Model, title: str, described_by: str) -> str:
    """Block diagram as inline SVG: body on top, below it every feedback path from an angle back to a joint."""
    loop = Loop.of(model)
    every, rows = loop.paths, loop.rows(model)
    sensed = {p.sense for p in every}
    angles = [a for a in (*model.angles, *sorted(sensed - set(model.angles))) if a in sensed]
    sums = {row: (150.0 - 45 * i, _TOP + _STEP * i) for i, row in enumerate(rows)}
    taps = {angle: (490.0 + 45 * i, _TOP + _STEP * i) for i, angle in enumerate(angles)}
    first_active = next((i for i, p in enumerate(every) if p.noisy), len(every))
    top = _TOP + _STEP * len(rows)
    heights = [top + 20 + _STEP * i + (_GAP if i >= first_active else 0) for i in range(len(every))]
    lines, boxes = [], []
    for row, (x, y) in sums.items():
        lowest = max((h for h, p in zip(heights, every, strict=True) if p.row == row), default=y)
        lines.append(_arrow(f"M{x} {lowest}V{y + 9}"))
        lines.append(_arrow(f"M{x + 9} {y}H{_BODY[0]}"))
        boxes.append(_circle(x, y) + _words(x + 5, y + 22, "−", "start"))
        boxes.append(_words(sums[rows[0]][0] + 24, y - 6, f"{row} torque", "start"))
        if drive := " + ".join(_drive(t, loop) for t in loop.drives if t.row == row):
            start, low = (20, 5) if drive == "u" else (86, 5)
            if len(drive) > _SHORT or start > x - 20:
                start, low = 4, -20
            lines.append(_arrow(f"M{start} {y}H{x - 9}"))
            boxes.append(_words(4, y + low, drive, "start") + _words(x - 15, y - 7, "+"))
    boxes.append(_box(*_BODY, _TOP + _STEP * (len(rows) - 1) / 2, _STEP * (len(rows) - 1) + 32, "body"))
    for angle, (x, y) in taps.items():
        lowest = max(h for h, p in zip(heights, every, strict=True) if p.sense == angle)
        lines.append(_arrow(f"M{_BODY[0] + _BODY[1]} {y}H600"))
        lines.append(_line(f"M{x} {y}V{lowest}"))
        boxes.append(_words(606, y + 5, _name(angle) if is_symbol(angle) else escape(angle), "start") + _dot(x, y))
        if any(p.noisy and p.sense == angle for p in every):
            i = angles.index(angle)
            at = heights[first_active] - _STEP / 2 - _GAP / 2 - 4 + 22 * i
            boxes.append(_circle(x, at))
            lines.append(_arrow(f"M600 {at}H{x + 9}"))
            boxes.append(_words(606, at + 5, f"noise {i + 1}", "start"))
    for path, y in zip(every, heights, strict=True):
        x, left = taps[path.sense][0], sums[path.row][0]
        lines.append(_arrow(f"M{x} {y}H{sum(_FEEDBACK)}"))
        boxes.append(_dot(x, y))
        boxes.append(_box(*_FEEDBACK, y, 28, " + ".join(_written(t) for t in path.terms)))
        if path.delays:
            lines.append(_arrow(f"M{_FEEDBACK[0]} {y}H{sum(_DELAY)}"))
            boxes.append(_box(*_DELAY, y, 28, "delay " + " + ".join(map(_name, path.delays))))
        lines.append(_line(f"M{_DELAY[0] if path.delays else _FEEDBACK[0]} {y}H{left}"))
        boxes.append(_dot(left, y))
        if path.tilt:
            angle = "".join(split(path.sense))  # without lowered indices, which would touch the box below
            senses = f'<tspan font-size="80%">acts on {angle} − {path.tilted}</tspan>'
            boxes.append(_words(_FEEDBACK[0] + _FEEDBACK[1] / 2, y + 25, senses))
        if path.controller:
            boxes.append(_words(_DELAY[0] - 5, y - 6, _name(path.controller), "end"))
    height = max(heights, default=top) + 20
    width = max(_WIDTH, 612 + _CHARACTER * max(map(len, taps), default=0))
    return (
        f'<svg class="plot" viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(title)}" '
        f'aria-describedby="{described_by}" xmlns="http://www.w3.org/2000/svg"><defs><marker id="arrow" '
        'viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0 0L8 4L0 8z" style="fill:var(--ink)"/></marker></defs>'
        f'<g style="fill:none;stroke:var(--ink);stroke-width:1.1">{"".join(lines)}</g>'
        f'<g style="fill:var(--ink);font-size:14px">{"".join(boxes)}</g></svg>'
    )


def _drive(term: Term, loop: Loop) -> str:
    stimulus = " ".join(filter(None, split(loop.stimuli[term.stimulus])))
    late = "".join(f" delayed {name}" for name in term.all_delays)
    return f"{written(term)} {stimulus}{late}".strip()


def _written(term: Term) -> str:
    """A term without its delays, as SVG text."""
    return written(replace(term, gain=tuple(map(_name, term.gain)))) or "1"


def _name(name: str) -> str:
    """A symbol with its index lowered, as SVG text."""
    letter, index = split(name)
    lowered = f'<tspan dy="4" font-size="75%">{escape(index)}</tspan><tspan dy="-4">\u200b</tspan>' if index else ""
    return letter + lowered


def _words(x: float, y: float, content: str, anchor: str = "middle") -> str:
    return f'<text x="{x:g}" y="{y:g}" style="text-anchor:{anchor}">{content}</text>'


def _box(x: float, width: float, y: float, height: float, content: str) -> str:
    shape = f'<rect x="{x:g}" y="{y - height / 2:g}" width="{width:g}" height="{height:g}" rx="3"'
    words = _words(x + width / 2, y + 5, content)
    if len(re.sub("<[^>]*>", "", content)) * _CHARACTER > width:
        words = words.replace("<text ", f'<text textLength="{width - 8:g}" lengthAdjust="spacingAndGlyphs" ', 1)
    return f'{shape} style="fill:var(--panel);stroke:var(--blue);stroke-width:1.4"/>' + words


def _circle(x: float, y: float) -> str:
    return (
        f'<circle cx="{x:g}" cy="{y:g}" r="9" style="fill:var(--panel);stroke:var(--blue);stroke-width:1.4"/>'
        f'<path d="M{x - 5:g} {y:g}h10M{x:g} {y - 5:g}v10" style="stroke:var(--ink)"/>'
    )


def _dot(x: float, y: float) -> str:
    return f'<circle cx="{x:g}" cy="{y:g}" r="2.6"/>'


def _line(d: str) -> str:
    return f'<path d="{d}"/>'


def _arrow(d: str) -> str:
    return f'<path d="{d}" marker-end="url(#arrow)"/>'
