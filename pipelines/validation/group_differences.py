"""What the comparison of two groups says of simulated people whose differences have known causes.

    python pipelines/validation/group_differences.py --groups 60 --compared 5

People stand on a tilting platform. Their parameters scatter by 5 % about the stand-in truth; their frequency responses
are those of the model (closed form) at nine points of a ternary sequence of 20 s, with noise. Rates of tests are over
``--groups`` pairs of groups of ten, in percent; with ``--compared`` N the change of parameters is named for N of them.

    python pipelines/validation/group_differences.py --nulls 400

How often is a difference of the means found where there is none, in groups that differ in nothing or in noise alone?
People have heavy tails, come in two clusters or are skewed, scatter by 8 % and have noise of their own level; in
percent with Wilson's 95 % intervals.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping

import numpy as np
import xarray as xr
from scipy.stats import binomtest

from mcstudy.effect_library import library
from mcstudy.group_comparison.compare import compare_groups
from mcstudy.group_comparison.detection import detect, name
from mcstudy.group_comparison.sample import sample_of
from mcstudy.recordings.frf_group import group_dataset
from mcstudy.recordings.sheets.frf_group_sheet import TableSheet
from mcstudy.spectra.frf_groups import in_space
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.response import frf
from mcstudy.text_tables import table
from pipelines import measured

POINTS = ((1,), (2,), (3, 4), (4, 5), (5, 6, 7), (6, 7, 8, 9), (8, 9, 10, 11), (10, 11, 12, 13), (12, 13, 14, 15, 16))

TESTS = ("p_mean", "p_ratio", "p_scatter")

CHANGES: dict[str, dict[str, float]] = {
    "none": {},
    "Wprop x 0.7": {"Wprop": 0.7},
    "K11, B11 x 1.15": {"K11": 1.15, "B11": 1.15},
    "Td1 x 1.2": {"Td1": 1.2},
    "K12, B12 x 1.3": {"K12": 1.3, "B12": 1.3},
    "K22, B22 x 1.4": {"K22": 1.4, "B22": 1.4},
}

NULLS: dict[str, tuple[int, int, str, bool, float, float]] = {
    "6 + 6, heavy tails": (6, 6, "heavy tails", False, 1.0, 1.0),
    "5 + 12, two clusters": (5, 12, "clusters", False, 1.0, 1.0),
    "6 pairs, skewed": (6, 6, "skewed", True, 1.0, 1.0),
    "9 pairs, heavy tails": (9, 9, "heavy tails", True, 1.0, 1.0),
    "8 pairs, noise of a 5/3": (8, 8, "normal", True, 5 / 3, 1.0),
    "6 + 12, noise of the 6 5/3": (6, 12, "normal", False, 5 / 3, 1.0),
    "12 + 6, noise of the 12 5/3": (12, 6, "normal", False, 5 / 3, 1.0),
    "5 + 6, noise of the 5 twice": (5, 6, "normal", False, 2.0, 1.0),
    "5 + 15, skewed, noise of the 5 twice": (5, 15, "skewed", False, 2.0, 1.0),
}
"""Groups of equal means: people of a and b, law of people, whether the same people, factors of the noise of both."""

LAWS = {
    "normal": lambda rng, shape: rng.normal(size=shape),
    "heavy tails": lambda rng, shape: rng.standard_t(3, shape) / np.sqrt(3),
    "clusters": lambda rng, shape: 0.9 * rng.choice([-1, 1], (shape[0], 1)) + 0.44 * rng.normal(size=shape),
    "skewed": lambda rng, shape: rng.exponential(size=shape) - 1,
}
"""Deviations of people, of unit variance."""


def people(
    n: int,
    seed: int,
    change: Mapping[str, float] | None = None,
    *,
    noise: float = 0.3,
    again: int = 0,
    effect: tuple[str, float] | None = None,
    law: str = "normal",
    scatter: float = 0.05,
    uneven: float = 0.0,
) -> xr.Dataset:
    """One condition of ``n`` people.

    ``change``: factors of parameters, the same for everybody. ``noise``: SD of the responses at 0.5 Hz; it falls with
    frequency. ``again``: number of the recording; another one of the same ``seed`` has other noise. ``effect``: of the
    library, with the value of its parameter. ``law``: one of `LAWS`. ``scatter``: SD of the logarithm of a parameter.
    ``uneven``: SD of the logarithm of a person's noise.
    """
    model = two_segment(stimulus="surface_tilt")
    sheet = TableSheet(file="", gain="*", phase="*", period_s=20.0, points=POINTS, prts_state_s=0.25)
    f_line, average = sheet.lines()
    theta = model.truth * np.exp(scatter * LAWS[law](np.random.default_rng([seed, 0]), (n, len(model.truth))))
    for parameter, factor in (change or {}).items():
        theta[:, model.names.index(parameter)] *= factor
    if effect:
        model = library.apply(model, effect[0])
        theta = np.column_stack([theta, np.full(n, effect[1])])
    rng = np.random.default_rng([seed, 1, again])
    lines = in_space(frf(model, theta, f_line))
    own = np.exp(uneven * rng.normal(size=(n, 1, 1))) if uneven else 1.0
    size = noise * own * (0.5 / np.maximum(f_line, 0.2))[None, :, None] / np.sqrt(2)
    lines = lines + size * (rng.normal(size=lines.shape) + 1j * rng.normal(size=lines.shape))
    points = np.einsum("nl,pls->psn", average, lines)[:, None]
    names = [f"person {seed}-{k}" for k in range(n)]
    return group_dataset(points, names, [()], [], f_line, average, "surface_tilt", Body())


def false_rates(n: int) -> str:
    """A table of `NULLS`, of ``n`` pairs of groups each."""
    rows = []
    for words, (na, nb, law, paired, of_a, of_b) in NULLS.items():
        found: Counter[str] = Counter()
        for k in range(n):
            settings = {"law": law, "scatter": 0.08, "uneven": 0.3}
            a = people(na, 2 * k, noise=0.3 * of_a, **settings)
            b = people(nb, 2 * k + (not paired), noise=0.3 * of_b, again=1, **settings)
            outcome = detect(sample_of(a, b, paired), a["f"].values, np.random.default_rng(k), 399)
            found.update(p for p in TESTS if getattr(outcome, p) <= 0.05)
            found["region"] += min(r.p for r in outcome.regions) <= 0.05
        cells = []
        for which in (*TESTS[:2], "region", *TESTS[2:]):
            low, high = binomtest(found[which], n).proportion_ci(method="wilson")
            cells.append(f"{100 * found[which] / n:.1f} [{100 * low:.1f}, {100 * high:.1f}]")
        rows.append([words, *cells])
    return table(["groups of equal means", "means", "ratio", "any region", "scatter"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare simulated groups with known causes.")
    parser.add_argument("--groups", type=int, default=60)
    parser.add_argument("--compared", type=int, default=0)
    parser.add_argument("--nulls", type=int, default=0)
    measured.add_option(parser)
    args = parser.parse_args()
    if args.nulls:
        print(false_rates(args.nulls))
        return
    rows = []
    for paired in (True, False):
        for words, change in CHANGES.items():
            found: Counter[str] = Counter()
            for k in range(args.groups):
                a, b = people(10, 2 * k), people(10, 2 * k + (not paired), change, again=1)
                outcome = detect(sample_of(a, b), a["f"].values, np.random.default_rng(k), 199)
                found.update(p for p in TESTS if getattr(outcome, p) <= 0.05)
                found["region"] += min(r.p for r in outcome.regions) <= 0.05
                found[name(outcome)] += 1
            counts = [found[w] for w in (*TESTS, "region", "same", "alike", "upper body")]
            rows.append([f"{'' if paired else 'un'}paired, {words}", *(f"{100 * c / args.groups:.0f}" for c in counts)])
    header = ["groups", "means", "ratio", "scatter", "any region", "same", "alike", "upper body"]
    print(table(header, rows), flush=True)
    measured.write(args.json, tables={"power": (header, rows)})
    for words, change in CHANGES.items() if args.compared else ():
        for k in range(args.compared):
            result = compare_groups(people(10, 2 * k), people(10, 2 * k + 1, change), permutations=199)
            first = [f"{c.name} {c.probability:.2f}" for c in result.causes[:3]] or ["no difference"]
            print(f"{words}: {', '.join(first)}; p = {result.detection.p_mean:.3f}", flush=True)


if __name__ == "__main__":
    main()
