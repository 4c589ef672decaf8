"""What an ideal method could reach on mechanisms in other forms: between two limits (pipelines.validation.form_bound).

    python pipelines/validation/misshapen_ceiling.py

The body and the forms are drawn as in gap_challenge_misshapen.toml, 24 of every form, from another seed. Some 100 CPU
seconds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from mcstudy_challenge.challenge_file import read_challenge

from mcstudy.streams import stream
from pipelines import measured
from pipelines.validation.form_bound import imagine, reached

FILE = Path(__file__).parents[1] / "gap_challenge_misshapen.toml"
SEED = 1
LEAST = 6.0
"""Delta from which the mechanism should be first."""


def main(draws: int, file: Path | None = None) -> None:
    """Print both limits, and write them to ``file``."""
    rng = stream(SEED, "form ceiling", 0)
    drawn = imagine(read_challenge(FILE).series["main"], rng, draws)
    share = drawn.share
    clear = share * (drawn.delta >= LEAST)
    print(f"{len(drawn.form)} forms of {len(drawn.right)} mechanisms")
    values = {}
    for key, among, what in (("low", False, "true form left out"), ("high", True, "true form among the draws")):
        ideal = reached(drawn, rng, among)
        top, covered = float(np.average(ideal.top, weights=clear)), float(np.average(ideal.covered, weights=share))
        values[key] = {"value": round(100 * top, 1)} | ({"unit": "%"} if among else {})
        print(
            f"{what}: right mechanism first at delta >= {LEAST:g}: {100 * top:.1f} %, 95 % set holds it: "
            f"{100 * covered:.1f} %"
        )
    measured.write(file, values)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=24, help="of every form (default: 24)")
    measured.add_option(parser)
    args = parser.parse_args()
    main(args.draws, args.json)
