"""FRFs of many people from their recordings, in the form of a group: points that average lines of the stimulus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import xarray as xr

from mcstudy.errors import RecordingError
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.frf_group import group_dataset
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.frf_groups import in_space
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import Body

POINTS = 12
"""Most points of a group; they divide the logarithm of frequency evenly."""


def group_of(
    recordings: Sequence[Recording | FrfRecording], people: Sequence[str], fmax: float | None = None, discard: int = 1
) -> xr.Dataset:
    """What `mcstudy.read_frf_group` returns, one condition, from one recording of every person.

    A point averages the lines in its band, weighted with the mean power of the stimulus at each of them. All people
    have the mean of the constants of their bodies.

    Raises `RecordingError` when recordings have other lines or stimuli, or hold one angle only.
    """
    measured = [measure(recording, fmax, discard) for recording in recordings]
    first, kind = measured[0], recordings[0].stimulus
    for lines, recording in zip(measured, recordings, strict=True):
        if recording.stimulus != kind:
            raise RecordingError(
                f"{recording.name}: stimulus: expected {kind}, as in the others, got {recording.stimulus}"
            )
        if lines.f.shape != first.f.shape or not np.allclose(lines.f, first.f):
            raise RecordingError(
                f"{recording.name}: expected the lines of {recordings[0].name}: the same period and rate"
            )
        if getattr(recording, "single", False):
            raise RecordingError(f"{recording.name}: expected both angles, found one")
    power = np.mean([lines.power for lines in measured], axis=0)
    average = _bands(first.f) * (power if np.isfinite(power).all() else np.ones_like(power))
    average /= average.sum(axis=1, keepdims=True)
    frf = np.array([(average @ in_space(lines.y)).T for lines in measured])[:, None]
    constants = {c.name: float(np.mean([getattr(r.body, c.name) for r in recordings])) for c in fields(Body)}
    return group_dataset(frf, people, [()], (), first.f, average, kind, Body(**constants))


def _bands(f: np.ndarray) -> np.ndarray:
    """Which lines (L,) every point has, (N, L) of 0 and 1; bands without a line are left out."""
    edges = np.geomspace(f[0], f[-1], POINTS + 1)
    band = np.clip(np.searchsorted(edges, f, side="right") - 1, 0, POINTS - 1)
    return np.array([(band == k).astype(float) for k in np.unique(band)])
