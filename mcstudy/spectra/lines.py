"""FRFs at frequency lines with their covariance: the input of all statistics of the diagnosis.

`Lines` is the common form of all recordings: a periodic one gives its excited lines (`mcstudy.spectra.periodic`), any
other the lines of overlapping segments (`mcstudy.spectra.segments`), a published FRF itself (`mcstudy.recordings.frf`).
`mcstudy.spectra.measure.measure` chooses. `JointLines` are those of several recordings of one person under different
stimuli. Each recording keeps the noise that was measured in it, with its own shape and degrees of freedom. A common
shape would be better determined, but it would be an assumption: linear sensor noise evokes the same sway under every
stimulus, yet people weigh their senses anew when the stimulus changes. Errors of different recordings are independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.special import fdtrc

from mcstudy.short_repr import Summary
from mcstudy.spectra.line_noise import LineNoise


@dataclass(frozen=True, repr=False)
class EvenLines(Summary):
    """M lines that the stimulus does not excite: only noise, unless the body has an even nonlinearity.

    Attributes
    ----------
    f: (M,) Hz. mean: (M, Y) Fourier coefficients of the mean over repeats, in the unit of each of Y outputs. variance:
    (M, Y) of that mean, from the scatter of the repeats. level: (M, Y) the same from the smoothed spectrum. repeats:
    their number.
    """

    f: np.ndarray
    mean: np.ndarray
    variance: np.ndarray
    level: np.ndarray
    repeats: int

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        return [("lines", _span(self.f)), ("repeats", str(self.repeats))]

    def excess(self, low: float = 0.0, high: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
        """Sum of |mean|^2 / level over sum of variance / level in a band, per output (Y,), and its p-value (Y,).

        About 1 for noise alone; F-distributed with (2 M, 2 M (repeats - 1)) degrees of freedom
        for independent Gaussian repeats. nan without a line in the band or with a single repeat.
        """
        inside = (self.f >= low) & (self.f <= high)
        m = int(inside.sum())
        if m == 0 or self.repeats < 2:
            nothing = np.full(self.mean.shape[1], np.nan)
            return nothing, nothing
        level = self.level[inside]
        power = (np.abs(self.mean[inside]) ** 2 / level).sum(axis=0)
        ratio = power / (self.variance[inside] / level).sum(axis=0)
        return ratio, fdtrc(2 * m, 2 * m * (self.repeats - 1), ratio)


@dataclass(frozen=True, repr=False)
class Lines(Summary):
    """FRFs of a recording at N lines, from R independent repeats.

    Attributes
    ----------
    f: (N,) Hz.
    y: (N, Y) complex, mean FRF of Y outputs in their unit per unit of the stimulus: sum over repeats of ``weight`` *
        ``repeats``.
    noise: of ``y``: covariance and its uncertainty, null samples.
    repeats: (R, N, Y) complex FRFs whose errors are independent of each other (cycles, or blocks of segments).
    weight: (R, N) share of each repeat in the mean, columns sum to 1; repeat r has covariance noise.C / weight[r].
    trial, cycle: (R,) which trial and which cycle (or block) a repeat is.
    amplitude: (R,) peak amplitude of the repeat's trial, unit of the stimulus.
    power: (N,) mean squared Fourier coefficient of the stimulus per repeat, unit^2: the sway at line n has mean
        square 2 power |y|^2 per output (for segments: the power of the band that belongs to the line).
    even: the lines that are not excited, or None.
    harmonic: (N,) harmonic number of each line, None when not periodic.
    notes: sentences about what is left out, and about noise that is not as assumed, without a full stop.
    published: whether these are the points of a published response, not lines that were measured here.
    """

    f: np.ndarray
    y: np.ndarray
    noise: LineNoise
    repeats: np.ndarray
    weight: np.ndarray
    trial: np.ndarray
    cycle: np.ndarray
    amplitude: np.ndarray
    power: np.ndarray
    even: EvenLines | None = None
    harmonic: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    published: bool = False

    def __len__(self) -> int:
        return int(self.f.size)

    @property
    def parts(self) -> tuple[Lines, ...]:
        """The lines by recording: themselves, unless they are of several (`JointLines`)."""
        return (self,)

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of lines of each part."""
        return tuple(len(p) for p in self.parts)

    @property
    def blocks(self) -> tuple[slice, ...]:
        """Where the lines of each part are."""
        ends = np.cumsum((0, *self.counts))
        return tuple(slice(int(a), int(b)) for a, b in pairwise(ends))

    @property
    def unit(self) -> str:
        """What one of them is called."""
        return "point" if self.published else "line"

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        noise = np.sqrt(self.noise.variance) / np.maximum(np.abs(self.y), 1e-300)
        facts = [
            ("lines", _span(self.f)),
            ("repeats", f"{self.repeats.shape[0]} of {np.unique(self.trial).size} trials"),
        ]
        if len(self):
            facts.append(
                ("standard error / gain", ", ".join(f"{x:.2g}" for x in np.median(noise, axis=0)) + " (median)")
            )
        return [*facts, ("even lines", "none" if self.even is None else _span(self.even.f))]

    def subset(self, repeats: np.ndarray) -> Lines:
        """The mean over some of the repeats only (indices or mask), same estimate of the noise."""
        weight = self.weight[repeats]
        total = weight.sum(axis=0)
        return replace(
            self,
            y=np.einsum("rn,rnj->nj", weight / total, self.repeats[repeats]),
            noise=self.noise.times(1 / total),
            repeats=self.repeats[repeats],
            weight=weight / total,
            trial=self.trial[repeats],
            cycle=self.cycle[repeats],
            amplitude=self.amplitude[repeats],
        )

    def below(self, fmax: float) -> Lines:
        """The lines up to ``fmax`` (Hz)."""
        keep = self.f <= fmax
        return replace(
            self,
            f=self.f[keep],
            y=self.y[keep],
            noise=self.noise.at(keep),
            repeats=self.repeats[:, keep],
            weight=self.weight[:, keep],
            power=self.power[keep],
            harmonic=None if self.harmonic is None else self.harmonic[keep],
        )

    def halves(self) -> tuple[Lines, Lines] | None:
        """First and last cycles of the trials (a middle one in neither), or None when no trial has two repeats."""
        first, last = np.zeros(self.trial.size, dtype=bool), np.zeros(self.trial.size, dtype=bool)
        for t in np.unique(self.trial):
            repeats = np.flatnonzero(self.trial == t)
            n = repeats.size // 2
            repeats = repeats[np.argsort(self.cycle[repeats], kind="stable")]
            first[repeats[:n]] = True
            last[repeats[repeats.size - n :]] = True
        return (self.subset(first), self.subset(last)) if first.any() else None

    def by_amplitude(self, tolerance: float = 0.1) -> list[tuple[float, Lines]]:
        """(amplitude, lines) for every distinct amplitude, ascending; amplitudes within ``tolerance`` are one."""
        groups: list[list[int]] = []
        for r in np.argsort(self.amplitude, kind="stable"):
            if groups and self.amplitude[r] <= self.amplitude[groups[-1][0]] * (1 + tolerance):
                groups[-1].append(int(r))
            else:
                groups.append([int(r)])
        return [(float(self.amplitude[g].mean()), self.subset(np.array(sorted(g)))) for g in groups]


