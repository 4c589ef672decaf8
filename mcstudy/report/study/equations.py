"""A model's equations and block diagram, written from its table of terms (`mcstudy.stance.feedback`)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from markupsafe import escape

from mcstudy.report.labels import CONTROLLERS
from mcstudy.stance.feedback import Model, Term

_GREEK = {"theta": "θ"}


def equations(model: Model) -> str:
    """The torque balances as MathML, the last one (of the ankle) first: body = stimulus - feedback."""
    rows = [r for r in reversed(model.rows) if any(t.row == r for t in model.terms)]
    return "".join(
        f'<p>{escape(row.capitalize())}: <math display="inline">{_balance(model, row)}</math></p>' for row in rows
    )


def _balance(model: Model, row: str) -> str:
    terms = [t for t in model.terms if t.row == row]
    body = [t for t in terms if not t.gain and t.sense != "stimulus"]
    left = [
        f"<mo>(</mo>{_sum(_coefficient(t.coefficient) + _power(t.order) for t in body if t.sense == sense)}<mo>)</mo>"
        + _signal(sense)
        for sense in dict.fromkeys(t.sense for t in body)
    ]
    drive = _sum(
        _coefficient(t.coefficient) + _power(t.order) + _symbol("u")
        for t in terms
        if t.sense == "stimulus" and not t.gain
    )
    feedback = "".join(f"<mo>−</mo>{_path(p)}" for p in paths(model) if p.row == row)
    return f"{'<mo>+</mo>'.join(left)}<mo>=</mo>{drive}{feedback}"


@dataclass(frozen=True)
class Path:
    """Feedback from one angle to one joint: the terms that share sense, delay and noise.

    ``tilt``: the share of a tilt u that is taken from the angle, the name of a weight or "1"; empty without a tilt.
    """

    row: str
    sense: str
    delay: str | None
    noisy: bool
    terms: tuple[Term, ...]
    tilt: str = ""

    @property
    def controller(self) -> str:
        """The paper's name of a neural controller, e.g. ``T12``; empty for passive feedback."""
        return CONTROLLERS.get((self.row, self.sense), "") if self.noisy else ""


def paths(model: Model) -> list[Path]:
    """The feedback paths of a model, passive ones first."""
    found: dict[tuple[str, str, str | None, bool], list[Term]] = {}
    for t in model.terms:
        if t.gain and t.sense != "stimulus":
            found.setdefault((t.row, t.sense, t.delay, t.noisy), []).append(t)
    every = [Path(*key, tuple(terms), _tilt(model, terms[0])) for key, terms in found.items()]
    return sorted(every, key=lambda p: (p.noisy, -model.rows.index(p.row), p.sense))


def _tilt(model: Model, term: Term) -> str:
    """The share of a tilt that the sense of a term holds."""
    for t in model.terms:
        if t.sense == "stimulus" and t.gain[: len(term.gain)] == term.gain and term.sense == "theta1":
            return "".join(t.gain[len(term.gain) :]) or "1"
    return ""


def _path(path: Path) -> str:
    gains = _sum(_gain(t) for t in path.terms)
    gains = f"<mo>(</mo>{gains}<mo>)</mo>" if len(path.terms) > 1 else gains
    delay = f"<msup><mi>e</mi><mrow><mo>−</mo>{_symbol(path.delay)}<mi>s</mi></mrow></msup>" if path.delay else ""
    if not path.tilt:
        return gains + delay + _signal(path.sense)
    share = "" if path.tilt == "1" else _symbol(path.tilt)
    return f"{gains}{delay}<mo>(</mo>{_signal(path.sense)}<mo>−</mo>{share}{_symbol('u')}<mo>)</mo>"


def _gain(term: Term) -> str:
    factor = "" if term.coefficient == 1 else _coefficient(term.coefficient)
    filters = "".join(
        f"<msub><mi>F</mi><mtext>{escape(f)}</mtext></msub><mo>(</mo><mi>s</mi><mo>)</mo>" for f in term.filters
    )
    return factor + "".join(_symbol(g) for g in term.gain) + _power(term.order) + filters


def _coefficient(value: float) -> str:
    if value == 1:
        return ""
    return f"<mo>−</mo><mn>{-value:.4g}</mn>" if value < 0 else f"<mn>{value:.4g}</mn>"


def _power(order: int) -> str:
    if order == 0:
        return ""
    return "<mi>s</mi>" if order == 1 else f"<msup><mi>s</mi><mn>{order}</mn></msup>"


def _sum(pieces: Iterable[str]) -> str:
    joined = ""
    for piece in pieces:
        joined += piece if not joined or piece.startswith("<mo>−") else f"<mo>+</mo>{piece}"
    return joined


def _split(name: str) -> tuple[str, str]:
    """Letter and index of a symbol: theta2s is θ and 2s, Kpas1 is K and pas1."""
    for word, letter in _GREEK.items():
        if name.startswith(word):
            return letter, name[len(word) :]
    return name[:1], name[1:]


def _symbol(name: str) -> str:
    letter, index = _split(name)
    return f"<msub><mi>{letter}</mi><mtext>{escape(index)}</mtext></msub>" if index else f"<mi>{letter}</mi>"


