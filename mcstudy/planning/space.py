"""The designs that are allowed, and what each costs.

``cycles`` and ``amplitude`` have a smallest and a largest value, ``fmax`` a list. An axis that is not named keeps the
value of the study. The cost of a design is its recording time, cycles times the duration of a cycle, for each stimulus;
of designs with equal time the one with the smaller amplitude is cheaper. A formula of the user's may replace that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mcstudy.errors import InputError
from mcstudy.expressions import Expression, expression, shortened
from mcstudy.study.group import Group

CYCLES, AMPLITUDE, FMAX, REALIZATIONS = "cycles", "amplitude", "fmax", "realizations"
AXES = (CYCLES, AMPLITUDE, FMAX, REALIZATIONS)

FACTOR = 10
"""Default range of cycles: up to so many times those of the study."""

WIDER = 2.0
"""Default range of amplitudes: so much beyond the smallest and the largest of the study."""

DEFAULT_REALIZATIONS = (10, 100_000)

MOST_CYCLES = 400
"""Numbers of cycles that are looked at; of a wider range the larger ones are spaced evenly in their logarithm."""

AMPLITUDES = 121

TIME = "time"
NAMES = (TIME, CYCLES, AMPLITUDE, FMAX)
"""What a formula of the cost may use; ``time`` is the recording time in s."""


@dataclass(frozen=True)
class Space:
    """Allowed designs.

    Attributes
    ----------
    cycles, amplitude: smallest and largest value, equal where they are not searched. fmax: values, Hz.
    realizations: smallest and largest number, None where they are not searched.
    over: names of the axes that are searched. period_s: duration of a cycle, under all stimuli in turn.
    discard: cycles that are not used.
    formula: cost in text, None for the recording time.
    """

    cycles: tuple[int, int]
    amplitude: tuple[float, float]
    fmax: tuple[float, ...]
    realizations: tuple[int, int] | None
    over: tuple[str, ...]
    period_s: float
    discard: int
    formula: str | None = None

    @property
    def cost_words(self) -> str:
        """What is minimised, for a reader."""
        return self.formula or "recording time in s (then the amplitude)"

    def ends(self, axis: str) -> tuple[float, float]:
        """Smallest and largest value of ``cycles`` or of ``amplitude``."""
        low, high = self.cycles if axis == CYCLES else self.amplitude
        return float(low), float(high)

    def counts(self) -> np.ndarray:
        """Numbers of cycles that are looked at, (C,)."""
        low, high = self.cycles
        if high - low < MOST_CYCLES:
            return np.arange(low, high + 1)
        return np.unique(np.geomspace(low, high, MOST_CYCLES).round().astype(int))

    def amplitudes(self) -> np.ndarray:
        """Amplitudes that are looked at, (A,)."""
        low, high = self.amplitude
        return np.array([low]) if low == high else np.geomspace(low, high, AMPLITUDES)

    def grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Cycles and amplitudes of all designs with one Fmax, each (C A,)."""
        cycles, amplitude = np.meshgrid(self.counts(), self.amplitudes(), indexing="ij")
        return cycles.ravel(), amplitude.ravel()

    @cached_property
    def _formula(self) -> Expression:
        return expression(self.formula or TIME, NAMES, "cost", "'time + 30 * amplitude'")

    def cost(self, cycles: np.ndarray, amplitude: np.ndarray, fmax: float) -> np.ndarray:
        """Cost of designs."""
        time = np.asarray(cycles, dtype=float) * self.period_s
        if self.formula is None:
            return time
        values = {TIME: time, CYCLES: cycles, AMPLITUDE: amplitude, FMAX: np.full(time.shape, fmax)}
        cost = np.broadcast_to(self._formula(values), time.shape)
        if not np.isfinite(cost).all():
            wrong = cost[~np.isfinite(cost)][0]
            raise InputError(
                f"cost {shortened(self.formula)!r}: expected a finite number for every allowed design, got {wrong}"
            )
        return cost

    def order(self, cycles: np.ndarray, amplitude: np.ndarray, fmax: float) -> np.ndarray:
        """Positions of designs from the cheapest to the dearest."""
        return np.lexsort((amplitude, cycles, rounded(self.cost(cycles, amplitude, fmax))))

    def signal(self, cycles: np.ndarray | float, amplitude: np.ndarray | float) -> np.ndarray:
        """Amplitude times the root of the used cycles: in linear theory all errors are inversely proportional to it."""
        return np.asarray(amplitude * np.sqrt(np.asarray(cycles) - self.discard))


