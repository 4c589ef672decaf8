"""How often does `mcstudy fit` miss the lowest minimum?

    python pipelines/examples/missed_minima.py --recordings 40

Recordings of the nominal body (two trials of six cycles) are searched as `mcstudy fit` does and again with ten times as
many random starts. Printed for each highest frequency: in how many recordings the longer search found a lower minimum
with a stable closed loop, and the share of starts that the search expects to end in a minimum not seen yet.
"""

from __future__ import annotations

import argparse

import numpy as np

from mcstudy.fitting.penalised import Data, Fitter
from mcstudy.identification.coverage import Condition, Source
from mcstudy.identification.fit import bounded
from mcstudy.identification.minimum import APART, search, without_prior
from mcstudy.stance.body import two_segment
from mcstudy.streams import stream

FMAX_HZ = (1.2, 3.1, 8.0)

MORE = 10


def missed(fmax: float, recordings: int, more: int = MORE) -> tuple[int, float, float]:
    """Recordings in which ``more`` times the starts find a lower minimum; mean stated share; mean starts."""
    source, nominal = Source(Condition(0, 6, fmax)), two_segment()
    model = bounded(nominal, nominal, {})
    lower, stated, starts = 0, [], []
    for r in range(recordings):
        lines = source(stream(r, "missed minima"))
        fitter, data = Fitter(model, without_prior(model, nominal), lines.f), Data.of(lines)
        one = search(fitter, data, r)
        further = search(fitter, data, r + recordings, least=more * one.starts)
        lower += bool(further.chi2[0] < one.chi2[0] - APART)
        stated.append(one.missed)
        starts.append(one.starts)
    return lower, float(np.mean(stated)), float(np.mean(starts))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="How often does mcstudy fit miss the lowest minimum?")
    parser.add_argument("--recordings", type=int, default=40)
    given = parser.parse_args()
    for highest in FMAX_HZ:
        times, share, used = missed(highest, given.recordings)
        print(
            f"{highest:g} Hz: a lower minimum in {times} of {given.recordings} recordings; stated share of starts "
            f"{100 * share:.2f} %; {used:.0f} starts, then {MORE * used:.0f}",
            flush=True,
        )