def _signal(name: str) -> str:
    """A sensed angle: its symbol, or its name where that is a word; a sum in parentheses."""
    if "+" in name or "-" in name or "*" in name:
        return f"<mo>(</mo><mtext>{escape(name)}</mtext><mo>)</mo>"
    return _symbol(name) if _is_symbol(name) else f"<mtext>{escape(name)}</mtext>"


def _is_symbol(name: str) -> bool:
    return len(name) == 1 or any(name.startswith(word) for word in _GREEK)


# --- block diagram

_TOP, _STEP, _GAP = 34.0, 42.0, 34.0  # pt
_WIDTH, _BODY, _DELAY, _FEEDBACK = 680.0, (275.0, 150.0), (185.0, 90.0), (320.0, 130.0)


def diagram(model: Model, title: str, described_by: str) -> str:
    """Block diagram as inline SVG: body on top, below it every feedback path from an angle back to a joint."""
    sensed = {t.sense for t in model.terms if t.gain and t.sense != "stimulus"}
    angles = [a for a in (*model.angles, *sorted(sensed - set(model.angles))) if a in sensed]
    rows = [r for r in reversed(model.rows) if any(t.row == r for t in model.terms)]
    sums = {row: (150.0 - 45 * i, _TOP + _STEP * i) for i, row in enumerate(rows)}
    taps = {angle: (490.0 + 45 * i, _TOP + _STEP * i) for i, angle in enumerate(angles)}
    every = paths(model)
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
        drives = [t for t in model.terms if t.row == row and t.sense == "stimulus" and not t.gain]
        if drives:
            drive = " + ".join(_drive(t) for t in drives)
            lines.append(_arrow(f"M{20 if drive == 'u' else 86} {y}H{x - 9}"))
            boxes.append(_words(4, y + 5, drive, "start") + _words(x - 15, y - 7, "+"))
    high = _STEP * (len(rows) - 1) + 32
    boxes.append(_box(*_BODY, _TOP + (high - 32) / 2, high, "body and gravity"))
    for angle, (x, y) in taps.items():
        lowest = max(h for h, p in zip(heights, every, strict=True) if p.sense == angle)
        lines.append(_arrow(f"M{_BODY[0] + _BODY[1]} {y}H600"))
        lines.append(_line(f"M{x} {y}V{lowest}"))
        boxes.append(_words(606, y + 5, _name(angle) if _is_symbol(angle) else escape(angle), "start") + _dot(x, y))
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
        if path.delay:
            lines.append(_arrow(f"M{_FEEDBACK[0]} {y}H{sum(_DELAY)}"))
            boxes.append(_box(*_DELAY, y, 28, f"delay {_name(path.delay)}"))
        lines.append(_line(f"M{_DELAY[0] if path.delay else _FEEDBACK[0]} {y}H{left}"))
        boxes.append(_dot(left, y))
        if path.tilt:
            share = "" if path.tilt == "1" else f"{path.tilt} "
            angle = "".join(_split(path.sense))  # without lowered indices, which would touch the box below
            senses = f'<tspan font-size="80%">acts on {angle} − {share}u</tspan>'
            boxes.append(_words(_FEEDBACK[0] + _FEEDBACK[1] / 2, y + 25, senses))
        if path.controller:
            boxes.append(_words(_DELAY[0] - 5, y - 6, _name(path.controller), "end"))
    height = max(heights, default=top) + 20
    return (
        f'<svg class="plot" viewBox="0 0 {_WIDTH:g} {height:g}" role="img" aria-label="{escape(title)}" '
        f'aria-describedby="{described_by}" xmlns="http://www.w3.org/2000/svg"><defs><marker id="arrow" '
        'viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0 0L8 4L0 8z" style="fill:var(--ink)"/></marker></defs>'
        f'<g style="fill:none;stroke:var(--ink);stroke-width:1.1">{"".join(lines)}</g>'
        f'<g style="fill:var(--ink);font-size:14px">{"".join(boxes)}</g></svg>'
    )


def _drive(term: Term) -> str:
    power = {0: "", 1: "s ", 2: "s² ", -1: "1/s "}[term.order]
    return ("" if term.coefficient == 1 else f"{term.coefficient:.4g} ".replace("-", "−")) + power + "u"


def _written(term: Term) -> str:
    factor = "" if term.coefficient == 1 else f"{term.coefficient:g} "
    power = {0: "", 1: " s", 2: " s²", -1: " / s"}[term.order]
    return factor + " ".join(_name(g) for g in term.gain) + power


def _name(name: str) -> str:
    """A symbol with its index lowered, as SVG text."""
    letter, index = _split(name)
    lowered = f'<tspan dy="4" font-size="75%">{escape(index)}</tspan><tspan dy="-4">\u200b</tspan>' if index else ""
    return letter + lowered


def _words(x: float, y: float, content: str, anchor: str = "middle") -> str:
    return f'<text x="{x:g}" y="{y:g}" style="text-anchor:{anchor}">{content}</text>'


def _box(x: float, width: float, y: float, height: float, content: str) -> str:
    shape = f'<rect x="{x:g}" y="{y - height / 2:g}" width="{width:g}" height="{height:g}" rx="3"'
    return f'{shape} style="fill:var(--panel);stroke:var(--blue);stroke-width:1.4"/>' + _words(
        x + width / 2, y + 5, content
    )


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
