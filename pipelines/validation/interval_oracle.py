"""Are the intervals of ``mcstudy fit`` those of an independent implementation?

    python pipelines/validation/interval_oracle.py --recordings 50

For both ends of every quantity that the data set: fix the quantity by eliminating a parameter, minimise the deviance
over the others by scipy's bounded least squares (its own trust-region method, model and derivatives from the closed
form, 20 starts), and find where the minimum reaches the threshold by Brent's method.

One line is printed after each recording, so that ``--first`` can go on with a stopped comparison. For every end that is
not the same within 1e-6 of the width it is printed who is right. An end is right if there are parameters with the
quantity at that value whose deviance is below the threshold, and if nobody found such parameters farther out.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, least_squares

from mcstudy.fitting.penalised import whiten
from mcstudy.fitting.problem import Data
from mcstudy.identification.fit import fit_lines
from mcstudy.identification.result import Estimate, FitResult
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf
from mcstudy.streams import stream
from pipelines import measured
from pipelines.validation.coverage import Condition, Source

BRACKET = 1e-4
"""Half-width of the bracket of an end, in widths of the interval, that is tried first."""

SAME = 1e-6
"""Largest difference of two ends, in widths of the interval, that are the same."""


class End(NamedTuple):
    """One end of an interval: ours and that of the other implementation.

    Attributes
    ----------
    apart: ours minus the other's, outwards, in widths of the interval. below: least deviance that the other finds with
    the quantity at our end, above the threshold (negative: there are better fits than ours). own: deviance of our
    parameters there by the closed form, above the threshold.
    """

    apart: float
    below: float
    own: float

    @property
    def verdict(self) -> str:
        """Whose end is right."""
        if abs(self.apart) < SAME:
            return "same"
        if self.apart < 0:
            return "ours is too short: the other found parameters below the threshold beyond it"
        if self.own <= DEVIANCE:
            return "ours is right: its parameters are below the threshold, the other did not find them"
        return "ours is too long: its parameters are above the threshold"


DEVIANCE = 1e-6
"""Error of a deviance that two implementations may differ by."""

NEAR = 1.0
"""Rise of the deviance above the lowest up to which a start that converged to a relative 1e-6 is converged further."""


class ClosedForm:
    """Frequency responses of the two-segment model and their derivatives: A(s) H = b(s), all terms at once."""

    def __init__(self, model: Model, f: np.ndarray) -> None:
        table, s = model.table, 2j * np.pi * f
        if table.n_filters or (table.entry[:, 4] >= 0).any() or (table.group_delay[:, 1] >= 0).any():
            raise ValueError("expected a model without filters, products of gains and sums of delays")
        row, order, group, self._gain = table.entry[:, :4].T
        terms, delay = np.arange(len(row)), table.group_delay[group, 0]
        self._known, self._late = self._gain < 0, np.flatnonzero(delay >= 0)
        self._gain, self._delay = np.where(self._known, 0, self._gain), delay[self._late]
        self._s, self._shape = s[:, None], (f.size, 2, len(model.names))
        self._fixed = table.weight[:, 0] * s[:, None] ** order  # (N, terms)
        self._into = np.zeros((len(row), 2, 3))  # coefficients of both angles and the stimulus
        self._into[terms, row] = table.weight[:, 1:]

    def __call__(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H (N, 2) and its derivatives (N, 2, P) at parameters (P,)."""
        slope = self._fixed.copy()  # by the gain of each term
        slope[:, self._late] *= np.exp(-self._s * theta[self._delay])
        value = slope * np.where(self._known, 1.0, theta[self._gain])
        whole = np.tensordot(value, self._into, 1)  # (N, 2, 3)
        inverse = np.linalg.inv(whole[..., :2])
        H = -(inverse @ whole[..., 2:])[..., 0]
        felt = np.einsum("trc,nc->ntr", self._into, np.column_stack([H, np.ones(len(H))]))
        J = np.zeros(self._shape, dtype=complex)
        for t in np.flatnonzero(~self._known):
            J[..., self._gain[t]] += slope[:, t, None] * felt[:, t]
        for t, k in zip(self._late, self._delay, strict=True):
            J[..., k] -= self._s * value[:, t, None] * felt[:, t]
        return H, -(inverse @ J)


