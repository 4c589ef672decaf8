"""``diagnosis.plot``: the figures of a diagnosis."""

from __future__ import annotations

from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING

from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.report.diagnosis.data import GapData
from mcstudy.report.diagnosis.traces import SwayTraces
from mcstudy.report.style import require_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Plots:
    """Figures of one diagnosis: each method draws on matplotlib axes ``ax`` (new ones when None) and returns them.

    ``angle`` is 0 for theta1, the lower body, and 1 for theta2, the hip, or the position of an output of a declared
    model. Both models are the base model and the model
    with the leading cause. Raises `InputError` without matplotlib (the extra ``report``).
    """

    def __init__(self, diagnosis: DiagnosisRecord) -> None:
        require_matplotlib()
        self._diagnosis = diagnosis

    def __repr__(self) -> str:
        return f"figures of {self._diagnosis.name}: " + ", ".join(n for n in dir(type(self)) if not n.startswith("_"))

    # Modules are looked up, not kept: they need matplotlib, and a diagnosis with figures must stay picklable.
    @property
    def _responses(self) -> ModuleType:
        from mcstudy.report.diagnosis import figures

        return figures

    @property
    def _outcome(self) -> ModuleType:
        from mcstudy.report.diagnosis import outcome_figures

        return outcome_figures

    @cached_property
    def _data(self) -> GapData:
        return GapData(self._diagnosis)

    @cached_property
    def _traces(self) -> SwayTraces:
        return SwayTraces.of(self._data)

    def response_gain(self, angle: int = 0, ax: Axes | None = None) -> Axes:
        """Gain of one angle, rad per unit of the stimulus: measured with a 95 % band, and both models."""
        return self._responses.response_gain(self._data, angle, ax)

    def response_phase(self, angle: int = 0, ax: Axes | None = None) -> Axes:
        """Phase of one angle, degrees: measured with a 95 % band, and both models."""
        return self._responses.response_phase(self._data, angle, ax)

    def misfit_gain(self, angle: int = 0, ax: Axes | None = None) -> Axes:
        """Measured gain minus that of the base model, percent, with a 95 % band; and the model with the cause."""
        return self._responses.misfit_gain(self._data, angle, ax)

    def misfit_phase(self, angle: int = 0, ax: Axes | None = None) -> Axes:
        """Measured phase minus that of the base model, degrees, with a 95 % band; and the model with the cause."""
        return self._responses.misfit_phase(self._data, angle, ax)

    def residual_map(self, ax: Axes | None = None) -> Axes:
        """Standardised residuals by angle and frequency, without and with the cause."""
        return self._responses.z_map(self._data, ax)

    def residuals(self, angle: int = 0, ax: Axes | None = None) -> Axes:
        """Standardised residuals of one angle, line by line, without and with the cause."""
        return self._responses.z_lines(self._data, angle, ax)

    def evidence(self, ax: Axes | None = None) -> Axes:
        """The test for a gap against its distribution in recordings with noise alone."""
        return self._outcome.null_statistic(self._diagnosis, ax)

    def goodness_of_fit(self, ax: Axes | None = None) -> Axes:
        """The squared residual of all lines against its distribution in recordings with noise alone."""
        return self._outcome.null_residual(self._diagnosis, ax)

    def sizes(self, ax: Axes | None = None) -> Axes:
        """Sizes of the causes in the 95 % set, in standard errors; raises `InputError` without a named one."""
        return self._outcome.effect_sizes(self._diagnosis, ax)

    def locations(self, ax: Axes | None = None) -> Axes:
        """Probability of every location."""
        return self._outcome.place_bars(self._diagnosis, ax)

    def causes(self, ax: Axes | None = None) -> Axes:
        """Probability of the leading causes, of a cause outside the library, and of no missing effect."""
        return self._outcome.cause_bars(self._diagnosis, ax)

    def gap_closed(self, ax: Axes | None = None) -> Axes:
        """Share of the gap that the leading cause closes; raises `InputError` when none was added."""
        return self._outcome.closed_bar(self._diagnosis, ax)

    def sway_error(self, ax: Axes | None = None) -> Axes:
        """Error of predicted sway, degrees RMS, without and with the cause, and its noise floor."""
        return self._outcome.sway_error_bars(self._diagnosis, ax)

    def sway(self, angle: int = 0, ax: Axes | None = None) -> Axes:
        """Measured sway of one angle in time, degrees, and what both models predict; needs time series."""
        return self._outcome.sway_trace(self._traces, angle, ax)

    def sway_residual(self, angle: int = 0, ax: Axes | None = None) -> Axes:
        """Measured minus predicted sway of one angle in time, degrees; needs time series."""
        return self._outcome.sway_left(self._traces, angle, ax)
