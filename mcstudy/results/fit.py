"""The parameters of one person: what is printed, figures, page."""

from __future__ import annotations

from functools import cached_property

from mcstudy.identification import words
from mcstudy.identification.conventions import comparison
from mcstudy.identification.estimate import with_unit
from mcstudy.identification.fit_record import FitRecord
from mcstudy.report.person.plots import FitPlots
from mcstudy.results.record import PagedResult
from mcstudy.short_repr import shortened
from mcstudy.text_tables import Table, p_words


class FitResult(PagedResult, FitRecord):
    """Parameters of one person; `mcstudy.fit` returns it."""

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        return [
            ("recording", shortened(self.name)),
            *((e.name, with_unit(e)) for e in self.estimates),
            ("goodness of fit", p_words(self.p_value)),
            *(("note", note) for note in self.warnings),
            ("more", "text(), plot, to_html(path), to_xarray(), to_dict()"),
        ]

    def text(self) -> str:
        """What `mcstudy fit` prints."""
        return words.text(self)

    def conventions(self) -> Table:
        """Estimates beside those that three publications would state, as a table for a notebook, or its ``text()``.

        Raises
        ------
        InputError
            The fit is of several stimuli or conditions.
        """
        return comparison(self)

    @cached_property
    def plot(self) -> FitPlots:
        """Its figures (`FitPlots`), e.g. ``fit.plot.profile("K11")``; `InputError` without matplotlib."""
        return FitPlots(self)

    def _page(self) -> str:
        from mcstudy.report.person.page import fit_page

        return fit_page(self)
