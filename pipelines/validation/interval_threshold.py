"""Which threshold would give the intervals of ``mcstudy fit`` a coverage of exactly 95 %, and what would it cost?

    python pipelines/validation/interval_threshold.py --bodies --draws 300
    python pipelines/validation/interval_threshold.py --recordings 20

The likelihood ratio of a quantity at its true value does not follow the law that the threshold assumes where bounds
hold other parameters, or where data leave some of them open. Its law can be simulated instead: fit a recording with
the quantity held at the value in question, draw recordings of the body that this fit finds, and compute the ratio of
each. The value is in the interval if fewer than 5 % of the drawn ratios are as large as that of the recording. With 39
draws this test is exact if the fitted body has the law of the true one.

``--bodies`` prints the 95 % points of the ratios of four true bodies, which nobody knows in an experiment: the three of
the coverage study, and the nominal one with half of its active stiffness made passive. Otherwise recordings of the
nominal body are tested. Printed for every quantity: coverage with the threshold of ``mcstudy fit``, coverage of the
simulated test (percent of the recordings), the median of the simulated 95 % point beside the threshold of a known
noise, 3.84, and its 10 and 90 % quantiles over recordings. The table is printed anew every `EVERY` recordings.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from mcstudy.fitting.arguments import Restraint
from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.identification.bounds import bounded
from mcstudy.identification.correction import Draws
from mcstudy.identification.minimum import ITERATIONS, TOLERANCE, without_prior
from mcstudy.models.quantities import Quantity, quantities
from mcstudy.stance.body import two_segment
from mcstudy.streams import stream
from pipelines.validation.at_truth import STIFF, judged, starts
from pipelines.validation.coverage import FEW, LEVEL, LOW_HZ, MANY, Condition, Source, body

EVERY = 5
"""Recordings between two tables."""


def held(fitter: Fitter, data: Data, quantity: Quantity, value: float, begin: np.ndarray) -> np.ndarray:
    """Parameters (P,) of the best fit with a quantity at a value, from starts ``begin`` (S, P)."""
    gradient = quantity.gradient(begin[0])
    lower, upper = (np.tile(x, (len(begin), 1)) for x in (fitter.model.lower, fitter.model.upper))
    restraint = None
    if np.count_nonzero(gradient) == 1:
        p = int(np.argmax(gradient != 0))
        lower[:, p] = upper[:, p] = value
    else:
        many = np.ones(len(begin))
        restraint = Restraint(np.tile(gradient, (len(begin), 1)), value * many, STIFF / value**2 * many)
    packed, problem = fitter.packed(data)[None], np.zeros(len(begin), int)
    found = fitter.fits(packed, begin, problem, lower, upper, TOLERANCE, ITERATIONS, restraint)
    return np.asarray(found.estimate[np.nanargmin(found.objective)])


def ratios(
    condition: Condition, fitter: Fitter, wanted: list[Quantity], theta: np.ndarray, draws: Draws, n: int, name: str
) -> np.ndarray:
    """Likelihood ratios (n, K) of the ``wanted`` quantities in recordings of a body with parameters ``theta`` (P,)."""
    source = Source(condition, theta)
    lines = [source(stream(k, name)) for k in range(n)]
    further = starts(fitter, range(n), MANY if condition.fmax < LOW_HZ else FEW)
    return judged(fitter, lines, wanted, theta, draws, LEVEL, further, exact=True).rise


def main() -> None:
    """Fit, simulate, count, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=int, default=40)
    parser.add_argument("--draws", type=int, default=39, help="simulated ratios of each quantity (default 39)")
    parser.add_argument("--fmax", type=float, default=1.2)
    parser.add_argument("--cycles", type=int, default=6)
    parser.add_argument("--bodies", action="store_true", help="the law of the true bodies instead")
    args = parser.parse_args()
    if args.draws < 19:
        parser.error(f"--draws: expected at least 19 for a test at 5 %, got {args.draws}")
    condition, nominal = Condition(0, args.cycles, args.fmax), two_segment()
    source, model = Source(condition), bounded(nominal, nominal, {})
    wanted, truth = list(quantities(model)), np.array(list(body(0).values()))
    fitter, draws = Fitter(model, without_prior(model, nominal), source(stream(0, "threshold")).f), source.draws()
    if args.bodies:
        _bodies(args, fitter, wanted, draws)
        return
    rank = int(np.ceil(0.95 * (args.draws + 1)))  # of the ratios in ascending order: the 95 % point
    kept = []
    for r in range(args.recordings):
        lines = source(stream(r, "threshold"))
        further = starts(fitter, [r], MANY if args.fmax < LOW_HZ else FEW)
        own = judged(fitter, [lines], wanted, truth, draws, LEVEL, further, exact=True)
        point = np.empty(len(wanted))
        for k, q in enumerate(wanted):
            begin = np.vstack([truth, own.minima[0].theta[:2]])
            body_there = held(fitter, Data.of(lines), q, q.value(truth), begin)
            drawn = ratios(condition, fitter, [q], body_there, draws, args.draws, f"threshold {r} {k}")
            point[k] = np.sort(drawn[:, 0])[rank - 1]
        kept.append(np.stack([own.contained[0], own.rise[0] <= point, point]))
        if (r + 1) % EVERY == 0 or r + 1 == args.recordings:
            _print(args, [q.name for q in wanted], np.array(kept))


def true_bodies() -> list[np.ndarray]:
    """Parameters (P,) of the bodies of ``--bodies``."""
    passive = dict(body(0))
    for active, other in (("K11", "Kpas1"), ("K22", "Kpas2")):
        passive |= {active: passive[active] / 2, other: passive[other] + passive[active] / 2}
    return [np.array(list(one.values())) for one in (*map(body, range(3)), passive)]


def _bodies(args: argparse.Namespace, fitter: Fitter, wanted: list[Quantity], draws: Draws) -> None:
    condition, points = Condition(0, args.cycles, args.fmax), []
    for number, theta in enumerate(true_bodies()):
        found = ratios(condition, fitter, wanted, theta, draws, args.draws, f"threshold body {number}")
        points.append(np.quantile(found, 0.95, axis=0))
    about = f"{args.cycles} cycles, up to {args.fmax:g} Hz"
    print(f"95 % points of {args.draws} ratios of bodies 0, 1, 2 and of the passive one, {about}")
    for q, row in zip(wanted, np.array(points).T, strict=True):
        print(f"{q.name:14}" + "".join(f"{x:8.2f}" for x in row))


def _print(args: argparse.Namespace, names: list[str], kept: np.ndarray) -> None:
    """``kept``: (R, 3, K)."""
    about = f"{len(kept)} recordings, {args.cycles} cycles, up to {args.fmax:g} Hz, {args.draws} draws"
    print(f"{about}: {time.process_time() / len(kept):.1f} CPU s a recording")
    print(f"{'quantity':14}{'coverage':>10}{'simulated':>11}{'95 % point [10 %, 90 %]':>28}")
    present, simulated = 100 * kept[:, :2].mean(axis=0)
    for k, name in enumerate(names):
        low, middle, high = np.quantile(kept[:, 2, k], (0.1, 0.5, 0.9))
        print(f"{name:14}{present[k]:10.1f}{simulated[k]:11.1f}{f'{middle:.2f} [{low:.2f}, {high:.2f}]':>28}")
    print(f"{'mean':14}{present.mean():10.1f}{simulated.mean():11.1f}{np.median(kept[:, 2]):13.2f}", flush=True)


if __name__ == "__main__":
    main()
