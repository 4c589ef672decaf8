"""Are the verdicts on the paper's rows right? Equal studies of our own take the place of the paper and of ours.

Many studies of 50 realizations with the same truth and independent noise are cut from one large study. One of them
plays the paper: its numbers, quoted as the paper quotes its own, are compared with one of the others, with 10 and with
all of them together. Equal studies must not differ (at most 1 % of comparisons per row), and must agree more often the
larger ours is. Then a study with another truth (--shift) takes the place of ours: it must be told. The script prints
the shares of the three verdicts for every row. ``-o FOLDER`` keeps the cubes, and a second run resumes.
"""

import argparse
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from mcstudy_goodworth2018.paper.published import AMPLITUDES_NM, FMAX_HZ, REALIZATIONS
from mcstudy_goodworth2018.paper.statements import RESULTS
from mcstudy_goodworth2018.paper.values import fit_values

import mcstudy as mc
from mcstudy.analysis.publications.sampling import Value, pooled
from mcstudy.analysis.publications.statement import Published
from mcstudy.analysis.publications.verdict import judge
from mcstudy.analysis.publications.verdict_names import AGREES, DIFFERS
from mcstudy.analysis.view import GroupView

GROUP, SEED = "accuracy", 990017
LARGER = 10
"""Studies of 50 that make up a larger one."""


def studies(path: Path, count: int, starts: int, seed: int, truth: dict[str, float], workers: int) -> list[dict]:
    """Values of the rows of ``count`` studies of the paper's size."""
    axes = {"realizations": REALIZATIONS * count, "starts": starts, "fmax": FMAX_HZ, "amplitude": AMPLITUDES_NM}
    study = mc.Study("equal_studies", seed=seed).group(GROUP, **axes, model={"truth": truth})
    view = GroupView(GROUP, mc.run(study, path, workers=workers)[GROUP].to_dataset())
    cells = view.at(view.cells, FMAX_HZ, AMPLITUDES_NM)
    cuts = [slice(i * REALIZATIONS, (i + 1) * REALIZATIONS) for i in range(count)]
    return [fit_values(cells.isel(realization=cut), view.model) for cut in cuts]


def quoted(statement: Published, value: float) -> Published:
    """The statement that a study with this value would have published: a number as it is rounded, a ranking its way."""
    if statement.criterion in ("at least", "at most"):
        return replace(statement, criterion="at least" if value >= statement.value else "at most")
    unit = 2 * statement.half_unit
    return replace(statement, value=round(value / unit) * unit if unit else value)


def together(values: Sequence[Value]) -> Value:
    """One larger study made of several."""
    numbers, errors = (np.array([getattr(v, name) for v in values]) for name in ("value", "study_error"))
    return pooled(numbers, errors, REALIZATIONS, REALIZATIONS)


def shares(key: str, papers: list[dict], others: list[dict], size: int, same: bool) -> tuple[float, float, int]:
    """Percent of comparisons that differ and that agree; number of comparisons. ``same``: never with itself."""
    n, found = len(others), Counter()
    for i, paper in enumerate(papers):
        statement = quoted(RESULTS[key], paper[key].value)
        for first in range(1, n) if size < n - 1 else [1]:  # the largest size leaves one way to choose
            chosen = [(i + first + j) % n for j in range(size)]
            if not (same and i in chosen):
                found[judge(statement, together([others[j][key] for j in chosen])).name] += 1
    total = max(sum(found.values()), 1)
    return 100 * found[DIFFERS] / total, 100 * found[AGREES] / total, total


def arguments() -> argparse.ArgumentParser:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--studies", type=int, default=6, help="number of equal studies (default: %(default)s)")
    parser.add_argument("--starts", type=int, default=3, help="starts of each fit (default: %(default)s)")
    parser.add_argument("--shift", default="K22=140", metavar="NAME=VALUE", help="another truth (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=2, help="worker processes (default: %(default)s)")
    parser.add_argument("-o", "--output", type=Path, help="folder that keeps the cubes")
    return parser


def main(argv: Sequence[str] | None = None) -> None:
    """Run both studies and print the shares."""
    given = arguments().parse_args(argv)
    name, _, value = given.shift.partition("=")
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.output or Path(temporary)
        base = studies(folder / "equal.zarr", given.studies, given.starts, SEED, {}, given.workers)
        truth = {name: float(value)}
        larger = min(LARGER, given.studies - 1)
        moved = studies(folder / "shifted.zarr", larger, given.starts, SEED + 1, truth, given.workers)
    sizes = sorted({1, larger, given.studies - 1})
    keys = [k for k in base[0] if RESULTS[k].criterion != "none"]
    print(f"{given.studies} equal studies of {REALIZATIONS} realizations; percent of comparisons that differ / agree")
    heads = "".join(f"{f'ours {k} x 50':>16}" for k in sizes)
    print(f"{'':48}{heads}{f'{given.shift}, {larger} x 50':>20}")
    worst, counts = 0.0, {k: np.zeros(2) for k in sizes}
    told = []
    for key in keys:
        found = {k: shares(key, base, base, k, same=True) for k in sizes}
        shifted = shares(key, base, moved, larger, same=False)
        for k in sizes:
            counts[k] += found[k][:2]
        worst = max(worst, *(found[k][0] for k in sizes))
        if shifted[0] > 50:
            told.append(key)
        line = "".join(f"{found[k][0]:8.1f} /{found[k][1]:6.1f}" for k in sizes)
        print(f"{RESULTS[key].label:48}{line}{shifted[0]:12.1f} /{shifted[1]:6.1f}")
    line = "".join(f"{counts[k][0] / len(keys):8.1f} /{counts[k][1] / len(keys):6.1f}" for k in sizes)
    print(f"{'mean over rows':48}{line}")
    print(f"largest share of equal studies that differ, any row: {worst:.1f} %")
    print(f"rows that tell the shifted truth in more than half of comparisons: {', '.join(told) or 'none'}")


if __name__ == "__main__":
    main()
