"""The outcome of a fit: estimates with intervals, where each comes from, and whether to believe the model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mcstudy.files import schema
from mcstudy.files.json_files import plain
from mcstudy.identification import words
from mcstudy.identification.minimum import Minima
from mcstudy.identification.profile import Profile
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.recording import Recording
from mcstudy.short_repr import Summary, shortened
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model

if TYPE_CHECKING:
    import xarray as xr

BANDS_HZ = (0.0, 0.3, 1.0, 3.0, np.inf)
"""Edges of the bands by which the information on a quantity is told."""


@dataclass(frozen=True, repr=False)
class Estimate:
    """One quantity of a fit.

    Attributes
    ----------
    name, unit
        A parameter and its unit, or an expression; the unit is empty when it is not known.
    estimate
        Value at the lowest minimum.
    low, high
        Profile likelihood interval.
    low_from, high_from
        What ends it: "data", "bound" (of the parameters), "not finite" (the quantity is not defined beyond) or "steps"
        (the search gave up).
    wald_low, wald_high
        Gauss-Newton interval, for comparison; nan on a bound.
    information
        Share of the information in the bands below 0.3, 1 and 3 Hz, and above; sums to 1.
    profile
        The profile (`Profile`).
    """

    name: str
    unit: str
    estimate: float
    low: float
    high: float
    low_from: str
    high_from: str
    wald_low: float
    wald_high: float
    information: tuple[float, ...]
    profile: Profile

    def __repr__(self) -> str:
        return f"{self.name} = {words.interval(self)}"

    @property
    def verdict(self) -> str:
        """ "identifiable", "lower limit only", "upper limit only" or "not identifiable"."""
        ends = self.low_from == "data", self.high_from == "data"
        return {
            (True, True): "identifiable",
            (True, False): "lower limit only",
            (False, True): "upper limit only",
            (False, False): "not identifiable",
        }[ends]


@dataclass(frozen=True, repr=False)
class FitResult(Summary):
    """Parameters of one person; `mcstudy.fit` returns it.

    Attributes
    ----------
    name
        Name of the recording.
    level
        Level of the intervals.
    estimates
        All quantities (`Estimate`), also by name: ``result["K11"]``.
    theta
        (P,), parameters of the best fit.
    chi2, expected_chi2, p_value
        Squared residual of the best fit, its mean for noise alone, and the p-value of the fit.
    growth_rate
        Of the closed loop at the estimate, 1/s; negative is stable.
    correlation
        (P, P), of the Gauss-Newton errors; nan for a parameter on a bound.
    minima
        Distinct minima, and how likely another one is (`Minima`).
    model
        The model with the bounds of the fit.
    lines
        The measured lines, with their noise.
    warnings
        Warnings about the recording and the fit.
    method
        Settings of the fit.
    without_chi2
        Squared residual of the best fit without effects; None if none were added.
    recording
        The fitted recording (several are pooled); None for lines alone.
    """

    name: str
    level: float
    estimates: tuple[Estimate, ...]
    theta: np.ndarray
    chi2: float
    expected_chi2: float
    p_value: float
    growth_rate: float
    correlation: np.ndarray
    minima: Minima
    model: Model
    lines: Lines
    warnings: tuple[str, ...]
    method: dict[str, Any]
    without_chi2: float | None = None
    recording: Recording | FrfRecording | None = None

    def __getitem__(self, name: str) -> Estimate:
        for e in self.estimates:
            if e.name == name:
                return e
        raise KeyError(f"{name!r}; expected one of {', '.join(e.name for e in self.estimates)}")

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        return [
            ("recording", shortened(self.name)),
            *((e.name, words.interval(e)) for e in self.estimates),
            ("goodness of fit", f"p = {self.p_value:.2g}"),
            *(("note", note) for note in self.warnings),
            ("more", "to_xarray(), to_dict(), text()"),
        ]

    def text(self) -> str:
        """What `mcstudy fit` prints."""
        return words.text(self)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON data, valid under ``results_schema/1.0.0/fit.json``."""
        m = self.minima
        return plain(
            {
                "schema": schema.identifier("fit"),
                "name": self.name,
                "level": self.level,
                "quantities": [
                    {
                        "name": e.name,
                        "unit": e.unit,
                        "estimate": e.estimate,
                        "low": e.low,
                        "high": e.high,
                        "low_from": e.low_from,
                        "high_from": e.high_from,
                        "wald_low": e.wald_low,
                        "wald_high": e.wald_high,
                        "verdict": e.verdict,
                        "information": e.information,
                        "profile": {"value": e.profile.value, "rise": e.profile.rise},
                    }
                    for e in self.estimates
                ],
                "bands_hz": BANDS_HZ[1:-1],
                "parameters": {
                    "names": self.model.names,
                    "lower": self.model.lower,
                    "upper": self.model.upper,
                    "correlation": self.correlation,
                },
                "fit": {
                    "chi2": self.chi2,
                    "expected": self.expected_chi2,
                    "p_value": self.p_value,
                    "lines": len(self.lines),
                    "without_effects": self.without_chi2,
                    "growth_rate": self.growth_rate,
                },
                "search": {
                    "starts": m.starts,
                    "missed": m.missed,
                    "minima": [
                        {"rise": c - m.chi2[0], "hits": h, "parameters": t}
                        for c, h, t in zip(m.chi2, m.hits, m.theta, strict=True)
                        if c - m.chi2[0] < words.REACH
                    ],
                },
                "warnings": self.warnings,
                "method": self.method,
            }
        )

    def to_xarray(self) -> xr.Dataset:
        """Estimates and intervals by ``quantity``, the profiles as (quantity, point), padded with nan."""
        import xarray as xr

        es = self.estimates
        longest = max(e.profile.value.size for e in es)

        def padded(name: str) -> np.ndarray:
            rows = [getattr(e.profile, name) for e in es]
            return np.array([np.pad(r, (0, longest - r.size), constant_values=np.nan) for r in rows])

        columns = ["estimate", "low", "high", "wald_low", "wald_high", "low_from", "high_from", "verdict", "unit"]
        return xr.Dataset(
            {
                **{c: ("quantity", [getattr(e, c) for e in es]) for c in columns},
                "profile_value": (("quantity", "point"), padded("value")),
                "profile_rise": (("quantity", "point"), padded("rise")),
            },
            coords={"quantity": [e.name for e in es]},
            attrs={"level": self.level, "recording": self.name, "p_value": self.p_value},
        )
