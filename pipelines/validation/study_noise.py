"""Does sensor noise explain the measured noise of a fitted person, and which recordings does `study-from` refuse?

    python pipelines/validation/study_noise.py

``mcstudy study-from`` refuses a recording when the sensor noise that it finds evokes an RMS of the sway that is not
within a factor of 1.5 of the measured one. Recordings (two trials of six cycles, lines up to 3.1 Hz) of two bodies and
every kind of stimulus are fitted. Printed for each recording: this factor (the larger of both angles) and the largest
error (natural logarithm) among quantities that the data determine; then the factors on either side of the limit.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from study_round_trip import AMPLITUDES, CYCLES, RATE_HZ, TRIALS

import mcstudy as mc
from mcstudy.identification.fit import fit_lines
from mcstudy.identification.settings import FitSettings
from mcstudy.identification.study_noise import LIKE, fitted_noise
from mcstudy.lines.checked_recording import checked_recording
from mcstudy.lines.settings import LineSettings
from pipelines import measured
from pipelines.validation.coverage import DISCARD, body, truths

FMAX = 3.1


def one(stimulus: str, number: int, seed: int) -> tuple[float, float]:
    """Factor of the RMS, and largest error (natural logarithm) of a determined quantity, of one recording."""
    amplitude = [AMPLITUDES[stimulus]] * TRIALS
    recording = mc.simulate(
        stimulus=stimulus, amplitude=amplitude, cycles=CYCLES, rate_hz=RATE_HZ, seed=seed, parameters=body(number)
    )
    checked = checked_recording(recording, LineSettings(fmax=FMAX, discard=DISCARD))
    fitted = replace(fit_lines(checked.lines, checked.nominal, FitSettings(seed=seed), curve=()), recording=recording)
    own = [e for e in fitted.estimates if e.verdict == "identifiable" and set(e.name.split(" + ")) <= body(0).keys()]
    true = truths(number, [e.name for e in own])
    error = np.abs(np.log(np.maximum([e.estimate for e in own], 1e-9) / true))
    return float(np.exp(np.abs(np.log(fitted_noise(fitted)[1])).max())), float(error.max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(201, 207)), help="default: 201 to 206")
    measured.add_option(parser)
    args = parser.parse_args()
    found = []
    for seed in args.seeds:
        for number in (0, 1 + seed % 5):
            for stimulus in AMPLITUDES:
                found.append(one(stimulus, number, seed))
                factor, error = found[-1]
                print(
                    f"seed {seed}, body {number}, {stimulus}: factor {factor:.2f}, largest error {error:.2f}",
                    flush=True,
                )
    factor, error = np.array(found).T
    refused = factor > LIKE
    print(f"{refused.sum()} of {refused.size} recordings refused; limit {LIKE:g}")
    for name, which in (("accepted", ~refused), ("refused", refused)):
        if which.any():
            f, e = factor[which], error[which]
            print(f"{name}: factor {f.min():.2f} to {f.max():.2f}, largest error {np.median(e):.2f} (median)")
    others = float(factor[~refused].max(initial=1.0))
    measured.write(args.json, {"refused": {"value": int(refused.sum())}, "others": {"value": others}})


if __name__ == "__main__":
    main()
