"""What an ideal method could reach on mechanisms in other forms: between two limits (pipelines.validation.form_bound).

    python pipelines/validation/misshapen_ceiling.py [DRAWS]

The body and the forms are drawn as in gap_challenge_misshapen.toml, DRAWS (24) of every form, from another seed. Some
100 CPU seconds.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from mcstudy_challenge.challenge_file import read_challenge

from mcstudy.streams import stream
from pipelines.validation.form_bound import imagine, reached

FILE = Path(__file__).parents[1] / "gap_challenge_misshapen.toml"
SEED = 1
LEAST = 6.0
"""Delta from which the mechanism should be first."""


def main(draws: int) -> None:
    """Print both limits."""
    rng = stream(SEED, "form ceiling", 0)
    drawn = imagine(read_challenge(FILE).series["main"], rng, draws)
    share = drawn.share
    clear = share * (drawn.delta >= LEAST)
    print(f"{len(drawn.form)} forms of {len(drawn.right)} mechanisms")
    for own, what in ((False, "true form left out"), (True, "true form among the draws")):
        found = reached(drawn, rng, own)
        top, covered = float(np.average(found.top, weights=clear)), float(np.average(found.covered, weights=share))
        print(
            f"{what}: right mechanism first at delta >= {LEAST:g}: {100 * top:.1f} %, 95 % set holds it: "
            f"{100 * covered:.1f} %"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 24)
