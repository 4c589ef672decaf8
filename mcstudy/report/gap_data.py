"""What the figures of a diagnosis are drawn from: the measured lines and what both models say about them.

A `Diagnosis` holds numbers and fits, not the recording; here the two are put together again. Nothing is fitted: the
model without effects is the diagnosis' own estimate of its parameters, the model with them its leading cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mcstudy.errors import InputError
from mcstudy.gap.detect import standardised
from mcstudy.gap.diagnose import pooled
from mcstudy.gap.diagnosis import Diagnosis
from mcstudy.gap.explain import Cause
from mcstudy.gap.fitting import Data, Fitted, opened
from mcstudy.gap.frf_only import FrfRecording
from mcstudy.gap.lines import Lines
from mcstudy.gap.measure import measure
from mcstudy.gap.recording import Recording
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf

BANDS_A_DECADE = 12
"""Bands into which neighbouring lines are averaged in drawings, per decade of frequency."""


@dataclass(frozen=True)
class Averages:
    """Neighbouring lines averaged in B bands, as the measured FRF over that of the model before.

    Attributes
    ----------
    f: (B,) Hz. ratio: (B, 2) complex, measured over before. sd: (B, 2), root of E|error|^2 of ``ratio``.
    after: (B, 2) complex, the model after over the model before, averaged alike.
    """

    f: np.ndarray
    ratio: np.ndarray
    sd: np.ndarray
    after: np.ndarray


@dataclass(frozen=True, eq=False)
class GapData:
    """A diagnosis with its recording.

    Attributes
    ----------
    diagnosis: the outcome. recording: what was diagnosed (several are pooled). lines: its lines.
    model: the model without effects.
    """

    diagnosis: Diagnosis
    recording: Recording | FrfRecording
    lines: Lines
    model: Model

    @classmethod
    def of(
        cls,
        diagnosis: Diagnosis,
        recording: Recording | FrfRecording | Sequence[Recording],
        model: Model | None = None,
    ) -> GapData:
        """``recording`` and ``model`` as they were given to `mcstudy.gap.diagnose.diagnose`; `InputError` if not."""
        one = pooled(recording)
        # a diagnosis of bare lines does not say how they were measured; then the defaults of `diagnose` hold
        method = {"fmax": 8.0, "discard": 1} | diagnosis.method
        lines = measure(one, method["fmax"], method["discard"])
        base = opened(model or one.base_model())
        names = tuple(s.name for s in diagnosis.shifts)
        if lines.f.shape != diagnosis.f.shape or not np.allclose(lines.f, diagnosis.f) or base.names != names:
            raise InputError(
                f"{one.name}: expected the recording and model that were diagnosed ({diagnosis.name}: "
                f"{diagnosis.f.size} lines, {len(names)} parameters), got {lines.f.size} lines, {len(base.names)}"
            )
        return cls(diagnosis, one, lines, base)

    @cached_property
    def theta(self) -> np.ndarray:
        """Estimates of the model without effects, (P,)."""
        return np.array([s.without for s in self.diagnosis.shifts])

    @property
    def leading(self) -> Cause | None:
        """The cause that was added, None without a gap."""
        d = self.diagnosis
        return d.causes[0] if d.detected and d.causes else None

    @property
    def added(self) -> Fitted | None:
        """The fit with the leading cause; None without a gap, or when the cause does not act on the mean response."""
        return (
            None
            if self.leading is None or self.leading.fitted.model.names == self.model.names
            else (self.leading.fitted)
        )

    @property
    def angles(self) -> list[str]:
        """Names of the measured angles."""
        n = 1 if isinstance(self.recording, FrfRecording) and self.recording.single else 2
        return ["θ1", "θ2"][:n]

    def before(self, f: np.ndarray) -> np.ndarray:
        """FRFs of the model without effects, (N, 2) complex, rad per unit of the stimulus."""
        return np.asarray(frf(self.model, self.theta, f))

    def after(self, f: np.ndarray) -> np.ndarray | None:
        """FRFs with the leading cause, None where nothing was added."""
        return None if self.added is None else self.added.response(f)

    @cached_property
    def sd(self) -> np.ndarray:
        """Root of E|error|^2 of the measured FRFs, (N, 2)."""
        return np.sqrt(self.lines.noise.variance)

    @cached_property
    def averages(self) -> Averages:
        """Measured over modelled FRFs in bands, weighted by their precision."""
        f = self.lines.f
        edges = 10 ** np.arange(np.log10(f[0]) - 1e-9, np.log10(f[-1]) + 1 / BANDS_A_DECADE, 1 / BANDS_A_DECADE)
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
        """|z|, (N, 2): standardised residuals of the model without effects, 1 on average in noise."""
        return np.abs(self.diagnosis.detection.z)

    @cached_property
    def z_after(self) -> np.ndarray | None:
        """The same of the model with the leading cause, None where nothing was added."""
        if self.added is None:
            return None
        data = Data.of(self.lines)
        return np.abs(standardised(self.added, data, self.added.residual(data)[:, None])[..., 0])
