"""``fit.plot``: the figures of a fit."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING

from mcstudy.identification.fit_record import FitRecord
from mcstudy.report.style import require_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class FitPlots:
    """Figures of one fit: each method draws on matplotlib axes ``ax`` (new ones when None) and returns them.

    ``angle`` is 0 for theta1, the lower body, and 1 for theta2, the hip. Raises `InputError` without matplotlib (the
    extra ``report``).
    """

    def __init__(self, fit: FitRecord) -> None:
        require_matplotlib()
        self._fit = fit

    def __repr__(self) -> str:
        return f"figures of {self._fit.name}: " + ", ".join(n for n in dir(type(self)) if not n.startswith("_"))

    # Modules are looked up, not kept: they need matplotlib, and a fit with figures must stay picklable.
    @property
    def _estimates(self) -> ModuleType:
        from mcstudy.report.person import figures

        return figures

    @property
    def _responses(self) -> ModuleType:
        from mcstudy.report.person import responses

        return responses

    def intervals(self, ax: Axes | None = None) -> Axes:
        """Estimates and intervals of all quantities relative to typical values."""
        return self._estimates.intervals(self._fit, ax)

    def profile(self, quantity: str, ax: Axes | None = None) -> Axes:
        """Profile of one quantity with its threshold and the parabola of Wald."""
        return self._estimates.profile(self._fit, quantity, ax)

    def correlations(self, ax: Axes | None = None) -> Axes:
        """Correlations of the errors near the estimate."""
        return self._estimates.correlations(self._fit, ax)

    def coverage(self, ax: Axes | None = None) -> Axes:
        """Percent of intervals of simulated recordings that hold the truth; `InputError` where none were simulated."""
        return self._estimates.coverage(self._fit, ax)

    def information(self, ax: Axes | None = None) -> Axes:
        """Share of the information on every quantity that each band of frequencies carries."""
        return self._estimates.information(self._fit, ax)

    def waterfall(self, ax: Axes | None = None) -> Axes:
        """Squared residuals of all random starts, ascending."""
        return self._estimates.waterfall(self._fit, ax)

    def response_gain(self, angle: int = 0, ax: Axes | None = None) -> Axes:
        """Gain of one angle: measured with a 95 % band, and the fit with its range over the intervals."""
        return self._responses.response_gain(self._fit, angle, ax)

    def response_phase(self, angle: int = 0, ax: Axes | None = None) -> Axes:
        """Phase of one angle, degrees: measured with a 95 % band, and the fit with its range over the intervals."""
        return self._responses.response_phase(self._fit, angle, ax)

    def sway(self, ax: Axes | None = None) -> Axes:
        """Predicted and measured sway, degrees RMS; raises `InputError` for a fit without recorded sway."""
        return self._estimates.sway(self._fit, ax)
