"""How often do 95 % intervals hold the true parameters of a body whose hidden cause the model lacks?

    python pipelines/validation/cause_coverage.py -o results/causes --seed 2 --cases 100

The bodies are those of the foreign simulator (`pipelines.validation.cause_bodies`): nothing missing, one mechanism of
the library in roughly its form, two of them, a cause outside the library. Compared are the fit of the model as it is
(``as is``), that with the leading cause of the diagnosis if it finds a gap (``leading``), the average over causes
(``averaged``), and the fit of somebody who knows the mechanism (``knows``; as it is for what has no linear effect).
``--cycles 3 6 12 24`` also makes recordings that long of the same bodies. Settings were chosen with ``--seed 1``.

Every body is a file in the output folder, so the same command resumes. The percentages are means over bodies of the
share of the 14 quantities that is held; their 95 % intervals come from resampled bodies. ``width``: median over bodies
and quantities, relative to the fit that knows the mechanism. ``--figure FILE``: coverage against how detectable the
causes are.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.effect_library.library import effect
from mcstudy.errors import InputError
from mcstudy.identification.fit import fit
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.settings import FitSettings
from mcstudy.recordings.recording import Recording
from mcstudy.text_tables import table
from pipelines import measured
from pipelines.validation.cause_bodies import CLASSES, Person, person

METHODS = ("as is", "leading", "averaged", "knows")
DELTAS = (0.0, 6.0, 10.0, 15.0, 30.0, np.inf)
"""Edges of the bins of the figure."""

STEP = 0.6180339887
"""Of the number of a body, which spreads the kinds evenly whatever the number of bodies."""


def judged(body: Person) -> dict[str, Any]:
    """Intervals of one body by method."""
    began = time.process_time()
    own = fit([body.recording], FitSettings(causes=True))
    seconds = time.process_time() - began
    assert own.averaged is not None
    assert own.gap is not None
    leading = next((c.effects for c in own.averaged.causes if c.effects), ())
    found = {
        "as is": own,
        "leading": _with(body.recording, leading, own) if own.gap.p_value < 0.05 else own,
        "knows": _with(body.recording, body.mechanisms, own),
    }
    ends = {method: [[e.low, e.high] for e in _same(r, own)] for method, r in found.items()}
    ends["averaged"] = [[q.low, q.high] for q in own.averaged.quantities]
    return {
        "kind": body.kind,
        "causes": body.causes,
        "delta": body.delta,
        "p_value": own.gap.p_value,
        "seconds": seconds,
        "named": [[c.name, c.probability] for c in own.averaged.causes[:5]],
        "quantities": [e.name for e in own.estimates],
        "truth": [sum(body.truth[n] for n in e.name.split(" + ")) for e in own.estimates],
        "ends": ends,
        "determined": [q.determined for q in own.averaged.quantities],
    }


def _with(recording: Recording, effects: Iterable[str], own: FitRecord) -> FitRecord:
    """The fit with those of the effects that have a linear form."""
    linear = [e for e in dict.fromkeys(effects) if e and " " not in e and effect(e).kind == "linear"]
    return fit([recording], FitSettings(effects=linear)) if linear else own


def _same(r: FitRecord, own: FitRecord) -> list[Any]:
    return [r[e.name] for e in own.estimates]


def run(folder: Path, seed: int, cases: int, cycles: int | None) -> list[dict[str, Any]]:
    """All bodies of a seed; those that cannot be fitted are told and left out."""
    folder.mkdir(parents=True, exist_ok=True)
    ends, out = np.cumsum(list(CLASSES.values())), []
    for number in range(cases):
        kind = list(CLASSES)[min(int(np.searchsorted(ends, (number * STEP) % 1.0, side="right")), len(CLASSES) - 1)]
        file = folder / f"{seed}_{number}{'' if cycles is None else f'_{cycles}'}.json"
        if not file.exists():
            body = person(seed, number, kind, cycles)
            try:
                answer = {} if body is None else judged(body)
            except InputError as error:
                answer = {"kind": kind, "refused": str(error)}
            file.write_text(json.dumps(answer), encoding="utf-8")
        out.append(json.loads(file.read_text(encoding="utf-8")))
    return [answer for answer in out if answer]


def held(answer: Mapping[str, Any], method: str) -> np.ndarray:
    """Which intervals (K,) hold the truth."""
    ends, truth = np.array(answer["ends"][method]), np.array(answer["truth"])
    slack = 1e-9 * np.abs(truth)
    return np.asarray((ends[:, 0] <= truth + slack) & (truth <= ends[:, 1] + slack))


def width(answer: Mapping[str, Any], method: str) -> np.ndarray:
    """Widths (K,) relative to the fit that knows the mechanism; nan where it has none."""
    own, knows = (np.diff(answer["ends"][m], axis=1)[:, 0] for m in (method, "knows"))
    return np.asarray(np.divide(own, knows, out=np.full_like(own, np.nan), where=knows > 0))


def coverage(answers: Sequence[Mapping[str, Any]], method: str) -> tuple[float, float, float]:
    """Percentage of intervals that hold the truth, and the ends of its interval."""
    rate = np.array([held(a, method).mean() for a in answers])
    again = np.random.default_rng(0).choice(rate, (2000, rate.size)).mean(axis=1)
    return tuple(100 * x for x in (rate.mean(), *np.quantile(again, (0.025, 0.975))))  # type: ignore[return-value]


def rows(answers: Sequence[Mapping[str, Any]]) -> list[list[object]]:
    """The table: by kind, bodies, coverage of every method, and the widths of the average and of the model as it is."""
    out: list[list[object]] = []
    for kind in CLASSES:
        own = [a for a in answers if a["kind"] == kind and "ends" in a]
        if not own:
            continue
        percent = ["{:.1f} % [{:.1f}, {:.1f}]".format(*coverage(own, m)) for m in METHODS]
        wide = [float(np.nanmedian([width(a, m) for a in own])) for m in ("as is", "averaged")]
        out.append([kind, len(own), *percent, *(f"{w:.2f}" for w in wide)])
    return out


def draw(answers: Sequence[Mapping[str, Any]], file: Path) -> None:
    """Coverage against delta of all causes together, with 95 % intervals; one curve per method."""
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(figsize=(5.5, 3.5), layout="constrained")
    for method in METHODS[:3]:
        x, y = [], []
        for low, high in pairwise(DELTAS):
            own = [a for a in answers if a["causes"] and low <= np.linalg.norm(a["delta"]) < high]
            if len(own) > 1:
                x.append(float(np.median([np.linalg.norm(a["delta"]) for a in own])))
                y.append(coverage(own, method))
        mid, bottom, top = np.array(y).T
        axes.errorbar(x, mid, [mid - bottom, top - mid], marker="o", capsize=2, label=method)
    axes.axhline(95, color="0.6", linewidth=0.8)
    axes.set(
        xscale="log", xlabel="detectability of the missing causes (delta)", ylabel="truth in interval, %", ylim=(0, 101)
    )
    axes.legend(loc="lower left")
    fig.savefig(file)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DIR", help="folder with a file per body")
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--cycles", type=int, nargs="*", default=[], help="lengths of recordings (default: six cycles)")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="coverage against the size of the cause")
    measured.add_option(parser)
    args = parser.parse_args()
    columns = ["missing", "bodies", *METHODS, "width as is", "width averaged"]
    tables = {}
    for cycles in args.cycles or [None]:
        answers = run(args.out, args.seed, args.cases, cycles)
        name = "coverage" if cycles is None else f"cycles_{cycles}"
        tables[name] = (columns, rows(answers))
        print(name, table(columns, [[str(c) for c in row] for row in tables[name][1]]), sep="\n")
        done = [a for a in answers if "ends" in a]
        print(f"{np.mean([a['seconds'] for a in done]):.1f} CPU s a recording; refused: {len(answers) - len(done)}")
    if args.figure:
        draw(done, args.figure)
    measured.write(args.json, tables=tables)


if __name__ == "__main__":
    main()