def _span(f: np.ndarray) -> str:
    return f"{f.size}, {f.min():.4g} to {f.max():.4g} Hz" if f.size else "0"


@dataclass(frozen=True, repr=False)
class JointLines(Lines):
    """The lines of all recordings, one after the other; see `Lines`.

    A repeat of one recording has no weight, and the response zero, at the lines of the others. ``power`` is divided by
    the number of recordings, so that a mean square of sway is the mean over recordings. Even lines and harmonics are
    those of the ``members`` alone, within which cycles and amplitudes are compared.
    """

    members: tuple[Lines, ...] = field(default=())

    @property
    def parts(self) -> tuple[Lines, ...]:
        """The lines by recording."""
        return self.members

    def subset(self, repeats: np.ndarray) -> Lines:
        """The mean over some of the repeats (indices or mask), at least one of each recording."""
        chosen = np.zeros(len(self.repeats), dtype=bool)
        chosen[repeats] = True
        by_recording = np.split(chosen, np.cumsum([len(p.repeats) for p in self.members])[:-1])
        return joined([p.subset(k) for p, k in zip(self.members, by_recording, strict=True)])

    def below(self, fmax: float) -> Lines:
        """The lines of all recordings up to ``fmax`` (Hz)."""
        return joined([p.below(fmax) for p in self.members])


def joined(parts: Sequence[Lines]) -> Lines:
    """The lines of ``parts`` as one set; a single part as it is. Trials are numbered through."""
    if len(parts) == 1:
        return parts[0]
    R, N = sum(len(p.repeats) for p in parts), sum(len(p) for p in parts)
    repeats, weight = np.zeros((R, N, parts[0].y.shape[1]), dtype=complex), np.zeros((R, N))
    trial = np.zeros(R, dtype=int)
    row = column = 0
    for p in parts:
        rows, columns = slice(row, row + len(p.repeats)), slice(column, column + len(p))
        repeats[rows, columns], weight[rows, columns] = p.repeats, p.weight
        trial[rows] = np.unique(p.trial, return_inverse=True)[1] + (trial[:row].max() + 1 if row else 0)
        row, column = rows.stop, columns.stop
    return JointLines(
        f=np.concatenate([p.f for p in parts]),
        y=np.concatenate([p.y for p in parts]),
        noise=LineNoise.joined([p.noise for p in parts]),
        repeats=repeats,
        weight=weight,
        trial=trial,
        cycle=np.concatenate([p.cycle for p in parts]),
        amplitude=np.concatenate([p.amplitude for p in parts]),
        power=np.concatenate([p.power for p in parts]) / len(parts),
        notes=tuple(dict.fromkeys(note for p in parts for note in p.notes)),
        members=tuple(parts),
    )
