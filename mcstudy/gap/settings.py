"""Which of the slow questions a diagnosis answers, besides whether there is a gap and what causes it.

The other answers do not depend on this choice: each question draws random numbers of its own.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Asked:
    """The questions that are answered.

    Attributes
    ----------
    nearest
        The nearest mechanism, what it leaves, and the likeness of the causes.
    closed
        The share of the gap that the leading cause closes.
    """

    nearest: bool = True
    closed: bool = True


EVERYTHING = Asked()

CAUSE_ONLY = Asked(nearest=False, closed=False)
"""For those who read neither."""
