"""Frequency lines (`Lines`) of a recording of any kind."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.joint_recording import JointRecording
from mcstudy.recordings.recording import LEAST_LINES, Recording
from mcstudy.spectra.line_noise import LineNoise
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.periodic import periodic_lines
from mcstudy.spectra.scatter import with_scatter, with_unequal_trials
from mcstudy.spectra.segments import segment_lines

LARGE_DOF = 1e6
"""Degrees of freedom of a published covariance, which was not estimated here."""

FMAX_HZ = 8.0
"""Highest frequency of a recording that is used unless another is wanted. Of a published response it is its last."""

NOISE_HZ = 8.0
"""Lines are measured up to this frequency, even if fewer are wanted. The autoregression that whitens their noise
follows chance where it has few lines: estimated up to 1.2 Hz only, the covariance is 9 % too small. And labels are
checked at all of them, because inertia determines the responses above 2 Hz."""

SAMPLES_PER_PERIOD = 2.5
"""Of the highest frequency up to which lines are measured if fewer are wanted."""

SAMPLES_OF_DECLARED = 4.0
"""The same of the highest frequency that is used of a declared model unless another is wanted. Nearer to half the rate
a record depends on what happens between its samples, and the right model is not the whole of it."""

LEAST_NOISE = 1e-5
"""Smallest plausible standard error of a response relative to its magnitude, median over lines; the resolution of
a 20-bit sensor gives more."""

LEAST_NOISE_OF_A_LINE = 1e-8
"""The same for any single line."""


def highest(recording: Recording | FrfRecording | JointRecording, fmax: float | None) -> float:
    """The highest frequency used, Hz: ``fmax``, or when None `FMAX_HZ`, or the last of a published response.

    Of a declared model, whose frequencies may be any, a quarter of the sampling rate (`SAMPLES_OF_DECLARED`).
    """
    if fmax is not None:
        return fmax
    if isinstance(recording, FrfRecording):
        return float(recording.f[-1])
    if isinstance(recording, JointRecording):
        return max(highest(part, None) for part in recording.parts)
    if isinstance(recording, Recording) and recording.model is not None:
        return recording.rate_hz / SAMPLES_OF_DECLARED
    return FMAX_HZ


def measure(recording: Recording | FrfRecording, fmax: float | None = None, discard: int = 1) -> Lines:
    """Lines of a recording up to ``fmax`` (Hz, see `highest`); ``discard`` transient cycles are left out.

    A periodic stimulus gives its excited lines, any other the lines of overlapping segments, a published FRF itself.
    Raises `RecordingError` when the recording is too short, or has fewer than `LEAST_LINES` lines up to ``fmax``.
    """
    fmax = highest(recording, fmax)
    return up_to(fmax, wide_lines(recording, fmax, discard), recording.name)


def wide_lines(recording: Recording | FrfRecording, fmax: float, discard: int) -> Lines:
    """Lines of a recording, parameters as in `measure`, up to `NOISE_HZ` even if ``fmax`` is lower.

    All of a published FRF; less of a slowly sampled recording. Raises `RecordingError` for one that is too short.
    """
    if not (math.isfinite(fmax) and fmax > 0):
        raise RecordingError(f"{recording.name}: fmax: expected a positive number of Hz, got {fmax!r}")
    if isinstance(recording, FrfRecording):
        return _published(recording)
    least = NOISE_HZ if recording.model is None else np.inf
    wide = max(fmax, min(least, recording.rate_hz / SAMPLES_PER_PERIOD))
    if recording.period_s is None:
        return segment_lines(recording, wide)
    return with_scatter(with_unequal_trials(periodic_lines(recording, wide, discard)))


def up_to(fmax: float, lines: Lines, name: str) -> Lines:
    """``lines`` up to ``fmax`` (Hz); raises `RecordingError` when they are fewer than `LEAST_LINES`."""
    kept = lines.below(fmax)
    if len(kept) < LEAST_LINES:
        raise RecordingError(
            f"{name}: expected at least {LEAST_LINES} {lines.unit}s up to fmax = {fmax:g} Hz, got {len(kept)}"
        )
    if lines.published and (beyond := lines.f[lines.f > fmax]).size:
        kept_points = (
            f"the last point, {beyond[0]:g} Hz, is"
            if beyond.size == 1
            else (f"the last {beyond.size} points, {beyond[0]:g} to {beyond[-1]:g} Hz, are")
        )
        return replace(kept, notes=(*kept.notes, f"{kept_points} above fmax = {fmax:g} Hz and left out"))
    return kept


def require_noise(lines: Lines, recording: Recording | FrfRecording) -> None:
    """Raise `RecordingError` for responses without noise or with a singular noise covariance."""
    where = f"{recording.name}: {recording.columns.names}"
    variance, C = lines.noise.variance, lines.noise.C
    size = np.abs(lines.y)
    if not (np.isfinite(C).all() and np.isfinite(size).all() and (variance > 0).all() and size.any()):
        raise RecordingError(f"{where}: expected responses with measurement noise, found none")
    relative = (np.sqrt(variance) / np.maximum(size, 1e-300)).min(axis=1)
    if np.median(relative) < LEAST_NOISE or relative.min() < LEAST_NOISE_OF_A_LINE:
        raise RecordingError(
            f"{where}: expected noise of at least {LEAST_NOISE:g} of the responses, with which a gap is "
            f"compared ({LEAST_NOISE_OF_A_LINE:g} at any line), got {np.median(relative):.1g} ({relative.min():.1g})"
        )
    if (np.linalg.det(C).real / variance.prod(axis=1) < LEAST_NOISE_OF_A_LINE).any():
        raise RecordingError(f"{where}: one is a multiple of the other; their covariance is singular")


def _published(frf: FrfRecording) -> Lines:
    """Lines with a single repeat (no cross-validation possible) and unknown amplitude and power."""
    unit_weight = np.ones(frf.f.size)
    notes = ("only one angle was published, so the hip is not tested",) if frf.single else ()
    y = frf.y.astype(complex)
    return Lines(
        f=frf.f,
        y=y,
        noise=LineNoise(frf.C.astype(complex), LARGE_DOF * unit_weight),
        repeats=y[None],
        weight=unit_weight[None],
        trial=np.zeros(1, dtype=int),
        cycle=np.zeros(1, dtype=int),
        amplitude=np.array([np.nan]),
        power=np.nan * unit_weight,
        notes=notes,
        published=True,
    )
