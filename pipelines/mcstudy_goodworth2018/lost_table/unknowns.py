"""The unknowns of the inference and what is known of them before the printed numbers are used.

A point of the inference is a vector u in the unit cube, one entry per unknown, uniform before any number is used
(`Prior.values` maps it). The true gains and delays are log-uniform: the sources state an order of magnitude, and the
range is that of published values, widened. The unstated choices are a few named possibilities with equal weight.

Sources of the ranges
---------------------
- Kpas1: "approximately 23 % of mgh" (Goodworth & Peterka 2018, Methods), mgh = 636.4 N m/rad: 22.5 to 23.5 %.
- Scale of the ankle: a one-segment model with 944 N m/rad, 314 N m s/rad and a delay of 97 ms (Table 1 of the review
  stored as PMC5664365), and K11 + Kpas1 above mgh in a body that does not fall.
- Delays: physiological range of 50 to 150 ms about the 97 ms above.
- Hip and cross gains: no table could be traced (Boonstra et al. 2013 and Engelhart et al. 2015, 2016 show theirs in
  figures), so the ranges span a factor of ten.
- Noise: 1 is the stated density, read as one-sided; other conventions of a density differ by a factor of 2. The range
  is twice as wide.
- The closed loop is stable, and its slowest mode decays faster than `SLOWEST` (1/s): the paper modified its gains
  because those of its source were close to instability (Methods).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mcstudy.errors import DesignError

SLOWEST = 0.2
"""Slowest decay of the true closed loop, 1/s."""


@dataclass(frozen=True)
class Unknown:
    """One unknown: log-uniform from ``low`` to ``high``, or one of ``choices`` with equal weight.

    ``unit``: of the value. ``meaning``: for tables. A choice is stored as its number in ``choices``.
    """

    name: str
    unit: str
    meaning: str
    low: float = 0.0
    high: float = 0.0
    choices: tuple[str, ...] = ()

    def value(self, u: np.ndarray) -> np.ndarray:
        """Values at positions ``u`` in [0, 1]; the number of the choice for a choice."""
        if self.choices:
            return np.minimum((u * len(self.choices)).astype(int), len(self.choices) - 1).astype(float)
        return np.asarray(self.low * (self.high / self.low) ** u)

    def feature(self, u: np.ndarray) -> np.ndarray:
        """Position for a regression, from -1 to 1; the same for all positions of one choice."""
        if self.choices:
            return 2.0 * (self.value(u) + 0.5) / len(self.choices) - 1.0
        return 2.0 * u - 1.0

    def position(self, value: float) -> float:
        """Inverse of `value` (the middle of a choice)."""
        if self.choices:
            return (value + 0.5) / len(self.choices)
        return float(np.log(value / self.low) / np.log(self.high / self.low))


_K, _B = "N m/rad", "N m s/rad"
GAINS = ("K11", "K12", "K21", "K22", "B11", "B12", "B21", "B22", "Kpas1", "Kpas2")
DELAYS = ("Td1", "Td2")

WIDTHS = (1.0, 0.5, 0.25, 0.01)
"""Fraction of a point's lines that are averaged, by number of the choice (`spectra.width` of a study file)."""

CONVENTIONS: tuple[Literal["peak", "peak_to_peak"], ...] = ("peak", "peak_to_peak")
SWAY_OVER = ("record", "cycle")
SOLVERS = ("minimum", "early")

UNKNOWNS: tuple[Unknown, ...] = (
    Unknown("K11", _K, "active stiffness, lower body to ankle torque", 500.0, 2000.0),
    Unknown("K12", _K, "active stiffness, lower body to hip torque", 60.0, 600.0),
    Unknown("K21", _K, "active stiffness, hip angle to ankle torque", 60.0, 800.0),
    Unknown("K22", _K, "active stiffness, hip angle to hip torque", 60.0, 600.0),
    Unknown("B11", _B, "active damping, lower body to ankle torque", 100.0, 800.0),
    Unknown("B12", _B, "active damping, lower body to hip torque", 15.0, 150.0),
    Unknown("B21", _B, "active damping, hip angle to ankle torque", 10.0, 200.0),
    Unknown("B22", _B, "active damping, hip angle to hip torque", 8.0, 80.0),
    Unknown("Kpas1", _K, "passive stiffness of the ankle", 143.2, 149.6),
    Unknown("Kpas2", _K, "passive stiffness of the hip", 15.0, 200.0),
    Unknown("Td1", "s", "time delay of active ankle torque", 0.05, 0.15),
    Unknown("Td2", "s", "time delay of active hip torque", 0.05, 0.15),
    Unknown("noise", "1", "factor on the stated density of the sensor noise", 0.25, 4.0),
    Unknown("convention", "", "meaning of the torque's amplitude", choices=CONVENTIONS),
    Unknown("width", "", "lines averaged into a point", choices=("all", "half", "quarter", "fewest")),
    Unknown("sway_over", "", "span over which the RMS of sway is taken", choices=SWAY_OVER),
    Unknown("solver", "", "end of a fit", choices=SOLVERS),
)


class Prior:
    """The unknowns of one inference, with the ranges of its file in place of the defaults."""

    def __init__(self, ranges: Mapping[str, Sequence[float]] | None = None) -> None:
        ranges = dict(ranges or {})
        known = {x.name: x for x in UNKNOWNS if not x.choices}
        for name in ranges:
            if name not in known:
                raise DesignError(f"prior.{name}: unknown, expected one of {', '.join(known)}")
        self.unknowns = tuple(
            Unknown(x.name, x.unit, x.meaning, ranges[x.name][0], ranges[x.name][1]) if x.name in ranges else x
            for x in UNKNOWNS
        )
        for x in self.unknowns:
            if not x.choices and not 0 < x.low < x.high:
                raise DesignError(f"prior.{x.name}: expected 0 < lowest < highest, got [{x.low:g}, {x.high:g}]")
            if x.name in DELAYS and x.low < 0.031:
                raise DesignError(
                    f"prior.{x.name}: expected delays above 0.031 s (bounds lie 0.03 s below), got {x.low:g}"
                )
        self.names = tuple(x.name for x in self.unknowns)

    def __len__(self) -> int:
        return len(self.unknowns)

    def values(self, u: np.ndarray) -> np.ndarray:
        """Values (..., U) at points ``u`` (..., U) of the cube."""
        return np.stack([x.value(u[..., k]) for k, x in enumerate(self.unknowns)], axis=-1)

    def features(self, u: np.ndarray) -> np.ndarray:
        """Regressors (..., U) from -1 to 1."""
        return np.stack([x.feature(u[..., k]) for k, x in enumerate(self.unknowns)], axis=-1)

    def positions(self, values: Mapping[str, float]) -> np.ndarray:
        """The point of the cube with these values, (U,)."""
        return np.array([x.position(values[x.name]) for x in self.unknowns])
