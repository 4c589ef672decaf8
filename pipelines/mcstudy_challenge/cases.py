"""The cases of a challenge: their names, series and kinds.

Everything follows from the challenge's seed, the series and the number of the case in it, so that any single case can
be made again. Cases are shuffled over all series, so neither the name of a case nor its neighbours give information
about it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.streams import stream
from mcstudy_challenge.design import KINDS, CaseKind, ChallengeFile, Series


@dataclass(frozen=True)
class Case:
    """One case before it is made: ``name`` in the data, series, number in the series, kind."""

    name: str
    series: str
    number: int
    kind: CaseKind


def list_cases(file: ChallengeFile) -> list[Case]:
    """Every case in the order of its name."""
    listed = []
    for name, series in file.series.items():
        kinds = _kinds(series)
        order = stream(file.challenge.seed, f"challenge kinds {name}").permutation(len(kinds))
        listed += [(name, k, kinds[i]) for k, i in enumerate(order)]
    order = stream(file.challenge.seed, "challenge order").permutation(len(listed))
    width = len(str(len(listed)))
    return [Case(f"case{k + 1:0{width}d}", *listed[i]) for k, i in enumerate(order)]


def _kinds(series: Series) -> list[CaseKind]:
    """Exact numbers of every kind: largest remainders."""
    wanted = np.array([series.mix.of(k) * series.cases for k in KINDS])
    count = np.floor(wanted + 1e-9).astype(int)
    for i in np.argsort(count - wanted, kind="stable")[: series.cases - count.sum()]:
        count[i] += 1
    return [k for k, n in zip(KINDS, count, strict=True) for _ in range(n)]
