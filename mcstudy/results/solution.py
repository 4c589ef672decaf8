"""The cheapest design that reaches a target: what is printed, its page, its study file."""

from __future__ import annotations

from pathlib import Path

from mcstudy.files.json_files import write_text
from mcstudy.files.local_path import local_path
from mcstudy.planning import words
from mcstudy.planning.solution import SolutionRecord
from mcstudy.results.record import PagedResult


class Solution(PagedResult, SolutionRecord):
    """The cheapest design that reaches the targets."""

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        facts = [("targets", "; ".join(t.text for t in self.targets))]
        if self.answer is None:
            return [*facts, ("answer", "none in the allowed range")]
        d = self.answer.design
        return [
            *facts,
            ("answer", f"{d.cycles} cycles, amplitude {d.amplitude:g}, Fmax {d.fmax:g} Hz"),
            ("interval", "; ".join(f"{axis} {low:.3g} to {high:.3g}" for axis, (low, high) in self.interval.items())),
        ]

    def text(self) -> str:
        """The tables that ``mcstudy solve`` prints."""
        return words.text(self)

    def write_study(self, path: str | Path) -> None:
        """Write the study of the answer as a study file."""
        write_text(local_path(path), self.to_study().to_toml().rstrip("\n"))

    def _page(self) -> str:
        from mcstudy.report.solution_page import solution_page

        return solution_page(self)
