"""Forms of what a publication states: numbers and rankings of one study, and claims about a changed setting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Criterion = Literal["equal", "at most", "at least", "none"]
"""How a published statement is compared with ours; `mcstudy.analysis.publications.verdict` has the rule.

equal: ours equals the number. at most, at least: ours is no larger (smaller) than the number; for a ranking the number
is 0, and ours is the margin by which the ranking holds. none: the publication gives nothing to compare with.
"""


@dataclass(frozen=True)
class Published:
    """One published statement.

    Attributes
    ----------
    key: name of the row. label: name in a table; "(reading)" marks a second reading of the same words. unit: of
    ``value``. value: the number; NaN where none is stated. shown: the statement as printed in a table.
    where: section, figure or table. criterion: see `Criterion`. half_unit: half a unit of the last digit quoted, or
    what "about" leaves open. margin: of equivalence, for criterion equal. n: realizations behind the
    number; 0 if it follows from the model alone.
    """

    key: str
    label: str
    unit: str
    value: float
    shown: str
    where: str
    criterion: Criterion = "equal"
    half_unit: float = 0.0
    margin: float = 0.0
    n: int = 50

    @property
    def sampled(self) -> bool:
        """Whether it depends on noise, so that the number of realizations matters."""
        return self.n > 1


@dataclass(frozen=True)
class Expectation:
    """Direction implied by a claim: a measure of `mcstudy.analysis.compare` rises (+1) or falls (-1) at these Fmax."""

    measure: str
    sign: int
    fmax: tuple[float, ...]


@dataclass(frozen=True)
class Variant:
    """A published claim about a changed setting, without a number.

    ``changes``: settings that differ from the published ones, as fields of a study file. ``expects``: the claim in
    terms of our measures. "Improved fits" is read as estimates closer to the truth and fewer unstable ones; a lower
    cost cannot be meant where bounds are tighter, because these can only raise the minimum.
    """

    study: str
    changes: tuple[str, ...]
    claim: str
    where: str
    expects: tuple[Expectation, ...]
