"""How often do the intervals of a group of people contain the true means?

    python pipelines/validation/group_coverage.py --people 500 --groups 500

Every person is a body whose parameters are drawn from normal distributions around the nominal ones; bodies that fall
are drawn again. Frequency responses are drawn in the frequency domain: the response of the body, and errors and
estimates of their covariance with the distribution that a recording of two trials of six cycles at 5 N m has. Each
person is fitted once. Groups are drawn from these people, and the mean, the standard deviation between people, the
difference between two groups of other people, and the values of the individuals are compared with the truth: mean and
standard deviation of all people that were drawn. A row is printed as soon as its quantity is done.

With ``--within 0.05`` every person is measured a second time, with parameters that changed at random by 5 %, and the
paired difference is judged too: how often its interval holds the true mean change, and how often a change is found at
the 5 % level, by the comparison and by a t-test of the estimates. ``--shift Td1=0.06`` changes parameters of everybody
besides, so that the last two are powers.

``--cause NAME`` tells instead why the interval of a standard deviation holds the truth too rarely: how often it does,
with Gaussian likelihoods, if people and errors of the fits are what theory assumes, and what they are.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache, partial
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, ndtri, stdtrit
from scipy.stats import kurtosis, ttest_1samp

import mcstudy as mc
from mcstudy.fitting.compilers import cores
from mcstudy.identification.fit import fit_lines
from mcstudy.identification.people.likelihood import Likelihood, difference, of_fit
from mcstudy.identification.people.population import Population
from mcstudy.identification.people.two_means import paired, unpaired
from mcstudy.identification.settings import FitSettings
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_spectral import sway_psd
from mcstudy.stance.stability import growth_rate
from mcstudy.streams import stream
from mcstudy.text_tables import table
from pipelines.measured import add_option, write

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""The matrices are small: threads of the linear algebra would cost more than they save."""

LEVEL = 0.95
"""Of all intervals."""

AFTER = 1_000_000
"""Added to the seed of a person's second measurement."""

SLOWEST = -0.5  # 1/s: bodies that are hardly stable sway for minutes after a push


class Person(NamedTuple):
    """True values and likelihoods by quantity, and those of a change between two measurements, if there were two."""

    truth: Mapping[str, float]
    likelihood: Mapping[str, Likelihood]
    true_change: Mapping[str, float] | None = None
    change: Mapping[str, Likelihood] | None = None


@cache
def template(fmax: float, cycles: int) -> Lines:
    """Lines of one recording in the time domain: frequencies, repeats and how well the noise is known."""
    return measure(mc.simulate(cycles=cycles, seed=0), fmax)


def drawn_lines(theta: np.ndarray, seed: int, fmax: float, cycles: int) -> Lines:
    """Lines of a body with parameters ``theta`` (12,)."""
    model, like, rng = two_segment(), template(fmax, cycles), stream(seed, "group lines")
    seconds = 2 * (cycles - 1) * 43.72  # two trials
    covariance = sway_psd(model, theta, SensorNoise(), like.f) / (2 * seconds) / like.power[:, None, None]
    root = np.linalg.cholesky(covariance)
    unit, precision = like.noise.joint_draws(rng, 1)
    estimated = root @ np.linalg.inv(precision[..., 0])  # its product with its adjoint is the estimate
    nu = np.maximum(like.noise.dof, 3.0)  # which the whitener takes to be unbiased, unlike its inverse
    C = estimated @ estimated.conj().swapaxes(1, 2) * ((nu - 2) / nu)[:, None, None]
    y = frf(model, theta, like.f) + (root @ unit)[..., 0]
    return replace(like, y=y, noise=replace(like.noise, C=C))


def body(seed: int, spread: float) -> np.ndarray:
    """True parameters of a random body that stands, (12,)."""
    nominal, rng = two_segment(), stream(seed, "group")
    while True:
        theta = nominal.truth * (1 + spread * rng.standard_normal(nominal.truth.size))
        if (theta > 0).all() and growth_rate(nominal, theta) < SLOWEST:
            return np.asarray(theta)


def person(
    seed: int, spread: float, fmax: float, cycles: int, within: float = 0.0, shift: Mapping[str, float] | None = None
) -> Person:
    """Draw, measure and fit one person, and if ``within`` is not zero once more after a change."""
    theta = body(seed, spread)
    truth, likelihood = measured(theta, seed, fmax, cycles)
    if not within:
        return Person(truth, likelihood)
    nominal, rng = two_segment(), stream(seed, "change")
    factor = np.array([1 + (shift or {}).get(name, 0.0) for name in nominal.names])
    after = theta * factor * np.exp(within * rng.standard_normal(theta.size))
    while growth_rate(nominal, after) > SLOWEST / 2:
        after = theta * factor * np.exp(within * rng.standard_normal(theta.size))
    true_after, likelihood_after = measured(after, seed + AFTER, fmax, cycles)
    true_change = {name: true_after[name] - truth[name] for name in truth}
    return Person(
        truth, likelihood, true_change, {n: difference(likelihood_after[n], likelihood[n]) for n in likelihood}
    )