class Constrained:
    """Least deviance of a fit with one quantity, a parameter or a sum of two, at a fixed value."""

    def __init__(self, fitted: FitResult, name: str) -> None:
        model = fitted.model
        self._model, self._data = model, Data.of(fitted.lines)
        self._closed = ClosedForm(model, self._data.f)
        self._which = [model.names.index(part) for part in name.split(" + ")]
        self._free = np.delete(np.arange(len(model.names)), self._which[0])
        self._scale = np.abs(model.truth)[self._free]
        self._last: tuple[np.ndarray, float, np.ndarray, np.ndarray] | None = None

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
        rough = [self._fit(value, start, 1e-6) for start in starts] if len(starts) > 1 else [(0.0, starts[0])]
        lowest = min(deviance for deviance, _ in rough)
        near = [theta for deviance, theta in rough if deviance < lowest + NEAR]
        return min((self._fit(value, theta, 1e-14) for theta in near), key=lambda found: found[0])

    def _fit(self, value: float, start: np.ndarray, tolerance: float) -> tuple[float, np.ndarray]:
        low, high = self._bounds(value)
        found = least_squares(
            lambda x: self._both(x, value)[0],
            np.clip(start[self._free] / self._scale, low + 1e-9 * (high - low), high - 1e-9 * (high - low)),
            jac=lambda x: self._both(x, value)[1],
            bounds=(low, high),
            xtol=tolerance,
            ftol=tolerance,
            gtol=1e-12,
            max_nfev=300,
        )
        return 2 * found.cost, self._theta(found.x, value)

    def deviance(self, theta: np.ndarray) -> float:
        """Deviance of parameters (P,)."""
        r = whiten(self._data.weight, self._data.y - frf(self._model, theta, self._data.f))
        return float(r @ r)

    def _both(self, x: np.ndarray, value: float) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and their derivatives; those of the last call are kept, since scipy asks for them one by one."""
        if self._last is None or value != self._last[1] or not np.array_equal(x, self._last[0]):
            H, slope = self._closed(self._theta(x, value))
            r, J = whiten(self._data.weight, self._data.y - H), -whiten(self._data.weight, slope)
            own = J[:, self._free]
            for other in self._which[1:]:
                own[:, np.flatnonzero(self._free == other)[0]] -= J[:, self._which[0]]
            self._last = x.copy(), value, r, np.asarray(own * self._scale)
        return self._last[2:]


def difference(fitted: FitResult, e: Estimate, side: int, starts: int, rng: np.random.Generator) -> End:
    """One end of an interval (``side`` -1 or 1) beside that of the other implementation."""
    other = Constrained(fitted, e.name)
    end, ours = (e.low, e.profile.low_theta) if side < 0 else (e.high, e.profile.high_theta)
    ceiling = fitted.chi2 + e.profile.rise[0 if side < 0 else -1]
    width = e.high - e.low
    drawn = ours * (1 + 0.3 * rng.standard_normal((starts - 1, ours.size)))
    deviance, theta = other.least(end, np.vstack([ours, np.clip(drawn, fitted.model.lower, fitted.model.upper)]))

    def excess(step: float) -> float:
        return other.least(end + side * step * width, theta[None])[0] - ceiling

    within, beyond = BRACKET, BRACKET
    while excess(beyond) < 0 and beyond < 1:
        beyond *= 10
    while excess(-within) > 0 and within < 1:
        within *= 10
    apart = -brentq(excess, -within, beyond, xtol=1e-10)
    return End(apart, deviance - ceiling, other.deviance(ours) - ceiling)


def main() -> None:
    """Fit, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=int, default=50)
    parser.add_argument("--first", type=int, default=0, help="number of the first recording (default 0)")
    parser.add_argument("--fmax", type=float, default=3.1)
    parser.add_argument("--starts", type=int, default=20)
    measured.add_option(parser)
    args = parser.parse_args()
    source, model = Source(Condition(0, 6, args.fmax)), two_segment()
    found: list[End] = []
    for r in range(args.first, args.first + args.recordings):
        fitted, rng = fit_lines(source(stream(r, "oracle")), model, curve=()), stream(r, "oracle starts")
        for e in fitted.estimates:
            for side, by in ((-1, e.low_from), (1, e.high_from)):
                if by != "data":
                    continue
                one = difference(fitted, e, side, args.starts, rng)
                found.append(one)
                if one.verdict != "same":
                    name = f"recording {r}, {e.name}, {'low' if side < 0 else 'high'}"
                    print(f"{name}: {one.apart:.1e}, {one.below:.1e}, {one.own:.1e}: {one.verdict}", flush=True)
        same = sum(one.verdict == "same" for one in found)
        print(f"recordings {args.first} to {r}: {same} of {len(found)} ends the same within {SAME:g}", flush=True)
    apart = np.abs([one.apart for one in found])
    print(f"{len(found)} ends set by the data, of {args.recordings} recordings up to {args.fmax:g} Hz")
    print(f"difference in widths: median {np.median(apart):.1e}, 95 % {np.quantile(apart, 0.95):.1e}")
    print(f"within {SAME:g}: {100 * np.mean(apart < SAME):.2f} %")
    share = {"value": 100 * float(np.mean(apart < SAME)), "unit": "%"}
    measured.write(args.json, {"ends": {"value": len(found)}, "same": share})


if __name__ == "__main__":
    main()