def rounded(cost: np.ndarray | float) -> np.ndarray:
    """Costs to twelve digits, so that equal ones are equal whatever their size."""
    mantissa, exponent = np.frexp(cost)
    return np.asarray(np.ldexp(mantissa.round(12), exponent))


def space_of(group: Group, period_s: float, over: Sequence[str], formula: str | None = None) -> Space:
    """The designs that ``over`` allows; its parts are ``NAME``, ``NAME=LOW:HIGH`` or ``fmax=HZ/HZ/...``.

    Raises `InputError`, one line, for an axis that is unknown, not numeric, or has no room.
    """
    given: dict[str, str] = {}
    for part in over:
        name, _, values = (piece.strip() for piece in part.partition("="))
        if name not in AXES:
            why = " (not numeric)" if name in ("kind", "cost", "solver", "starts", "points") else ""
            raise InputError(f"over: expected axes among {', '.join(AXES)}, got {name!r}{why}")
        if name in given:
            raise InputError(f"over: expected every axis once, got {name} twice")
        given[name] = values
    if not given:
        raise InputError(f"over: expected at least one of {', '.join(AXES)}")
    s = group.stimulus
    cycles, amplitude = (s.cycles, s.cycles), group.amplitude
    if CYCLES in given:
        low, high = _range(CYCLES, given[CYCLES], (s.discard + 1, FACTOR * s.cycles), whole=True)
        if low <= s.discard:
            raise InputError(f"over: cycles: expected more than the {s.discard} discarded, got {low:g}")
        cycles = (int(low), int(high))
    if AMPLITUDE in given:
        default = (amplitude[0] / WIDER, amplitude[-1] * WIDER)
        amplitude = _range(AMPLITUDE, given[AMPLITUDE], default)
    elif len(amplitude) > 1:
        raise InputError("over: expected amplitude among the axes, or one amplitude in the study, got several")
    fmax = _fmax(given.get(FMAX), group)
    realizations = None
    if REALIZATIONS in given:
        low, high = _range(REALIZATIONS, given[REALIZATIONS], DEFAULT_REALIZATIONS, whole=True)
        realizations = (int(low), int(high))
    space = Space(cycles, (amplitude[0], amplitude[-1]), fmax, realizations, tuple(given), period_s, s.discard, formula)
    for value in fmax:
        space.cost(*space.grid(), value)
    return space


def _range(name: str, text: str, default: tuple[float, float], whole: bool = False) -> tuple[float, float]:
    if not text:
        return default
    what = "whole numbers" if whole else "numbers"
    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        raise InputError(f"over: {name}: expected LOW:HIGH in {what}, got {text!r}") from None
    if not 0 < low < high < 1e7 or (whole and (low != round(low) or high != round(high))):
        raise InputError(f"over: {name}: expected {what} above 0 with LOW < HIGH, got {text!r}")
    return low, high


def _fmax(text: str | None, group: Group) -> tuple[float, ...]:
    if text is None:
        if len(group.fmax) > 1:
            raise InputError("over: expected fmax among the axes, or one fmax in the study, got several")
        return group.fmax
    if not text:
        if len(group.fmax) == 1:
            raise InputError(
                "over: fmax: the study has one; expected the values to choose from, such as fmax=0.41/1.2/8"
            )
        return group.fmax
    try:
        values = tuple(sorted({float(part) for part in text.split("/")}))
    except ValueError:
        raise InputError(f"over: fmax: expected frequencies in Hz, such as 0.41/1.2/8, got {text!r}") from None
    return values
