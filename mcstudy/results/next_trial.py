"""Which trial to record next, with its page."""

from __future__ import annotations

from mcstudy.gap.planned.next_trial import NextTrialRecord
from mcstudy.results.record import PagedResult


class NextTrial(PagedResult, NextTrialRecord):
    """Possible next trials, ranked by what they are expected to tell of the cause."""

    def _page(self) -> str:
        from mcstudy.report.next_page import next_page

        return next_page(self)
