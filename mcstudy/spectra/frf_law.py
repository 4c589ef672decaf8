"""The exact distribution of the "sim" FRF, from which many can be drawn for the price of one record.

Band means of H + N/U (`mcstudy.spectra.estimate.SpectralExperiment`) are linear in the Fourier coefficients of the
record of sway, and these are independent Gaussian. So the band means are Gaussian, and their covariance is a sum over
the coefficients: leakage, averaging of cycles, shared lines and the removal of the ramp are all in the linear map.
Derived. What cannot be drawn in this way is the covariance that is estimated from the even lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from mcstudy.spectra.bands import Bands
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import members
from mcstudy.stance.line_stimulus import Stimulus
from mcstudy.stance.noise import MeasurementNoise, Noise
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_spectral import sway_psd


@dataclass(frozen=True)
class FrfLaw:
    """Distribution of the FRF at unit amplitude.

    Attributes
    ----------
    mean: expected FRF of Y outputs, (N, Y). root: M, (2 N Y, 2 N Y), with M^T M the covariance of the real parts of all
    N points and outputs, followed by the imaginary parts. joint: E[r r^H] of the errors r of all points, (N Y, N Y).
    """

    mean: np.ndarray
    root: np.ndarray
    joint: np.ndarray

    @property
    def size(self) -> int:
        """Standard normal numbers behind one FRF."""
        return len(self.root)

    @property
    def covariance(self) -> np.ndarray:
        """E[r r^H] of the errors of each point, (N, Y, Y)."""
        return np.einsum("nink->nik", self.joint.reshape(*self.mean.shape, *self.mean.shape))

    def draw(self, normal: np.ndarray, amplitude: float) -> np.ndarray:
        """FRFs (R, N, Y) at an amplitude from standard normal numbers (R, 2 N Y); equal numbers give paired FRFs."""
        parts = (normal @ self.root).reshape(len(normal), 2, *self.mean.shape) / amplitude
        return np.asarray(self.mean + parts[:, 0] + 1j * parts[:, 1])


def frf_law(
    model: Model,
    stimulus: Stimulus,
    noise: Noise,
    bands: Bands,
    cycles: int,
    discard: int,
    ramp_removed: bool,
    measured: MeasurementNoise | None = None,
) -> FrfLaw:
    """The law at the true parameters, for the same arguments as `SpectralExperiment`; ``discard`` >= 1 with ramps.

    Under J stimuli, each in a recording of its own, every point is there J times in turn.
    """
    n = cycles * stimulus.samples
    f, duration_s = np.arange(1, (n + 1) // 2) * (stimulus.rate_hz / n), n / stimulus.rate_hz
    answers = _answers(stimulus, bands, cycles, discard, ramp_removed, f.size)
    recorded = None if measured is None else measured.psd(stimulus.rate_hz)
    each = [
        _of_one(m, bands, answers, sway_psd(m, m.truth, noise, f, recorded) / (2 * duration_s)) for m in members(model)
    ]
    return each[0] if len(each) == 1 else _in_turn(each)


def _in_turn(laws: list[FrfLaw]) -> FrfLaw:
    """The law of independent recordings, the J of a point after each other."""
    J, (N, Y) = len(laws), laws[0].mean.shape
    joint = np.zeros((N, J, Y, N, J, Y), dtype=complex)
    root = np.zeros((2, N, J, Y, 2, N, J, Y))
    for k, law in enumerate(laws):
        joint[:, k, :, :, k] = law.joint.reshape(N, Y, N, Y)
        root[:, :, k, :, :, :, k] = law.root.reshape(2, N, Y, 2, N, Y)
    mean = np.stack([law.mean for law in laws], axis=1).reshape(N * J, Y)
    return FrfLaw(mean, root.reshape(2 * mean.size, -1), joint.reshape(mean.size, -1))


def _answers(
    stimulus: Stimulus, bands: Bands, cycles: int, discard: int, ramp_removed: bool, size: int
) -> tuple[np.ndarray, np.ndarray]:
    """What the first ``size`` coefficients of a record, and their conjugates, add to each point (N, size).

    The coefficient at half the sampling rate is left out, one of many thousands.
    """
    period, n = stimulus.samples, cycles * stimulus.samples
    drive = stimulus.coefficients()[bands.lines] / stimulus.amplitude
    forward, backward = (np.empty((len(bands), size), dtype=complex) for _ in range(2))
    for p, weights in enumerate(bands.weights):
        lines = np.zeros(period, dtype=complex)
        lines[bands.lines] = weights / drive
        if ramp_removed:
            step = 1 - np.exp(-2j * np.pi * bands.lines / period)
            lines[bands.lines] /= step
        # what one sample of the used cycles adds to the point, and from that what one coefficient of the record adds
        sample = np.zeros(n, dtype=complex)
        sample[discard * period :] = np.tile(fft.fft(lines) / ((cycles - discard) * period), cycles - discard)
        if ramp_removed:  # increments x[t] - x[t - 1], counted from the first used cycle's own start
            sample = np.roll(sample, -1)
            sample = np.roll(sample, 1) - sample
        answer = fft.ifft(sample) * n
        forward[p], backward[p] = answer[1 : size + 1], answer[-1 : -size - 1 : -1]
    return forward, backward


def _of_one(model: Model, bands: Bands, answers: tuple[np.ndarray, np.ndarray], power: np.ndarray) -> FrfLaw:
    """The law under one stimulus, from its `_answers` and the power of each coefficient of the sway."""
    (forward, backward), N, Y = answers, len(bands), model.n_outputs
    gamma, pseudo = (np.empty((N, Y, N, Y), dtype=complex) for _ in range(2))
    for i in range(Y):
        for k in range(Y):
            S = power[:, i, k]
            gamma[:, i, :, k] = (forward * S) @ forward.conj().T + (backward * S.conj()) @ backward.conj().T
            pseudo[:, i, :, k] = (forward * S) @ backward.T + (backward * S.conj()) @ forward.T
    G, C = gamma.reshape(N * Y, N * Y), pseudo.reshape(N * Y, N * Y)
    joint = np.block([[(G + C).real, (C - G).imag], [(C - G).imag.T, (G - C).real]]) / 2
    size = np.sqrt(np.maximum(np.diag(joint), np.finfo(float).tiny))
    value, vector = np.linalg.eigh(joint / size / size[:, None])
    root = (vector * np.sqrt(np.maximum(value, 0.0))) @ vector.T * size
    mean = bands.average(frf(model, model.truth, bands.line_f))
    return FrfLaw(mean, root, G)
