"""A diagnosis with its words, figures and page."""

from __future__ import annotations

from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

from mcstudy.gap import tables, verdict
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.document import document
from mcstudy.gap.nearest_words import chance
from mcstudy.report.diagnosis.plots import Plots
from mcstudy.results.record import PagedResult
from mcstudy.short_repr import shortened

if TYPE_CHECKING:
    import xarray as xr


class Diagnosis(PagedResult, DiagnosisRecord):
    """Diagnosis of the gap between the body in one recording and the model."""

    def verdict(self) -> str:
        """Summary of the diagnosis in one paragraph."""
        return verdict.verdict(self)

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        causes = [
            *((c.probability, verdict.effects_of(c)) for c in self.causes),
            (self.unknown_probability, "a cause outside the library"),
            (self.none_probability, "no missing effect"),
        ]
        location, probability = max(self.place.items(), key=lambda item: item[1])
        p = verdict.p_words(self.p_value, self.p_least)
        facts = [
            ("name", shortened(self.name)),
            ("verdict", f"{'a' if self.detected else 'no'} gap beyond noise ({p})"),
            ("causes", "; ".join(f"{name} {chance(p)}" for p, name in sorted(causes, reverse=True)[:4])),
            ("location", f"{location} {chance(probability)}"),
        ]
        if self.closed is not None:
            c = self.closed
            facts.append(("closed", f"{100 * c.fraction:.0f} % [{100 * c.low:.0f}, {100 * c.high:.0f}] of the gap"))
        if self.warnings:
            facts.append(("notes", shortened("; ".join(self.warnings), 600)))
        return [*facts, ("more", "verdict(), plot, to_html(path), to_xarray(), to_dict()")]

    def _repr_html_(self) -> str:
        return f"<h3>{escape(self.name)}</h3><p>{escape(self.verdict())}</p>{tables.html(self)}"

    @cached_property
    def plot(self) -> Plots:
        """Its figures (`Plots`), e.g. ``diagnosis.plot.misfit_gain(angle=1)``; `InputError` without matplotlib."""
        return Plots(self)

    def to_xarray(self) -> xr.Dataset:
        """Responses, residuals, causes with probability and likeness, and the torque that the nearest one leaves.

        Dims ``line`` (with coordinate ``frequency``), ``angle``, ``cause`` and ``quantile``; units are attributes.
        """
        from mcstudy.gap.dataset import dataset  # xarray is slow to import, and a verdict does not need it

        return dataset(self)

    def to_dict(self) -> dict[str, Any]:
        """All results as plain JSON data, valid under ``results_schema/1.1.0/diagnosis.json``."""
        return document(self)

    def _page(self) -> str:
        from mcstudy.report.diagnosis.page import gap_page

        return gap_page(self)
