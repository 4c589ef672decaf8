"""Does a study of a person's experiment scatter as the intervals of the fit say?

    python pipelines/validation/study_round_trip.py

A simulated recording (two trials of six cycles) of every stimulus kind is fitted, `mcstudy.study_from` writes the study
of its experiment, and the study is run. Printed for every quantity that the
recording determines: the standard deviation of the study's estimates over the half-width of the profile likelihood
interval in standard errors (half-width / 1.96). It is 1 on average if both are right; intervals of one recording and
standard deviations of few realizations differ from it by chance.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

import mcstudy as mc
from mcstudy.errors import InputError
from pipelines import measured

AMPLITUDES = {
    "ankle_torque": 5.0,
    "hip_torque": 3.0,
    "platform_translation": 0.01,
    "surface_tilt": 0.02,
    "visual_tilt": 0.05,
}
"""Peak of the stimulus, N m, m or rad, by kind."""

TRIALS, CYCLES, RATE_HZ, NORMAL = 2, 6, 100.0, 1.96


def ratios(
    stimulus: str, fmax: float = 3.1, realizations: int = 20, starts: int = 8, seed: int = 5
) -> dict[str, tuple[float, float]]:
    """By quantity that data determine on both sides: standard deviation of the study, standard error of the fit."""
    amplitude = [AMPLITUDES[stimulus]] * TRIALS
    recording = mc.simulate(stimulus=stimulus, amplitude=amplitude, cycles=CYCLES, rate_hz=RATE_HZ, seed=seed)
    fitted = mc.fit(recording, fmax=fmax)
    study = mc.study_from(fitted, "round_trip", realizations=realizations, starts=starts)
    with tempfile.TemporaryDirectory() as folder:
        group = mc.run(study, Path(folder) / "cube.zarr", workers=1)["experiment"].isel(amplitude=0, fmax=0).load()
    best = group.estimate.isel(start=group.cost.argmin("start"))  # (realization, parameter)
    found = {}
    for e in fitted.estimates:
        if e.verdict == "identifiable":
            values = sum(best.sel(parameter=part) for part in e.name.split(" + "))
            found[e.name] = float(np.std(values, ddof=1)), (e.high - e.low) / (2 * NORMAL)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fmax", type=float, default=3.1, help="highest frequency, Hz (default 3.1)")
    parser.add_argument("--realizations", type=int, default=20, help="realizations of every study (default 20)")
    parser.add_argument("--starts", type=int, default=8, help="starts of every fit of the study (default 8)")
    parser.add_argument("--stimulus", nargs="+", choices=AMPLITUDES, help="kinds of stimulus (default: all)")
    measured.add_option(parser)
    args = parser.parse_args()
    means: dict[str, measured.Value] = {}
    for stimulus in args.stimulus or AMPLITUDES:
        try:
            pairs = ratios(stimulus, args.fmax, args.realizations, args.starts)
        except InputError as error:
            print(f"{stimulus}: no study: {error}")
            continue
        found = {name: a / b for name, (a, b) in pairs.items()}
        mean = float(np.exp(np.mean(np.log(list(found.values())))))
        means[stimulus.split("_")[0]] = {"value": mean}
        print(f"{stimulus}: geometric mean {mean:.2f}")
        print("  " + ", ".join(f"{name} {ratio:.2f}" for name, ratio in found.items()), flush=True)
    measured.write(args.json, means)


if __name__ == "__main__":
    main()
