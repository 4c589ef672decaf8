"""Data of the figures of a diagnosis: the measured lines and the responses of both models."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.questions.detection import standardised
from mcstudy.gap.verdict import added_name
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import standing
from mcstudy.stance.feedback import Model

BANDS_PER_DECADE = 12
"""Bands into which neighbouring lines are averaged in drawings, per decade of frequency."""


@dataclass(frozen=True)
class Averages:
    """Neighbouring lines averaged in B bands: the ratio of the measured FRF to that of the base model.

    Attributes
    ----------
    f: (B,) Hz. ratio: (B, Y) complex, measured FRF divided by that of the base model. sd: (B, Y), root of
    E|error|^2 of ``ratio``. after: (B, Y) complex, the same ratio for the model with the cause.
    """

    f: np.ndarray
    ratio: np.ndarray
    sd: np.ndarray
    after: np.ndarray


class Phases(NamedTuple):
    """Phases in rad without jumps between branches: ``base`` and ``added`` (K,) of the models (None when no cause was
    added), ``measured`` (B,) of the bands of `Averages`."""

    base: np.ndarray
    added: np.ndarray | None
    measured: np.ndarray


@dataclass(frozen=True, eq=False)
class GapData:
    """Lines of a diagnosis, and responses of the base model and of the model with the leading cause."""

    diagnosis: DiagnosisRecord

    @property
    def lines(self) -> Lines:
        """The measured lines."""
        return self.diagnosis.lines

    @property
    def model(self) -> Model:
        """The model without effects."""
        return self.diagnosis.base.model

    @property
    def added(self) -> Fitted | None:
        """The fit with the leading cause, see `DiagnosisRecord.added`."""
        return self.diagnosis.added

    @property
    def added_name(self) -> str:
        """What that model is called in legends and captions."""
        return added_name(self.diagnosis)

    @property
    def angles(self) -> list[str]:
        """Names of what was measured."""
        names = self.model.output_names
        return [name.replace("theta", "θ") if standing(self.model) else name for name in names]

    @property
    def units(self) -> list[str]:
        """Units in which they are drawn in time: ° for rad."""
        return ["°" if unit == "rad" else unit for unit in self.model.output_units]

    def drawn(self, x: np.ndarray) -> np.ndarray:
        """Values (..., Y) in the units in which they are drawn in time."""
        return np.asarray(x * [np.degrees(1.0) if unit == "rad" else 1.0 for unit in self.model.output_units])

    def before(self, f: np.ndarray) -> np.ndarray:
        """FRFs of the model without effects, (N, Y) complex, per unit of the stimulus."""
        return self.diagnosis.base.response(f)

    def after(self, f: np.ndarray) -> np.ndarray | None:
        """FRFs of the model with the leading cause, None when none was added."""
        return None if self.added is None else self.added.response(f)

    @cached_property
    def averages(self) -> Averages:
        """Ratio of measured and modelled FRFs in bands, weighted by the precision of the lines."""
        f = self.lines.f
        return band_means(self.lines, self.before(f), self.after(f))

    def phases(self, f: np.ndarray, angle: int) -> Phases:
        """Phases of one angle, those of the models at the frequencies ``f`` (K,); all follow one another.

        Each model's curve is continuous, the base model's within half a turn of the other's on average. Measured
        values are within half a turn of the model with the cause, or continuous about the base model without one.
        """
        a, after = self.averages, self.after(f)
        base = np.unwrap(np.angle(self.before(f)[:, angle]))
        off = np.angle(a.ratio[:, angle])
        if after is None:
            return Phases(base, None, np.interp(a.f, f, base) + np.unwrap(off))
        added = np.unwrap(np.angle(after[:, angle]))
        base += _turns((added - base).mean())
        off += _turns(np.interp(a.f, f, added - base) - off)
        return Phases(base, added, np.interp(a.f, f, base) + off)

    @property
    def z_before(self) -> np.ndarray:
        """|z|, (N, Y): standardised residuals of the base model; RMS 1 for noise alone."""
        return np.abs(self.diagnosis.detection.z)

    @cached_property
    def z_after(self) -> np.ndarray | None:
        """The same for the model with the leading cause, None when none was added."""
        if self.added is None:
            return None
        data = Data.of(self.lines)
        return np.abs(standardised(self.added, data, self.added.residual(data)[:, None])[..., 0])


def band_means(lines: Lines, before: np.ndarray, after: np.ndarray | None = None) -> Averages:
    """Means over bands of the lines relative to the responses ``before`` (N, Y) of a model; ``after``: of another.

    Not a number for an angle that was not measured.
    """
    f = lines.f
    edges = 10 ** np.arange(np.log10(f[0]) - 1e-9, np.log10(f[-1]) + 1 / BANDS_PER_DECADE, 1 / BANDS_PER_DECADE)
    band = np.unique(np.digitize(f, edges), return_inverse=True)[1]
    weight = np.abs(before) ** 2 / lines.noise.variance
    centre, ratio, sd, moved = [], [], [], []
    for b in range(band.max() + 1):
        inside = band == b
        centre.append(np.exp(np.log(f[inside]).mean()))
        with np.errstate(divide="ignore", invalid="ignore"):
            w = weight[inside] / weight[inside].sum(axis=0)
            ratio.append((w * lines.y[inside] / before[inside]).sum(axis=0))
            sd.append(weight[inside].sum(axis=0) ** -0.5)
            moved.append(
                np.ones(before.shape[1]) if after is None else (w * after[inside] / before[inside]).sum(axis=0)
            )
    return Averages(np.array(centre), np.array(ratio), np.array(sd), np.array(moved))


def _turns(angle: np.ndarray) -> np.ndarray:
    """The nearest whole number of turns, rad."""
    return np.asarray(2 * np.pi * np.round(angle / (2 * np.pi)))
