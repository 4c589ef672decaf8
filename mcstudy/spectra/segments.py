"""Lines of a recording whose stimulus is not periodic: overlapping segments, cross-spectra, coherence.

Every trial is divided into blocks, and every block into Hann-windowed segments that overlap by half. The linear trend
of each segment is removed. With U and Theta the transforms of a segment, the FRF of a line is
y = sum U* Theta / sum |U|^2. Its covariance is that of the residual Theta - y U, the incoherent part (Bendat & Piersol
2010, ch. 9; the two-channel form is derived). Blocks do not overlap, so they serve as independent repeats. With a Hann
window the correlation is 2/3 between neighbouring bins and 1/6 between every second bin; every second bin is used as a
line.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.recording import LEAST_LINES, Recording, Trial
from mcstudy.spectra.intersample import drive
from mcstudy.spectra.line_noise import LineNoise
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.null_draws import pooled
from mcstudy.spectra.window import parabolic

SEGMENT_S = (8.0, 40.0)
"""Shortest and longest segment, s. The shortest still resolves the sway resonance; longer ones bring no benefit."""

SEGMENTS_PER_RECORDING = 12
"""Number of segment lengths the recording is divided into, within `SEGMENT_S`."""

REPEATS = 6
"""Wanted number of independent blocks over all trials; each contains at least two segment lengths."""

HANN_OVERLAP = 1.0 / (1.0 + 2.0 / 36.0)
"""Equivalent share of independent segments at half overlap, for a correlation of 1/6 between neighbours."""

ROUNDING = 1e-14
"""Power of a line, relative to the strongest line, up to which it may be rounding error of single precision."""


def segment_seconds(recording: Recording) -> float:
    """Segment length in s for a recording."""
    shortest = min(t.samples for t in recording.trials) / recording.rate_hz
    low, high = SEGMENT_S
    return float(min(np.clip(recording.duration_s / SEGMENTS_PER_RECORDING, low, high), shortest / 2))


def segment_lines(recording: Recording, fmax: float = 8.0, seconds: float | None = None) -> Lines:
    """Lines of a recording with any stimulus.

    Parameters
    ----------
    fmax: highest frequency, Hz. seconds: segment length, chosen by `segment_seconds` when None.

    Raises `RecordingError` when there are fewer than six segments in total.
    """
    if fmax > recording.rate_hz / 2:
        raise RecordingError(
            f"{recording.name}: rate_hz: {recording.rate_hz:g} Hz does not reach lines up to {fmax:g} Hz"
        )
    seconds = seconds or segment_seconds(recording)
    n = 2 * round(seconds * recording.rate_hz / 2)
    bins = np.arange(2, int(fmax * n / recording.rate_hz) + 1, 2)
    if bins.size < LEAST_LINES:
        shortest = min(t.samples for t in recording.trials) / recording.rate_hz
        raise RecordingError(
            f"{recording.name}: segments of {seconds:.3g} s (the shortest trial has {shortest:.3g} s) hold {bins.size} "
            f"lines up to {fmax:g} Hz; expected at least {LEAST_LINES}"
        )
    blocks = _blocks(recording, n)
    transforms = [_transform(trial, n) for _, _, trial in blocks]
    count = np.array([u.shape[0] for u, _ in transforms])
    segments = int(count.sum())
    if segments < 6:
        raise RecordingError(
            f"{recording.name}: duration: {recording.duration_s:.1f} s gives {segments} segments of {seconds:.1f} s; "
            "expected at least 6"
        )
    u = np.concatenate([u for u, _ in transforms])[:, bins] * drive(recording, bins * recording.rate_hz / n)
    theta = np.concatenate([y for _, y in transforms])[:, bins]
    bins, u, theta = _excited(bins, u, theta)
    owner = np.repeat(np.arange(len(blocks)), count)
    power = np.abs(u) ** 2
    total = power.sum(axis=0)
    y = np.einsum("sn,snj->nj", u.conj(), theta) / total[:, None]
    independent = segments * HANN_OVERLAP
    residual = theta - u[..., None] * y
    single = np.einsum("sni,snj->nij", residual, residual.conj()) / segments * independent / (independent - 1)
    single, gain = _smooth(single)
    weight = np.array([power[owner == b].sum(axis=0) for b in range(len(blocks))])
    if not weight.all():
        t, b, _ = blocks[int(np.argwhere(weight == 0)[0, 0])]
        raise RecordingError(
            f"{recording.name}: trial {t + 1}: stimulus: expected one that varies throughout the trial, "
            f"found no variation in part {b + 1} of it"
        )
    repeats = np.array(
        [
            np.einsum("sn,snj->nj", u[owner == b].conj(), theta[owner == b]) / weight[b][:, None]
            for b in range(len(blocks))
        ]
    )
    from scipy import signal  # slow to import, and only recordings that are not periodic have segments

    window = signal.get_window("hann", n)
    density = 2.0 / (recording.rate_hz * (window**2).sum())
    trial, cycle = np.array([(t, c) for t, c, _ in blocks]).T
    dof, trials = (independent - 1) * gain, len(recording.trials)
    return Lines(
        f=bins * recording.rate_hz / n,
        y=y,
        noise=LineNoise(single * (segments / independent / total)[:, None, None], dof, pooled(dof, trials)),
        repeats=repeats,
        weight=weight / total,
        trial=trial,
        cycle=cycle,
        amplitude=recording.amplitudes[trial],
        power=power.mean(axis=0) * density * recording.rate_hz / n,
    )


def _blocks(recording: Recording, n: int) -> list[tuple[int, int, Trial]]:
    """(trial, block, part of the trial): at most `REPEATS` over all trials, none shorter than two segments."""
    each = max(1, round(REPEATS / len(recording.trials)))
    parts = []
    for t, trial in enumerate(recording.trials):
        k = max(1, min(each, trial.samples // (2 * n)))
        edges = np.linspace(0, trial.samples, k + 1).astype(int)
        parts += [(t, b, Trial(trial.stimulus[i:j], trial.theta[i:j])) for b, (i, j) in enumerate(pairwise(edges))]
    return parts


def _transform(trial: Trial, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Windowed transforms of the segments of one block: (S, K) of the stimulus and (S, K, Y) of the outputs."""
    from scipy import signal

    x = np.column_stack([trial.stimulus, trial.theta])
    starts = range(0, x.shape[0] - n + 1, n // 2)
    cut = signal.detrend(np.array([x[s : s + n] for s in starts]), axis=1)
    z = np.fft.rfft(cut * signal.get_window("hann", n)[:, None], axis=1)
    return z[..., 0], z[..., 1:]


def _excited(bins: np.ndarray, u: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lines at which the stimulus exceeds rounding error; a weakly excited line only gets a large covariance."""
    power = (np.abs(u) ** 2).mean(axis=0)
    keep = power > ROUNDING * power.max()
    return bins[keep], u[:, keep], theta[:, keep]


def _smooth(single: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean over neighbouring lines, normalised by their magnitude first, and the gain in degrees of freedom.

    The half-width is a tenth of the line number and at least one line.
    """
    n = single.shape[0]
    level = np.sqrt(np.maximum(np.einsum("nii->ni", single).real, 1e-300))
    reach = np.maximum(1, np.arange(1, n + 1) // 10)
    window = parabolic(np.arange(n), np.arange(n), reach + 1.0)
    smooth = np.exp(window @ np.log(level))
    white = single / (smooth[:, :, None] * smooth[:, None, :])
    local = np.einsum("nm,mij->nij", window, white)
    return local * smooth[:, :, None] * smooth[:, None, :], 1.0 / (window**2).sum(axis=1)
