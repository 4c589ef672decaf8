"""Lines of several recordings of one person under different stimuli, as one set.

Each recording keeps the noise that was measured in it, with its own shape and degrees of freedom. A common shape would
be better determined, but it would be an assumption: linear sensor noise evokes the same sway under every stimulus, yet
people weigh their senses anew when the stimulus changes. Errors of different recordings are independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mcstudy.spectra.line_noise import LineNoise
from mcstudy.spectra.lines import Lines


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
        own = np.split(chosen, np.cumsum([len(p.repeats) for p in self.members])[:-1])
        return joined([p.subset(k) for p, k in zip(self.members, own, strict=True)])

    def below(self, fmax: float) -> Lines:
        """The lines of all recordings up to ``fmax`` (Hz)."""
        return joined([p.below(fmax) for p in self.members])


def joined(parts: Sequence[Lines]) -> Lines:
    """The lines of ``parts`` as one set; a single part as it is. Trials are numbered through."""
    if len(parts) == 1:
        return parts[0]
    R, N = sum(len(p.repeats) for p in parts), sum(len(p) for p in parts)
    repeats, weight = np.zeros((R, N, 2), dtype=complex), np.zeros((R, N))
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
