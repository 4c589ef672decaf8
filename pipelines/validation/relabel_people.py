"""Name what was changed between two groups of ten people, from their frequency responses alone.

    python pipelines/validation/relabel_people.py pipelines/recordings/comtest.toml --data DIR

The table must hold the same people with two values of two factors, by default eyes (vision) and tilt_pp_deg
(amplitude).
A draw takes ten people at random and two groups of responses:

- same: two random tens of people in one condition;
- amplitude, vision: two conditions that differ in one factor, in random order, either of the same ten people (paired)
  or of two random tens (unpaired).

There is also a paired form of same: ten people in two conditions, exchanged at random in every person.
`mcstudy.group_comparison.detection` tests the draw: a difference neither of the means nor of the scatter between people
(Fisher's product of both p-values) is "same"; one in which both segments change alike is "amplitude", because amplitude
changes the weight of the sensed stimulus, which acts at the ankle, and the noise relative to the response; one in which
the upper body changes relative to the lower is "vision", because the scene is seen by the head.
No label enters a draw. The smoothing and the upper frequency of the ratio test were chosen with these data at hand,
though: with ``--choose`` they are chosen on one half of the people and tested on the other. ``--ceiling`` trains a
linear discriminant of all test statistics on the labels of one half of the people and tests it on the other.
``--laws`` gives what the labels could tell at most: a normal law of the responses in every condition, with the
covariance between people, is taken from the labelled conditions of one half of the people, or of all of them, and the
kind of change with the highest likelihood is named in the other half, or in the same people. ``--size`` sets the number
of people in a group.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.stats import binomtest, combine_pvalues

import mcstudy as mc
from mcstudy.errors import InputError
from mcstudy.group_comparison.detection import Detection, detect
from mcstudy.group_comparison.ratio_test import ratio_test
from mcstudy.group_comparison.sample import Sample
from mcstudy.spectra.frf_groups import as_real, scatter
from mcstudy.streams import stream
from mcstudy.text_tables import table

TRUTHS = ("same", "amplitude", "vision")
PERMUTATIONS = 199
VARIANTS = tuple(itertools.product((0.5, 1.0, 1.5, 2.0), (0.5, 0.75, 1.5, np.inf)))
"""Octaves of smoothing and upper frequency (Hz) of the ratio test."""


@dataclass(frozen=True)
class People:
    """Responses (people, condition, D) with the pairs of conditions that differ in one factor."""

    x: np.ndarray
    f: np.ndarray
    pairs: dict[str, list[tuple[int, int]]]

    def some(self, which: np.ndarray) -> People:
        return People(self.x[which], self.f, self.pairs)


def people_of(group: xr.Dataset, vision: str, amplitude: str) -> People:
    for factor in (vision, amplitude):
        if factor not in group.coords:
            raise InputError(f"{factor}: expected a column that is part of the condition")
    x = as_real(group["frf"].transpose("person", "condition", "segment", "point").values)
    factors = {"vision": group[vision].values, "amplitude": group[amplitude].values}
    pairs: dict[str, list[tuple[int, int]]] = {"same": [(k, k) for k in range(x.shape[1])]}
    for changed, held in (("amplitude", "vision"), ("vision", "amplitude")):
        pairs[changed] = [
            (i, k)
            for i, k in itertools.combinations(range(x.shape[1]), 2)
            if factors[changed][i] != factors[changed][k] and factors[held][i] == factors[held][k]
        ]
    return People(x[np.isfinite(x).all(axis=(1, 2))], group["f"].values, pairs)


def draw(people: People, truth: str, paired: bool, size: int, rng: np.random.Generator) -> Sample:
    """Two groups of ``size`` people."""
    who = rng.permutation(len(people.x))
    if paired and truth == "same":
        changed = people.pairs["amplitude"] + people.pairs["vision"]
        i, k = changed[rng.integers(len(changed))]
        swap = rng.random((size, 1)) < 0.5
        a, b = people.x[who[:size], i], people.x[who[:size], k]
        return Sample(np.where(swap, b, a), np.where(swap, a, b), True)
    i, k = people.pairs[truth][rng.integers(len(people.pairs[truth]))]
    if rng.random() < 0.5:
        i, k = k, i
    others = who[:size] if paired else who[size : 2 * size]
    return Sample(people.x[who[:size], i], people.x[others, k], paired)


def draws(
    people: People, paired: bool, n: int, size: int, seed: int
) -> Iterator[tuple[str, Sample, np.random.Generator]]:
    for k in range(n):
        rng = stream(seed, "relabel_people", k, int(paired))
        truth = TRUTHS[int(rng.integers(3))]
        yield truth, draw(people, truth, paired, size, rng), rng


def named(outcome: Detection, p_ratio: float) -> str:
    """What was changed, by the tests; ``p_ratio``: of equal responses of the upper relative to the lower body."""
    if combine_pvalues([outcome.p_mean, outcome.p_scatter]).pvalue > 0.05:
        return "same"
    return "vision" if p_ratio <= 0.05 else "amplitude"


def answers(people: People, paired: bool, n: int, size: int, seed: int) -> Counter[tuple[str, str]]:
    """How often each truth was given each name."""
    found: Counter[tuple[str, str]] = Counter()
    for truth, sample, rng in draws(people, paired, n, size, seed):
        outcome = detect(sample, people.f, rng, PERMUTATIONS)
        found[truth, named(outcome, outcome.p_ratio)] += 1
    return found


def chosen(train: People, test: People, paired: bool, n: int, size: int, seed: int) -> Counter[tuple[str, str]]:
    """The same for the variant of the ratio test that is best on other people."""
    right = np.zeros(len(VARIANTS))
    for truth, sample, rng in draws(train, paired, n, size, seed):
        if truth != "same":
            labels = sample.relabelled(rng, PERMUTATIONS)
            p = np.array([ratio_test(sample, train.f, labels, *variant) for variant in VARIANTS])
            right += (p <= 0.05) == (truth == "vision")
    best = VARIANTS[int(np.argmax(right))]
    print(f"chosen: {best[0]:g} octaves, below {best[1]:g} Hz")
    found: Counter[tuple[str, str]] = Counter()
    for truth, sample, rng in draws(test, paired, n, size, seed + 1):
        outcome = detect(sample, test.f, rng, PERMUTATIONS)
        p = ratio_test(sample, test.f, sample.relabelled(rng, PERMUTATIONS), *best)
        found[truth, named(outcome, max(p, outcome.p_mean))] += 1
    return found


def ceiling(train: People, test: People, paired: bool, n: int, size: int, seed: int) -> Counter[tuple[str, str]]:
    """The same for a linear discriminant of the statistics of all points, trained on the labels of other people."""

    def features(of: People, first: int) -> tuple[np.ndarray, np.ndarray]:
        rows, truths = [], []
        for truth, sample, rng in draws(of, paired, n, size, first):
            outcome = detect(sample, of.f, rng, PERMUTATIONS)
            size_of = sample.difference**2 / np.diag(sample.error)
            by_point = size_of.reshape(2, 2, -1).sum(axis=0).ravel()
            of_tests = [outcome.p_mean, outcome.p_scatter, outcome.p_ratio]
            rows.append([*np.log(by_point), *np.log(of_tests), abs(np.log(outcome.scatter_ratio))])
            truths.append(TRUTHS.index(truth))
        return np.array(rows), np.array(truths)

    x, y = features(train, seed)
    means = np.array([x[y == k].mean(axis=0) for k in range(3)])
    within = np.cov((x - means[y]).T) + 1e-3 * np.eye(x.shape[1])
    rule = np.linalg.solve(within, means.T)
    z, truths = features(test, seed + 1)
    named = np.argmax(z @ rule - 0.5 * (means * rule.T).sum(axis=1), axis=1)
    return Counter((TRUTHS[t], TRUTHS[k]) for t, k in zip(truths, named, strict=True))


def laws(train: People, test: People, paired: bool, n: int, size: int, seed: int) -> Counter[tuple[str, str]]:
    """The same for a classifier that knows the law of every condition from labelled people; groups of other people."""
    about = scatter(*np.moveaxis(train.x, 1, 0)).covariance
    root = np.linalg.inv(np.linalg.cholesky(about))
    away = (test.x[:, :, None] - train.x.mean(axis=0)) @ root.T  # (people, condition, law, D)
    log = -0.5 * (away**2).sum(axis=-1)
    found: Counter[tuple[str, str]] = Counter()
    for k in range(n):
        rng = stream(seed, "relabel_people", k, int(paired))
        truth = TRUTHS[int(rng.integers(3))]
        who = rng.permutation(len(test.x))
        i, j = test.pairs[truth][rng.integers(len(test.pairs[truth]))]
        of_a, of_b = log[who[:size], i].sum(axis=0), log[who[size : 2 * size], j].sum(axis=0)
        likely = [np.logaddexp.reduce([of_a[x] + of_b[y] for x, y in both_ways(test.pairs[t])]) for t in TRUTHS]
        found[truth, TRUTHS[int(np.argmax(likely))]] += 1
    return found


def both_ways(pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Pairs of conditions in both orders."""
    return pairs + [(k, i) for i, k in pairs]


