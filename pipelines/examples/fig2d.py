"""Why FRFs of noise-free simulations differ from the equations (Goodworth & Peterka 2018, Fig. 2D), cause by cause.

The same body without noise is simulated with one thing changed at a time, and its FRF (DFT of the sway over DFT of the
stimulus' 200 Hz samples) is compared with the closed form. Columns: relative error of the FRF near 0.41, 1.2 and 8 Hz,
sway error in percent of the sway's RMS, how much of it is the same in every cycle, and what the error does to a fit up
to 8 Hz: its cost J and the mean error of the 12 parameters.
"""

import argparse
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mcstudy.fitting.linearised import linearised
from mcstudy.fitting.problem import paper_cost
from mcstudy.fitting.solvers import fit
from mcstudy.spectra import periods
from mcstudy.spectra.bands import odd_lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_time import simulate
from mcstudy.stance.stability import growth_rate
from mcstudy.stance.stimulus import Prts

SAMPLED_HZ = 200.0
SLOW_K11 = 0.70
"""Fraction of K11 at which the stand-in body has a slow closed-loop mode."""

points = odd_lines(8.0)
AT = [int(np.argmin(np.abs(points.f - f))) for f in (0.41, 1.2, 8.0)]
body = two_segment()
coarse = Prts(rate_hz=SAMPLED_HZ)


@dataclass(frozen=True)
class Case:
    """One simulation: ``rate`` of the solver, torque ``between`` the 200 Hz samples, cycles ``dropped``."""

    name: str
    rate: float = SAMPLED_HZ
    between: str = "straight"
    dropped: int = 1
    cycles: int = 3
    correct: bool = False
    slow: bool = False


@dataclass(frozen=True)
class Result:
    """``error``: relative FRF errors at the lines, (L, 2). Shares in percent. ``fit``: J and mean parameter error."""

    error: np.ndarray
    sway: float
    repeats: float
    fit: tuple[float, float]


def cases(fine: float) -> list[Case]:
    """All cases; ``fine`` is the faster solver rate, Hz."""
    return [
        Case("straight between samples, as the PRTS is"),
        Case("the same, solver faster", fine),
        Case("held between samples, solver faster", fine, "held"),
        Case("sampled, solved and analysed faster", fine, "resampled"),
        Case("first cycle kept", dropped=0),
        Case("first cycle kept, solver faster", fine, dropped=0),
        Case("slow mode", slow=True),
        Case("slow mode, solver faster", fine, slow=True),
        Case("straight, drive times sinc squared", correct=True),
        Case("held, drive times sinc and half a sample late", fine, "held", correct=True),
    ]


def torque(case: Case) -> np.ndarray:
    """One cycle of the torque at the solver's samples; the simulator joins these by straight lines."""
    if case.between == "resampled":
        return replace(coarse, rate_hz=case.rate).waveform()
    factor, samples = round(case.rate / SAMPLED_HZ), coarse.waveform()
    if case.between == "held":
        return np.repeat(samples, factor)
    x = np.arange(samples.size * factor) / factor
    return np.interp(x, np.arange(samples.size + 1), np.append(samples, samples[0]))


def drive(case: Case, cycle: np.ndarray) -> np.ndarray:
    """Fourier coefficients of the stimulus that the sway's are divided by, (L,)."""
    if case.between == "resampled":
        return periods.coefficients(cycle)[points.lines]
    known = coarse.coefficients()[points.lines]
    if not case.correct:
        return known
    # what a hold or straight lines make of the samples' spectrum; a simulated jump takes one step of the solver
    if case.between == "held":
        late = 0.5 / SAMPLED_HZ - 0.5 / case.rate
        held = np.sinc(points.f / SAMPLED_HZ) * np.sinc(points.f / case.rate)
        return known * held * np.exp(-2j * np.pi * points.f * late)
    return known * np.sinc(points.f / SAMPLED_HZ) ** 2


def subject(slow: bool) -> Model:
    """The stand-in body, or the same with a slow closed-loop mode."""
    if not slow:
        return body
    weak = [replace(p, value=SLOW_K11 * p.value) if p.name == "K11" else p for p in body.parameters]
    return replace(body, parameters=tuple(weak))


def run(case: Case) -> Result:
    """Simulate, estimate the FRF, compare and fit."""
    model, cycle = subject(case.slow), torque(case)
    n = cycle.size
    sway = simulate(model, model.truth, np.tile(cycle, case.cycles), case.rate).theta
    ideal = frf(model, model.truth, points.f)
    divisor = drive(case, cycle)[:, None]
    estimate = periods.raw(sway, n, case.dropped)[points.lines] / divisor
    error = estimate / ideal - 1
    # sway error of each analysed cycle, from the lines up to 8 Hz
    wanted = ideal * divisor
    each = np.array([periods.coefficients(c)[points.lines] for c in periods.cut(sway, n, case.dropped)]) - wanted
    total = np.sum(np.abs(each) ** 2)
    same = np.sum(np.abs(each.mean(axis=0)) ** 2) * len(each)
    problem = paper_cost(model, points.f, estimate)
    found = fit(problem, linearised(problem, np.random.default_rng(0), 5))
    misses = np.mean(np.abs(found.estimate[found.best] / model.truth - 1))
    return Result(
        error=error,
        sway=float(100 * np.sqrt(total / len(each) / np.sum(np.abs(wanted) ** 2))),
        repeats=float(100 * same / total),
        fit=(float(found.cost[found.best]), float(100 * misses)),
    )


def held_recording(source: Path, target: Path) -> None:
    """Copy a recording of the nominal body (a folder of `mcstudy simulate`) as if its torque had been held."""
    shutil.copytree(source, target)
    factor = 10
    for file in sorted(source.glob("*.csv")):
        header = file.read_text().split("\n", 1)[0]
        record = np.loadtxt(file, delimiter=",", skiprows=1)
        straight = simulate(body, body.truth, record[:, 1], SAMPLED_HZ).angle
        held = simulate(body, body.truth, np.repeat(record[:, 1], factor), factor * SAMPLED_HZ).angle[::factor]
        record[:, 2:4] += np.degrees(held - straight)  # the loop is linear: noise-evoked sway stays as it is
        np.savetxt(target / file.name, record, delimiter=",", header=header, comments="", fmt="%.12g")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--held",
        type=Path,
        nargs=2,
        metavar=("REC", "OUT"),
        help="only write a copy OUT of the recording REC with its torque held between samples",
    )
    parser.add_argument(
        "--fine", type=float, default=2000.0, help="rate of the faster solver, Hz (default 2000; the paper: 10000)"
    )
    arguments = parser.parse_args()
    if arguments.held:
        held_recording(*arguments.held)
        raise SystemExit
    fine = arguments.fine
    rates = [growth_rate(m, m.truth) for m in (subject(False), subject(True))]
    print(f"slowest mode: {rates[0]:.2f} 1/s; of the body with a slow mode: {rates[1]:.3f} 1/s")
    print(f"{'case':<47}{'Hz':>6}{'0.41 Hz':>9}{'1.2 Hz':>9}{'8 Hz':>9}{'sway %':>9}{'same %':>8}{'J':>9}{'par. %':>8}")
    for case in cases(fine):
        r = run(case)
        e = np.abs(r.error[AT]).max(axis=1)
        print(
            f"{case.name:<47}{case.rate:>6.0f}{e[0]:>9.1e}{e[1]:>9.1e}{e[2]:>9.1e}{r.sway:>9.2g}{r.repeats:>8.0f}"
            f"{r.fit[0]:>9.1e}{r.fit[1]:>8.2g}"
        )
