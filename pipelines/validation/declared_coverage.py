"""How often do the intervals of a declared model hold the truth?

    python pipelines/validation/declared_coverage.py pipelines/examples/own_model.toml --recordings 60 --fmax 8

Recordings of the model of a study file, or of a model file, are simulated in time from its true values, with sensor
noise and with white noise of what is recorded, and fitted as `mcstudy.fit` does. Counted is in how many of them each
interval holds the truth, with the binomial range in which 95 % of such counts lie when the level is right.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.stats import binom

import mcstudy as mc
from mcstudy.identification.fit import fit_lines
from mcstudy.identification.settings import FitSettings
from mcstudy.lines.checked_recording import checked_recording
from mcstudy.lines.settings import LineSettings
from mcstudy.text_tables import table

LEVEL = 0.95


def held(model: Path, seed: int, options: argparse.Namespace) -> dict[str, bool]:
    """Whether the interval of each quantity of one recording holds its true value."""
    recording = mc.simulate(
        model=model,
        seed=seed,
        cycles=options.cycles,
        rate_hz=options.rate,
        amplitude=options.amplitude,
        noise=options.noise,
        measurement_sd=options.measurement_sd,
    )
    checked = checked_recording(recording, LineSettings(fmax=options.fmax))
    fitted = fit_lines(checked.lines, checked.nominal, FitSettings(level=LEVEL, seed=seed), name=recording.name)
    truth = dict(zip(checked.nominal.names, checked.nominal.truth, strict=True))
    return {e.name: bool(e.low <= truth[e.name] <= e.high) for e in fitted.estimates if e.name in truth}


def main() -> None:
    """Simulate, fit, count and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help="file with a table [model]")
    parser.add_argument("--recordings", type=int, default=60)
    parser.add_argument("--cycles", type=int, default=6)
    parser.add_argument("--rate", type=float, default=100.0, help="Hz")
    parser.add_argument("--amplitude", type=float, default=1.0, help="peak, in the unit of the stimulus")
    parser.add_argument("--noise", type=float, default=1.0, help="sensor noise, see `mcstudy simulate --noise`")
    parser.add_argument("--measurement-sd", type=float, default=0.02, help="see `mcstudy simulate --measurement-sd`")
    parser.add_argument("--fmax", type=float, help="Hz")
    options = parser.parse_args()
    answers = [held(options.model, seed, options) for seed in range(options.recordings)]
    low, high = (100 * x / len(answers) for x in binom.interval(LEVEL, len(answers), LEVEL))
    counts = {name: np.array([a[name] for a in answers]) for name in answers[0]}
    rows = [[name, f"{100 * c.mean():.1f}", "" if low <= 100 * c.mean() <= high else "*"] for name, c in counts.items()]
    print(table(["parameter", "intervals that hold the truth, %", "outside the range"], rows))
    print(
        f"{len(answers)} recordings; chance leaves {low:.1f} to {high:.1f} % of intervals of level {100 * LEVEL:g} %."
    )


if __name__ == "__main__":
    main()
