"""How true values that a study file states itself are called where they are shown."""

from __future__ import annotations

REPLACED = "; replaced by the study file: "
"""Before the names of the true values that a study file states, in the origin of a model's values."""

OWN_VALUES = "your values (study file)"
"""Origin of true values that a study file states for every parameter."""


def another_body(provenance: str) -> bool:
    """Whether true values of this origin are the user's own in part, so that the body is not the one of the paper."""
    return provenance == OWN_VALUES or REPLACED in provenance
