"""Do the forecasts of ``mcstudy fit`` come true? Refits of simulated recordings with each change, against forecasts.

    python pipelines/validation/interval_forecasts.py --recordings 20

Every recording (two trials of four cycles at 5 N m, lines up to 3 Hz) is fitted, and fitted again with twice the
cycles, twice the amplitude, lines up to 8 Hz, and for each quantity with the parameter known that its forecast names.
Printed for every change: the half-width of the intervals after it over its forecast, as a geometric mean over
quantities and recordings, and the range that holds 80 % of them. The mean is 1 if forecasts are right; intervals of two
recordings differ by chance.
"""

from __future__ import annotations

import argparse

import numpy as np

import mcstudy as mc
from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.identification.fit import fit_lines
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.forecast import Forecast
from mcstudy.identification.settings import FitSettings
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.stimulus import Prts
from pipelines import measured

FMAX, HIGHER = 3.0, 8.0
KNOWN = 1e-4
"""Width of the bounds of a parameter that is known, relative to its value."""

Ratios = dict[str, list[float]]


def record(seed: int, amplitude: float = 5.0, cycles: int = 4) -> mc.Recording:
    """A recording of the nominal body."""
    protocol = Protocol(waveform=Prts(rate_hz=100.0), amplitudes=(amplitude, amplitude), cycles=cycles)
    return simulate_recording(protocol, two_segment().truth, np.random.default_rng(seed))


def refit(recording: mc.Recording, fmax: float, known: str = "") -> FitRecord:
    """The fit without what is said about it; a ``known`` parameter is held at its true value."""
    nominal, bounds = recording.base_model(), {}
    if known:
        value = float(nominal.truth[nominal.names.index(known)])
        bounds[known] = (value * (1 - KNOWN), value * (1 + KNOWN))
    return fit_lines(measure(recording, fmax), nominal, FitSettings(bounds=bounds))


def ratios(seed: int) -> tuple[Ratios, Ratios]:
    """By change: half-width over forecast of every quantity, firm forecasts and rough ones."""
    fitted = mc.fit(record(seed), fmax=FMAX)
    found = [f for f in fitted.forecasts if fitted[f.name].verdict == "identifiable"]
    firm: Ratios = {}
    rough: Ratios = {}

    def enter(change: str, forecasts: list[Forecast], after: FitRecord, value: str) -> None:
        for f in forecasts:
            e, predicted = after[f.name], getattr(f, value)
            if e.verdict == "identifiable":
                (rough if f.rough else firm).setdefault(change, []).append((e.high - e.low) / 2 / predicted)

    enter("twice the cycles", found, refit(record(seed, cycles=7), FMAX), "cycles")  # the first is left out
    enter("twice the amplitude", found, refit(record(seed, 10.0), FMAX), "amplitude")
    enter(f"up to {HIGHER:g} Hz", found, refit(record(seed), HIGHER), "fmax")
    for known in sorted({f.known for f in found}):
        enter("one known", [f for f in found if f.known == known], refit(record(seed), FMAX, known), "with_known")
    return firm, rough


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=20)
    measured.add_option(parser)
    args = parser.parse_args()
    every = [ratios(seed) for seed in range(args.recordings)]
    print(f"{args.recordings} recordings: half-width / forecast, geometric mean [10 %, 90 %] (number)")
    print(f"{'change':20} {'firm forecasts':>28} {'rough forecasts':>28}")
    changes = ("twice the cycles", "twice the amplitude", f"up to {HIGHER:g} Hz", "one known")
    firm: dict[str, measured.Value] = {}
    for key, change in zip(("cycles", "amplitude", "fmax", "known"), changes, strict=True):
        cells = []
        for kind in (0, 1):
            x = np.log([v for pair in every for v in pair[kind].get(change, [])])
            low, high = np.exp(np.quantile(x, (0.1, 0.9))) if x.size else (np.nan, np.nan)
            if x.size and not kind:
                firm[key] = {"value": float(np.exp(x.mean()))}
            cells.append(f"{np.exp(x.mean()):.2f} [{low:.2f}, {high:.2f}] ({x.size})" if x.size else "-")
        print(f"{change:20} {cells[0]:>28} {cells[1]:>28}")
    measured.write(args.json, firm)


if __name__ == "__main__":
    main()
