"""True values of the two-segment model by name, for study files: none of them is the paper's Table I, which is lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mcstudy.stance.body import TRUTH_PROVENANCE, two_segment

INFERRED = "inferred from the paper's published numbers"
"""How true values are called that were found by `mcstudy infer`, wherever they are shown."""


@dataclass(frozen=True)
class Truth:
    """A named set of true values: ``values`` by parameter, and ``provenance``, where they come from in one line."""

    values: Mapping[str, float]
    provenance: str


TRUTHS: dict[str, Truth] = {
    "stand_in": Truth({p.name: p.value for p in two_segment().parameters}, TRUTH_PROVENANCE),
    "inferred": Truth(
        {
            "K11": 584.3,
            "K12": 75.94,
            "K21": 496.4,
            "K22": 286.9,
            "B11": 243.6,
            "B12": 37.76,
            "B21": 10.51,
            "B22": 21.93,
            "Kpas1": 147.5,
            "Kpas2": 19.55,
            "Td1": 0.05533,
            "Td2": 0.07715,
        },
        f"{INFERRED}: its Table I is lost; these values came nearest to the printed numbers among simulated "
        "studies (mcstudy infer table_one); the numbers do not determine all of them",
    ),
}
"""Sets that `model.truth` of a study file may name."""


def provenance_of(values: Mapping[str, float]) -> str | None:
    """Where a set of true values comes from, if it is a named one."""
    return next((t.provenance for t in TRUTHS.values() if dict(t.values) == dict(values)), None)
