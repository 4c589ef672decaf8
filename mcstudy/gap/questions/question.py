"""What every question of a diagnosis has: a function that answers it, and an answer that states itself.

A question is one file of this folder. Its function takes an `Inquiry`, everything that was found before, and returns an
`Answer`, or None where there is nothing to answer. `mcstudy.gap.diagnose.QUESTIONS` lists the functions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from mcstudy.gap.questions.any_gap import GapTest
from mcstudy.gap.questions.posterior import Cause, Explanation
from mcstudy.gap.settings import DiagnosisSettings
from mcstudy.spectra.lines import Lines
from mcstudy.text_tables import Table

CREDIBLE = 0.95
"""Probability of the smallest set of causes that is stated."""


@dataclass(frozen=True)
class Inquiry:
    """What a question may ask: the recording's lines, the test for a gap, and the causes.

    Attributes
    ----------
    lines
        The measured lines.
    test
        The test for a gap, with the fit of the base model.
    explanation
        The probabilities of all causes.
    causes
        The named causes in order of decreasing probability.
    detected
        Whether there is a gap.
    settings
        How the recording is diagnosed.
    """

    lines: Lines
    test: GapTest
    explanation: Explanation
    causes: tuple[Cause, ...]
    detected: bool
    settings: DiagnosisSettings

    @property
    def leading(self) -> Cause | None:
        """The most probable named cause; None without a gap."""
        return self.causes[0] if self.detected and self.causes else None

    @property
    def credible_set(self) -> tuple[int | str, ...]:
        """The smallest set of causes (by index), "unknown" and "none" with a probability of at least `CREDIBLE`."""
        entries: list[tuple[float, int | str]] = [(c.probability, k) for k, c in enumerate(self.causes)]
        entries += [(self.explanation.unknown, "unknown"), (self.explanation.none, "none")]
        credible: list[int | str] = []
        total = 0.0
        for probability, entry in sorted(entries, key=lambda e: -e[0]):
            credible.append(entry)
            total += probability
            if total >= CREDIBLE:
                break
        return tuple(credible)


def shown_causes(causes: Sequence[Cause], credible_set: Sequence[int | str], leading: Cause | None) -> list[Cause]:
    """The leading cause and the other named ones of the 95 % set."""
    inside = [causes[k] for k in credible_set if isinstance(k, int)]
    return inside if leading is None or any(c is leading for c in inside) else [leading, *inside]


class Answer(ABC):
    """The answer to one question: plain data, in JSON under ``name``, with its sentence and its table."""

    name: ClassVar[str]

    @abstractmethod
    def to_dict(self) -> Any:
        """The answer as plain JSON data."""

    def sentence(self) -> str:
        """What the verdict says of it; empty for nothing."""
        return ""

    def table(self) -> Table | None:
        """Its table; None for none."""
        return None
