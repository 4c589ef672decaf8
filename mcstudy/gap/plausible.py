"""Whether a recording's channels are what their labels say, from what any standing body must do.

Above about 2 Hz a stimulus works against inertia alone, so the responses approach M^-1 b whatever the controller does;
below, they stay within a factor of a few of the nominal model. A mislabelled channel - degrees for radians, theta1
and theta2 exchanged, a flipped sign, the trunk's angle in space instead of the hip angle - changes the responses by a
known 2 x 2 matrix T. Every reading is scored by the likelihood of the band means of the measured FRFs around T H0,
with H0 the nominal model, an error of that model (`MODEL_ERROR`) and the measured covariance; the score is the
logarithm of the odds against the reading as labelled. Derived.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.gap.lines import Lines
from mcstudy.gap.recording import Recording, Suspicion
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf

EDGES_HZ = (0.05, 0.15, 0.3, 0.5, 0.8, 1.3, 2.0, 3.0, 4.5, 6.5, 9.0)
"""Edges of the bands that are compared; each counts as one independent look at the model's error."""

MODEL_ERROR = ((0.05, 0.9), (0.8, 0.8), (2.0, 0.5), (4.5, 0.35), (9.0, 0.35))
"""(frequency in Hz, relative error of the nominal model for any person), interpolated in log frequency."""

CERTAIN = 12.0
"""Log odds from which a reading is refused; below, down to `DOUBTFUL`, it is noted."""

DOUBTFUL = 4.0

_DEG = 180 / np.pi

READINGS: dict[str, tuple[tuple[tuple[float, float], tuple[float, float]], str, str]] = {
    "degrees": (((_DEG, 0), (0, _DEG)), "theta1, theta2", "in deg but declared rad"),
    "radians": (((1 / _DEG, 0), (0, 1 / _DEG)), "theta1, theta2", "in rad but declared deg"),
    "degrees_theta1": (((_DEG, 0), (0, 1)), "theta1", "in deg but declared rad"),
    "degrees_theta2": (((1, 0), (0, _DEG)), "theta2", "in deg but declared rad"),
    "radians_theta1": (((1 / _DEG, 0), (0, 1)), "theta1", "in rad but declared deg"),
    "radians_theta2": (((1, 0), (0, 1 / _DEG)), "theta2", "in rad but declared deg"),
    "swapped": (((0, 1), (1, 0)), "theta1, theta2", "exchanged (theta1 must be the lower body, theta2 the hip)"),
    "sign": (((-1, 0), (0, -1)), "stimulus or theta1, theta2", "of opposite sign to each other"),
    "sign_theta1": (((-1, 0), (0, 1)), "theta1", "of the wrong sign"),
    "sign_theta2": (((1, 0), (0, -1)), "theta2", "of the wrong sign"),
    "space_angle": (((1, 0), (1, 1)), "theta2", "the upper body's angle in space; the hip angle is expected"),
}
"""Per reading: the matrix T it puts on the true responses, the channel, and what to say."""


def band_means(lines: Lines, model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies (B,), measured and nominal FRFs (B, 2) and covariance (B, 2, 2), each line over the nominal
    magnitude first and averaged with inverse-variance weights."""
    H = frf(model, model.truth, lines.f)
    f, y, h, C = [], [], [], []
    for low, high in pairwise(EDGES_HZ):
        inside = (lines.f >= low) & (lines.f < high)
        if not inside.any():
            continue
        scale = np.abs(H[inside])
        noise = lines.noise.variance[inside] / scale**2
        w = 1 / (noise.mean(axis=1) + 1e-300)
        w /= w.sum()
        # Rotating every line by the nominal phase of the first angle keeps the mean from cancelling.
        turn = np.exp(-1j * np.angle(H[inside, :1]))
        f.append(float(w @ lines.f[inside]))
        y.append(w @ (lines.y[inside] * turn / scale.mean(axis=1, keepdims=True)))
        h.append(w @ (H[inside] * turn / scale.mean(axis=1, keepdims=True)))
        C.append(np.einsum("n,nij->ij", w**2 / scale.mean(axis=1) ** 2, lines.noise.C[inside]))
    return np.array(f), np.array(y), np.array(h), np.array(C)


def readings(recording: Recording, lines: Lines) -> dict[str, float]:
    """Log likelihood of every reading, "as_labelled" included."""
    f, y, h, C = band_means(lines, recording.base_model())
    at, size = np.array(MODEL_ERROR).T
    error = np.interp(np.log(f), np.log(at), size)
    out = {}
    for name, T in [("as_labelled", np.eye(2)), *((n, np.array(t)) for n, (t, _, _) in READINGS.items())]:
        expected = np.einsum("ij,nj->ni", T, h)
        spread = np.einsum("ij,nj,kj->nik", T, (error[:, None] * np.abs(h)) ** 2, T)
        S = C + spread
        r = y - expected
        misfit = np.einsum("ni,nij,nj->n", r.conj(), np.linalg.inv(S), r).real
        # A heavy tail: one band that the nominal model has wrong must not decide.
        out[name] = float(-(np.log(np.linalg.det(S).real) + 4 * np.log1p(misfit / 4)).sum())
    return out


def plausibility(recording: Recording, lines: Lines) -> tuple[Suspicion, ...]:
    """The readings that explain the responses better than the labels do, best first."""
    score = readings(recording, lines)
    base = score.pop("as_labelled")
    best = sorted(score, key=lambda n: -score[n])
    found = []
    for name in best:
        odds = score[name] - base
        if odds < DOUBTFUL:
            break
        _, channel, words = READINGS[name]
        found.append(Suspicion(name, channel, f"{recording.name}: {channel}: looks {words}", odds))
    return tuple(found)


def refuse(suspicions: Iterable[Suspicion], accept: Iterable[str] = ()) -> None:
    """Raise `RecordingError` for the strongest suspicion of a mislabelled channel that is beyond doubt.

    ``accept``: codes that the user has looked at and wants to keep.
    """
    accepted = set(accept)
    for s in suspicions:
        if s.code in READINGS and s.code not in accepted and s.odds >= CERTAIN:
            raise RecordingError(f"{s.message} (odds 10^{s.odds / np.log(10):.0f} to 1); accept {s.code!r} to keep it")
