"""What a user chooses about the way from recordings to lines and to a fit of the base model."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from mcstudy.stance.feedback import Model


@dataclass(frozen=True, kw_only=True)
class LineSettings:
    """How recordings of one person become lines, and what model is fitted to them.

    Attributes
    ----------
    seed
        Seed of all random numbers.
    model
        Base model; None for the two-segment model of the recording's body. None under several stimuli.
    fmax
        Highest frequency used, Hz; None for 8, or the last of a published response.
    discard
        Transient cycles left out at the start of every trial; None for one, or as many as the slowest oscillation of
        the fitted body needs to decay (`mcstudy.lines.settling`).
    accept
        Codes of suspicions that the user has checked, e.g. of mislabelled channels: these labels are kept.
    """

    seed: int = 0
    model: Model | None = None
    fmax: float | None = None
    discard: int | None = None
    accept: Iterable[str] = ()

    def __post_init__(self) -> None:
        codes = (self.accept,) if isinstance(self.accept, str) else self.accept
        object.__setattr__(self, "accept", frozenset(codes))
