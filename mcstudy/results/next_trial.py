"""Which trial to record next, with its words and its page."""

from __future__ import annotations

from mcstudy.gap.nearest_words import chance
from mcstudy.gap.trial_planning import recommendation
from mcstudy.gap.trial_planning.choice import Option
from mcstudy.gap.trial_planning.next_trial import NextTrialRecord
from mcstudy.results.record import PagedResult
from mcstudy.short_repr import shortened


class NextTrial(PagedResult, NextTrialRecord):
    """Possible next trials, ranked by what they are expected to tell of the cause."""

    def sentence(self, option: Option) -> str:
        """What a trial would decide, in words."""
        return recommendation.sentence(self, option)

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        causes = "; ".join(f"{name} {chance(p)}" for name, p in self.causes[:4])
        return [("name", shortened(self.name)), ("causes", causes), ("next", self.sentence(self.best))]

    def text(self) -> str:
        """What `mcstudy gap next` prints."""
        return recommendation.text(self)

    def _page(self) -> str:
        from mcstudy.report.next_page import next_page

        return next_page(self)
