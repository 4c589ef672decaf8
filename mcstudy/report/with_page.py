"""Solutions, designs and next trials that write themselves as a page."""

from __future__ import annotations

from pathlib import Path

from mcstudy.gap.planned.next_trial import NextTrial
from mcstudy.report.extended import extended
from mcstudy.report.style import require_matplotlib


class NextTrialWithPage(NextTrial):
    __doc__ = NextTrial.__doc__  # what `help` shows of a result of `mcstudy.next_trial`
    shown_as = "NextTrial"

    @classmethod
    def from_next(cls, found: NextTrial) -> NextTrialWithPage:
        """The same with its page."""
        return extended(cls, found)

    def to_html(self, path: str | Path) -> Path:
        """Write the possible trials as a self-contained page.

        Raises `InputError` without matplotlib (the extra ``report``), and for a file that cannot be written.
        """
        require_matplotlib()
        from mcstudy.report.document import write_page
        from mcstudy.report.next_page import next_page

        return write_page(path, lambda: next_page(self))
