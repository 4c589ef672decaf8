"""The same recording given twice, found by what was measured: names, formats, rounding and cut ends do not matter.

Two trials under one stimulus differ by the noise of both, as two cycles of one trial do. A copy differs by rounding
only. So the difference of two trials, at the lag at which they are most alike, is compared with that of the cycles of
one of them. Trials without cycles are copies where they differ by less than two measurements of one person ever do.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.recording import Recording, Trial

CODE = "copy"
"""What is accepted by whoever has recordings that are alike and yet different."""

STEP_S = 0.04
"""Samples that are compared, s: means over this time."""

LAGS = 16
"""Lags within one of these samples."""

ALIKE_SPREAD = 0.1
"""Largest relative difference of the standard deviations of an angle of two copies."""

COPY = 0.1
"""Power of the difference of copies, relative to that of two cycles of one trial. That of two trials is about 1."""

COPY_APERIODIC = 5e-4
"""The same relative to the power of the sway, without cycles. With a noise of 3 % it is 2e-3 under one stimulus."""

ROUNDING = 1e-10
"""The same below which nothing was measured anew, however small the noise."""

BETWEEN = 2e-3
"""The same that half a sample of lag adds at most."""

OVERLAP = 0.5
"""Least share of the shorter trial that both have in common."""

COPY_FRF = 1e-3
"""Mean squared difference of published responses that are copies, relative to the variances that both state."""

EQUAL = 1e-6
"""Relative difference of the responses of two rows of a table that are copies."""


@dataclass(frozen=True)
class _Signature:
    """A trial for comparison: its columns (m, Y) every `STEP_S`, the period in the same unit, and the power of the
    difference of two of its cycles."""

    name: str
    x: np.ndarray
    period: float | None
    cycles: float | None

    @classmethod
    def of(cls, name: str, trial: Trial, rate_hz: float, period_s: float | None) -> _Signature:
        n = trial.samples
        at = np.arange(int(n / rate_hz / STEP_S) + 1) * STEP_S * rate_hz
        total = np.concatenate([np.zeros((1, trial.theta.shape[1])), np.cumsum(trial.theta, axis=0)])
        x = np.column_stack([np.diff(np.interp(at, np.arange(n + 1), column)) for column in total.T])
        x /= STEP_S * rate_hz
        p, cycles = None, None
        if period_s is not None and n / rate_hz >= 3 * period_s:
            p = period_s / STEP_S
            m = np.arange(int(p), x.shape[0] - int(p) - 1)
            later = np.column_stack([np.interp(m + p, np.arange(x.shape[0]), column) for column in x.T])
            cycles = _power(later - x[m])
        return cls(name, x - x.mean(axis=0), p, cycles)


def _power(x: np.ndarray) -> float:
    return float(np.var(x, axis=0).sum())


def _apart(x: np.ndarray) -> float:
    """Power of a difference (m, Y) without its linear trend, which programs take out."""
    line = np.linspace(-1.0, 1.0, len(x))
    slopes = line @ x / (line @ line)
    return _power(x - line[:, None] * slopes)


def refuse_copies(
    named: Iterable[tuple[str, Recording | FrfRecording]], accept: Iterable[str] = (), where: str = "recordings"
) -> None:
    """Raise `RecordingError`, one line that names both, if a trial or a published response is there twice.

    ``accept``: does nothing if `CODE` is in it.
    """
    if CODE in ({accept} if isinstance(accept, str) else set(accept)):
        return
    trials: list[_Signature] = []
    published: list[tuple[str, FrfRecording]] = []
    for name, r in named:
        if isinstance(r, FrfRecording):
            published.append((name, r))
            continue
        for k, trial in enumerate(r.trials, start=1):
            label = name if len(r.trials) == 1 else f"{name}, trial {k}"
            trials.append(_Signature.of(label, trial, r.rate_hz, r.period_s))
    pair = _first_copy(trials) or next(((a, b) for (a, x), (b, y) in combinations(published, 2) if _equal(x, y)), None)
    if pair is not None:
        raise RecordingError(
            f"{where}: {pair[1]}: holds the same data as {pair[0]}; expected every recording once, because copies "
            f"count as independent and make intervals too narrow; leave one out (to keep both: accept {CODE!r})"
        )


def numbered(recordings: Sequence[Recording | FrfRecording]) -> list[tuple[str, Recording | FrfRecording]]:
    """Recordings by their names, with their places where there are several."""
    if len(recordings) == 1:
        return [(recordings[0].name, recordings[0])]
    return [(f"recording {k} ({r.name})", r) for k, r in enumerate(recordings, start=1)]


def equal_rows(responses: np.ndarray) -> tuple[int, int] | None:
    """Two rows of responses (R, ...) that are copies, or None; rows with a missing value are none."""
    rows = responses.reshape(len(responses), -1)
    size = np.abs(rows).mean(axis=1)
    order = np.argsort(size)
    for k, i in enumerate(order):
        for j in order[k + 1 :]:
            if not size[j] <= size[i] * (1 + EQUAL):
                break
            if np.abs(rows[i] - rows[j]).max() <= EQUAL * size[i]:
                return min(int(i), int(j)), max(int(i), int(j))
    return None


def _first_copy(trials: Sequence[_Signature]) -> tuple[str, str] | None:
    if len(trials) < 2:
        return None
    spread = np.array([t.x.std(axis=0) for t in trials])
    size = 1 << (2 * max(len(t.x) for t in trials)).bit_length()
    kept: dict[int, np.ndarray] = {}

    def spectrum(k: int) -> np.ndarray:
        if k not in kept:
            kept[k] = np.fft.rfft(trials[k].x, size, axis=0)
        return kept[k]

    for j in range(1, len(trials)):
        near = np.abs(spread[:j] / np.maximum(spread[j], 1e-300) - 1).max(axis=1) <= ALIKE_SPREAD
        for i in np.flatnonzero(near):
            a, b = trials[int(i)], trials[j]
            cross = np.fft.irfft((spectrum(int(i)).conj() * spectrum(j)).sum(axis=1), size)
            best = int(np.argmax(cross))
            best = best - size if best > size // 2 else best
            # Of a copy that lacks whole cycles, other lags of whole periods are almost as much alike.
            lacks = b.period is not None and abs(len(a.x) - len(b.x)) > b.period / 2
            turns = np.arange(-3, 4) if lacks else np.zeros(1)
            lags = {best + round(float(k * (b.period or 0.0))) + near for k in turns for near in (-1, 0, 1)}
            if any(_copy(a, b, lag) for lag in sorted(lags, key=lambda x: abs(x - best))):
                return a.name, b.name
    return None


def _copy(a: _Signature, b: _Signature, lag: int) -> bool:
    """Whether sample k of ``a`` is sample k + ``lag`` of ``b``, up to less than one sample."""
    start, stop = max(0, -lag) + 1, min(len(a.x), len(b.x) - lag) - 2
    if stop - start < OVERLAP * min(len(a.x), len(b.x)):
        return False
    samples, other = a.x[start:stop], slice(start + lag, stop + lag)
    power = _power(samples)
    known = [c for c in (a.cycles, b.cycles) if c is not None]
    limit = max(ROUNDING * power, COPY * min(known) if known else COPY_APERIODIC * power)
    if _apart(samples - b.x[other]) > 2 * limit + BETWEEN * power:
        return False
    return any(_apart(samples - _between(b.x, other, part)) <= limit for part in np.arange(LAGS) / LAGS)


def _between(x: np.ndarray, at: slice, part: float) -> np.ndarray:
    """Samples (m, Y) at ``at`` + ``part``, by the cubic through four of them (Lagrange)."""
    p = part
    weights = (
        -p * (p - 1) * (p - 2) / 6,
        (p + 1) * (p - 1) * (p - 2) / 2,
        -(p + 1) * p * (p - 2) / 2,
        (p + 1) * p * (p - 1) / 6,
    )
    return np.asarray(sum(w * x[at.start + k : at.stop + k] for w, k in zip(weights, (-1, 0, 1, 2), strict=True)))


def _equal(a: FrfRecording, b: FrfRecording) -> bool:
    if a.y.shape != b.y.shape or not np.allclose(a.f, b.f, rtol=1e-4):
        return False
    apart = np.abs(a.y - b.y) ** 2
    variance = np.einsum("nii->ni", a.C + b.C).real
    return bool((apart / variance).mean() <= COPY_FRF)
