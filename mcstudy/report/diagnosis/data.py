"""Data of the figures of a diagnosis: the measured lines and the responses of both models."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mcstudy.fitting.penalised import Data, Fitted
from mcstudy.gap.diagnosis import Diagnosis
from mcstudy.gap.questions.detection import standardised
from mcstudy.gap.questions.posterior import Cause
from mcstudy.recordings.frf import FrfRecording
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model

BANDS_PER_DECADE = 12
"""Bands into which neighbouring lines are averaged in drawings, per decade of frequency."""


@dataclass(frozen=True)
class Averages:
    """Neighbouring lines averaged in B bands: the ratio of the measured FRF to that of the base model.

    Attributes
    ----------
    f: (B,) Hz. ratio: (B, 2) complex, measured FRF divided by that of the base model. sd: (B, 2), root of
    E|error|^2 of ``ratio``. after: (B, 2) complex, the same ratio for the model with the cause.
    """

    f: np.ndarray
    ratio: np.ndarray
    sd: np.ndarray
    after: np.ndarray


@dataclass(frozen=True, eq=False)
class GapData:
    """Lines of a diagnosis, and responses of the base model and of the model with the leading cause."""

    diagnosis: Diagnosis

    @property
    def lines(self) -> Lines:
        """The measured lines."""
        return self.diagnosis.lines

    @property
    def model(self) -> Model:
        """The model without effects."""
        return self.diagnosis.base.model

    @property
    def leading(self) -> Cause | None:
        """The leading cause, None when no gap was detected."""
        d = self.diagnosis
        return d.causes[0] if d.detected and d.causes else None

    @property
    def added(self) -> Fitted | None:
        """The fit with the leading cause; None without a gap, or when the cause does not act on the mean response."""
        leading = self.leading
        return None if leading is None or leading.fitted.model.names == self.model.names else leading.fitted

    @property
    def angles(self) -> list[str]:
        """Names of the measured angles."""
        recording = self.diagnosis.recording
        n = 1 if isinstance(recording, FrfRecording) and recording.single else 2
        return ["θ1", "θ2"][:n]

    def before(self, f: np.ndarray) -> np.ndarray:
        """FRFs of the model without effects, (N, 2) complex, rad per unit of the stimulus."""
        return self.diagnosis.base.response(f)

    def after(self, f: np.ndarray) -> np.ndarray | None:
        """FRFs of the model with the leading cause, None when none was added."""
        return None if self.added is None else self.added.response(f)

    @cached_property
    def sd(self) -> np.ndarray:
        """Root of E|error|^2 of the measured FRFs, (N, 2)."""
        return np.sqrt(self.lines.noise.variance)

    @cached_property
    def averages(self) -> Averages:
        """Ratio of measured and modelled FRFs in bands, weighted by the precision of the lines."""
        f = self.lines.f
        edges = 10 ** np.arange(np.log10(f[0]) - 1e-9, np.log10(f[-1]) + 1 / BANDS_PER_DECADE, 1 / BANDS_PER_DECADE)
        band = np.unique(np.digitize(f, edges), return_inverse=True)[1]
        before, after = self.before(f), self.after(f)
        weight = np.abs(before) ** 2 / self.sd**2
        centre, ratio, sd, moved = [], [], [], []
        for b in range(band.max() + 1):
            inside = band == b
            w = weight[inside] / weight[inside].sum(axis=0)
            centre.append(np.exp(np.log(f[inside]).mean()))
            ratio.append((w * self.lines.y[inside] / before[inside]).sum(axis=0))
            sd.append(weight[inside].sum(axis=0) ** -0.5)
            moved.append(np.ones(2) if after is None else (w * after[inside] / before[inside]).sum(axis=0))
        return Averages(np.array(centre), np.array(ratio), np.array(sd), np.array(moved))

    @property
    def z_before(self) -> np.ndarray:
        """|z|, (N, 2): standardised residuals of the base model; RMS 1 for noise alone."""
        return np.abs(self.diagnosis.detection.z)

    @cached_property
    def z_after(self) -> np.ndarray | None:
        """The same for the model with the leading cause, None when none was added."""
        if self.added is None:
            return None
        data = Data.of(self.lines)
        return np.abs(standardised(self.added, data, self.added.residual(data)[:, None])[..., 0])
