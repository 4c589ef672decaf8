"""The parameters of many people: what is printed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Self

from mcstudy.identification.people import group_words
from mcstudy.identification.people.group_record import GroupRecord, with_interval
from mcstudy.results.fit import FitResult
from mcstudy.results.record import Result
from mcstudy.short_repr import shortened


class GroupResult(Result, GroupRecord):
    """Parameters of many people; `mcstudy.fit_group` returns it."""

    fits: Mapping[tuple[str, str], FitResult]

    @classmethod
    def of(cls, record: Any) -> Self:
        """The result that has the fields of ``record``, and whose ``fits`` are results too."""
        return replace(super().of(record), fits={key: FitResult.of(fit) for key, fit in record.fits.items()})

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        several = len(self.conditions) > 1
        return [
            ("people", shortened(group_words.counts(self))),
            *((m.quantity + f", {m.condition}" * several, with_interval(m.mean, m)) for m in self.means),
            *((f"{d.quantity}, {d.condition} - {d.reference}", group_words.change(d)) for d in self.differences),
            *(("failed", shortened(f"{p}, {c}: {why}")) for p, c, why in self.failed),
            ("more", "to_xarray(), to_dict(), text(), fits"),
        ]

    def text(self) -> str:
        """What `mcstudy fit --group` prints."""
        return group_words.text(self)
