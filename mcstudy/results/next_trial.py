"""Which trial to record next, with its page."""

from __future__ import annotations

from mcstudy.gap.planned.next_trial import NextTrialRecord
from mcstudy.results.record import PagedResult


class NextTrial(PagedResult, NextTrialRecord):
    __doc__ = NextTrialRecord.__doc__  # what `help` shows of a result of `mcstudy.next_trial`

    def _page(self) -> str:
        from mcstudy.report.next_page import next_page

        return next_page(self)
