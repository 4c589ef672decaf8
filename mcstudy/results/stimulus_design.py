"""An optimal stimulus: what is printed, its page, its files."""

from __future__ import annotations

from pathlib import Path

from mcstudy.results.record import PagedResult
from mcstudy.stimulus_design import words
from mcstudy.stimulus_design.design_record import StimulusDesignRecord, geometric_mean
from mcstudy.stimulus_design.run import waveform_csv, write_design


class StimulusDesign(PagedResult, StimulusDesignRecord):
    """An optimal stimulus and how it was verified."""

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        gain = geometric_mean(self.predicted_ratio)
        facts = [("lines", str(len(self.stimulus.harmonic))), ("predicted reduction of SD", f"x{gain:.3g}")]
        if self.distances.size:
            facts.append(("distance of the models", f"x{float((self.distances[1] / self.distances[0]).min()):.3g}"))
        return [*facts, ("verified", f"x{self.spreads_at_fmax.mean:.3g}" if self.spreads else "no")]

    def text(self) -> str:
        """The tables that ``mcstudy design`` prints."""
        return words.text(self)

    def csv(self) -> str:
        """The waveform of one cycle as text."""
        return waveform_csv(self)

    def write(self, out: Path) -> None:
        """Write ``design.json``, ``waveform.csv`` and ``study.toml`` into a folder."""
        write_design(self, out)

    def _page(self) -> str:
        from mcstudy.report.design_page import design_page

        return design_page(self)
