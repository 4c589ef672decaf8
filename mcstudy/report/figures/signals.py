"""Stimulus, noise and sway: Fig. 2A-D, drawn again from the study's own settings and random streams."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib.axes import Axes

from mcstudy.analysis.view import GroupView
from mcstudy.report.axes import axes, frequency_axis, legend_below, log_axis
from mcstudy.report.figures.common import GroupLike, chosen_amplitude, view_of
from mcstudy.report.labels import unit
from mcstudy.report.style import COLOURS, DASHES, MARKERS, SERIES
from mcstudy.spectra import periods
from mcstudy.spectra.intersample import straight_lines
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import members
from mcstudy.stance.line_stimulus import Stimulus
from mcstudy.stance.noise import Noise
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_spectral import NoiseSway, stimulus_sway, sway_psd
from mcstudy.stance.simulate_time import simulate, with_derivatives
from mcstudy.streams import noise_stream
from mcstudy.study.measure import spectrum, stimulus

PIXELS = 480
"""Columns a long record is reduced to; each keeps its smallest and largest sample."""


@dataclass(frozen=True, eq=False)
class Signals:
    """Signals of one realization of a group, at the true parameters; records are (samples, 2), angles in rad.

    Attributes
    ----------
    view
        The group.
    seed
        Seed of the study.
    amplitude
        Amplitude of the stimulus, in its unit.
    realization
        Which noise.
    """

    view: GroupView
    seed: int
    amplitude: float
    realization: int = 0

    @classmethod
    def of(cls, data: GroupLike, seed: int, amplitude: float | None = None, realization: int = 0) -> Signals:
        """The signals of a group; by default those of its largest amplitude and first realization."""
        view = view_of(data)
        return cls(view, seed, chosen_amplitude(view, amplitude), realization)

    @property
    def model(self) -> Model:
        """The true model; under the first of several stimuli."""
        return members(self.view.simulated)[0]

    @cached_property
    def periodic(self) -> Stimulus:
        """The stimulus."""
        return stimulus(self.view.group, self.amplitude)

    @property
    def angles(self) -> list[str]:
        """Names of the angles that move."""
        return [n.replace("theta", "θ") for n in self.model.output_names]

    @property
    def cycles(self) -> int:
        """Cycles in the record."""
        return self.view.group.stimulus.cycles

    @cached_property
    def t(self) -> np.ndarray:
        """Time, s, (samples,)."""
        return np.arange(self.cycles * self.periodic.samples) / self.periodic.rate_hz

    @cached_property
    def torque(self) -> np.ndarray:
        """The stimulus over the whole record, (samples,)."""
        return np.tile(self.periodic.waveform(), self.cycles)

    @cached_property
    def _noise(self) -> Noise:
        return self.view.group.noise_source

    @cached_property
    def sensor_noise(self) -> np.ndarray:
        """Noise on the sensed angles."""
        return self._noise.sample(noise_stream(self.seed, self.realization), self.t.size, self.periodic.rate_hz)

    @cached_property
    def noise_sway(self) -> np.ndarray:
        """What is recorded without a stimulus: sway that the same noise evokes, and the noise of the recording."""
        model = self.model
        measured = self.view.group.measurement_noise
        sway = NoiseSway(model, model.truth, self._noise, self.t.size, self.periodic.rate_hz, measured)
        return sway.sample(noise_stream(self.seed, self.realization))

    @cached_property
    def ideal_sway(self) -> np.ndarray:
        """Steady-state sway that the stimulus evokes, without noise."""
        model = self.model
        once = stimulus_sway(model, model.truth, self.periodic.waveform(), self.periodic.rate_hz)
        return np.tile(once, (self.cycles, 1))

    @cached_property
    def simulated_sway(self) -> np.ndarray:
        """The same by integration in time from rest."""
        model, rate = self.model, self.periodic.rate_hz
        drive = self.torque
        if model.senses_motion:
            drive = np.tile(with_derivatives(self.periodic.waveform(), rate), (self.cycles, 1))
        return simulate(model, model.truth, drive, rate).theta

    @cached_property
    def noise_spectrum(self) -> np.ndarray:
        """Spectrum of the noise-evoked sway as the FRFs get it, coefficients (period // 2 + 1, 2)."""
        group = self.view.group
        return spectrum(group)(self.noise_sway, self.periodic.samples, group.stimulus.discard)

    def expected_noise_power(self, f: np.ndarray) -> np.ndarray:
        """E|coefficient|^2 of the mean cycle's noise without leakage, rad^2, (N, 2)."""
        model, group = self.model, self.view.group
        measured = group.measurement_noise
        recorded = None if measured is None else measured.psd(self.periodic.rate_hz)
        density = sway_psd(model, model.truth, self._noise, f, recorded)
        duration = (group.stimulus.cycles - group.stimulus.discard) * self.periodic.period_s
        return np.einsum("nii->ni", density).real / (2 * duration)

    def frf_error(self, discard: int) -> tuple[np.ndarray, np.ndarray]:
        """Error of the FRFs that the time simulation gives when the first ``discard`` cycles are left out.

        Returns the odd lines (N,), Hz, and |simulated - exact| / |exact|, (N, angles).
        """
        model = self.model
        lines = np.arange(1, int(8.0 * self.periodic.period_s) + 1, 2)
        lines = lines[self.periodic.coefficients()[lines] != 0]
        f = lines / self.periodic.period_s
        simulated = periods.raw(self.simulated_sway, self.periodic.samples, discard)[lines]
        exact = frf(model, model.truth, f) * self.periodic.coefficients()[lines, None]
        return f, np.abs(simulated - exact) / np.abs(exact)

    def sampling_error(self, f: np.ndarray) -> np.ndarray:
        """The part of `frf_error` that sampling explains, (N,): the simulated stimulus is linear between samples."""
        return 1.0 - straight_lines(f, self.periodic.rate_hz)


def envelope(t: np.ndarray, x: np.ndarray, columns: int = PIXELS) -> tuple[np.ndarray, np.ndarray]:
    """A long record as the smallest and largest sample of each of ``columns`` stretches: looks the same, is small."""
    if x.size <= 2 * columns:
        return t, x
    edges = np.linspace(0, x.size, columns + 1).astype(int)
    low, high = np.minimum.reduceat(x, edges[:-1]), np.maximum.reduceat(x, edges[:-1])
    return np.repeat(t[edges[:-1]], 2), np.stack([low, high], axis=1).ravel()


def stimulus_record(signals: Signals, ax: Axes | None = None) -> Axes:
    """Fig. 2A, top: the stimulus over all cycles."""
    ax = axes(ax, (4.3, 2.2))
    ax.plot(*envelope(signals.t, signals.torque), color=COLOURS["ink"], linewidth=0.9, label="stimulus")
    ax.set_ylabel(f"stimulus ({unit(signals.view)})")
    return _time(signals, ax)


def sensor_noise_record(signals: Signals, ax: Axes | None = None) -> Axes:
    """Fig. 2A, below: sensor noise on the sensed angles."""
    ax = axes(ax, (4.3, 2.6))
    _records(ax, signals, signals.sensor_noise)
    ax.set_ylabel("sensor noise (°)")
    return _time(signals, ax)


def noise_sway_record(signals: Signals, ax: Axes | None = None) -> Axes:
    """Fig. 2A as the Methods describe it: sway that the noise alone evokes."""
    ax = axes(ax, (4.3, 2.6))
    _records(ax, signals, signals.noise_sway)
    ax.set_ylabel("noise sway (°)")
    return _time(signals, ax)


def sway_record(signals: Signals, ax: Axes | None = None) -> Axes:
    """Fig. 2C: realistic sway, evoked by stimulus and noise together."""
    ax = axes(ax, (4.3, 2.6))
    _records(ax, signals, signals.ideal_sway + signals.noise_sway)
    ax.set_ylabel("sway (°)")
    return _time(signals, ax)


def simulation_error_record(signals: Signals, ax: Axes | None = None) -> Axes:
    """Fig. 2D: time simulation from rest minus exact steady state, absolute value, without noise."""
    ax = axes(ax, (4.3, 2.8))
    error = np.abs(np.degrees(signals.simulated_sway - signals.ideal_sway))
    for i, name in enumerate(signals.angles):
        block = max(1, error.shape[0] // PIXELS)
        n = error.shape[0] // block * block
        worst = error[:n, i].reshape(-1, block).max(1)
        ax.plot(signals.t[:n:block], worst, color=SERIES[i], linestyle=DASHES[i], label=name)
    log_axis(ax.yaxis)
    ax.set_ylabel("sway error (°)")
    ax.legend(ncols=2)
    return _time(signals, ax)


def simulation_error_frf(signals: Signals, ax: Axes | None = None) -> Axes:
    """What the error of Fig. 2D does to the FRFs, with and without the first cycle, and what sampling explains."""
    ax = axes(ax, (4.3, 3.2))
    kept = signals.view.group.stimulus.discard
    for discard, dash, label in ((0, DASHES[2], "all cycles"), (kept, DASHES[0], f"without the first {cycles(kept)}")):
        f, error = signals.frf_error(discard)
        for i, name in enumerate(signals.angles):
            ax.plot(f, error[:, i], color=SERIES[i], linestyle=dash, label=f"{name}, {label}", linewidth=1.2)
        if kept == 0:
            break
    keep = np.unique(np.geomspace(1, f.size, 12).astype(int)) - 1
    ax.plot(f[keep], signals.sampling_error(f[keep]), "x", color=COLOURS["ink"], markersize=5, label="sampling")
    log_axis(ax.yaxis)
    frequency_axis(ax, f)
    ax.set_ylabel("relative error of the FRF")
    legend_below(ax, 2, -0.2)
    return ax


def stimulus_spectrum(signals: Signals, ax: Axes | None = None) -> Axes:
    """Fig. 2B: power of the stimulus at its lines; even lines hold none."""
    ax = axes(ax, (4.3, 2.8))
    lines = np.arange(1, int(20.0 * signals.periodic.period_s), 2)
    lines = lines[lines <= signals.periodic.samples // 2]
    lines = lines[signals.periodic.coefficients()[lines] != 0]
    f, power = lines / signals.periodic.period_s, np.abs(signals.periodic.coefficients()[lines]) ** 2
    keep = _log_spaced(f, power)
    ax.plot(f[keep], power[keep], ".", color=COLOURS["ink"], markersize=3.5, label="stimulus")
    log_axis(ax.yaxis)
    frequency_axis(ax, f)
    ax.set_ylabel(f"power of stimulus (({unit(signals.view)})²)")
    return ax


def noise_spectrum(signals: Signals, ax: Axes | None = None) -> Axes:
    """Fig. 2B: power of the noise-evoked sway in the mean cycle (dots), and without leakage (lines)."""
    ax = axes(ax, (4.3, 2.8))
    lines = np.arange(1, int(8.5 * signals.periodic.period_s))
    f = lines / signals.periodic.period_s
    expected = signals.expected_noise_power(f)
    for i, name in enumerate(signals.angles):
        power = np.degrees(np.abs(signals.noise_spectrum[lines, i])) ** 2
        keep = _log_spaced(f, power)
        ax.plot(f[keep], power[keep], MARKERS[i], color=SERIES[i], markersize=2.6, alpha=0.8, label=name)
        ax.plot(f, np.degrees(np.degrees(expected[:, i])), color=SERIES[i], linestyle=DASHES[i])
    log_axis(ax.yaxis)
    frequency_axis(ax, f)
    ax.set_ylabel("power of sway (°²)")
    ax.legend(ncols=2)
    return ax


def _log_spaced(f: np.ndarray, power: np.ndarray, most: int = 160) -> np.ndarray:
    """Which of many lines to draw, evenly on a logarithmic axis."""
    nearest = np.searchsorted(f, np.geomspace(f[0], f[-1], most)).clip(0, f.size - 1)
    chosen = np.unique(nearest)
    return chosen[power[chosen] > 0]


LEGEND_ROOM = 0.28
"""Room above a record for its legend, relative to its range."""


def _records(ax: Axes, signals: Signals, x: np.ndarray) -> None:
    for i, name in enumerate(signals.angles):
        t, y = envelope(signals.t, np.degrees(x[:, i]))
        width = 0.8 if i else 1.2
        ax.plot(t, y, color=SERIES[i], linewidth=width, alpha=0.9, label=name, zorder=2.5 - 0.1 * i)  # the first on top
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + LEGEND_ROOM * (high - low))
    ax.legend(ncols=2, loc="upper left")  # seen on a phone without scrolling


def _time(signals: Signals, ax: Axes) -> Axes:
    ax.set_xlabel("time (s)")
    ax.set_xlim(0, signals.t[-1])
    return ax


def cycles(n: int) -> str:
    """``cycle`` or ``n cycles``, after "the first"."""
    return "cycle" if n == 1 else f"{n} cycles"
