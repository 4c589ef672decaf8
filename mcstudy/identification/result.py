"""The outcome of a fit: estimates with intervals, where each comes from, and whether to believe the model."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from mcstudy.files import schema
from mcstudy.files.json_files import plain
from mcstudy.identification import tables, words
from mcstudy.identification.belief import GapFound, WithEffects
from mcstudy.identification.forecast import Forecast
from mcstudy.identification.loop_stability import Stability
from mcstudy.identification.minimum import Minima
from mcstudy.identification.profile import Profile
from mcstudy.identification.settings import FitMethod
from mcstudy.identification.simulated_coverage import Coverage, Covered
from mcstudy.identification.sway import PredictedSway
from mcstudy.identification.trades import Valley, moving
from mcstudy.lines.part_fits import PartFit, parts_dict
from mcstudy.recordings.joint_recording import AnyRecording, JointRecording, part_labels
from mcstudy.short_repr import Summary, shortened
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import members
from mcstudy.text_tables import p_words

if TYPE_CHECKING:
    import xarray as xr


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
        (the search did not converge: the interval extends at least to there).
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
        return f"{self.name} = {words.with_unit(self)}"

    @property
    def verdict(self) -> str:
        """One of "identifiable", "lower limit only", "upper limit only" or "not identifiable"."""
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

    more: ClassVar[str] = "text(), to_xarray(), to_dict()"
    """Further methods, named in the representation at a prompt."""

    @property
    def parts(self) -> tuple[Self, ...]:
        """The fit as seen in each of its recordings: its lines, and the responses to its stimulus.

        Estimates and all else are those of all recordings. A single recording is its own part.
        """
        if len(self.lines.parts) == 1:
            return (self,)
        recordings = self.recording.parts if isinstance(self.recording, JointRecording) else (None,) * len(self.labels)
        several = zip(self.labels, self.lines.parts, members(self.model), recordings, strict=True)
        return tuple(replace(self, name=n, lines=own, model=m, recording=r) for n, own, m, r in several)

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

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        return [
            ("recording", shortened(self.name)),
            *((e.name, words.with_unit(e)) for e in self.estimates),
            ("goodness of fit", p_words(self.p_value)),
            *(("note", note) for note in self.warnings),
            ("more", self.more),
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
                        "on_bound": tables.on_bound(self, e),
                        "low_leans_on": self.leaning(e.name)[0],
                        "high_leans_on": self.leaning(e.name)[1],
                        "paper_cost": self.paper_value(e.name),
                        "moves_with": self.moving(e.name),
                        "forecast": without_name(self.forecast(e.name)),
                        "coverage": None if (c := self.covered(e.name)) is None else c.to_dict(),
                        "information": e.information,
                        "profile": {"value": e.profile.value, "rise": e.profile.rise},
                    }
                    for e in self.estimates
                ],
                "bands_hz": tables.BANDS_HZ[1:-1],
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
                    "lowest_from": m.lowest_from,
                    **({} if m.missed_lowest is None else {"missed_lowest": m.missed_lowest}),
                    "minima": [
                        {"rise": c - m.chi2[0], "hits": h, "parameters": t}
                        for c, h, t in zip(m.chi2, m.hits, m.theta, strict=True)
                        if c - m.chi2[0] < words.REACH
                    ],
                },
                "valleys": [asdict(v) for v in self.valleys],
                "stability": None if self.stability is None else asdict(self.stability),
                "sway": None if self.sway is None else asdict(self.sway),
                "coverage": None if self.coverage is None else self.coverage.to_dict(),
                "gap": None if self.gap is None else asdict(self.gap),
                "comparison": None if self.comparison is None else asdict(self.comparison),
                "warnings": self.warnings,
                "method": self.method.to_dict(),
                **parts_dict(self.labels, self.part_fits),
            }
        )

    def to_xarray(self) -> xr.Dataset:
        """Estimates, intervals and class by ``quantity``, the profiles as (quantity, point), padded with nan.

        Quantities have different units, so these are the coordinate ``unit``.
        """
        import xarray as xr

        es = self.estimates
        longest = max(e.profile.value.size for e in es)

        def padded(name: str) -> np.ndarray:
            rows = [getattr(e.profile, name) for e in es]
            return np.array([np.pad(r, (0, longest - r.size), constant_values=np.nan) for r in rows])

        numbers = {
            "estimate": "estimate",
            "low": "lower end of the profile likelihood interval",
            "high": "upper end of the profile likelihood interval",
            "wald_low": "lower end of the Gauss-Newton interval",
            "wald_high": "upper end of the Gauss-Newton interval",
        }
        texts = {"low_from": "what ends it below", "high_from": "what ends it above"}
        own = {"units": "see coordinate unit"}
        return xr.Dataset(
            {
                **{
                    c: ("quantity", [getattr(e, c) for e in es], {"long_name": name, **own})
                    for c, name in numbers.items()
                },
                **{c: ("quantity", [getattr(e, c) for e in es], {"long_name": name}) for c, name in texts.items()},
                "coverage": (
                    "quantity",
                    [np.nan if (c := self.covered(e.name)) is None else c.percent for e in es],
                    {"long_name": "simulated intervals that hold the truth", "units": "percent"},
                ),
                "class": ("quantity", [e.verdict for e in es], {"long_name": "whether the data determine it"}),
                "profile_value": (("quantity", "point"), padded("value"), {"long_name": "value on the profile", **own}),
                "profile_rise": (
                    ("quantity", "point"),
                    padded("rise"),
                    {"long_name": "squared residual above the lowest", "units": "1"},
                ),
            },
            coords={"quantity": [e.name for e in es], "unit": ("quantity", [e.unit for e in es])},
            attrs={"level": self.level, "recording": self.name, "p_value": self.p_value},
        )


def without_name(f: Forecast | None) -> dict[str, Any] | None:
    """The fields of a forecast without its name."""
    return None if f is None else {k: v for k, v in asdict(f).items() if k != "name"}
