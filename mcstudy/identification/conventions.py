"""Estimates as published analyses of the sensorimotor integration test define them, beside those of a fit.

The likelihood weighs every line by its measured noise. Published analyses average neighbouring odd lines to some twelve
points, whose bands overlap, and weigh what is left by the gain of the data or of the model:

- Peterka (2002, J Neurophysiol 88:1097): squares of the error relative to the measured point;
- Peterka, Murchison, Parrington, Fino & King (2018, Front Neurol 9:1045), as in balancepy's ``peterka18.py``: absolute
  values of the error relative to the model, at the mean frequency of each point;
- Assländer et al. (2023, Sci Rep 13:2594), as in ``asslaender23.py``: likelihood of errors with a Laplace distribution
  whose scale is the gain of the model times an unknown b; the model is averaged like the data. Here the delay is exact.

None states its uncertainty. Gains of these publications are divided by m g h, and that of the torque feedback is
multiplied by it; where it is stated per degree, it is 180/pi times that per radian.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from mcstudy.errors import InputError
from mcstudy.identification.fit_record import FitRecord
from mcstudy.models.quantities import derived
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf
from mcstudy.streams import stream
from mcstudy.text_tables import Table, number

BANDS: dict[float, tuple[tuple[int, int], ...]] = {
    10.0: ((1, 1), (1, 2), (2, 2), (2, 3), (3, 4), (4, 5), (5, 7), (6, 9), (8, 10)),
    20.0: (
        *((1, 1), (1, 2), (2, 2), (2, 3), (3, 4), (4, 5), (5, 7), (6, 9)),
        *((8, 11), (10, 13), (12, 16), (16, 20)),
    ),
    60.5: (
        *((1, 1), (2, 2), (3, 4), (4, 5), (5, 7), (6, 9), (8, 11), (10, 13), (12, 16), (16, 20)),
        *((20, 25), (25, 32), (32, 40), (40, 49), (49, 59), (54, 66), (61, 75)),
    ),
}
"""First and last odd line of each point, counted from 1, by the period of the stimulus in s (balancepy)."""

STARTS, EVALUATIONS = 4, 6000
"""Starts of each search, the first at the estimates of the fit, and the most evaluations of one."""


@dataclass(frozen=True)
class Convention:
    """What an analysis minimises.

    Attributes
    ----------
    title: whose it is. cost: of model H and data Y, (M, outputs) each. averages: whether the model is averaged over the
    lines of a point, as the data are, or taken at their mean frequency.
    """

    title: str
    cost: Callable[[np.ndarray, np.ndarray], float]
    averages: bool = False


def _relative_squares(H: np.ndarray, Y: np.ndarray) -> float:
    return float((np.abs(H - Y) ** 2 / np.abs(Y) ** 2).sum())


def _relative_to_model(H: np.ndarray, Y: np.ndarray) -> float:
    return float((np.abs(H - Y) / np.abs(H)).sum())


def _laplace(H: np.ndarray, Y: np.ndarray) -> float:
    """Negative log likelihood at the most likely scale b, which is the mean of the relative errors."""
    b = np.mean(np.abs(H - Y) / np.abs(H))
    return float(np.log(2 * b * np.abs(H)).sum() + H.size)


CONVENTIONS = {
    "peterka2002": Convention("Peterka 2002", _relative_squares),
    "peterka2018": Convention("Peterka 2018", _relative_to_model),
    "asslaender2023": Convention("Assländer 2023", _laplace, averages=True),
}


@dataclass(frozen=True)
class Points:
    """Averages of lines: weights (M, N) of N lines at ``f`` (N,) in M points, and the data there, (M, Y)."""

    f: np.ndarray
    weight: np.ndarray
    y: np.ndarray

    @classmethod
    def of(cls, lines: Lines) -> Points:
        """The published bands of a period of 10, 20 or 60.5 s; otherwise, and of published points, lines alone."""
        weight = np.eye(len(lines))
        if lines.harmonic is not None:
            period = float(np.median(lines.harmonic / lines.f))
            bands = next((b for seconds, b in BANDS.items() if abs(seconds - period) < 0.01 * seconds), ())
            place = (lines.harmonic + 1) / 2
            inside = np.array([(place >= first) & (place <= last) for first, last in bands if last <= place.max()])
            weight = inside / inside.sum(axis=1, keepdims=True) if inside.size else weight
        return cls(lines.f, weight, weight @ lines.y)

    def model(self, model: Model, theta: np.ndarray, averages: bool) -> np.ndarray:
        """Responses of the model at the points, (M, Y)."""
        return self.weight @ frf(model, theta, self.f) if averages else frf(model, theta, self.weight @ self.f)


def estimates(fit: FitRecord, name: str) -> np.ndarray:
    """Parameters (P,) of a fit of one recording under the convention ``name``, within the bounds of the fit.

    Raises `InputError` for an unknown name, and for a fit of several stimuli.
    """
    if name not in CONVENTIONS:
        raise InputError(f"convention: expected one of {', '.join(CONVENTIONS)}, got {name!r}")
    if len(fit.lines.parts) > 1:
        raise InputError("convention: expected a fit of one recording, got several stimuli or conditions")
    convention, points, model = CONVENTIONS[name], Points.of(fit.lines), fit.model
    width = model.upper - model.lower

    def cost(u: np.ndarray) -> float:
        H = points.model(model, model.lower + width * u, convention.averages)
        with np.errstate(all="ignore"):  # without a weight the model does not move
            value = convention.cost(H, points.y)
        return value if np.isfinite(value) else np.inf

    rng = stream(fit.method.seed, "conventions")
    starts = [(fit.theta - model.lower) / width, *rng.random((STARTS - 1, width.size))]
    options = {"maxfev": EVALUATIONS, "xatol": 1e-7, "fatol": 1e-10, "adaptive": True}
    bounds = [(0.0, 1.0)] * width.size
    found = [minimize(cost, start, method="Nelder-Mead", bounds=bounds, options=options) for start in starts]
    best = min(found, key=lambda one: float(one.fun))
    again = minimize(cost, best.x, method="Nelder-Mead", bounds=bounds, options=options)
    return np.asarray(model.lower + width * again.x)


def comparison(fit: FitRecord) -> Table:
    """Estimates of a fit beside those under every convention; raises what `estimates` raises."""
    theta = {"maximum likelihood": fit.theta} | {c.title: estimates(fit, name) for name, c in CONVENTIONS.items()}
    model = fit.model
    rows = [[n, model.units[k], *(number(float(x[k])) for x in theta.values())] for k, n in enumerate(model.names)]
    rows += [[q.name, q.unit, *(number(q.value(x)) for x in theta.values())] for q in derived(model)]
    note = "The conventions average lines to points with overlapping bands, weigh by gains and state no uncertainty."
    return Table("Published conventions", ["quantity", "unit", *theta], rows, note)
