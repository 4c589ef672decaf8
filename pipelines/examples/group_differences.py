"""What the comparison of two groups says of simulated people whose differences have known causes.

    python pipelines/examples/group_differences.py --groups 60 --compared 5

People stand on a tilting platform. Their parameters scatter by 5 % about the stand-in truth; their frequency responses
are those of the model (closed form) at nine points of a ternary sequence of 20 s, with noise. Rates of tests are over
``--groups`` pairs of groups of ten, in percent; with ``--compared`` N the change of parameters is named for N of them.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping

import numpy as np
import xarray as xr

from mcstudy.effect_library import library
from mcstudy.group_comparison.changes import NOTHING
from mcstudy.group_comparison.compare import compare_groups
from mcstudy.group_comparison.detection import detect, name
from mcstudy.group_comparison.sample import sample_of
from mcstudy.recordings.frf_group import group_dataset
from mcstudy.recordings.frf_group_sheet import TableSheet
from mcstudy.spectra.frf_groups import in_space
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.response import frf
from mcstudy.text_tables import table

POINTS = ((1,), (2,), (3, 4), (4, 5), (5, 6, 7), (6, 7, 8, 9), (8, 9, 10, 11), (10, 11, 12, 13), (12, 13, 14, 15, 16))

CHANGES: dict[str, dict[str, float]] = {
    "none": {},
    "Wprop x 0.7": {"Wprop": 0.7},
    "K11, B11 x 1.15": {"K11": 1.15, "B11": 1.15},
    "Td1 x 1.2": {"Td1": 1.2},
    "K12, B12 x 1.3": {"K12": 1.3, "B12": 1.3},
    "K22, B22 x 1.4": {"K22": 1.4, "B22": 1.4},
}


def people(
    n: int,
    seed: int,
    change: Mapping[str, float] | None = None,
    *,
    noise: float = 0.3,
    again: int = 0,
    effect: tuple[str, float] | None = None,
) -> xr.Dataset:
    """One condition of ``n`` people.

    ``change``: factors of parameters, the same for everybody. ``noise``: SD of the responses at 0.5 Hz; it falls with
    frequency. ``again``: number of the recording; another one of the same ``seed`` has other noise. ``effect``: of the
    library, with the value of its parameter.
    """
    model = two_segment(stimulus="surface_tilt")
    sheet = TableSheet(file="", gain="*", phase="*", period_s=20.0, points=POINTS, prts_state_s=0.25)
    f_line, average = sheet.lines()
    theta = model.truth * np.exp(0.05 * np.random.default_rng([seed, 0]).normal(size=(n, len(model.truth))))
    for parameter, factor in (change or {}).items():
        theta[:, model.names.index(parameter)] *= factor
    if effect:
        model = library.apply(model, effect[0])
        theta = np.column_stack([theta, np.full(n, effect[1])])
    rng = np.random.default_rng([seed, 1, again])
    lines = in_space(frf(model, theta, f_line))
    size = noise * (0.5 / np.maximum(f_line, 0.2))[None, :, None] / np.sqrt(2)
    lines = lines + size * (rng.normal(size=lines.shape) + 1j * rng.normal(size=lines.shape))
    points = np.einsum("nl,pls->psn", average, lines)[:, None]
    names = [f"person {seed}-{k}" for k in range(n)]
    return group_dataset(points, names, [()], [], f_line, average, "surface_tilt", Body())


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare simulated groups with known causes.")
    parser.add_argument("--groups", type=int, default=60)
    parser.add_argument("--compared", type=int, default=0)
    args = parser.parse_args()
    rows = []
    for paired in (True, False):
        for words, change in CHANGES.items():
            found: Counter[str] = Counter()
            for k in range(args.groups):
                a, b = people(10, 2 * k), people(10, 2 * k + (not paired), change, again=1)
                outcome = detect(sample_of(a, b), a["f"].values, np.random.default_rng(k), 199)
                found.update(p for p in ("p", "p_mean", "p_scatter", "p_ratio") if getattr(outcome, p) <= 0.05)
                found[name(outcome)] += 1
            counts = [found[w] for w in ("p", "p_mean", "p_scatter", "p_ratio", "same", "alike", "upper body")]
            rows.append([f"{'' if paired else 'un'}paired, {words}", *(f"{100 * c / args.groups:.0f}" for c in counts)])
    header = ["groups", "p <= 0.05", "mean", "scatter", "ratio", "same", "alike", "upper body"]
    print(table(header, rows), flush=True)
    for words, change in CHANGES.items() if args.compared else ():
        for k in range(args.compared):
            result = compare_groups(people(10, 2 * k), people(10, 2 * k + 1, change), permutations=199)
            first = [f"{c.name} {c.probability:.2f}" for c in result.causes[:3]]
            none = next(c.probability for c in result.causes if c.name == NOTHING)
            print(f"{words}: {', '.join(first)}; no difference {none:.2f}", flush=True)


if __name__ == "__main__":
    main()
