"""Lines at which the cycles of a recording scatter more than their noise covariance allows.

The covariance of a line comes from its neighbours (`mcstudy.spectra.even_lines`). An almost undamped mode breaks the
assumption behind this: its noise is confined to one or two lines, and what is left of the start of the recording rings
at its frequency with another phase in every cycle. In both cases the cycles differ at that line by more than its
neighbours say. `with_scatter` finds such lines and enlarges their covariance. Leakage at the ends of cycles also makes
cycles differ, but it cancels in their mean and is equal over many lines, so each line is compared with the median of
those around it. Derived; `pipelines/gap_challenge.md` states false alarms near the limit of stability.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from mcstudy.spectra.around import around
from mcstudy.spectra.lines import Lines

LOWEST = 5
"""Lowest harmonic that is judged; cycles are not quite independent below (`mcstudy.gap.questions.contrasts`)."""

AROUND = 51
"""Number of lines whose median scatter a line is compared with."""

SHARP = 1e-5
"""p-value of a line from which it is widened. It is approximate, because the covariance is an estimate too."""

LEAST_RATIO = 2.5
"""Least scatter of such a line, relative to the lines around it."""


@dataclass(frozen=True)
class Scatter:
    """Scatter of the cycles at N lines.

    Attributes
    ----------
    ratio: (N,) mean square of the differences between cycles, relative to the covariance and to the median of the lines
        around; 1 where it is not judged.
    p: (N,) its p-value, 1 where it is not judged.
    """

    ratio: np.ndarray
    p: np.ndarray

    @property
    def sharp(self) -> np.ndarray:
        """(N,) whether the covariance of a line is too small."""
        return (self.p < SHARP) & (self.ratio >= LEAST_RATIO)


def deviations(lines: Lines) -> np.ndarray:
    """Whitened differences (R, N, 2) of the repeats from the mean of their trial.

    Their sum of squares over repeats and angles is 4 times the number of repeats less that of trials, per line.
    """
    out = np.empty_like(lines.repeats)
    for t in np.unique(lines.trial):
        own = lines.trial == t
        share = lines.weight[own] / lines.weight[own].sum(axis=0)
        out[own] = lines.repeats[own] - np.einsum("rn,rnj->nj", share, lines.repeats[own])
    return np.einsum("nij,rnj,rn->rni", lines.noise.whitener, out, np.sqrt(lines.weight), optimize=True)


def scatter(lines: Lines) -> Scatter:
    """Scatter of the repeats at every line; nothing is judged where no trial has two repeats or there is no noise."""
    free = lines.trial.size - np.unique(lines.trial).size
    if free == 0 or lines.harmonic is None or not lines.noise.definite:
        return Scatter(np.ones(len(lines)), np.ones(len(lines)))
    judged = lines.harmonic >= LOWEST
    power = (np.abs(deviations(lines)) ** 2).sum(axis=(0, 2))[judged] / (4 * free)
    ratio, p = np.ones(len(lines)), np.ones(len(lines))
    ratio[judged] = power / np.maximum(np.median(around(power, AROUND), axis=-1), 1.0)
    p[judged] = fdtrc(4 * free, 4 * lines.noise.dof[judged], ratio[judged])
    return Scatter(ratio, p)


def with_scatter(lines: Lines) -> Lines:
    """The lines with the covariance of sharp ones enlarged, and a note that says so.

    What rings may have the same phase in all repeats, which then share it instead of averaging it out. A sharp line
    therefore gets the excess variance of a single repeat, R times that of their mean.
    """
    found = scatter(lines)
    if not found.sharp.any():
        return lines
    factor = np.where(found.sharp, 1 + lines.trial.size * (found.ratio - 1), 1.0)
    return replace(lines, noise=lines.noise.times(factor), notes=(*lines.notes, _note(lines, found)))


def _note(lines: Lines, found: Scatter) -> str:
    where = np.flatnonzero(found.sharp)
    worst = where[int(found.ratio[where].argmax())]
    more = f" and {where.size - 1} other lines" if where.size > 2 else " and one other line" if where.size == 2 else ""
    return (
        f"at {lines.f[worst]:.2f} Hz{more} the cycles differ by up to {found.ratio[worst]:.2g} times the variance that "
        "neighbouring lines show (an almost undamped mode, or a start that is not over); the noise is taken as "
        "accordingly larger there"
    )
