"""The record of a design: the stimulus, what it promises, and what the Monte Carlo study gave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from mcstudy.errors import InputError
from mcstudy.files.json_files import plain
from mcstudy.files.schema import identifier
from mcstudy.stance.line_stimulus import LineStimulus
from mcstudy.stimulus_design.bodies import model_of
from mcstudy.stimulus_design.evoked_sway import OTHER, OtherBodies, drawn_costs, ratios
from mcstudy.stimulus_design.spectrum import Designed, Size, noise_sway, predicted, size_of
from mcstudy.stimulus_design.verify import STIMULI, Spread, bodies_of, costs, spreads, study_of
from mcstudy.study.design import Study


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
class StimulusDesignRecord:
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
                    **self._sway("sway_rms", s.sway),
                }
                for name, s in zip(STIMULI, self.sizes, strict=True)
            },
            **self._sway("noise_sway_rms", self.noise_sway),
            "parameters": list(self.names),
            "predicted_cv": _by_stimulus(self.cv),
            "predicted_cv_with_bounds": _by_stimulus(self.bounded_cv),
            "other_bodies": asdict(self.others),
            "differences": self._differences(),
            "verification": [_spread(s) for s in self.spreads],
            "bodies": [
                {"predicted_ratio": b.predicted, "sway_ratio": b.sway, "found": b.found and _spread(b.found)}
                for b in self.bodies
            ],
        }
        return dict(plain(value))

    def _sway(self, name: str, rms: np.ndarray) -> dict[str, np.ndarray]:
        """The RMS of all outputs: in deg if they are angles in rad, else in their units."""
        angles = set(self.designed.model.output_units) == {"rad"}
        return {f"{name}_deg": np.degrees(rms)} if angles else {name: rms}

    def _differences(self) -> list[dict[str, Any]]:
        difference = self.designed.difference
        if difference is None:
            return []
        return [
            {"effect": name, "sizes": sizes, **_by_stimulus(distances)}
            for name, sizes, distances in zip(difference.effects, difference.sizes, self.distances.T, strict=True)
        ]


def _by_stimulus(pair: Sequence[Any] | np.ndarray) -> dict[str, Any]:
    return dict(zip(STIMULI, pair, strict=True))


def _spread(s: Spread) -> dict[str, Any]:
    return {
        "cost": s.cost,
        "fmax_hz": s.fmax,
        "realizations": s.n,
        **{name: _by_stimulus(getattr(s, name)) for name in ("cv", "bias", "at_bound")},
        "ratio": s.ratio,
        "ratio_error": s.ratio_error,
        "mean_ratio": s.mean,
        "mean_ratio_error": s.mean_error,
    }


def design_record(designed: Designed, results: xr.DataTree | None = None) -> StimulusDesignRecord:
    """The record of a design and, where it was verified, of the cube of its verification."""
    file, model = designed.file, designed.model
    powers = designed.before, designed.after
    cv, bounded_cv = (
        np.stack([predicted(file, model, designed.f, p, bounded) for p in powers]) for bounded in (False, True)
    )
    bodies = []
    for n, section in enumerate(bodies_of(designed)):
        body = model_of(file, section)
        sequence, design = (predicted(file, body, designed.f, p, bounded=True) for p in powers)
        sway = size_of(body, designed.stimulus).sway / size_of(body, designed.sequence).sway
        fits = None if results is None else spreads(results, f"body{n + 1:02d}_", "ml")[0]
        bodies.append(BodyCheck(geometric_mean(sequence / design), float(sway.max()), fits))
    unknown = drawn_costs(file, model, OTHER, "others", designed.sequence, designed.f)
    difference = designed.difference
    return StimulusDesignRecord(
        designed=designed,
        cv=cv,
        bounded_cv=bounded_cv,
        sizes=(size_of(model, designed.sequence), size_of(model, designed.stimulus)),
        noise_sway=noise_sway(file, model),
        others=OtherBodies.of(ratios(unknown, designed.after), file.limits.sway),
        spreads=() if results is None else tuple(s for cost in costs(file) for s in spreads(results, "", cost)),
        bodies=tuple(bodies),
        distances=np.zeros((2, 0)) if difference is None else np.stack([difference.distances(p) for p in powers]),
    )


def geometric_mean(values: np.ndarray) -> float:
    """Of all ``values``."""
    return float(np.exp(np.log(values).mean()))
