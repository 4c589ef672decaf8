"""Solutions and designs that write themselves as a page."""

from __future__ import annotations

from pathlib import Path

from mcstudy.planning.result import Solution
from mcstudy.report.extended import extended
from mcstudy.report.style import require_matplotlib
from mcstudy.stimulus_design.result import StimulusDesign


class SolutionWithPage(Solution):
    __doc__ = Solution.__doc__  # what `help` shows of a result of `mcstudy.solve`
    shown_as = "Solution"

    @classmethod
    def from_solution(cls, found: Solution) -> SolutionWithPage:
        """The same with its page."""
        return extended(cls, found)

    def to_html(self, path: str | Path) -> Path:
        """Write the solution as a self-contained page.

        Raises `InputError` without matplotlib (the extra ``report``), and for a file that cannot be written.
        """
        require_matplotlib()
        from mcstudy.report.document import write_page
        from mcstudy.report.solution_page import solution_page

        return write_page(path, lambda: solution_page(self))


class StimulusDesignWithPage(StimulusDesign):
    __doc__ = StimulusDesign.__doc__  # what `help` shows of a result of `mcstudy.design`
    shown_as = "StimulusDesign"

    @classmethod
    def from_design(cls, found: StimulusDesign) -> StimulusDesignWithPage:
        """The same with its page."""
        return extended(cls, found)

    def to_html(self, path: str | Path) -> Path:
        """Write the design as a self-contained page.

        Raises `InputError` without matplotlib (the extra ``report``), and for a file that cannot be written.
        """
        require_matplotlib()
        from mcstudy.report.design_page import design_page
        from mcstudy.report.document import write_page

        return write_page(path, lambda: design_page(self))
