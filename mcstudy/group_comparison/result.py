"""What a comparison of two groups found, as plain data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.group_comparison.changes import OTHER
from mcstudy.group_comparison.detection import Detection, name

LEVEL = 0.05
"""Level of the test that decides, and of all others."""


@dataclass(frozen=True)
class Cause:
    """One hypothesis about what changed.

    Attributes
    ----------
    name: of the hypothesis. probability: given the data, that the means differ, and equal prior probabilities of the
    named changes.
    closed, closed_se: share of the difference that it closes in people who were not used for it, and its standard
    error; None where it was not computed. parameters: name, value in a, value in b.
    """

    name: str
    probability: float
    closed: float | None
    closed_se: float | None
    parameters: tuple[tuple[str, float, float], ...]


@dataclass(frozen=True, repr=False)
class ComparisonRecord:
    """Two groups compared.

    Attributes
    ----------
    a, b: names of the groups. people: of each, the pairs if ``paired``. stimulus: its kind.
    f: (N,), Hz. mean_a, mean_b: (2, N) mean responses, lower and upper body in space. error_a, error_b: (2, N) their
    standard errors (root of E|error|^2). detection: tests. causes: by probability; only of a difference that was found.
    predicted: (2, N), difference that the best named change predicts. inflation: factor of the error of the difference
    in the evidence. Both are None where no difference was found. notes: what was left out of the recordings, and why.
    """

    a: str
    b: str
    people: tuple[int, int]
    paired: bool
    stimulus: str
    f: np.ndarray
    mean_a: np.ndarray
    mean_b: np.ndarray
    error_a: np.ndarray
    error_b: np.ndarray
    predicted: np.ndarray | None
    inflation: float | None
    permutations: int
    detection: Detection
    causes: tuple[Cause, ...]
    notes: tuple[str, ...] = ()

    @property
    def differs(self) -> bool:
        """Whether a difference of the mean responses was found at the 5 % level: the decision."""
        return self.detection.p_mean <= LEVEL

    @property
    def kind(self) -> str:
        """``"same"``, ``"alike"`` (both segments change by one factor) or ``"upper body"`` (their ratio changes)."""
        return name(self.detection, LEVEL)

    @property
    def best(self) -> Cause | None:
        """The most probable named change; None where no difference was found."""
        return next((c for c in self.causes if c.name != OTHER), None)
