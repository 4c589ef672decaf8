"""What an ideal method could reach that knows noise, body and the shares of the challenge.

The method is that of pipelines.validation.fair_bound.

    python pipelines/validation/fair_ceiling.py

Two bodies and out-of-library effects are drawn as in gap_challenge.toml, from another seed. Beside it stands the ideal
method of the keys, which knows that there is no effect or one of the library. Some 40 CPU seconds per body; +- is the
standard error over bodies.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from mcstudy_challenge.challenge_file import read_challenge
from mcstudy_challenge.scores.oracle import Ceiling

from mcstudy.streams import stream
from mcstudy.text_tables import table
from pipelines import measured
from pipelines.validation.fair_bound import ideal

FILE = Path(__file__).parents[1] / "gap_challenge.toml"
SEED = 1
DRAWS = 200
"""Draws of noise for each signature."""

ROWS = (
    (4.0, "detected", "detection at delta = 4"),
    (6.0, "top", "most probable cause is in the true group at delta = 6"),
    (6.0, "probability", "mean P(true group) at delta = 6"),
    (6.0, "covered", "95 % set contains the truth at delta = 6"),
    (6.0, "set_size", "size of the 95 % set at delta = 6"),
)


def main(bodies: int, file: Path | None = None) -> None:
    """Print both bounds, and write them to ``file`` beside what the benchmark measured."""
    series = read_challenge(FILE).series["main"]
    found: dict[float, list[tuple[Ceiling, Ceiling]]] = {4.0: [], 6.0: []}
    for body in range(bodies):
        rng = stream(SEED, "fair ceiling", body)
        both = ideal(series, rng)
        for delta, figures in found.items():
            figures.append(both.figures(rng, delta, DRAWS))
    rows = []
    for delta, name, words in ROWS:
        values = np.array([[getattr(c, name) for c in pair] for pair in found[delta]])
        rows.append([words, *(_text(column, name != "set_size") for column in values.T)])
    print(f"{bodies} bodies, {DRAWS} draws of noise for each signature")
    print(table(["figure", "no effect or one of the library", "shares of all kinds"], rows))
    reached = {row[0].partition(" (")[0]: row[1:3] for row in measured.load("challenge")["tables"]["targets"]["rows"]}
    every = [[name, *reached[name], *bounds] for name, *bounds in rows if name in reached]
    columns = ["target", "goal", "figure above", "oracle bound", "fair bound"]
    tables = {
        "bounds": ([*columns[:3], columns[4]], [[*row[:3], row[4]] for row in every]),
        "bounds_all": (columns, every),
    }
    measured.write(file, tables=tables)


def _text(values: np.ndarray, percent: bool) -> str:
    scale, digits, unit = (100, 1, " %") if percent else (1, 2, "")
    error = values.std(ddof=1) / np.sqrt(values.size) if values.size > 1 else float("nan")
    return f"{scale * values.mean():.{digits}f} +- {scale * error:.{digits}f}{unit}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", type=int, default=2, help="default: 2")
    measured.add_option(parser)
    args = parser.parse_args()
    main(args.bodies, args.json)
