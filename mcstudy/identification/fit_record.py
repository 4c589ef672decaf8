"""The outcome of a fit: estimates with intervals, where each comes from, and whether to believe the model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from mcstudy.files import schema
from mcstudy.files.json_files import named, plain
from mcstudy.identification.averaged_record import Averaged
from mcstudy.identification.belief import GapFound, WithEffects
from mcstudy.identification.estimate import BANDS_HZ, Estimate
from mcstudy.identification.forecast import Forecast
from mcstudy.identification.loop_stability import Stability
from mcstudy.identification.minimum import TOLD, Minima
from mcstudy.identification.settings import FitMethod
from mcstudy.identification.simulated_coverage import Coverage, Covered
from mcstudy.identification.sway import PredictedSway
from mcstudy.identification.trades import Valley, moving
from mcstudy.lines.part_fits import PartFit, parts_dict
from mcstudy.recordings.joint_recording import AnyRecording, JointRecording, part_labels
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import members

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, repr=False)
class FitRecord:
    """Parameters of one person.

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
    without
        Minima of the model without effects (`Minima`); None if none were added.
    recording
        The fitted recording; several of one kind are pooled, of different kinds they are a `JointRecording`. None for
        lines alone.
    valleys
        Parameters that trade for each other (`Valley`); empty for lines alone, as are all that follow.
    stability
        Stability of the closed loop over the intervals (`Stability`).
    sway
        Predicted and measured sway (`PredictedSway`); None for a published response.
    forecasts
        What would make the intervals narrower (`Forecast`).
    gap
        The test of ``mcstudy gap diagnose --fast`` (`GapFound`).
    comparison
        The model with the added effects against that without (`WithEffects`); None if none were added.
    paper
        (P,), estimates under the cost of Goodworth & Peterka (2018), for comparison; None without a period.
    part_fits
        Goodness of fit of each recording of a joint set (`PartFit`); empty for a single recording.
    averaged
        The quantities averaged over causes (`Averaged`); None where there is no gap, or if not wanted.
    coverage
        How often intervals of similar simulated recordings hold the truth (`Coverage`); None where none were simulated.
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
    method: FitMethod
    without: Minima | None = None
    recording: AnyRecording | None = None
    valleys: tuple[Valley, ...] = ()
    stability: Stability | None = None
    sway: PredictedSway | None = None
    forecasts: tuple[Forecast, ...] = ()
    gap: GapFound | None = None
    comparison: WithEffects | None = None
    paper: np.ndarray | None = None
    part_fits: tuple[PartFit, ...] = ()
    coverage: Coverage | None = None
    averaged: Averaged | None = None

    @property
    def parts(self) -> tuple[Self, ...]:
        """The fit as seen in each of its recordings: its lines, and the responses to its stimulus.

        Estimates and all else are those of all recordings. A single recording is its own part.
        """
        if len(self.lines.parts) == 1:
            return (self,)
        recordings = self.recording.parts if isinstance(self.recording, JointRecording) else (None,) * len(self.labels)
        several = zip(self.labels, self.lines.parts, members(self.model), recordings, strict=True)
        return tuple(
            replace(self, name=name, lines=lines, model=model, recording=recording)
            for name, lines, model, recording in several
        )

    @property
    def labels(self) -> tuple[str, ...]:
        """What each part is called."""
        return part_labels(self.recording, len(self.lines.parts))

    @property
    def without_chi2(self) -> float | None:
        """Squared residual of the best fit without effects; None if none were added."""
        return None if self.without is None else float(self.without.chi2[0])

    def forecast(self, name: str) -> Forecast | None:
        """The forecast for one quantity; None for lines alone."""
        return next((f for f in self.forecasts if f.name == name), None)

    def covered(self, name: str) -> Covered | None:
        """How often simulated intervals of one quantity hold the truth; None where this was not simulated."""
        return None if self.coverage is None else self.coverage.quantities.get(name)

    def moving(self, name: str) -> dict[str, tuple[float, float]]:
        """Parameters that move along the profile of a quantity, with their values at its lower and upper end."""
        return moving(self.model, self.estimates, self[name])

    def on_bound(self, name: str) -> bool:
        """Whether the estimate of a parameter lies on one of its bounds."""
        model = self.model
        if name not in model.names:
            return False
        k = model.names.index(name)
        return bool(self.theta[k] <= model.lower[k] or self.theta[k] >= model.upper[k])

    def leaning(self, name: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Other parameters that lie on a bound at the lower and at the upper end of an interval that the data end.

        With wider bounds of these the interval might be wider.
        """
        e, m = self[name], self.model

        def held(theta: np.ndarray, ended: str) -> tuple[str, ...]:
            on = (theta <= m.lower) | (theta >= m.upper)
            return tuple(n for n, x in zip(m.names, on, strict=True) if x and n != name and ended == "data")

        return held(e.profile.low_theta, e.low_from), held(e.profile.high_theta, e.high_from)

    def paper_value(self, name: str) -> float | None:
        """The estimate of a parameter, or of a sum of parameters, under the paper's cost; None where there is none."""
        terms = name.split(" + ")
        if self.paper is None or not set(terms) <= set(self.model.names):
            return None
        return float(sum(self.paper[self.model.names.index(t)] for t in terms))

    def __getitem__(self, name: str) -> Estimate:
        for e in self.estimates:
            if e.name == name:
                return e
        raise KeyError(f"{name!r}; expected one of {', '.join(e.name for e in self.estimates)}")

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON data, valid under ``results_schema/1.0.0/fit.json``."""
        m = self.minima
        return plain(
            {
                "schema": schema.identifier("fit"),
                "name": self.name,
                "level": self.level,
                "quantities": [self._quantity(e) for e in self.estimates],
                "bands_hz": BANDS_HZ[1:-1],
                "parameters": {**named(self.model, "names", "lower", "upper"), "correlation": self.correlation},
                "fit": {
                    "chi2": self.chi2,
                    "expected": self.expected_chi2,
                    "p_value": self.p_value,
                    "lines": len(self.lines),
                    "without_effects": self.without_chi2,
                    "growth_rate": self.growth_rate,
                },
                "search": {
                    **named(m, "starts", "missed", "lowest_from"),
                    **({} if m.missed_lowest is None else {"missed_lowest": m.missed_lowest}),
                    "minima": [
                        {"rise": c - m.chi2[0], "hits": h, "parameters": t}
                        for c, h, t in zip(m.chi2, m.hits, m.theta, strict=True)
                        if c - m.chi2[0] < TOLD
                    ],
                },
                **named(self, "valleys", "stability"),
                "sway": self.sway and self.sway.to_dict(),
                "coverage": self.coverage and self.coverage.to_dict(),
                **named(self, "gap", "comparison", "warnings"),
                **({} if self.averaged is None else {"averaged": self.averaged.to_dict()}),
                "method": self.method.to_dict(),
                **parts_dict(self.labels, self.part_fits),
            }
        )

    def _quantity(self, e: Estimate) -> dict[str, Any]:
        low_leans_on, high_leans_on = self.leaning(e.name)
        forecast, covered = self.forecast(e.name), self.covered(e.name)
        names = ("name", "unit", "estimate", "low", "high", "low_from", "high_from", "wald_low", "wald_high", "verdict")
        return {
            **named(e, *names),
            "on_bound": self.on_bound(e.name),
            "low_leans_on": low_leans_on,
            "high_leans_on": high_leans_on,
            "paper_cost": self.paper_value(e.name),
            "moves_with": self.moving(e.name),
            "forecast": forecast and {name: value for name, value in named(forecast).items() if name != "name"},
            "coverage": covered and covered.to_dict(),
            "information": e.information,
            "profile": named(e.profile, "value", "rise"),
        }

    def to_xarray(self) -> xr.Dataset:
        """Estimates, intervals and class by ``quantity``, the profiles as (quantity, point), padded with nan.

        Quantities have different units, so these are the coordinate ``unit``.
        """
        import xarray as xr

        es, units = self.estimates, {"units": "see coordinate unit"}
        longest = max(e.profile.value.size for e in es)

        def padded(name: str) -> np.ndarray:
            rows = [getattr(e.profile, name) for e in es]
            return np.array([np.pad(r, (0, longest - r.size), constant_values=np.nan) for r in rows])

        covered = [self.covered(e.name) for e in es]
        columns = {
            name: ([getattr(e, name) for e in es], {"long_name": long_name, **more})
            for name, long_name, more in (
                ("estimate", "estimate", units),
                ("low", "lower end of the profile likelihood interval", units),
                ("high", "upper end of the profile likelihood interval", units),
                ("wald_low", "lower end of the Gauss-Newton interval", units),
                ("wald_high", "upper end of the Gauss-Newton interval", units),
                ("low_from", "what ends it below", {}),
                ("high_from", "what ends it above", {}),
            )
        }
        columns["coverage"] = (
            [np.nan if c is None else c.percent for c in covered],
            {"long_name": "simulated intervals that hold the truth", "units": "percent"},
        )
        columns["class"] = [e.verdict for e in es], {"long_name": "whether the data determine it"}
        rise = {"long_name": "squared residual above the lowest", "units": "1"}
        points = ("quantity", "point")
        return xr.Dataset(
            {
                **{name: ("quantity", *column) for name, column in columns.items()},
                "profile_value": (points, padded("value"), {"long_name": "value on the profile", **units}),
                "profile_rise": (points, padded("rise"), rise),
            },
            coords={"quantity": [e.name for e in es], "unit": ("quantity", [e.unit for e in es])},
            attrs={"level": self.level, "recording": self.name, "p_value": self.p_value},
        )
