"""The sway that a stimulus evokes in bodies that nobody has measured, and optima that most of these bodies may have.

Near instability a body resonates, so a stimulus within the limit of the sway for one body may be far above it for
another. A share of all bodies of the prior shall keep the limit (a chance constraint; Calafiore & Campi 2006, IEEE
Trans Autom Control 51:742-753). Its optimum is sought with bodies that are drawn for it: those that sway least keep the
limit, the others are given up. As many limits as that adapt to the bodies that were drawn, so others keep them less
often. The limit of the bodies that are kept is therefore lowered until enough of further bodies, which the optimum does
not know, keep what was asked.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import beta, binom

from mcstudy.errors import InputError
from mcstudy.stance.feedback import Model
from mcstudy.stance.line_stimulus import Stimulus
from mcstudy.stance.response import frf
from mcstudy.stimulus_design.bodies import equivalent, factors
from mcstudy.stimulus_design.design_file import DesignFile
from mcstudy.stimulus_design.optimum import Optimum
from mcstudy.streams import stream

KNOWN, FURTHER, OTHER = 600, 2000, 2000
"""Bodies drawn for the optimum, for its calibration, and to say how many keep the limit in the end."""

CONFIDENCE = 0.95
"""That the share of all bodies that keep the limit is at least the one asked for."""

ROUNDS = 12
"""Most optima sought."""

NEAR = 0.99
"""Of the limit: from here on nothing is given away."""

TOP_HZ = 20.0
"""Up to which the sway of the sequence counts: its lines fall as 1/f and the responses of a body as 1/f^2."""

CHUNK = 250
"""Bodies whose responses are computed at a time."""


def costs(model: Model, theta: np.ndarray, sequence: Stimulus, f: np.ndarray) -> np.ndarray:
    """Squared sway that unit power at lines ``f`` (K,) evokes, over that of the sequence; (B, A, K).

    ``theta``: parameters (B, P) of bodies, with the inertia of ``model``.
    """
    c = sequence.coefficients()
    k = np.flatnonzero(c)
    k = k[k / sequence.period_s <= max(TOP_HZ, float(f[-1]))]
    every, power = k / sequence.period_s, np.abs(c[k]) ** 2
    out = []
    for first in range(0, len(theta), CHUNK):
        some = theta[first : first + CHUNK]
        whole, at_lines = (np.abs(frf(model, some, x)) ** 2 for x in (every, f))
        out.append(np.swapaxes(at_lines / np.einsum("k,bka->ba", power, whole)[:, None], 1, 2))
    return np.concatenate(out)


def ratios(cost: np.ndarray, x: np.ndarray) -> np.ndarray:
    """RMS of the sway that powers ``x`` (K,) evoke over that of the sequence, of the angle with the most; (B,)."""
    return np.asarray(np.sqrt((cost @ x).max(axis=1)))


def drawn_costs(file: DesignFile, model: Model, n: int, purpose: str, sequence: Stimulus, f: np.ndarray) -> np.ndarray:
    """`costs` of ``n`` bodies drawn from the prior with random numbers of their own for each ``purpose``."""
    rng = stream(file.design.seed, f"design_{purpose}")
    return costs(model, equivalent(model, factors(file, model, n, rng)), sequence, f)


@dataclass(frozen=True, eq=False)
class SwayLimit:
    """The limit of the sway, for the body of the file and for a share of all bodies of the prior.

    Attributes
    ----------
    limit: RMS of the evoked sway over that of the sequence. share: of all bodies that keep it; 0 for the first alone.
    alone, known, further: `costs` at the lines of the design of the body of the file, of bodies drawn for the optimum,
    and of bodies drawn for its calibration.
    """

    limit: float
    share: float
    alone: np.ndarray
    known: np.ndarray
    further: np.ndarray

    @classmethod
    def of(cls, file: DesignFile, model: Model, sequence: Stimulus, f: np.ndarray) -> SwayLimit:
        """Of a design file, whose body is ``model``, at lines ``f`` (K,)."""
        share, alone = file.limits.bodies_within, costs(model, model.truth[None], sequence, f)
        drawn = [
            drawn_costs(file, model, n, purpose, sequence, f) if share else alone[:0]
            for n, purpose in ((KNOWN, "known"), (FURTHER, "further"))
        ]
        return cls(file.limits.sway, share, alone, *drawn)

    def used(self, x: np.ndarray) -> float:
        """Part of the limit, in power, that ``x`` (K,) use: of the first body, or of the one at the percentile."""
        largest = float(ratios(self.alone, x)[0])
        if self.share:
            largest = max(largest, float(np.quantile(ratios(self.further, x), self.share)))
        return (largest / self.limit) ** 2

    def optimum(self, best: Callable[[np.ndarray], Optimum]) -> Optimum:
        """The optimum within this limit; ``best``: that within further limits, costs (L, K) as in `Allowed.cost`.

        Raises `InputError`, one line, if there is none.
        """
        always = _rows(self.alone, self.limit)
        last, within = best(always), None
        if not self.share:
            return last
        least = int(binom.ppf(CONFIDENCE, len(self.further), self.share)) + 1  # reached by chance in 5 % otherwise
        calm, tight = math.ceil(self.share * len(self.known)), self.limit
        for _ in range(ROUNDS):
            kept = self.known[np.argsort(ratios(self.known, last.x))[:calm]]
            last = best(np.concatenate([always, _rows(kept, tight)]))
            most = float(np.sort(ratios(self.further, last.x))[least - 1])
            if most <= self.limit and (within is None or last.value > within.value):
                within = last
            if NEAR * self.limit <= most <= self.limit:
                break
            tight = min(self.limit, tight * 0.999 * self.limit / most)
        if within is None:
            raise InputError(
                f"limits.bodies_within: no stimulus found with which {100 * self.share:g} % of the bodies sway at most "
                f"{self.limit:g} times as much as with the sequence; raise limits.sway, or lower limits.bodies_within "
                "or design.keep"
            )
        return within


def _rows(cost: np.ndarray, limit: float) -> np.ndarray:
    """`costs` (B, A, K) as limits (B A, K) of powers."""
    return cost.reshape(-1, cost.shape[-1]) / limit**2


@dataclass(frozen=True)
class OtherBodies:
    """How much bodies sway that neither the optimum nor its calibration knew, relative to the sequence.

    Attributes
    ----------
    drawn: their number. within: share that keeps the limit, with the 95 % interval ``low`` to ``high``.
    median, percentile_95, largest: RMS of the evoked sway over that of the sequence, of the angle with the most.
    """

    drawn: int
    within: float
    low: float
    high: float
    median: float
    percentile_95: float
    largest: float

    @classmethod
    def of(cls, ratio: np.ndarray, limit: float) -> OtherBodies:
        """From the ratios (B,) of bodies; the interval is that of Clopper and Pearson."""
        n, held = len(ratio), int((ratio <= limit * (1 + 1e-9)).sum())
        low = float(beta.ppf(0.025, held, n - held + 1)) if held else 0.0
        high = float(beta.ppf(0.975, held + 1, n - held)) if held < n else 1.0
        median, most = (float(x) for x in np.quantile(ratio, (0.5, 0.95)))
        return cls(n, held / n, low, high, median, most, float(ratio.max()))
