"""How often does `mcstudy fit` miss the lowest minimum?

    python pipelines/validation/missed_minima.py --recordings 40

Recordings of the nominal body (two trials of six cycles) are searched as `mcstudy fit` does and again with ten times as
many random starts. Printed for each highest frequency: in how many recordings the longer search found a lower minimum
with a stable closed loop, in how many it found further ones that an interval would have to cover, and the share of
starts that the search expects to end in a minimum not seen yet.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np

from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.identification.bounds import bounded
from mcstudy.identification.minimum import APART, search, without_prior
from mcstudy.stance.body import two_segment
from mcstudy.streams import stream
from pipelines.validation.coverage import Condition, Source

FMAX_HZ = (1.2, 3.1, 8.0)

MORE = 10


COVERED = 4.0
"""Rise of the deviance up to which intervals cover a minimum, about."""


class Missed(NamedTuple):
    """Of so many recordings: those in which the longer search found a lower minimum, those in which it found another
    one within `COVERED` of the lowest; mean stated share of starts, mean random starts."""

    lower: int
    other: int
    stated: float
    starts: float


def missed(fmax: float, recordings: int, more: int = MORE) -> Missed:
    """What ``more`` times the starts find beyond the search of `mcstudy fit`."""
    source, nominal = Source(Condition(0, 6, fmax)), two_segment()
    model = bounded(nominal, nominal, {})
    lower, other, stated, starts = 0, 0, [], []
    for r in range(recordings):
        lines = source(stream(r, "missed minima"))
        fitter, data = Fitter(model, without_prior(model, nominal), lines.f), Data.of(lines)
        one = search(fitter, data, r)
        further = search(fitter, data, r + recordings, least=more * one.starts).chi2
        further = further[further < min(further[0], one.chi2[0]) + COVERED]
        lower += bool(further[:1] < one.chi2[0] - APART)
        other += bool((np.abs(further[:, None] - one.chi2) > APART).all(axis=1).any())
        stated.append(one.missed)
        starts.append(one.starts)
    return Missed(lower, other, float(np.mean(stated)), float(np.mean(starts)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="How often does mcstudy fit miss the lowest minimum?")
    parser.add_argument("--recordings", type=int, default=40)
    given = parser.parse_args()
    for highest in FMAX_HZ:
        found = missed(highest, given.recordings)
        print(
            f"{highest:g} Hz: a lower minimum in {found.lower} of {given.recordings} recordings, another one that "
            f"intervals cover in {found.other}; stated share of starts {100 * found.stated:.2f} %; "
            f"{found.starts:.0f} starts, then {MORE * found.starts:.0f}",
            flush=True,
        )
