"""Whether a published number and ours are the same: agrees, differs or cannot tell.

Both are numbers of Monte Carlo studies, so both have an error. The paper's is not published; it is the error that a
study of the paper's size would have if its model were ours (`Value.study_error`). It does not shrink when ours does.

agrees: the two are equivalent. The 90 % interval of their difference lies within a margin (two one-sided tests at 5 %;
Schuirmann 1987, J Pharmacokinet Biopharm 15:657-680). differs: they are further apart than `LIMIT` (`LIMIT_FEW`)
errors of the difference, beyond what the rounding of the published number explains. Else the two studies cannot tell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mcstudy.analysis.publications.sampling import MANY, Value
from mcstudy.analysis.publications.statement import Published
from mcstudy.analysis.publications.verdict_names import AGREES, CANNOT_TELL, DIFFERS, LIMIT

LIMIT_FEW = 3.75
"""The same for fewer than `MANY` blocks, whose error is itself an estimate, too small where a mean |bias| is small by
chance: with it no row of two equal studies differs in more than 1 % (pipelines/validation/equal_studies.py)."""

EQUIVALENT = 1.645
"""Half the width of the 90 % interval of a difference, in standard errors."""

MOST_BLOCKS = 10_000
"""More blocks than this (half a million realizations) count as never."""

ENOUGH = 0.8
"""Share of the paper's realizations from which a study is compared; below, numbers that depend on it are too large."""


@dataclass(frozen=True)
class Verdict:
    """What two studies say about one published number.

    Attributes
    ----------
    name: `AGREES`, `DIFFERS`, `CANNOT_TELL`, or empty where the paper gives nothing to compare with.
    distance: difference, less half a unit of rounding, in standard errors of both studies; NaN where both are exact.
    error: standard error of the difference. paper_error: the paper's part of it.
    needed: realizations of ours that would tell if our value stays; 0 where the verdict is known or none would.
    limited_by: why it cannot be told: `OURS` (too few realizations), `THEIRS` (no number of ours would tell, because
    the paper's own error is too large), `DEFINITION` (a definition that the paper does not give decides); else empty.
    """

    name: str
    distance: float = float("nan")
    error: float = float("nan")
    paper_error: float = float("nan")
    needed: int = 0
    limited_by: str = ""


NONE = Verdict("")

OURS, THEIRS, DEFINITION = "realizations", "paper's error", "definition"


def judge(paper: Published, ours: Value) -> Verdict:
    """The verdict on one row."""
    if paper.criterion == "none" or not np.isfinite(ours.value):
        return NONE
    if np.isfinite(ours.low):
        return _of_range(paper, ours)
    if paper.sampled and ours.n < ENOUGH * paper.n:
        return Verdict(CANNOT_TELL, error=ours.mcse, paper_error=ours.study_error, needed=paper.n, limited_by=OURS)
    if not (np.isfinite(ours.mcse) and np.isfinite(ours.study_error)):
        return Verdict(CANNOT_TELL, needed=paper.n, limited_by=OURS)
    gap = ours.value - paper.value
    error = float(np.hypot(ours.mcse, ours.study_error))
    beyond, inside = _apart(paper, gap)
    distance = float(np.sign(gap)) * max(beyond, 0.0) / error + 0.0 if error > 0 else float("nan")
    name = _name(beyond, inside, error, ours.blocks)
    answer = Verdict(name, distance, error, ours.study_error)
    if name != CANNOT_TELL:
        return answer
    blocks = _blocks_needed(beyond, inside, ours.study_error)
    return Verdict(name, distance, error, ours.study_error, blocks * paper.n, OURS if blocks else THEIRS)


def _apart(paper: Published, gap: float) -> tuple[float, float]:
    """How far beyond the rounding of the paper's number ours is, and how far inside the margin of equivalence."""
    if paper.criterion == "at least":
        return -gap - paper.half_unit, gap + paper.half_unit
    if paper.criterion == "at most":
        return gap - paper.half_unit, paper.half_unit - gap
    return abs(gap) - paper.half_unit, paper.margin - abs(gap)


def _name(beyond: float, inside: float, error: float, blocks: int) -> str:
    limit = LIMIT if blocks >= MANY else LIMIT_FEW
    if inside >= EQUIVALENT * error:
        return AGREES
    return DIFFERS if beyond > limit * error else CANNOT_TELL


def _blocks_needed(beyond: float, inside: float, study_error: float) -> int:
    """Blocks of the paper's size that would decide if our value stays; 0 if none would."""

    def told(blocks: int) -> bool:
        return _name(beyond, inside, study_error * math.sqrt(1 + 1 / blocks), blocks) != CANNOT_TELL

    if not told(MOST_BLOCKS):  # a smaller error of ours only helps
        return 0
    few, enough = 0, MOST_BLOCKS
    while enough - few > 1:
        middle = (few + enough) // 2
        few, enough = (few, middle) if told(middle) else (middle, enough)
    return enough


def _of_range(paper: Published, ours: Value) -> Verdict:
    """Ours ranges over readings of a definition that the paper does not give: all of them must agree, or differ."""
    error = float(np.hypot(ours.mcse, ours.study_error)) if np.isfinite(ours.study_error) else 0.0
    spans = ours.low <= paper.value <= ours.high
    readings = [ours.low, ours.high, *([paper.value] if spans else [])]
    names = {_name(*_apart(paper, x - paper.value), error, ours.blocks) for x in readings}
    name = names.pop() if len(names) == 1 else CANNOT_TELL
    nearest = min(max(paper.value, ours.low), ours.high) - paper.value
    beyond = max(abs(nearest) - paper.half_unit, 0.0)
    distance = float(np.sign(nearest)) * beyond / error + 0.0 if error > 0 else float("nan")
    return Verdict(name, distance, error, ours.study_error, limited_by=DEFINITION if name == CANNOT_TELL else "")
