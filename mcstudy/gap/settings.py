"""What a user chooses about a diagnosis, and what of it the result states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mcstudy.errors import InputError
from mcstudy.gap.prior import NONE, prior
from mcstudy.lines.checked_recording import Discard
from mcstudy.lines.settings import LineSettings

DRAWS = 1000
"""Null samples, unless another number of bootstrap samples is wanted."""

LEAST_DRAWS = 50
"""Fewest bootstrap samples: with fewer than 31 no p-value could be below the level of the test."""


@dataclass(frozen=True)
class Asked:
    """Which of the slow questions a diagnosis answers, besides whether there is a gap and what causes it.

    The other answers do not depend on this choice: each question draws random numbers of its own.

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
"""Whether there is a gap, and what causes it."""


@dataclass(frozen=True, kw_only=True)
class DiagnosisSettings(LineSettings):
    """How a recording is diagnosed; what is not stated here is as in `LineSettings`.

    Attributes
    ----------
    fast
        Null samples are simulated noise through the linearised fit; otherwise the model is refitted to each of them.
    bootstrap
        Number of refitted null samples; None for `DRAWS`, and with ``fast``.
    prior_none
        Prior probability that no effect is missing; the other prior probabilities keep their ratios.
    asked
        The questions that are answered; the results of the others are None.

    Raises
    ------
    InputError
        ``bootstrap`` is too small, or given together with ``fast``; ``prior_none`` is no probability between 0 and 1.
    """

    fast: bool = False
    bootstrap: int | None = None
    prior_none: float = NONE
    asked: Asked = EVERYTHING

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fast and self.bootstrap is not None:
            raise InputError("bootstrap: expected without fast, which does not use it")
        if self.draws < LEAST_DRAWS:
            raise InputError(f"bootstrap: expected at least {LEAST_DRAWS} null samples, got {self.draws}")
        prior(self.prior_none)

    @property
    def draws(self) -> int:
        """Number of null samples."""
        return DRAWS if self.bootstrap is None else self.bootstrap


FAST = DiagnosisSettings(fast=True)
"""All questions, with null samples of the linearised fit."""


@dataclass(frozen=True)
class DiagnosisMethod:
    """How a diagnosis was made.

    Attributes
    ----------
    null
        Where the null samples come from.
    draws
        Their number.
    seed
        Seed of all random numbers.
    trials, repeats
        Numbers of trials, and of cycles or segments, that were analysed.
    fmax
        Highest frequency used, Hz; None for lines without a recording.
    discard
        Cycles left out at the start of every trial, or those of each recording of a joint set; None likewise.
    """

    null: str
    draws: int
    seed: int
    trials: int
    repeats: int
    fmax: float | None = None
    discard: Discard | None = None

    def to_dict(self) -> dict[str, Any]:
        """What is known, by name."""
        return {name: value for name, value in vars(self).items() if value is not None}
