"""What one group of a study measures and fits: frequency points, data of a realization, problems and starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mcstudy.errors import DesignError, InputError
from mcstudy.fit.problem import Problem, ml_cost, paper_cost
from mcstudy.fit.starts import uniform
from mcstudy.spectra import periods
from mcstudy.spectra.bands import PERIOD_S, Bands, averaged, narrower, odd_lines, published
from mcstudy.spectra.estimate import SpectralExperiment
from mcstudy.stance.feedback import Model
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.stimulus import Prts
from mcstudy.study.design import Group
from mcstudy.study.models import build_model
from mcstudy.study.streams import noise_stream, start_stream

MAX_SAMPLES = 200_000_000
"""Longest record a study may ask for."""

HIGHEST_HZ = 8.0
"""Highest frequency point, whatever the Fmax: the points, and with them the data, do not depend on the fits."""

SPECTRUM = {"keep": periods.raw, "remove": periods.ramp_removed}


def stimulus(group: Group, amplitude: float) -> Prts:
    """The stimulus of a group at one amplitude."""
    s = group.stimulus
    return Prts(s.stages, s.state_s, s.rate_hz, amplitude, s.convention)


def frequency_points(group: Group) -> Bands:
    """All frequency points of a group, before any is left out."""
    period = stimulus(group, group.amplitude[0]).period_s
    if group.spectra.points == "odd_lines":
        return odd_lines(HIGHEST_HZ, period)
    return narrower((published if group.spectra.points == "published" else averaged)(period), group.spectra.width)


def kept_points(group: Group) -> Bands:
    """The frequency points of a group."""
    bands = frequency_points(group)
    for f in group.spectra.exclude_hz:
        bands = bands.without(f)
    return bands


def check(group: Group) -> None:
    """Everything about a group that only the physics can tell is wrong.

    Raises `DesignError`; the message starts with the field, relative to the group.
    """
    parameters = len(build_model(group).parameters)
    s = group.stimulus
    try:
        prts = stimulus(group, group.amplitude[0])
    except InputError as error:
        raise DesignError(str(error).replace("stimulus ", "stimulus.", 1)) from None
    if s.discard >= s.cycles:
        raise DesignError(f"stimulus.discard: expected fewer than cycles = {s.cycles}, got {s.discard}")
    if prts.samples * s.cycles > MAX_SAMPLES:
        raise DesignError(f"stimulus.cycles: expected a record of at most {MAX_SAMPLES} samples")
    if s.rate_hz < 4 * HIGHEST_HZ:
        raise DesignError(f"stimulus.rate_hz: expected at least {4 * HIGHEST_HZ} Hz, got {s.rate_hz}")
    if group.spectra.ramp == "remove" and s.discard == 0:
        raise DesignError("spectra.ramp: expected 'keep' when stimulus.discard = 0 (the ramp needs a sample before)")
    if group.spectra.points != "odd_lines" and abs(prts.period_s - PERIOD_S) > 1e-9:
        raise DesignError(
            f"spectra.points: expected 'odd_lines' for a period other than {PERIOD_S} s, got {group.spectra.points!r}"
        )
    if group.spectra.points == "odd_lines" and group.spectra.width != 1:
        raise DesignError(
            f"spectra.width: expected 1 for points 'odd_lines' (one line each), got {group.spectra.width}"
        )
    points, half_line = frequency_points(group).f, 0.5 / prts.period_s
    if group.fmax[0] < points[0] - half_line:
        raise DesignError(f"fmax: expected at least {points[0]:.4g} Hz, the first frequency, got {group.fmax[0]}")
    last = max(points[-1], HIGHEST_HZ)
    if group.fmax[-1] > last + half_line:
        raise DesignError(f"fmax: expected at most {last:.4g} Hz, the last frequency, got {group.fmax[-1]}")
    for f in group.spectra.exclude_hz:
        if np.abs(points - f).min() > half_line:
            raise DesignError(f"spectra.exclude_hz: expected frequencies of the FRF, got {f}")
    if group.simulator == "none" and group.fit.cost == "ml":
        raise DesignError("fit.cost: expected 'paper' with simulator 'none' (there is no noise to weigh by), got 'ml'")
    try:
        smallest = len(kept_points(group).below(group.fmax[0]))
    except InputError:
        smallest = 0
    if 4 * smallest < parameters:
        raise DesignError(
            f"fmax: expected at least {-(-parameters // 4)} frequencies for {parameters} parameters, "
            f"{group.fmax[0]} Hz leaves {smallest}"
        )


@dataclass(frozen=True)
class Measurement:
    """Data of one cell: FRFs (N, 2) in rad per unit of stimulus, and their covariance (N, 2, 2) or None."""

    frf: np.ndarray
    covariance: np.ndarray | None


class Experiment:
    """One group of a study, with everything that does not depend on the cell prepared once; safe to share by threads.

    Parameters
    ----------
    group: the resolved group.
    seed: seed of the study.
    model: fitted instead of the one the group describes (`mcstudy.study.own_model`).
    """

    def __init__(self, group: Group, seed: int, model: Model | None = None) -> None:
        self.group, self.seed = group, seed
        self.model: Model = build_model(group) if model is None else model
        self.bands = kept_points(group)
        self.f = self.bands.f
        self.n_frequencies = tuple(len(self.bands.below(fmax)) for fmax in group.fmax)
        self.true_frf = frf(self.model, self.model.truth, self.f)
        self.measure: Callable[[float, int], Measurement] = {
            "none": self._noise_free,
            "spectral": self._spectral(),
        }[group.simulator]

    def _noise_free(self, amplitude: float, realization: int) -> Measurement:
        """The closed form at the points' own frequencies: what the paper's noise-free fits use."""
        del amplitude, realization
        return Measurement(self.true_frf, None)

    def _spectral(self) -> Callable[[float, int], Measurement]:
        group, s = self.group, self.group.stimulus
        noise = SensorNoise(group.noise.psd, group.noise.corner_hz)
        subject = SpectralExperiment(
            self.model,
            self.model.truth,
            stimulus(group, 1.0),
            noise,
            self.bands,
            s.cycles,
            s.discard,
            SPECTRUM[group.spectra.ramp],
        )

        def measure(amplitude: float, realization: int) -> Measurement:
            return Measurement(*subject.frf(subject.realization(noise_stream(self.seed, realization)), amplitude))

        return measure

    def problem(self, data: Measurement, fmax: float) -> Problem:
        """The fit problem of a measurement on the frequencies up to ``fmax``."""
        n = len(self.bands.below(fmax))
        if self.group.fit.cost == "ml":
            assert data.covariance is not None  # `check` refuses ml without noise
            return ml_cost(self.model, self.f[:n], data.frf[:n], data.covariance[:n])
        return paper_cost(self.model, self.f[:n], data.frf[:n])

    def starts(self, problem: Problem, realization: int) -> np.ndarray:
        """All starts of one realization, (starts, P)."""
        return uniform(problem.model, start_stream(self.seed, realization), self.group.starts)
