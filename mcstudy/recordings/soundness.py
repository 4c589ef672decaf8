"""What is unsound in the signals of a recording, in words, and what follows: cycles that are left out, gaps filled."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.faults import Fault, angle_faults, constant_end, stimulus_faults
from mcstudy.recordings.recording import LEAST_CYCLES, Recording, Suspicion, Trial, sentences
from mcstudy.recordings.resampling import interpolated

CODES = {
    "held": "stuck",
    "clipped": "clipped",
    "spike": "jump",
    "step": "jump",
    "constant": "stimulus",
    "different": "stimulus",
}
"""Code of the suspicion of every kind of fault; whoever accepts it keeps the cycles."""

FILLABLE = ("held", "spike")
"""Kinds of faults that are gaps: the values before and after them are right."""

QUIET_START = 0.5
"""Part of the first cycle, from its beginning, in which a stimulus may be at rest or rise: the cycle is left out as
transient, and the next one has settled."""

BEFORE = 3
"""Samples before a cycle that its analysis uses (`mcstudy.spectra.leakage`)."""


@dataclass(frozen=True)
class _Told:
    """Faults of one kind, of one trial, common to some channels."""

    code: str
    kind: str
    channels: tuple[str, ...]
    faults: tuple[Fault, ...]


def _faults(trial: Trial, recording: Recording, discard: int = 1) -> list[_Told]:
    """Faults of a trial, those of several outputs at the same time once; none of a quiet start that is discarded."""
    outputs = recording.columns.outputs
    faults = {name: angle_faults(x, recording.rate_hz) for name, x in zip(outputs, trial.theta.T, strict=True)}
    by_kind: dict[tuple[str, tuple[str, ...]], list[Fault]] = {}
    for name in outputs:
        for f in faults[name]:
            meet = {n for n in outputs for g in faults[n] if g.kind == f.kind and g.start < f.stop and f.start < g.stop}
            if name == min(meet, key=outputs.index):
                by_kind.setdefault((f.kind, tuple(n for n in outputs if n in meet)), []).append(f)
    period = recording.period
    if period is not None:
        quiet = QUIET_START * period if discard else 0
        for f in stimulus_faults(trial.stimulus, period, recording.rate_hz):
            if f.stop <= quiet:
                continue
            by_kind.setdefault((f.kind, ("stimulus",)), []).append(f)
    return [_Told(CODES[kind], kind, channels, tuple(faults)) for (kind, channels), faults in by_kind.items()]


def faults_in_words(recording: Recording, trial: Trial, where: str) -> list[Suspicion]:
    """What is unsound in a trial: what, in which channel, how often, how long, when."""
    suspicions = [
        Suspicion(t.code, ", ".join(t.channels), _words(t, trial, recording, where)) for t in _faults(trial, recording)
    ]
    if recording.period is None and (end := constant_end(trial.stimulus, recording.rate_hz)) is not None:
        begin, lasts = end.start / recording.rate_hz, (end.stop - end.start) / recording.rate_hz
        message = (
            f"{where}: stimulus: is constant from t = {begin:.4g} s to the end, {lasts:.3g} s, longer than ever before"
        )
        suspicions.append(Suspicion("stimulus", "stimulus", message))
    return suspicions


def _words(group: _Told, trial: Trial, recording: Recording, where: str) -> str:
    rate, faults = recording.rate_hz, group.faults
    spans = [(f.stop - f.start) / rate for f in faults]
    what = _what(group, trial, recording)
    if len(faults) == 1:
        when = f"at t = {faults[0].start / rate:.4g} s"
        lasts = "" if group.kind == "step" or spans[0] * rate < 2 else f" for {spans[0]:.2g} s"
        return f"{where}: {', '.join(group.channels)}: {what}{lasts} {when}"
    times = ", ".join(f"{f.start / rate:.4g}" for f in faults[:3]) + (", ..." if len(faults) > 3 else "")
    total = f", {sum(spans):.3g} s in all ({100 * sum(spans) * rate / trial.samples:.2g} %), at most {max(spans):.2g} s"
    if group.kind == "step":
        total = ""
    return f"{where}: {', '.join(group.channels)}: {what} {len(faults)} times{total}, at t = {times} s"


def _what(group: _Told, trial: Trial, recording: Recording) -> str:
    largest = max(group.faults, key=lambda f: abs(f.size))
    if group.kind == "held":
        return "is exactly 0" if all(f.size == 0 for f in group.faults) else "is constant"
    if group.kind == "clipped":
        return f"is constant at the end of its range ({_size(largest.size, recording, 3)}: clipped)"
    if group.kind in ("spike", "step"):
        up = _size(abs(largest.size), recording, 2)
        return f"jumps by {up} and back" if group.kind == "spike" else f"steps by {up} and stays there"
    if group.kind == "constant":
        ends = group.faults[-1].stop >= trial.samples - (trial.samples % (recording.period or 1))
        value = f"{largest.size:.3g} {recording.stimulus_unit}"
        return (
            f"stops, at {value},"
            if ends and len(group.faults) == 1
            else f"is constant ({value}) unlike in other cycles"
        )
    return "differs from its other cycles"


def _size(value: float, recording: Recording, digits: int) -> str:
    """A value of an output with its unit, of an angle in deg."""
    unit = recording.columns.unit
    return f"{np.rad2deg(value):.{digits}g} deg" if unit == "rad" else f"{value:.{digits}g} {unit}"


def with_left_out(recording: Recording, accept: Iterable[str] = (), discard: int = 1) -> Recording:
    """The recording without the cycles that hold a fault, see `Trial.left_out`; faults with a code in ``accept`` stay.

    Raises `RecordingError`, with the way on, for a stimulus that never repeats, and where a fault leaves no trial with
    `LEAST_CYCLES` cycles after the first ``discard``.
    """
    accepted = {accept} if isinstance(accept, str) else set(accept)
    period = recording.period
    trials, reasons, gaps = [], [], 0.0
    for k, trial in enumerate(recording.trials, start=1):
        where = f"{recording.name}: trial {k}"
        groups = [t for t in _faults(trial, recording, discard) if t.code not in accepted]
        bad = sorted(_touched(groups, period, trial.samples)) if period else []
        trials.append(replace(trial, left_out=tuple(bad)) if bad else trial)
        reasons += [(t, _words(t, trial, recording, where)) for t in groups if period is None or bad]
        gaps = max([gaps, *((f.stop - f.start) / recording.rate_hz for t in groups for f in t.faults)])
    if not reasons:
        return recording
    sound = replace(recording, trials=tuple(trials))
    if period is not None and any(len(c) >= LEAST_CYCLES for c in sound.analysed(discard)):
        return sound
    codes = " and ".join(dict.fromkeys(repr(t.code) for t, _ in reasons))
    worse = sum(len(t.faults) for t, _ in reasons)
    more = f" ({len(reasons) - 1} more)" if len(reasons) > 1 else ""
    left = (
        "a stimulus without a period has no cycles that could be left out"
        if period is None
        else f"that leaves no trial with {LEAST_CYCLES} whole cycles after the first {discard}"
    )
    fill = ""
    if worse and all(t.kind in FILLABLE for t, _ in reasons):
        longest = np.ceil(100 * gaps) / 100
        fill = f"to interpolate: mcstudy import --fill-gaps {longest:g}, in Python fill_gaps(recording, {longest:g}); "
    raise RecordingError(f"{reasons[0][1]}{more}; {left}; {fill}to keep the values: accept {codes}")


def _touched(groups: Sequence[_Told], period: int, samples: int) -> set[int]:
    """Cycles that faults spoil, from 0; what follows a fault of the stimulus still answers to it."""
    cycles: set[int] = set()
    for t in groups:
        more = 1 if t.code == "stimulus" else 0
        for f in t.faults:
            last = (f.stop - 1 + BEFORE) // period
            cycles |= set(range(f.start // period, last + 1 + more))
    return {c for c in cycles if c < samples // period}


def fill_gaps(recording: Recording, longest_s: float) -> Recording:
    """The recording with held values and spikes of its angles interpolated (monotone cubic).

    Parameters
    ----------
    recording
        As `read_recording` or `import_recording` returned it, or made of arrays.
    longest_s
        Longest gap that is filled, s. Longer ones, those at an end of a trial, steps and clipped values stay.

    Returns
    -------
    Recording
        Its ``provenance`` says how much was interpolated.
    """
    trials, count = [], 0
    for trial in recording.trials:
        theta = trial.theta.copy()
        for c in range(theta.shape[1]):
            theta[:, c], n = without_gaps(theta[:, c], recording.rate_hz, longest_s)
            count += n
        trials.append(replace(trial, theta=theta))
    if not count:
        return recording
    note = f"{count} values of held or jumping angles interpolated (monotone cubic, gaps up to {longest_s:g} s)"
    kept = tuple(s for s in recording.suspicions if s.code not in CODES.values())
    out = replace(
        recording,
        trials=tuple(trials),
        suspicions=kept,
        provenance=sentences(recording.provenance, note),
    )
    noted = [s for k, t in enumerate(out.trials, start=1) for s in faults_in_words(out, t, f"{out.name}: trial {k}")]
    return replace(out, suspicions=(*kept, *noted))


def without_gaps(values: np.ndarray, rate_hz: float, longest_s: float) -> tuple[np.ndarray, int]:
    """An angle (n,) whose held values and spikes of at most ``longest_s`` are interpolated, and how many these are."""
    mask = np.zeros(values.size, dtype=bool)
    for f in angle_faults(values, rate_hz):
        if f.kind in FILLABLE and f.stop - f.start <= longest_s * rate_hz and f.start > 0 and f.stop < values.size:
            mask[f.start : f.stop] = True
    return (interpolated(values, mask) if mask.any() else values), int(mask.sum())
