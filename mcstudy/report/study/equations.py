"""A model's equations, written from its table of terms (`mcstudy.stance.feedback`)."""

from __future__ import annotations

from collections.abc import Iterable

from markupsafe import escape

from mcstudy.report.study.paths import Loop, Path, is_symbol, split
from mcstudy.stance.feedback import Model, Term


def equations(model: Model) -> str:
    """The torque balances as MathML, the last one (of the ankle) first: body = stimulus - feedback."""
    loop = Loop.of(model)
    return "".join(
        f'<p>{escape(row.capitalize())}: <math display="inline">{_balance(loop, row)}</math></p>'
        for row in loop.rows(model)
    )


def _balance(loop: Loop, row: str) -> str:
    body = [t for t in loop.body if t.row == row]
    left = [
        f"<mo>(</mo>{_sum(_factor(t) for t in body if t.sense == sense)}<mo>)</mo>" + _signal(sense)
        for sense in dict.fromkeys(t.sense for t in body)
    ]
    drives = _sum(
        _factor(t, "") + _delay(t.all_delays) + _symbol(loop.stimuli[t.stimulus]) for t in loop.drives if t.row == row
    )
    feedback = "".join(f"<mo>−</mo>{_path(p)}" for p in loop.paths if p.row == row)
    zero = "<mn>0</mn>"
    return f"{'<mo>+</mo>'.join(left) or zero}<mo>=</mo>{drives}{feedback}"


def _path(path: Path) -> str:
    gains = _sum(_factor(t) for t in path.terms)
    if len(path.terms) > 1 or gains.startswith("<mo>−"):
        gains = f"<mo>(</mo>{gains}<mo>)</mo>"
    delay = _delay(path.delays)
    if not path.tilt:
        return gains + delay + _signal(path.sense)
    share = "" if path.tilt == "1" else _symbol(path.tilt)
    return f"{gains}{delay}<mo>(</mo>{_signal(path.sense)}<mo>−</mo>{share}{_symbol('u')}<mo>)</mo>"


def _delay(names: tuple[str, ...]) -> str:
    if not names:
        return ""
    total = "<mo>+</mo>".join(map(_symbol, names))
    total = f"<mo>(</mo>{total}<mo>)</mo>" if len(names) > 1 else total
    return f"<msup><mi>e</mi><mrow><mo>−</mo>{total}<mi>s</mi></mrow></msup>"


def _factor(term: Term, one: str = "<mn>1</mn>") -> str:
    """Coefficient, gains, power of s and filters of a term; ``one`` where there is none of them."""
    filters = "".join(
        f"<msub><mi>F</mi><mtext>{escape(f)}</mtext></msub><mo>(</mo><mi>s</mi><mo>)</mo>" for f in term.filters
    )
    symbols = "".join(_symbol(g) for g in term.gain) + _power(term.order) + filters
    return _coefficient(term.coefficient) + symbols or one


def _coefficient(value: float) -> str:
    if value == 1:
        return ""
    return f"<mo>−</mo><mn>{-value:.4g}</mn>" if value < 0 else f"<mn>{value:.4g}</mn>"


def _power(order: int) -> str:
    if order == 0:
        return ""
    if order < 0:
        return "<mfrac><mn>1</mn><mi>s</mi></mfrac>"
    return "<mi>s</mi>" if order == 1 else f"<msup><mi>s</mi><mn>{order}</mn></msup>"


def _sum(pieces: Iterable[str]) -> str:
    joined = ""
    for piece in pieces:
        joined += piece if not joined or piece.startswith("<mo>−") else f"<mo>+</mo>{piece}"
    return joined


def _symbol(name: str) -> str:
    letter, index = split(name)
    return f"<msub><mi>{letter}</mi><mtext>{escape(index)}</mtext></msub>" if index else f"<mi>{letter}</mi>"


def _signal(name: str) -> str:
    """A sensed angle: its symbol, or its name where that is a word; a sum in parentheses."""
    if "+" in name or "-" in name or "*" in name:
        return f"<mo>(</mo><mtext>{escape(name)}</mtext><mo>)</mo>"
    return _symbol(name) if is_symbol(name) else f"<mtext>{escape(name)}</mtext>"
