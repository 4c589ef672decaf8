"""What an ideal method could reach that knows noise, body and the shares of the challenge.

The method is that of pipelines.validation.fair_bound.

    python pipelines/validation/fair_ceiling.py [BODIES]

Bodies (2) and out-of-library effects are drawn as in gap_challenge.toml, from another seed. Beside it stands the ideal
method of the keys, which knows that there is no effect or one of the library. Some 40 CPU seconds per body; +- is the
standard error over bodies.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from mcstudy_challenge.challenge_file import read_challenge
from mcstudy_challenge.scores.oracle import Ceiling

from mcstudy.streams import stream
from mcstudy.text_tables import table
from pipelines.validation.fair_bound import ideal

FILE = Path(__file__).parents[1] / "gap_challenge.toml"
SEED = 1
DRAWS = 200
"""Draws of noise for each signature."""

ROWS = (
    (4.0, "detected", "detection at delta = 4"),
    (6.0, "top", "true group most probable at delta = 6"),
    (6.0, "probability", "mean P(true group) at delta = 6"),
    (6.0, "covered", "95 % set contains the truth at delta = 6"),
    (6.0, "set_size", "size of the 95 % set at delta = 6"),
)


def main(bodies: int) -> None:
    """Print both bounds."""
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


def _text(values: np.ndarray, percent: bool) -> str:
    scale, digits, unit = (100, 1, " %") if percent else (1, 2, "")
    error = values.std(ddof=1) / np.sqrt(values.size) if values.size > 1 else float("nan")
    return f"{scale * values.mean():.{digits}f} +- {scale * error:.{digits}f}{unit}"


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2)
