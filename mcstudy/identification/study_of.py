"""A study of one person's experiment: the fitted person as truth, the same stimulus, noise, cycles and lines."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from mcstudy.errors import InputError
from mcstudy.identification.result import FitResult
from mcstudy.recordings.recording import Recording
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import noise_response
from mcstudy.stance.stimulus import RECURRENCES, Prts
from mcstudy.study.design import Study

LIKE = 0.05
"""Largest relative difference of the lines of a recorded stimulus from those of a pseudorandom ternary sequence."""

LOWEST_CORNER_HZ, HIGHEST_CORNER_HZ = 0.01, 20.0
"""Between these a corner of the noise is sought."""

CORNERS = 60
"""Corners that are tried, at equal ratios."""

HIGHEST_HZ = 8.0
"""Highest frequency of the fits of a study."""


def study_of(fitted: FitResult, name: str, *, realizations: int = 100, starts: int = 10, seed: int = 1) -> Study:
    """The study of the experiment in which a person was fitted; see `mcstudy.study_from`."""
    recording = fitted.recording
    if not isinstance(recording, Recording) or recording.period_s is None:
        raise InputError(
            f"{fitted.name}: expected a recording with a periodic stimulus, whose experiment can be repeated"
        )
    if fitted.method["effects"]:
        raise InputError(f"{fitted.name}: effects: expected none, a study has the model without effects")
    prts = sequence_of(recording, fitted)
    noise = noise_of(fitted)
    model, R = fitted.model, len(fitted.lines.repeats)
    amplitude = float(np.sqrt(np.mean(fitted.lines.amplitude**2)))
    what = f"the experiment of {fitted.name}, with its estimate as truth"
    begun: Study = Study.from_python(name, seed=seed, description=what)
    return begun.group(
        "experiment",
        realizations=realizations,
        starts=starts,
        fmax=[min(float(fitted.method["fmax"]), HIGHEST_HZ)],
        amplitude=[float(f"{amplitude:.6g}")],
        model={
            "truth": {n: float(v) for n, v in zip(model.names, fitted.theta, strict=True)},
            "body": {n: float(getattr(recording.body, n)) for n in ("J1", "J2", "C1", "C2", "A1", "A2", "g")},
            "bounds": {
                "absolute": {
                    n: [float(a), float(b)] for n, a, b in zip(model.names, model.lower, model.upper, strict=True)
                }
            },
        },
        stimulus={
            "kind": recording.stimulus,
            "stages": prts.stages,
            "state_s": prts.state_s,
            "rate_hz": recording.rate_hz,
            "cycles": R + 1,
            "discard": 1,
        },
        noise={"psd": [float(p) for p in noise.psd_deg2_hz], "corner_hz": noise.corner_hz},
        spectra={"points": "odd_lines", "ramp": "remove"},
        fit={"cost": "ml", "starts": "linearised"},  # between such wide bounds few uniform starts end lowest
    )


def sequence_of(recording: Recording, fitted: FitResult) -> Prts:
    """The pseudorandom ternary sequence that a recording's stimulus is, of peak 1.

    Raises `InputError` when its lines are not those of such a sequence.
    """
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
    raise InputError(
        f"{recording.name}: stimulus: expected a pseudorandom ternary sequence of {min(RECURRENCES)} to "
        f"{max(RECURRENCES)} stages whose states last whole samples; a study file has no other stimulus"
    )


def noise_of(fitted: FitResult) -> SensorNoise:
    """The noise that evokes the measured RMS of both angles in the fitted body; of these the most likely.

    Raises `InputError` when there is none.
    """
    lines, recording = fitted.lines, fitted.recording
    assert isinstance(recording, Recording)
    seconds = len(lines.repeats) * float(recording.period_s or 0.0)
    measured = lines.noise.C * (2 * seconds * lines.power)[:, None, None]
    measured = np.einsum("nii->ni", measured).real
    response = np.abs(noise_response(fitted.model, fitted.theta, lines.f)[:, :2, :2]) ** 2

    best = None
    for corner in np.geomspace(LOWEST_CORNER_HZ, HIGHEST_CORNER_HZ, CORNERS):
        # The two densities with which the sway has the measured mean square, per angle.
        shape = SensorNoise((1.0, 1.0), float(corner)).psd(lines.f)
        sums = np.einsum("nij,nj->ij", response, shape)
        size = measured.sum(axis=0)
        psd, _ = optimize.nnls(sums / size[:, None], np.ones(2))
        level = np.einsum("nij,nj->ni", response, shape * psd)
        unlikely = float((lines.noise.dof[:, None] * (np.log(level) + measured / level)).sum())
        if (psd > 0).all() and (best is None or unlikely < best[0]):
            noise = SensorNoise((float(psd[0]), float(psd[1])), float(f"{corner:.4g}"))
            best = unlikely, noise
    if best is None:
        raise InputError(
            f"{fitted.name}: noise: no noise of a study evokes the measured sway in the fitted body; "
            "use more lines (fmax) or more trials"
        )
    return best[1]
