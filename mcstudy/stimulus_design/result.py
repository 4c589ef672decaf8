"""What a design found: the stimulus, what it promises, what the Monte Carlo study gave, and the files of all that."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from mcstudy.errors import InputError
from mcstudy.files.csv_text import csv_text
from mcstudy.files.json_files import plain
from mcstudy.files.schema import identifier
from mcstudy.short_repr import Summary
from mcstudy.stance.line_stimulus import LineStimulus
from mcstudy.stimulus_design.bodies import model_of
from mcstudy.stimulus_design.evoked_sway import OTHER, OtherBodies, drawn_costs, ratios
from mcstudy.stimulus_design.spectrum import Designed, Size, noise_sway, predicted, size_of
from mcstudy.stimulus_design.verify import Spread, bodies_of, costs, spreads, study_of
from mcstudy.study.design import Study

DOCUMENT = "design.json"
"""File of a design, in its folder."""


@dataclass(frozen=True, eq=False)
class BodyCheck:
    """One body of the verification: predicted and found geometric mean ratios of the SDs, and of the evoked sway.

    Attributes
    ----------
    predicted: ratio of SDs at the Cramer-Rao bound, with the bounds of the fit. sway: largest ratio of the sway RMS
    of the angles, design over sequence. found: the spread of the fits, None without
    verification.
    """

    predicted: float
    sway: float
    found: Spread | None


@dataclass(frozen=True, eq=False, repr=False)
class StimulusDesign(Summary):
    """An optimal stimulus and how it was verified.

    Attributes
    ----------
    designed
        The stimulus, its spectrum and its limits.
    cv
        Predicted coefficients of variation with sequence and design, up to ``design.fmax``, (2, P).
    bounded_cv
        The same with what the bounds of the fit add, (2, P).
    sizes
        Of sequence and design: RMS, peak, rate, crest factor, evoked sway.
    noise_sway
        RMS of the sway that the noise alone evokes, rad, (A,).
    others
        How much bodies sway that neither the design nor its calibration knew (`OtherBodies`).
    spreads
        Of the fits for the body of the file; empty without verification.
    bodies
        The same for the other bodies.
    distances
        Of every effect of the criterion "difference" from what the model can give without it, with sequence and
        design, in standard deviations, (2, E); E is 0 for the other criteria.
    """

    designed: Designed
    cv: np.ndarray
    bounded_cv: np.ndarray
    sizes: tuple[Size, Size]
    noise_sway: np.ndarray
    others: OtherBodies
    spreads: tuple[Spread, ...] = ()
    bodies: tuple[BodyCheck, ...] = ()
    distances: np.ndarray = field(default_factory=lambda: np.zeros((2, 0)))

    @classmethod
    def of(cls, designed: Designed, results: xr.DataTree | None = None) -> StimulusDesign:
        """From a design and, where it was verified, the cube of its verification."""
        file, model = designed.file, designed.model
        powers = designed.before, designed.after
        cv, bounded_cv = (
            np.stack([predicted(file, model, designed.f, p, bounded) for p in powers]) for bounded in (False, True)
        )
        sizes = size_of(model, designed.sequence), size_of(model, designed.stimulus)
        found: list[Spread] = []
        bodies: list[BodyCheck] = []
        if results is not None:
            found = [s for cost in costs(file) for s in spreads(results, "", cost)]
        for n, section in enumerate(bodies_of(designed)):
            body = model_of(file, section)
            both = [predicted(file, body, designed.f, p, bounded=True) for p in powers]
            one, other = size_of(body, designed.sequence), size_of(body, designed.stimulus)
            bodies.append(
                BodyCheck(
                    float(np.exp(np.log(both[0] / both[1]).mean())),
                    float((other.sway / one.sway).max()),
                    None if results is None else spreads(results, f"body{n + 1:02d}_", "ml")[0],
                )
            )
        unknown = drawn_costs(file, model, OTHER, "others", designed.sequence, designed.f)
        others = OtherBodies.of(ratios(unknown, designed.after), file.limits.sway)
        shown = designed.difference
        distances = np.zeros((2, 0)) if shown is None else np.stack([shown.distances(p) for p in powers])
        noise = noise_sway(file, model)
        return cls(designed, cv, bounded_cv, sizes, noise, others, tuple(found), tuple(bodies), distances)

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters."""
        return tuple(self.designed.model.names)

    @property
    def stimulus(self) -> LineStimulus:
        """The designed stimulus."""
        return self.designed.stimulus

    @property
    def study(self) -> Study:
        """A study of the design and of the sequence."""
        return study_of(self.designed)

    @property
    def predicted_ratio(self) -> np.ndarray:
        """Predicted ratio of the standard deviations, sequence over design, (P,)."""
        return np.asarray(self.cv[0] / self.cv[1])

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        gain = float(np.exp(np.log(self.predicted_ratio).mean()))
        facts = [("lines", str(len(self.stimulus.harmonic))), ("predicted reduction of SD", f"x{gain:.3g}")]
        if self.distances.size:
            facts.append(("distance of the models", f"x{float((self.distances[1] / self.distances[0]).min()):.3g}"))
        return [*facts, ("verified", f"x{self.spreads_at_fmax.mean:.3g}" if self.spreads else "no")]

    @property
    def spreads_at_fmax(self) -> Spread:
        """The spread of maximum likelihood at the highest Fmax of the verification."""
        return max((s for s in self.spreads if s.cost == "ml"), key=lambda s: s.fmax)

    def waveform(self, rate_hz: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """One cycle of the design.

        Parameters
        ----------
        rate_hz
            Sampling rate, with a whole number of samples in a cycle; that of the design file when 0.

        Returns
        -------
        tuple
            Times, s, and the stimulus in its unit, each (n,).

        Raises
        ------
        InputError
            The rate does not suit the cycle or is below twice the highest line.
        """
        rate = rate_hz or self.designed.file.design.waveform_rate_hz or self.stimulus.rate_hz
        s = self.stimulus
        n = round(s.period_s * rate)
        if abs(s.period_s * rate - n) > 1e-6 or n <= 2 * s.harmonic[-1]:
            raise InputError(
                f"rate_hz: expected a whole number of samples in a cycle of {s.period_s:g} s, and more than "
                f"{2 * s.harmonic[-1] / s.period_s:g} Hz, got {rate:g}"
            )
        t = np.arange(n) / rate
        c, k = s.coefficients()[list(s.harmonic)], np.array(s.harmonic)
        spectrum = np.zeros(n // 2 + 1, dtype=complex)
        spectrum[k] = c
        return t, np.fft.irfft(spectrum, n, norm="forward")

    def csv(self) -> str:
        """The waveform of one cycle as text."""
        t, u = self.waveform()
        unit = self.designed.model.stimulus_unit
        rows = ((f"{a:.6f}", f"{b:.9g}") for a, b in zip(t, u, strict=True))
        return csv_text(["time (s)", f"stimulus ({unit})"], rows)

    def text(self) -> str:
        """The tables that ``mcstudy design`` prints."""
        from mcstudy.stimulus_design.words import text

        return text(self)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain values, in the form of the schema ``stimulus_design``."""
        d, file = self.designed, self.designed.file
        value = {
            "schema": identifier("stimulus_design"),
            "design_file": file.model_dump(mode="json"),
            "stimulus_unit": d.model.stimulus_unit,
            "cycles": file.cycles,
            "period_s": d.stimulus.period_s,
            "amplitude": d.stimulus.amplitude,
            "lines": d.lines.model_dump(mode="json"),
            "spectrum": {"frequency_hz": d.f, "sequence": d.before, "design": d.after, "detection": d.empty},
            "optimality_gap": d.optimum.gap,
            "limits_used": d.limits,
            "size": {
                name: {
                    "rms": s.rms,
                    "peak": s.peak,
                    "rate_rms": s.rate,
                    "crest_factor": s.crest_factor,
                    "sway_rms_deg": np.degrees(s.sway),
                }
                for name, s in zip(("sequence", "design"), self.sizes, strict=True)
            },
            "noise_sway_rms_deg": np.degrees(self.noise_sway),
            "parameters": list(self.names),
            "predicted_cv": {"sequence": self.cv[0], "design": self.cv[1]},
            "predicted_cv_with_bounds": {"sequence": self.bounded_cv[0], "design": self.bounded_cv[1]},
            "other_bodies": asdict(self.others),
            "differences": self._differences(),
            "verification": [_spread(s) for s in self.spreads],
            "bodies": [
                {
                    "predicted_ratio": b.predicted,
                    "sway_ratio": b.sway,
                    "found": None if b.found is None else _spread(b.found),
                }
                for b in self.bodies
            ],
        }
        return dict(plain(value))

    def _differences(self) -> list[dict[str, Any]]:
        shown = self.designed.difference
        if shown is None:
            return []
        return [
            {"effect": name, "sizes": sizes, "sequence": one, "design": other}
            for name, sizes, one, other in zip(shown.effects, shown.sizes, *self.distances, strict=True)
        ]

    def write(self, out: Path) -> None:
        """Write ``design.json``, ``waveform.csv`` and ``study.toml`` into a folder."""
        from mcstudy.files.json_files import ensure_folder, write_json, write_text

        ensure_folder(out)
        write_json(out / DOCUMENT, self.to_dict(), "stimulus_design")  # first: it marks the folder as a design's
        write_text(out / "waveform.csv", self.csv())
        write_text(out / "study.toml", self.study.to_toml().rstrip("\n"))


def _spread(s: Spread) -> dict[str, Any]:
    pairs = {"cv": s.cv, "bias": s.bias, "at_bound": s.at_bound}
    return {
        "cost": s.cost,
        "fmax_hz": s.fmax,
        "realizations": s.n,
        **{name: {"sequence": value[0], "design": value[1]} for name, value in pairs.items()},
        "ratio": s.ratio,
        "ratio_error": s.ratio_error,
        "mean_ratio": s.mean,
        "mean_ratio_error": s.mean_error,
    }
