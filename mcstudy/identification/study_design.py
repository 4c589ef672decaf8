"""A study of one person's experiment: the fitted person as truth, the same stimulus, noise, cycles and lines."""

from __future__ import annotations

from typing import Any

import numpy as np

from mcstudy.errors import InputError
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.study_noise import noise_of
from mcstudy.lines.checked_recording import discarded
from mcstudy.recordings.joint_recording import JointRecording
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.measure import highest
from mcstudy.spectra.periodic import cycle_coefficients, excited_lines, only_odd, polarity
from mcstudy.stance.body import standing
from mcstudy.stance.stimulus import RECURRENCES, Prts
from mcstudy.study.design import Study
from mcstudy.study.group import HIGHEST_HZ

LIKE = 0.05
"""Largest relative difference of the lines of a recorded stimulus from those of a pseudorandom ternary sequence."""

LEAST_RATE_HZ = 100.0
"""Lowest sampling rate of a study; a recording may have a lower one."""

LINES_UPTO_HZ = 20.0
"""Highest line of a stimulus that is given by its lines; fits end at `HIGHEST_HZ`."""

STATES, STAGES = 8, 2
"""States of the shortest sequence, whose cycle lasts as long as that of any stimulus, and its stages."""


def study_of(fitted: FitRecord, name: str, *, realizations: int = 100, starts: int = 10, seed: int = 1) -> Study:
    """The study of the experiment in which a person was fitted; see `mcstudy.study_from`."""
    recording = fitted.recording
    if isinstance(recording, JointRecording):
        raise InputError(
            f"{fitted.name}: expected one stimulus, because a study has one, got {' and '.join(recording.labels)}"
        )
    if not isinstance(recording, Recording) or recording.period_s is None:
        raise InputError(
            f"{fitted.name}: expected a recording with a periodic stimulus, whose experiment can be repeated"
        )
    if fitted.method.effects:
        raise InputError(f"{fitted.name}: effects: expected none, a study has the model without effects")
    stimulus, amplitude = stimulus_of(recording, fitted)
    noise = noise_of(fitted)
    model, R = fitted.model, len(fitted.lines.repeats)
    fmax = highest(recording, fitted.method.fmax)
    what = f"the experiment of {fitted.name}, with its estimate as truth"
    body, highest_hz = standing(model), HIGHEST_HZ if standing(model) else fmax
    if fmax > highest_hz:
        what += f"; fits up to {HIGHEST_HZ:g} Hz, where that of the person used lines up to {fmax:g} Hz"
    begun: Study = Study.from_python(name, seed=seed, description=what)
    return begun.group(
        "experiment",
        realizations=realizations,
        starts=starts,
        fmax=[min(fmax, highest_hz)],
        amplitude=[float(f"{amplitude:.6g}")],
        model=_of_body(recording, fitted) if body else model.with_values(_values(fitted)),
        stimulus={**({"kind": recording.stimulus} if body else {}), **stimulus, "cycles": R + 1, "discard": 1},
        noise=noise.section(),
        spectra={"points": "odd_lines", "ramp": "remove", **({} if body else {"highest_hz": fmax})},
        # between bounds as wide as a person's few uniform starts end lowest
        fit={"cost": "ml", "starts": "linearised"} if body else {"cost": "ml"},
    )


def _values(fitted: FitRecord) -> dict[str, float]:
    """The estimates by name."""
    return {n: float(v) for n, v in zip(fitted.model.names, fitted.theta, strict=True)}


def _of_body(recording: Recording, fitted: FitRecord) -> dict[str, Any]:
    """The model of a standing body, with the bounds of the fit."""
    model = fitted.model
    absolute = {n: [float(a), float(b)] for n, a, b in zip(model.names, model.lower, model.upper, strict=True)}
    return {
        "truth": _values(fitted),
        "body": {n: float(getattr(recording.body, n)) for n in ("J1", "J2", "C1", "C2", "A1", "A2", "g")},
        "bounds": {"absolute": absolute},
    }


def stimulus_of(recording: Recording, fitted: FitRecord) -> tuple[dict[str, Any], float]:
    """The stimulus of a recording as the table of a study file, and its amplitude (peak).

    A pseudorandom ternary sequence is one. Any other stimulus with odd lines only is given by its lines.
    Raises `InputError` for a stimulus with even lines.
    """
    amplitude = float(np.sqrt(np.mean(fitted.lines.amplitude**2)))
    prts = sequence_of(recording, fitted)
    if prts is not None:
        times = int(np.ceil(LEAST_RATE_HZ / 2 / recording.rate_hz))
        rate_hz = recording.rate_hz * times
        return {"stages": prts.stages, "state_s": prts.state_s, "rate_hz": rate_hz}, amplitude
    period_s = float(recording.period_s or 0.0)
    upto = min(LINES_UPTO_HZ, recording.rate_hz / 2.2)
    cycles = cycle_coefficients(recording, upto, discarded(fitted.method.discard or 1, 0))
    excited = excited_lines(cycles.stimulus)
    excited = excited[excited <= upto * period_s + 0.5]
    if not only_odd(cycles.stimulus, excited):
        raise InputError(
            f"{recording.name}: stimulus: expected one with odd harmonics of its period only, as in every study, got "
            "even ones too"
        )
    scale = polarity(cycles.stimulus) / cycles.amplitude
    coefficients = (cycles.stimulus[:, excited] * scale[:, None]).mean(axis=0)
    samples = STATES * int(np.ceil(period_s * max(LEAST_RATE_HZ, recording.rate_hz) / STATES))
    sequence = {"stages": STAGES, "state_s": period_s / STATES, "rate_hz": samples / period_s}
    size = np.abs(coefficients)
    lines = {
        "harmonic": [int(k) for k in excited],
        "weight": [float(f"{w:.6g}") for w in size / size.max()],
        "phase_deg": [float(f"{p:.6g}") for p in np.degrees(np.angle(coefficients))],
    }
    return {**sequence, "lines": lines}, _peak(coefficients, excited, samples) * amplitude


def _peak(coefficients: np.ndarray, harmonic: np.ndarray, samples: int) -> float:
    """Largest value of a waveform with these lines, coefficients (K,) as of a cycle."""
    c = np.zeros(samples // 2 + 1, dtype=complex)
    c[harmonic] = coefficients
    return float(np.abs(np.fft.irfft(c, samples, norm="forward")).max())


def sequence_of(recording: Recording, fitted: FitRecord) -> Prts | None:
    """The pseudorandom ternary sequence that a recording's stimulus is, of peak 1; None if it is none."""
    lines, period = fitted.lines, recording.period or 0
    size = np.sqrt(lines.power)
    for stages in RECURRENCES:
        held = period / (3**stages - 1)
        if held < 1 or abs(held - round(held)) > 1e-6 * held:
            continue
        prts = Prts(stages, round(held) / recording.rate_hz, recording.rate_hz, 1.0)
        odd = np.arange(1, int(fitted.lines.f[-1] * prts.period_s + 0.5) + 1, 2)
        if lines.harmonic is None or not np.array_equal(lines.harmonic, odd):
            continue
        ratio = size / np.abs(prts.coefficients()[odd])
        if np.abs(ratio / np.median(ratio) - 1).max() < LIKE:
            return prts
    return None