def measured(theta: np.ndarray, seed: int, fmax: float, cycles: int) -> tuple[dict[str, float], dict[str, Likelihood]]:
    """True values of all quantities of a body, and their likelihoods from one recording."""
    fitted = fit_lines(drawn_lines(theta, seed, fmax, cycles), two_segment(), FitSettings(seed=seed))
    values = dict(zip(fitted.model.names, theta, strict=True))
    return {e.name: float(sum(values[n] for n in e.name.split(" + "))) for e in fitted.estimates}, of_fit(fitted)


class Held(NamedTuple):
    """Whether intervals hold the truth, and whether data end the mean's interval on both sides."""

    mean: bool
    identified: bool
    between: bool
    difference: bool
    individuals: float


def judged(people: Sequence[Person], name: str, groups: int, size: int) -> list[Held]:
    """Of random groups of ``size`` people; the truth is that of all ``people``.

    The people are put in random order and cut into groups, again and again; the difference is that of a group and the
    next one of the same order, which holds other people.
    """
    rng, out = stream(0, "groups"), list[Held]()
    true = np.array([p.truth[name] for p in people])
    mean, spread = float(true.mean()), float(true.std(ddof=1))
    while len(out) < groups:
        order = rng.permutation(len(people))[: len(people) // size * size].reshape(-1, size)[: groups - len(out) + 1]
        drawn = [Population([people[k].likelihood[name] for k in picked], LEVEL) for picked in order]
        for n, (picked, first) in enumerate(zip(order, drawn, strict=True)):
            m, s, d = first.mean(), first.between(), unpaired(drawn[(n + 1) % len(drawn)], first).interval
            own = [v.low <= true[k] <= v.high for k, v in zip(picked, first.individual(), strict=True)]
            both = m.low_from == m.high_from == "data"
            out.append(
                Held(
                    mean=m.low <= mean <= m.high,
                    identified=both,
                    between=s.low <= spread <= s.high,
                    difference=d.low <= 0 <= d.high,
                    individuals=float(np.mean(own)),
                )
            )
    return out[:groups]


class Changed(NamedTuple):
    """Of a group: whether the paired interval holds the true mean change; whether a change was found, by a t-test."""

    held: bool
    found: bool
    by_t_test: bool


def changes(people: Sequence[Person], name: str, groups: int, size: int) -> list[Changed]:
    """Of random groups of ``size`` people; the truth is the mean change of all ``people``."""
    rng, out = stream(0, "groups"), list[Changed]()
    both = [(p.true_change[name], p.change[name]) for p in people if p.true_change and p.change]
    true = float(np.mean([change for change, _ in both]))
    while len(out) < groups:
        for picked in rng.permutation(len(both))[: len(both) // size * size].reshape(-1, size):
            own = [both[k][1] for k in picked]
            (_, low, high, *_), p = paired(Population(own, LEVEL))
            t_test = ttest_1samp([x.estimate for x in own], 0.0).pvalue
            out.append(Changed(low <= true <= high, p <= 1 - LEVEL, bool(t_test <= 1 - LEVEL)))
    return out[:groups]


class Cause(NamedTuple):
    """Percent of intervals of a standard deviation that hold the truth, by threshold, and the median estimate."""

    what: str
    chi_squared: float
    present: float
    estimate: float


def causes(people: Sequence[Person], name: str, size: int, groups: int = 4000) -> list[Cause]:
    """The interval of the standard deviation of a quantity with Gaussian likelihoods, as assumptions fail one by one.

    Estimates are in standard deviations of the true values. Errors of "any person" do not depend on the true value.
    """
    rng = stream(0, "causes")
    true = np.array([p.truth[name] for p in people])
    error = np.array([p.likelihood[name].estimate for p in people]) - true
    width = np.array([p.likelihood[name].width for p in people])
    spread, own = true.std(ddof=1), np.array([rng.permutation(len(people))[:size] for _ in range(groups)])
    anyone = rng.permuted(own, axis=1)[rng.permutation(groups)]
    normal, exact = spread * rng.standard_normal(own.shape), np.full(own.shape, 1e-3 * spread)
    cases = {
        "normal people, no errors": (normal, exact),
        "these people, no errors": (true[own], exact),
        "normal people, errors of any person": (normal + error[anyone], width[anyone]),
        "these people, errors of any person": (true[own] + error[anyone], width[anyone]),
        "these people, their own errors": (true[own] + error[own], width[own]),
    }
    tau = np.geomspace(0.02, 6.0, 300)
    t_squared = float(stdtrit(size - 1, 0.5 + LEVEL / 2) ** 2)
    thresholds = float(chdtri(1.0, 1 - LEVEL)), size * float(np.log1p(t_squared / (size - 1)))
    found = []
    for what, (x, w) in cases.items():
        log = np.array([_restricted(t, x / spread, w / spread) for t in [1.0, *tau]])
        rise = 2 * (np.maximum(log.max(axis=0), log[0]) - log[0])
        held = (100 * float(np.mean(rise <= goal)) for goal in thresholds)
        found.append(Cause(what, *held, float(np.median(tau[log[1:].argmax(axis=0)]))))
    return found


def _restricted(tau: float, x: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Restricted log likelihood of a standard deviation, of groups (G, n) with Gaussian likelihoods; (G,)."""
    weight = 1 / (tau**2 + width**2)
    mean = (weight * x).sum(axis=1) / weight.sum(axis=1)
    squares = (weight * (x - mean[:, None]) ** 2).sum(axis=1)
    return np.asarray(0.5 * (np.log(weight).sum(axis=1) - np.log(weight.sum(axis=1)) - squares))


def main() -> None:
    """Draw people, fit, draw groups, count and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--people", type=int, default=500, help="people to draw and fit (default 500)")
    parser.add_argument("--groups", type=int, default=500, help="groups drawn from them (default 500)")
    parser.add_argument("--size", type=int, default=10, help="people in a group (default 10)")
    parser.add_argument("--spread", type=float, default=0.2, help="between-person CV of every parameter (default 0.2)")
    parser.add_argument("--cycles", type=int, default=6, help="stimulus periods per trial (default 6)")
    parser.add_argument("--fmax", type=float, default=3.1, help="highest frequency, Hz (default 3.1)")
    parser.add_argument("--within", type=float, default=0.0, help="measure twice, with changes of this CV")
    parser.add_argument("--shift", nargs="*", default=[], metavar="NAME=X", help="and with these changes of everybody")
    parser.add_argument("--cause", metavar="NAME", help="why the spread of a quantity is covered too rarely")
    parser.add_argument("--workers", type=int, default=cores(), help="processes (default one per core)")
    add_option(parser)
    args = parser.parse_args()
    if args.people < 2 * args.size:
        parser.error(f"--people: expected at least twice --size = {args.size}, got {args.people}")
    shift = {name: float(x) for name, x in (word.split("=") for word in args.shift)}
    run = partial(person, spread=args.spread, fmax=args.fmax, cycles=args.cycles, within=args.within, shift=shift)
    os.environ |= dict.fromkeys(ONE_THREAD, "1")  # read by the new processes
    with ProcessPoolExecutor(args.workers, get_context("spawn")) as pool:
        people = list(pool.map(run, range(args.people), chunksize=5))
        names = list(people[0].truth)
        if args.cause:
            if args.cause not in names:
                parser.error(f"--cause: expected one of {', '.join(names)}")
            _print_cause(people, args.cause, args.size)
            return
        if args.within:
            _print_changes(people, args)
            return
        judge = [pool.submit(judged, _of(people, name), name, args.groups, args.size) for name in names]
        print(
            f"{args.groups} groups of {args.size} from {args.people} people, up to {args.fmax:g} Hz: "
            "% of 95 % intervals that hold the truth"
        )
        held = [100 * np.mean(future.result(), axis=0) for future in judge]
    header = ["quantity", *COLUMNS]
    *rows, mean = (
        [name, *(f"{x:.{k != 1:d}f}" for k, x in enumerate(shares))]
        for name, shares in zip([*names, "mean"], [*held, np.mean(held, axis=0)], strict=True)
    )
    print(table(header, [*rows, mean]))
    write(args.json, tables={"held": (header, rows)})


def _print_cause(people: Sequence[Person], name: str, size: int) -> None:
    """Why the spread of a quantity is covered too rarely."""
    rows = [
        [c.what, f"{c.chi_squared:.1f}", f"{c.present:.1f}", f"{c.estimate:.2f}"] for c in causes(people, name, size)
    ]
    header = [f"standard deviation of {name}", "% held with chi-squared", "with the present threshold", "median"]
    print(table(header, rows))
    true = np.array([p.truth[name] for p in people])
    error = np.array([p.likelihood[name].estimate for p in people]) - true
    rms, usual = np.sqrt(np.mean(error**2)), np.median(np.abs(error)) / ndtri(0.75)
    print(f"kurtosis of people {kurtosis(true):+.2f}; errors: RMS {rms / true.std():.2f} standard deviations of")
    print(f"people, that of normal errors with the same median {usual / true.std():.2f}")


def _print_changes(people: Sequence[Person], args: argparse.Namespace) -> None:
    """How often changes of people who are measured twice are held, and found."""
    print(f"{args.groups} groups of {args.size} from {args.people} people, measured twice")
    rows = [
        [name, *(f"{100 * share:.1f}" for share in np.mean(changes(people, name, args.groups, args.size), axis=0))]
        for name in people[0].truth
    ]
    print(table(["quantity", "held (%)", "change found (%)", "by a t-test (%)"], rows))
    lowest = {"value": min(float(row[1]) for row in rows), "unit": "%"}
    write(args.json, {"lowest": lowest}, {"held": (["quantity", "held", "change found", "by a t-test"], rows)})


COLUMNS = ("mean", "(ended by data)", "SD between", "difference", "individuals")
"""What is judged, in the order of `Held`."""


def _of(people: Sequence[Person], name: str) -> list[Person]:
    """People with one quantity, so that no more is sent to a process than it needs."""
    return [Person({name: p.truth[name]}, {name: p.likelihood[name]}) for p in people]


if __name__ == "__main__":
    main()
