"""True values of the two-segment model by name, for study files: none of them is the paper's Table I, which is lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mcstudy.stance.body import TRUTH_PROVENANCE, two_segment


@dataclass(frozen=True)
class Truth:
    """A named set of true values: ``values`` by parameter, and ``provenance``, where they come from in one line."""

    values: Mapping[str, float]
    provenance: str


TRUTHS: dict[str, Truth] = {
    "stand_in": Truth({p.name: p.value for p in two_segment().parameters}, TRUTH_PROVENANCE),
}
"""Sets that `model.truth` of a study file may name."""


def provenance_of(values: Mapping[str, float]) -> str | None:
    """Where a set of true values comes from, if it is a named one."""
    return next((t.provenance for t in TRUTHS.values() if dict(t.values) == dict(values)), None)