def told(title: str, found: Counter[tuple[str, str]], seconds: float) -> str:
    """A table of names by truth; intervals are Wilson's at 95 %."""
    rows = []
    for truth in (*TRUTHS, "all"):
        own = {k: v for (t, k), v in found.items() if t == truth}
        n = sum(own.values()) if truth != "all" else found.total()
        hits = own.get(truth, 0) if truth != "all" else sum(v for (t, k), v in found.items() if t == k)
        if not n:
            continue
        low, high = binomtest(hits, n).proportion_ci(method="wilson")
        cells = [str(own.get(k, 0)) if truth != "all" else "" for k in TRUTHS]
        rows.append([truth, str(n), *cells, f"{100 * hits / n:.1f}", f"{100 * low:.1f} to {100 * high:.1f}"])
    header = ["true", "draws", *(f"named {k}" for k in TRUTHS), "right (%)", "95 %"]
    return f"{title} ({seconds:.1f} CPU s)\n{table(header, rows)}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description="Name what was changed between two groups of people.")
    parser.add_argument("file", type=Path, help="description of the FRFs of a group (.toml)")
    parser.add_argument("--data", type=Path, help="folder of its table")
    parser.add_argument("--vision", default="eyes", help="column of vision")
    parser.add_argument("--amplitude", default="tilt_pp_deg", help="column of amplitude")
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--size", type=int, default=10, help="people in a group")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--choose", action="store_true", help="choose the ratio test on half of the people")
    parser.add_argument("--ceiling", action="store_true", help="train a classifier on half of the people")
    parser.add_argument("--laws", action="store_true", help="know the law of every condition from labelled people")
    args = parser.parse_args()
    people = people_of(mc.read_frf_group(args.file, args.data), args.vision, args.amplitude)
    order = stream(args.seed, "relabel_halves").permutation(len(people.x))
    halves = [people.some(half) for half in np.array_split(order, 2)]
    for paired in (True, False):
        report(people, halves, paired, args)


def report(people: People, halves: list[People], paired: bool, args: argparse.Namespace) -> None:
    form = "the same people in both groups" if paired else "other people in both groups"

    def trained(method: Callable[..., Counter[tuple[str, str]]]) -> Counter[tuple[str, str]]:
        turns = ((halves[0], halves[1]), (halves[1], halves[0]))
        return sum((method(a, b, paired, args.draws // 2, args.size, args.seed) for a, b in turns), Counter())

    runs = {form: lambda: answers(people, paired, args.draws, args.size, args.seed)}
    if args.choose:
        runs[f"{form}, ratio test chosen on half of the people"] = lambda: trained(chosen)
    if args.ceiling:
        runs[f"{form}, trained on half of the people"] = lambda: trained(ceiling)
    if args.laws and not paired:
        runs[f"{form}, laws of half of the people"] = lambda: trained(laws)
        runs[f"{form}, laws of the same people"] = lambda: laws(
            people, people, paired, args.draws, args.size, args.seed
        )
    for title, run in runs.items():
        start = time.process_time()
        found = run()
        print(told(title, found, time.process_time() - start))


if __name__ == "__main__":
    main()
