"""What do several stimuli tell of one person, and are joint intervals and joint diagnoses right?

    python pipelines/validation/joint_recordings.py coverage --sets 100
    python pipelines/validation/joint_recordings.py noise --sets 200
    python pipelines/validation/joint_recordings.py alarms --sets 40
    python pipelines/validation/joint_recordings.py twins

``coverage``: sets of two recordings (ankle torque 5 N m, hip torque 2 N m, one trial of six cycles each) of bodies
whose parameters are drawn within 20 % of nominal, fitted together. Counted is how often each 95 % interval holds the
truth. The standard deviation of the estimates, in units of what the Fisher information of the sum predicts at the
truth from the noise of the simulation (`mcstudy.stance.information.expected_line_covariance`), and the width of the
interval relative to that of two trials of ankle torque.

``noise``: whether the noise that is estimated in single recordings of one trial explains the errors of the responses.

``alarms``: the same sets, diagnosed together; counted are false alarms at the 5 % level. With ``--alone`` of single
recordings of ankle torque.

``twins``: for experiments of equal duration (six trials of six cycles, up to 8 Hz, nominal body), how many linear
effects have an indistinguishable twin. The platform moves by 3 cm RMS. Also with other limits of similarity, and
without pairs that are variants of one cause.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import betaincinv

from mcstudy.effect_library.library import LIBRARY
from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.errors import FallsError
from mcstudy.fitting.penalised import whiten
from mcstudy.gap.diagnose import detect
from mcstudy.gap.settings import DiagnosisSettings
from mcstudy.gap.trial_planning.trials import PlannedTrial, SwayNoise
from mcstudy.gap.trial_planning.twins import Twins, twins_of_design
from mcstudy.identification.fit import fit_lines
from mcstudy.identification.settings import FitSettings
from mcstudy.lines.checked_recording import checked_recording, given_model
from mcstudy.lines.settings import LineSettings
from mcstudy.models.quantities import quantities
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.information import expected_line_covariance, line_information, standard_errors, unit_variance
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_spectral import sway_psd
from mcstudy.stance.stimulus import Prts
from mcstudy.streams import stream

PLATFORM_RMS_M = 0.03
CYCLES = 6
RATE_HZ = 50.0
LIMITS = (0.95, 0.98, 0.99)
"""Limits of the |cosine| above which effects count as twins; the first is that of the diagnosis."""

CLOSE = 0.985

AMPLITUDE = {"ankle_torque": 5.0, "hip_torque": 2.0, "platform_translation": 0.03}


def recorded(kind: str, theta: np.ndarray, rng: np.random.Generator, trials: int = 1, **body: object) -> Recording:
    """Trials of one kind of stimulus."""
    waveform = Prts(rate_hz=RATE_HZ)
    protocol = Protocol(kind, waveform, (AMPLITUDE[kind],) * trials, CYCLES)
    return simulate_recording(protocol, theta, rng, name=kind, **body)  # type: ignore[arg-type]


def fisher_errors(theta: np.ndarray, kinds: Sequence[str], fmax: float) -> np.ndarray:
    """Standard errors of all quantities of a fit from theory alone, one trial of each kind."""
    information = 0.0
    for kind in kinds:
        model, waveform = two_segment(stimulus=kind), replace(Prts(rate_hz=RATE_HZ), amplitude=AMPLITUDE[kind])
        harmonic = np.arange(1, waveform.samples // 2, 2)
        f = harmonic / waveform.period_s
        keep = f <= fmax
        drive = np.abs(waveform.coefficients()[harmonic][keep])
        C = expected_line_covariance(model, theta, SensorNoise(), f[keep], drive, (CYCLES - 1) * waveform.period_s)
        information = information + line_information(model, theta, f[keep], unit_variance(C)).sum(axis=0)
    gradients = np.array([q.gradient(theta) for q in quantities(two_segment(), ())])
    return standard_errors(np.asarray(information), gradients)


def coverage(sets: int, fmax: float) -> None:
    """Print the table of ``coverage``, a line for every quantity."""
    held, off, width, wide = [], [], [], []
    for k in range(sets):
        rng = stream(k, "joint sets")
        theta = two_segment().truth * rng.uniform(0.8, 1.2, two_segment().truth.size)
        try:
            ankle, hip, again = (recorded(kind, theta, rng) for kind in ("ankle_torque", "hip_torque", "ankle_torque"))
        except FallsError:  # unstable: no person
            continue
        fits = []
        for chosen in ([ankle, hip], [ankle, again]):
            checked = checked_recording(chosen, LineSettings(fmax=8.0))
            lines = checked.lines.below(fmax)
            nominal = given_model(None, checked.recording, lines)
            fits.append(fit_lines(lines, nominal, FitSettings(seed=k), curve=()))
        joint, alone = fits
        truth = np.array([q.value(theta) for q in quantities(two_segment(), ())])
        low, high, at = (np.array([getattr(e, n) for e in joint.estimates]) for n in ("low", "high", "estimate"))
        held.append((low <= truth) & (truth <= high))
        off.append((at - truth) / fisher_errors(theta, ("ankle_torque", "hip_torque"), fmax))
        width.append(high - low)
        wide.append([e.high - e.low for e in alone.estimates])
    n = len(held)
    print(f"{n} sets of one trial each of ankle and hip torque, up to {fmax:g} Hz; width: against two of ankle torque")
    print(f"{'quantity':12}  covered %  SD of estimate / Fisher  width of interval / ankle torque alone")
    ratio = np.median(np.array(width) / np.array(wide), axis=0)
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    for e, c, s, r in zip(joint.estimates, np.mean(held, axis=0), rms, ratio, strict=True):
        print(f"{e.name:12}  {100 * c:9.0f}  {s:23.2f}  {r:38.2f}")
    means = 100 * np.mean(held), np.exp(np.log(rms).mean()), np.exp(np.log(ratio).mean())
    print(f"{'mean':12}  {means[0]:9.1f}  {means[1]:23.2f}  {means[2]:38.2f}")


def noise(sets: int, fmax: float) -> None:
    """Print the squared error of measured responses, relative to the noise that is estimated with them."""
    squared = []
    for k in range(sets):
        rng, model = stream(k, "measured noise"), two_segment()
        theta = model.truth * rng.uniform(0.9, 1.1, model.truth.size)
        try:
            lines = measure(recorded("ankle_torque", theta, rng), fmax)
        except FallsError:  # unstable: no person
            continue
        squared.append(np.mean(whiten(lines.noise.whitener, lines.y - frf(model, theta, lines.f)) ** 2))
    error = np.std(squared, ddof=1) / np.sqrt(len(squared))
    print(
        f"{len(squared)} recordings of one trial up to {fmax:g} Hz: squared error {np.mean(squared):.3f} "
        f"+- {error:.3f} (standard error) of what the estimated noise gives"
    )


def alarms(sets: int, fmax: float, kinds: Sequence[str]) -> None:
    """Print how many sets of sound bodies are said to have a gap."""
    p, squared = [], []
    for k in range(sets):
        rng = stream(k, "joint alarms")
        theta = two_segment().truth * rng.uniform(0.9, 1.1, two_segment().truth.size)
        try:
            recordings = [recorded(kind, theta, rng) for kind in kinds]
        except FallsError:  # unstable: no person
            continue
        found = detect(recordings, DiagnosisSettings(fast=True, fmax=fmax))
        p.append(found.p_value)
        squared.append(found.detection.chi2 / found.detection.expected_chi2)
    false = sum(x < 0.05 for x in p)
    low, high = (betaincinv(false + a, len(p) - false + 1 - a, q) for a, q in ((0, 0.025), (1, 0.975)))
    error = np.std(squared, ddof=1) / np.sqrt(len(p))
    print(
        f"{false} false alarms in {len(p)} sets up to {fmax:g} Hz (95 % interval {100 * (low if false else 0):.1f} to "
        f"{100 * high:.1f} %); smallest p-value {min(p):.2g}; squared residual {np.mean(squared):.3f} +- {error:.3f} "
        "(standard error) of what noise explains"
    )


def designs() -> None:
    """Print the effects with a twin for one, two and three stimuli, and how many there are by another definition."""
    model, f = two_segment(), np.geomspace(0.01, 10.0, 600)
    sway = SwayNoise(f, sway_psd(model, model.truth, SensorNoise(), f))
    peak = {"ankle_torque": 5.0, "hip_torque": 5.0, "platform_translation": 1.0}
    trial = PlannedTrial("platform_translation", 1.0, "prts", 1, CYCLES, 1, 8.0)
    peak["platform_translation"] = PLATFORM_RMS_M / float(np.sqrt(2 * (np.abs(trial.drive) ** 2).sum()))
    kinds = tuple(peak)
    for fmax in (8.0, 3.1):
        counts = []
        for n in (1, 2, 3):
            trials = [PlannedTrial(k, peak[k], "prts", 6 // n, CYCLES, 1, fmax) for k in kinds[:n]]
            found = twins_of_design(model, trials, sway, Body())
            groups = "; ".join(", ".join(g) for g in found.groups)
            effects = len(found.effects)
            print(f"{', '.join(kinds[:n])}, {fmax:g} Hz: {found.count} of {effects} effects have a twin ({groups})")
            counts.append([twins_apart_from_variants(found, limit) for limit in LIMITS])
            print("    closest:", ", ".join(closest(found)))
        for limit, row in zip(LIMITS, np.transpose(counts), strict=True):
            print(
                f"{fmax:g} Hz, |cosine| above {limit:g}, without variants of one cause: {', '.join(map(str, row))} "
                "with one, two, three stimuli"
            )


def closest(found: Twins) -> list[str]:
    """Pairs of effects of different causes with the largest |cosine|, above `CLOSE`."""
    cosine = np.tril(found.cosine, -1)
    order = np.argsort(-cosine, axis=None)[: int((cosine > CLOSE).sum())]
    pairs = [(*(found.effects[i] for i in np.unravel_index(k, cosine.shape)), cosine.flat[k]) for k in order]
    return [f"{a} and {b} {c:.4f}" for a, b, c in pairs if LIBRARY[a].cause != LIBRARY[b].cause]


def twins_apart_from_variants(found: Twins, limit: float) -> int:
    """Effects with a |cosine| above ``limit`` to one of another cause."""
    cause = np.array([LIBRARY[n].cause for n in found.effects])
    alike = (found.cosine > limit) & (cause[:, None] != cause)
    return int(alike.any(axis=1).sum())


def main(arguments: list[str] | None = None) -> None:
    """Print what was asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("coverage", "noise", "alarms", "twins"))
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--fmax", type=float, default=3.1)
    parser.add_argument("--alone", action="store_true", help="alarms: recordings of ankle torque alone")
    given = parser.parse_args(arguments)
    if given.what == "coverage":
        coverage(given.sets, given.fmax)
    elif given.what == "alarms":
        alarms(given.sets, given.fmax, ("ankle_torque",) if given.alone else ("ankle_torque", "hip_torque"))
    elif given.what == "noise":
        noise(given.sets, given.fmax)
    else:
        designs()


if __name__ == "__main__":
    main()
