"""The nearest mechanism in words: how well it resembles the gap, what it leaves, and as what transfer function."""

from __future__ import annotations

import numpy as np

from mcstudy.gap.questions.detection import Band
from mcstudy.gap.questions.interval import Interval
from mcstudy.gap.questions.nearest import Nearest
from mcstudy.gap.questions.remaining_torque import RemainingTorque
from mcstudy.text_tables import number

SUPERSCRIPTS = ("", " s", " s²", " s³", " s⁴")


def where(bands: tuple[Band, ...]) -> str:
    """The bands of a residual map that exceed their limit, as text; empty when none does."""
    by_angle: dict[str, list[tuple[float, float]]] = {}
    for b in bands:
        if b.beyond:
            spans = by_angle.setdefault(b.angle, [])
            if spans and b.low_hz <= spans[-1][1] + 0.1:
                spans[-1] = (spans[-1][0], b.high_hz)
            else:
                spans.append((b.low_hz, b.high_hz))
    name = {"theta1": "the lower body's angle", "theta2": "the hip angle"}
    parts = [
        f"{name.get(a, a)} " + " and ".join(_span(_hz(low), _hz(high)) for low, high in spans)
        for a, spans in by_angle.items()
    ]
    return "in " + ", and in ".join(parts) if parts else ""


def _hz(f: float) -> str:
    return f"{f:.2g}" if f < 99.5 else f"{f:.0f}"


def _span(low: str, high: str) -> str:
    return f"at {low} Hz" if low == high else f"from {low} to {high} Hz"


def percent(share: Interval) -> str:
    """A share as percent with its interval."""
    return f"{100 * share.estimate:.0f} % [{100 * share.low:.0f}, {100 * share.high:.0f}]"


def bracketed(x: Interval, unit: str = "") -> str:
    """A number with its interval."""
    return f"{number(x.estimate)} [{number(x.low)}, {number(x.high)}] {unit}".rstrip()


def resembles(near: Nearest, named: str) -> str:
    """One sentence: the nearest mechanism, ``named`` as in the verdict, and its likeness."""
    assert near.cause.likeness is not None
    return (
        f"The nearest mechanism of the library is {named}. It predicts {percent(near.cause.likeness)} of the gap at "
        "lines left out of its fit."
    )


def leaves(near: Nearest, noise: tuple[float, float]) -> str:
    """What the mechanism leaves: where, how large, and as what torque. ``noise``: range of chi2 for noise alone."""
    left, place = near.remaining, where(near.bands)
    if not left.found:
        said = f"It leaves no {'torque at a joint' if left.unit else 'further term'} that these data show"
        said += f" (probability of one: {chance(left.probability)})."
        return said + (f" Its residual exceeds noise {place}." if place else "")
    acts = f"a {'torque at the' if left.unit else 'term in'} {left.row} that depends on {_sense(left.sense)}"
    sure = f"probability {chance(left.probability)}, among such torques {chance(left.path_probability)}"
    sizes = [] if left.share is None else [f"{percent(left.share)} of the active torque there"]
    sizes += [] if left.rms is None else [f"{bracketed(left.rms, left.unit.split('/')[0])} RMS"]
    size = f": {', '.join(sizes)}" if sizes else ""
    gain, phase = left.at(left.clearest_hz)
    out = f"What it leaves{', ' + place + ',' if place else ''} is described by {acts} ({sure}){size}."
    out += (
        f" Its transfer function, {counted_poles(left.poles)}, is {formula(left)} {left.unit}; at "
        f"{left.clearest_hz:.2g} Hz, where the data show it best, {bracketed(gain, left.unit)} with a phase of "
        f"{phase.estimate:.0f}° [{phase.low:.0f}, {phase.high:.0f}]."
    )
    if left.chi2 > noise[1]:
        out += (
            f" With it the squared residual is {left.chi2:.0f}, where noise alone gives {noise[0]:.0f} to "
            f"{noise[1]:.0f}: more remains than such a torque."
        )
    return out


def counted_poles(poles: int) -> str:
    """Number of poles in words."""
    return "without poles" if poles == 0 else f"with {poles} pole{'s' if poles > 1 else ''}"


def formula(left: RemainingTorque) -> str:
    """The transfer function of the best fit, e.g. ``(12.3 s) / (1 + 0.05 s)``."""
    above = _polynomial(left.numerator)
    return above if len(left.denominator) == 1 else f"{above} / {_polynomial(left.denominator)}"


def _polynomial(coefficients: np.ndarray) -> str:
    terms = [(float(c), SUPERSCRIPTS[k]) for k, c in enumerate(coefficients) if c != 0]
    text = " ".join(
        f"{'-' if c < 0 else '+'} {number(abs(c))}{power}" if k else f"{number(c)}{power}"
        for k, (c, power) in enumerate(terms)
    )
    return f"({text or '0'})"


def chance(p: float) -> str:
    """A posterior probability in percent; none is known so well that it could be 0 or 100."""
    return "> 99 %" if p > 0.995 else "< 1 %" if p < 0.005 else f"{100 * p:.0f} %"


def _sense(sense: str) -> str:
    return "the stimulus" if sense == "stimulus" else sense
