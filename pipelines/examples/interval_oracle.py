"""Are the intervals of ``mcstudy fit`` those of an independent implementation?

    python pipelines/examples/interval_oracle.py --recordings 50

For both ends of every quantity: fix the quantity by eliminating a parameter, minimise the deviance over the others by
scipy's bounded least squares (its own trust-region method, model and derivatives from the closed form, 20 starts), and
find where the minimum reaches the threshold by Brent's method. Printed: differences in widths of the interval, and ends
beyond which the other implementation still finds a fit below the threshold.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.optimize import brentq, least_squares

from mcstudy.fitting.penalised import Data, whiten
from mcstudy.identification.coverage import Condition, Source
from mcstudy.identification.fit import fit_lines
from mcstudy.identification.result import Estimate, FitResult
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf, frf_jacobian
from mcstudy.streams import stream

BRACKET = 1e-4
"""Half-width of the bracket of an end, in widths of the interval, that is tried first."""


class Constrained:
    """Least deviance of a fit with one quantity, a parameter or a sum of two, at a fixed value."""

    def __init__(self, fitted: FitResult, name: str) -> None:
        model = fitted.model
        self._model, self._data = model, Data.of(fitted.lines)
        self._which = [model.names.index(part) for part in name.split(" + ")]
        self._free = np.delete(np.arange(len(model.names)), self._which[0])
        self._scale = np.abs(model.truth)[self._free]

    def _bounds(self, value: float) -> tuple[np.ndarray, np.ndarray]:
        low, high = self._model.lower.copy(), self._model.upper.copy()
        if len(self._which) == 2:
            first, second = self._which
            low[second] = max(low[second], value - high[first])
            high[second] = min(high[second], value - low[first])
        return low[self._free] / self._scale, high[self._free] / self._scale

    def _theta(self, x: np.ndarray, value: float) -> np.ndarray:
        theta = np.empty(len(self._free) + 1)
        theta[self._free] = x * self._scale
        theta[self._which[0]] = value - theta[self._which[1:]].sum()
        return theta

    def least(self, value: float, starts: np.ndarray) -> tuple[float, np.ndarray]:
        """Least deviance with the quantity at ``value``, from parameters ``starts`` (S, P), and where it is."""
        low, high = self._bounds(value)
        best = np.inf, starts[0]
        for start in starts:
            found = least_squares(
                lambda x: whiten(
                    self._data.weight, self._data.y - frf(self._model, self._theta(x, value), self._data.f)
                ),
                np.clip(start[self._free] / self._scale, low + 1e-9 * (high - low), high - 1e-9 * (high - low)),
                jac=lambda x: self._slope(x, value),
                bounds=(low, high),
                xtol=1e-14,
                ftol=1e-14,
                gtol=1e-12,
                max_nfev=300,
            )
            if 2 * found.cost < best[0]:
                best = 2 * found.cost, self._theta(found.x, value)
        return best

    def _slope(self, x: np.ndarray, value: float) -> np.ndarray:
        J = -whiten(self._data.weight, frf_jacobian(self._model, self._theta(x, value), self._data.f)[1])
        own = J[:, self._free]
        for other in self._which[1:]:
            own[:, np.flatnonzero(self._free == other)[0]] -= J[:, self._which[0]]
        return np.asarray(own * self._scale)


def difference(fitted: FitResult, e: Estimate, side: int, starts: int, rng: np.random.Generator) -> tuple[float, float]:
    """Of one end: ours minus the other's, outwards, in widths; least deviance at our end over the threshold."""
    other = Constrained(fitted, e.name)
    end, theta = (e.low, e.profile.low_theta) if side < 0 else (e.high, e.profile.high_theta)
    ceiling = fitted.chi2 + e.profile.rise[0 if side < 0 else -1]
    width = e.high - e.low
    drawn = theta * (1 + 0.3 * rng.standard_normal((starts - 1, theta.size)))
    deviance, theta = other.least(end, np.vstack([theta, np.clip(drawn, fitted.model.lower, fitted.model.upper)]))

    def excess(step: float) -> float:
        return other.least(end + side * step * width, theta[None])[0] - ceiling

    bracket = BRACKET
    while excess(bracket) < 0 and bracket < 1:
        bracket *= 10
    return -brentq(excess, -BRACKET, bracket, xtol=1e-10), deviance - ceiling


def main() -> None:
    """Fit, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=int, default=50)
    parser.add_argument("--fmax", type=float, default=3.1)
    parser.add_argument("--starts", type=int, default=20)
    args = parser.parse_args()
    source, model, rng = Source(Condition(0, 6, args.fmax)), two_segment(), np.random.default_rng(0)
    found = []
    for r in range(args.recordings):
        fitted = fit_lines(source(stream(r, "oracle")), model, curve=())
        for e in fitted.estimates:
            for side, by in ((-1, e.low_from), (1, e.high_from)):
                if by == "data":
                    found.append((*difference(fitted, e, side, args.starts, rng), r, e.name, side))
    apart = np.abs([f[0] for f in found])
    print(f"{len(found)} ends set by the data, of {args.recordings} recordings up to {args.fmax:g} Hz")
    print(f"difference in widths: median {np.median(apart):.1e}, 95 % {np.quantile(apart, 0.95):.1e}")
    print(f"within 1e-6: {100 * np.mean(apart < 1e-6):.1f} %")
    for gap, below, r, name, side in found:
        if abs(gap) >= 1e-6:
            print(f"recording {r}, {name}, {'low' if side < 0 else 'high'}: {gap:.1e}, least deviance {below:.1e}")


if __name__ == "__main__":
    main()
