"""Where the true values of a model come from, in one line: which of them are the paper's, a stand-in, or the user's."""

from __future__ import annotations

from collections.abc import Collection

LOST = "stand-in: the paper's Table I is lost"

REPLACED = "; replaced by the study file: "
"""Before the names of the true values that a study file states, and "body" where it states another one."""

OWN = "your values"
"""Origin of true values that replace those of every parameter."""

OWN_VALUES = f"{OWN} (study file)"
"""The same where a study file states them."""

REPLACED_IN_PYTHON = "; replaced by your values: "
"""Before the names of the true values that a program replaces (`Model.with_values`)."""

BODY = "body"
"""Stands for inertia and gravity among the names of what was replaced."""

WEIGHT = "the sensory weight is a round stand-in as well"
"""Peterka (2002) reports weights of 0.8 to 0.4 for tilts of 0.5 to 4 deg; they depend on amplitude and person."""


def stand_in(passive: str, replaced: Collection[str] = (), weights: Collection[str] = ()) -> str:
    """Origin of the values of a reference model, of which some are ``replaced``: names of parameters, and `BODY`.

    ``passive``: name of the ankle's passive stiffness, which is the paper's; ``weights``: names of sensory weights.
    """
    papers = [name for name in (BODY, passive) if name not in replaced]
    where = "" if BODY in papers else " for the paper's body"
    said = f"{' and '.join(papers)} {'is' if len(papers) == 1 else 'are'} the paper's, " if papers else ""
    aim = "until the study reproduces the paper's published aggregates"
    text = f"{LOST}; {said}the other gains were calibrated{where} {aim}"
    if any(name not in replaced for name in weights):
        text += f"; {WEIGHT}"
    return text + (REPLACED + ", ".join(replaced) if replaced else "")


def own_values(own_body: bool) -> str:
    """Origin of values that a study file states for every parameter, and perhaps for the body."""
    return OWN_VALUES + ("; the body is yours, too" if own_body else "; the body is the paper's")


def another_body(provenance: str) -> bool:
    """Whether true values of this origin are the user's own in part, so that the body is not the one of the paper."""
    return provenance.startswith(OWN) or REPLACED in provenance or REPLACED_IN_PYTHON in provenance


def with_replaced(provenance: str, replaced: Collection[str], every: Collection[str]) -> str:
    """Origin of the values of a model of this origin after a program ``replaced`` some of ``every`` parameter's."""
    if not replaced or not provenance:
        return provenance
    return OWN if len(replaced) == len(every) else provenance + REPLACED_IN_PYTHON + ", ".join(replaced)


def in_short(provenance: str) -> str:
    """Where the true values come from, in a few words."""
    first = "a stand-in" if provenance.startswith(LOST) else provenance.partition(";")[0]
    replaced = [provenance.partition(mark)[2].partition(";")[0] for mark in (REPLACED, REPLACED_IN_PYTHON)]
    return "; your own: ".join([first, *filter(None, replaced)])
