"""Simulators: the data of one cell, for each simulator that a study file may name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np

from mcstudy.spectra.bands import Bands, averaged, narrower, odd_lines, published
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import members
from mcstudy.stance.line_stimulus import LineStimulus, Stimulus
from mcstudy.stance.response import frf
from mcstudy.stance.stimulus import Prts
from mcstudy.streams import noise_stream
from mcstudy.study.group import Group, LinesSection

if TYPE_CHECKING:
    from mcstudy.spectra.estimate import SpectralExperiment, SpectrumNoise

# Simulators and solvers are imported by the functions that use them: who only reads a cube needs neither, and to load
# numba and SciPy for them takes longer than all else.

KEPT_REALIZATIONS = 512
"""Noise realizations kept in memory per group, about 30 kB each, to be used again at the other amplitudes."""


def spectrum(group: Group) -> Callable[[np.ndarray, int, int], np.ndarray]:
    """The spectrum of a record, with or without its ramp."""
    from mcstudy.spectra import periods

    return {"keep": periods.raw, "remove": periods.ramp_removed}[group.spectra.ramp]


@dataclass(frozen=True)
class Measurement:
    """Data of one cell: FRFs (N, Y), outputs' units per unit of stimulus, and their covariance (N, Y, Y) or None."""

    frf: np.ndarray
    covariance: np.ndarray | None


Measuring = Callable[[float, int], Measurement]
"""From amplitude (units of the stimulus) and realization to data; safe to call from several threads."""

Stream = Callable[[int], np.random.Generator]
"""From realization to its random numbers."""


def stimulus(group: Group, amplitude: float) -> Stimulus:
    """The stimulus of a group at one amplitude."""
    s = group.stimulus
    sequence = Prts(s.stages, s.state_s, s.rate_hz, amplitude, s.convention)
    if s.lines == LinesSection():
        return sequence
    x = s.lines
    return LineStimulus(x.harmonic, x.weight, x.phase_deg, sequence.samples, s.rate_hz, amplitude, s.convention)


def frequency_points(group: Group) -> Bands:
    """All frequency points of a group, before any is left out; lines without stimulus are in none."""
    period = stimulus(group, group.amplitude[0]).period_s
    if group.spectra.points == "odd_lines":
        points = odd_lines(group.spectra.highest_hz, period)
    else:
        points = narrower((published if group.spectra.points == "published" else averaged)(period), group.spectra.width)
    return points.among(group.stimulus.lines.harmonic) if group.stimulus.lines.harmonic else points


def kept_points(group: Group) -> Bands:
    """The frequency points of a group."""
    bands = frequency_points(group)
    for f in group.spectra.exclude_hz:
        bands = bands.without(f)
    return bands


def noise_free(group: Group, model: Model, bands: Bands, stream: Stream) -> Measuring:
    """The closed form at the points' own frequencies: what the paper's noise-free fits use."""
    del group, stream
    data = Measurement(frf(model, model.truth, bands.f), None)
    return lambda amplitude, realization: data  # noqa: ARG005


def spectral(group: Group, model: Model, bands: Bands, stream: Stream) -> Measuring:
    """Ideal response plus the spectrum of steady-state noise sway: the paper's "sim" FRF."""
    s = group.stimulus

    @cache
    def subject() -> SpectralExperiment:  # made for the first cell only: reading a cube does not need it
        from mcstudy.spectra.estimate import SpectralExperiment

        noise = group.noise_source
        unit = stimulus(group, 1.0)
        recorded = group.measurement_noise
        return SpectralExperiment(
            model, model.truth, unit, noise, bands, s.cycles, s.discard, spectrum(group), recorded
        )

    @lru_cache(maxsize=KEPT_REALIZATIONS)
    def drawn(realization: int) -> SpectrumNoise:
        return subject().realization(stream(realization))

    def measure(amplitude: float, realization: int) -> Measurement:
        return Measurement(*subject().frf(drawn(realization), amplitude))

    def through_loop(amplitude: float, realization: int) -> Measurement:
        from mcstudy.fitting.linearised import linearised
        from mcstudy.fitting.problem import ml_cost
        from mcstudy.fitting.solvers import fit

        first = ml_cost(model, bands.f, *subject().frf(drawn(realization), amplitude))
        fits = fit(first, linearised(first, np.random.default_rng(), 1))  # the first start uses no random numbers
        return Measurement(*subject().frf(subject().through_loop(drawn(realization), fits.estimate[0]), amplitude))

    def known(amplitude: float, realization: int) -> Measurement:
        return Measurement(*subject().frf(subject().known(drawn(realization)), amplitude))

    return {"even_lines": measure, "through_loop": through_loop, "true": known}[group.spectra.covariance]


def time_domain(group: Group, model: Model, bands: Bands, stream: Stream) -> Measuring:
    """FRFs of a record simulated with stimulus and noise together, from rest and with true delays."""
    s = group.stimulus

    def measure(amplitude: float, realization: int) -> Measurement:
        from mcstudy.spectra.estimate import frf_from_recording
        from mcstudy.stance.simulate_time import simulate, with_derivatives
        from mcstudy.study.effects import in_time, refuse_fallen

        noise = group.noise_source
        cycle = stimulus(group, amplitude).waveform()
        drive = np.tile(cycle, s.cycles)
        samples = np.tile(with_derivatives(cycle, s.rate_hz), (s.cycles, 1)) if model.senses_motion else drive
        rng, measured = stream(realization), group.measurement_noise
        sensed = noise.sample(rng, drive.size, s.rate_hz)
        how = in_time(group, model, amplitude, drive.size, rng)
        recorded = simulate(model, model.truth, samples, s.rate_hz, noise=sensed, **how).theta
        refuse_fallen(group, recorded, amplitude)
        if measured is not None:
            recorded = recorded + measured.sample(rng, drive.size)
        data = frf_from_recording(recorded, drive, s.rate_hz, bands, s.discard, spectrum(group))
        return Measurement(data.frf, data.covariance)

    return measure


SIMULATORS: dict[str, Callable[[Group, Model, Bands, Stream], Measuring]] = {
    "none": noise_free,
    "spectral": spectral,
    "time_domain": time_domain,
}
"""Simulators by the name a study file gives them."""


def measuring(group: Group, model: Model, bands: Bands, seed: int) -> Measuring:
    """The simulator of a group; under J stimuli, each in a recording of its own, every point J times in turn."""
    simulator = SIMULATORS[group.simulator]
    each = [simulator(group, m, bands, partial(noise_stream, seed, stimulus=k)) for k, m in enumerate(members(model))]
    if len(each) == 1:
        return each[0]

    def measure(amplitude: float, realization: int) -> Measurement:
        found = [of_one(amplitude, realization) for of_one in each]
        covariances = [m.covariance for m in found if m.covariance is not None]
        covariance = _in_turn(covariances) if covariances else None
        return Measurement(_in_turn([m.frf for m in found]), covariance)

    return measure


def _in_turn(arrays: list[np.ndarray]) -> np.ndarray:
    """J arrays (N, ...) as (N J, ...), the J of a point after each other."""
    return np.stack(arrays, axis=1).reshape(-1, *arrays[0].shape[1:])
