"""The parameters of one person in several conditions: what is printed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Self

from mcstudy.identification.conditions import words
from mcstudy.identification.conditions.record import ConditionsRecord
from mcstudy.identification.estimate import with_unit
from mcstudy.results.fit import FitResult
from mcstudy.results.record import Result
from mcstudy.short_repr import shortened
from mcstudy.text_tables import p_words


class ConditionsResult(Result, ConditionsRecord):
    """Parameters of one person in several conditions; `mcstudy.fit_conditions` returns it."""

    fit: FitResult

    @classmethod
    def of(cls, record: Any) -> Self:
        """The result that has the fields of ``record``, and whose ``fit`` is a result, too."""
        return replace(super().of(record), fit=FitResult.of(record.fit))

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        return [
            ("conditions", shortened(", ".join(self.conditions))),
            *((e.name, with_unit(e)) for e in self.fit.estimates),
            *((f"one {s.name} for all", p_words(s.p_value)) for s in self.sharings if not s.separate),
            ("more", "text(), sharing(name), fit, to_dict()"),
        ]

    def text(self, *, details: bool = False) -> str:
        """What `mcstudy fit --per condition NAMES` prints; with ``details`` also what it says of one recording."""
        return words.text(self, details=details)
