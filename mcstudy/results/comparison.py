"""A comparison of two groups with its words and its figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mcstudy.group_comparison import verdict
from mcstudy.group_comparison.document import document
from mcstudy.group_comparison.result import LEVEL, ComparisonRecord
from mcstudy.report.style import require_matplotlib
from mcstudy.results.record import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SEGMENTS = ("lower body", "upper body")


class Comparison(Result, ComparisonRecord):
    """Two groups compared."""

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        people = f"{self.a} ({self.people[0]}), {self.b} ({self.people[1]})"
        difference = f"{self.kind} ({verdict.p_of(self, self.detection.p_mean, 'p of equal means')})"
        return [
            ("groups", f"{people}, {'' if self.paired else 'un'}paired"),
            ("difference", difference),
            ("cause", self.best.name if self.best else "none"),
        ]

    def verdict(self) -> str:
        """The answer in a few sentences."""
        return verdict.verdict(self)

    def text(self) -> str:
        """Verdict and tables."""
        return verdict.text(self)

    def to_dict(self) -> dict[str, Any]:
        """All results as plain JSON data, valid under ``results_schema/1.0.0/comparison.json``."""
        return document(self)

    def plot(self) -> Figure:
        """Gain and phase of both groups, by segment, on a new figure.

        Bands are one standard error of the mean. Grey regions differ at the 5 % level, corrected for all regions. The
        dashed line is group a with the difference that the most probable change predicts.

        Raises `InputError` without matplotlib (the extra ``report``).
        """
        require_matplotlib()
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7.2, 5.0), layout="constrained")
        axes = figure.subplots(2, 2, sharex=True, squeeze=False)
        for k, segment in enumerate(SEGMENTS):
            self._draw(axes[0, k], axes[1, k], k)
            axes[0, k].set_title(segment)
        axes[0, 0].set_ylabel("gain")
        axes[1, 0].set_ylabel("phase (°)")
        axes[0, 0].legend(loc="lower left", frameon=False, fontsize="small")
        return figure

    def _draw(self, gain: Axes, phase: Axes, k: int) -> None:
        f = self.f
        for region in self.detection.regions:
            if region.segment == SEGMENTS[k].split()[0] and region.p <= LEVEL:
                for ax in (gain, phase):
                    ax.axvspan(region.low * 0.93, region.high * 1.07, color="0.93", zorder=0)
        lines = [
            (self.a, self.mean_a[k], self.error_a[k], "C0", "-"),
            (self.b, self.mean_b[k], self.error_b[k], "C1", "-"),
        ]
        if self.predicted is not None and self.best is not None:
            label = f"{self.a} with {self.best.name} changed"
            lines.append((label, self.mean_a[k] + self.predicted[k], np.zeros_like(f), "C1", "--"))
        for label, H, error, colour, style in lines:
            size, angle = np.abs(H), np.rad2deg(np.unwrap(np.angle(H)))
            width = np.rad2deg(np.minimum(error / size, np.pi)) / np.sqrt(2)
            gain.loglog(f, size, color=colour, linestyle=style, label=label)
            phase.semilogx(f, angle, color=colour, linestyle=style)
            if error.any():
                half = error / np.sqrt(2)
                gain.fill_between(f, np.maximum(size - half, size / 10), size + half, color=colour, alpha=0.2, lw=0)
                phase.fill_between(f, angle - width, angle + width, color=colour, alpha=0.2, lw=0)
        phase.set_xlabel("frequency (Hz)")
