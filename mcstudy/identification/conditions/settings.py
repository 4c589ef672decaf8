"""Which parameters have a value in each condition, and which one all conditions share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mcstudy.errors import InputError
from mcstudy.identification.settings import FitSettings
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import copies
from mcstudy.text_tables import similar

ALL = "all"
"""Stands for the names of all parameters."""


@dataclass(frozen=True, kw_only=True)
class ConditionSettings(FitSettings):
    """How parameters of a person in several conditions are estimated; what is not stated here is as in `FitSettings`.

    Attributes
    ----------
    shared, per
        Parameters that all conditions share, and those with a value in each. With ``shared`` alone all others have a
        value in each condition; with ``per`` alone, or without both, all others are shared. Without both the sensory
        weights have a value in each. ``"all"`` stands for all names.
    """

    shared: Sequence[str] = ()
    per: Sequence[str] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        for what in ("shared", "per"):
            given = getattr(self, what)
            names = given.split(",") if isinstance(given, str) else given
            object.__setattr__(self, what, tuple(name.strip() for name in names if name.strip()))

    def separate(self, model: Model) -> tuple[str, ...]:
        """Names of the parameters of a joint ``model`` that have a value in each condition, in the model's order.

        Raises `InputError` for an unknown name, for one that is named twice, and where nothing says what differs.
        """
        shared, per = (self._named(model, what) for what in ("shared", "per"))
        for name in shared & per:
            raise InputError(f"{name}: expected shared or per condition, got both")
        if shared and not per:
            per = set(model.names) - shared
        if not self.shared and not self.per:
            per = set(model.weights)
            if not per:
                raise InputError(
                    f"per: expected parameters with a value in each condition, as model {model.name} has no sensory "
                    f"weights; it has {', '.join(model.names)}"
                )
        return tuple(name for name in model.names if name in copies(model, per))

    def _named(self, model: Model, what: str) -> set[str]:
        names = getattr(self, what)
        if ALL in names:
            return set(model.names)
        for name in names:
            if name not in model.names:
                raise InputError(
                    f"{what}: expected parameters of the model ({', '.join(model.names)}), got {name!r}"
                    f"{similar(name, model.names)}"
                )
        return set(names)
