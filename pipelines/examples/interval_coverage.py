"""How often do the 95 % intervals of ``mcstudy fit`` contain the true values?

    python pipelines/examples/interval_coverage.py --recordings 200

Every recording is simulated in the time domain, from a body whose parameters are drawn evenly within 20 % of the
nominal ones, and fitted up to each Fmax. Printed: percentage of intervals that contain the truth, profile likelihood
and Wald; the standard error of 95 % among n recordings is sqrt(0.95 x 0.05 / n).
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

import mcstudy as mc
from mcstudy.fitting.compilers import cores
from mcstudy.identification.fit import fit_lines
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.stability import growth_rate
from mcstudy.streams import stream

SPREAD = 0.2
SLOWEST = -0.5  # 1/s: bodies that are hardly stable sway for minutes after a push


def person(seed: int) -> dict[str, float]:
    """True parameters of a random body that stands."""
    nominal, rng = two_segment(), stream(seed, "coverage")
    while True:
        theta = nominal.truth * (1 + rng.uniform(-SPREAD, SPREAD, nominal.truth.size))
        if growth_rate(nominal, theta) < SLOWEST:
            return dict(zip(nominal.names, map(float, theta), strict=True))


def one(seed: int, fmax: tuple[float, ...], cycles: int) -> list[tuple[float, str, bool, bool, bool]]:
    """For every Fmax and quantity: whether the profile interval, and Wald's, hold the truth; whether data end both."""
    truth = person(seed)
    recording = mc.simulate(parameters=truth, cycles=cycles, seed=seed)
    out = []
    for f in fmax:
        for e in fit_lines(measure(recording, f), two_segment(), seed=seed).estimates:
            value = sum(truth[name] for name in e.name.split(" + "))
            held = e.low <= value <= e.high, e.wald_low <= value <= e.wald_high
            out.append((f, e.name, *held, e.verdict == "identifiable"))
    return out


def main() -> None:
    """Simulate, fit, count and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=int, default=200, help="number of recordings (default 200)")
    parser.add_argument("--cycles", type=int, default=6, help="stimulus periods per trial (default 6)")
    parser.add_argument("--fmax", type=float, nargs="+", default=[1.2, 3.1, 8.0], help="highest frequencies, Hz")
    args = parser.parse_args()
    count: dict[tuple[float, str], list[tuple[bool, bool, bool]]] = defaultdict(list)
    run = partial(one, fmax=tuple(args.fmax), cycles=args.cycles)
    with ProcessPoolExecutor(cores()) as pool:
        for rows in pool.map(run, range(args.recordings)):
            for f, name, *held in rows:
                count[f, name].append(tuple(held))
    print(
        f"{args.recordings} recordings: % of 95 % intervals that hold the truth (Wald; % ended by data on both sides)"
    )
    names = list(dict.fromkeys(name for _, name in count))
    print("".join([f"{'quantity':14}", *(f"{f'{f:g} Hz':>18}" for f in args.fmax)]))
    for name in names:
        shown = [100 * np.mean(count[f, name], axis=0) for f in args.fmax]
        print("".join([f"{name:14}", *(f"{h:8.1f} ({w:.0f}; {i:.0f})".rjust(18) for h, w, i in shown)]))
    overall = [100 * np.mean([np.mean(count[f, n], axis=0) for n in names], axis=0) for f in args.fmax]
    print("".join([f"{'mean':14}", *(f"{h:8.1f} ({w:.0f}; {i:.0f})".rjust(18) for h, w, i in overall)]))


if __name__ == "__main__":
    main()
