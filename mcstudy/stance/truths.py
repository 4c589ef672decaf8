"""True values of the two-segment model by name, for study files: none of them is the paper's Table I, which is lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mcstudy.stance.body import two_segment

INFERRED = "inferred from the paper's published numbers"
"""How true values are called that were found by `mcstudy infer`, wherever they are shown."""


@dataclass(frozen=True)
class Truth:
    """A named set of true values: ``values`` by parameter, and ``provenance``, where they come from in one line."""

    values: Mapping[str, float]
    provenance: str


TRUTHS: dict[str, Truth] = {
    "stand_in": Truth({p.name: p.value for p in two_segment().parameters}, two_segment().provenance),
    "inferred": Truth(
        {
            "K11": 639.6,
            "K12": 111.1,
            "K21": 679.3,
            "K22": 335.8,
            "B11": 242.1,
            "B12": 33.04,
            "B21": 15.72,
            "B22": 21.73,
            "Kpas1": 148.7,
            "Kpas2": 24.21,
            "Td1": 0.05795,
            "Td2": 0.07593,
        },
        f"{INFERRED}: its Table I is lost; these values came nearest to the printed numbers among simulated "
        "studies (mcstudy infer table_one); the numbers do not determine all of them",
    ),
}
"""Sets that `model.truth` of a study file may name."""


def named(values: Mapping[str, float]) -> str | None:
    """Name of a set of true values, if it is one of `TRUTHS`."""
    return next((name for name, truth in TRUTHS.items() if dict(truth.values) == dict(values)), None)
