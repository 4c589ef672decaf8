"""The bank: simulated studies at many configurations, in files of a few studies each.

A study of the bank depends on the seed, its wave and its number alone, so a stopped run resumes with the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from mcstudy.errors import StoreError
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.streams import stream
from mcstudy_goodworth2018.lost_table.kept_files import Kind, kept
from mcstudy_goodworth2018.lost_table.simulate import Moments, damped, simulate
from mcstudy_goodworth2018.lost_table.unknowns import Prior

PART = 4
"""Studies per file; a kill loses at most this many per worker."""

NAMES = tuple(f.name for f in fields(Moments))
"""Arrays of a file."""

DRAWS = 4096
"""Points of the prior drawn at a time."""


@dataclass(frozen=True)
class Bank:
    """Simulated studies: points ``u`` (N, U) of the cube and `Moments` whose leading dim is N."""

    u: np.ndarray
    moments: Moments

    def __len__(self) -> int:
        return len(self.u)

    def take(self, which: np.ndarray) -> Bank:
        """Some of the studies."""
        return Bank(self.u[which], Moments(*(getattr(self.moments, n)[which] for n in NAMES)))

    def joined(self, other: Bank) -> Bank:
        """The studies of both."""
        both = (np.concatenate([getattr(b.moments, n) for b in (self, other)]) for n in NAMES)
        return Bank(np.concatenate([self.u, other.u]), Moments(*both))


def prior_points(prior: Prior, rng: np.random.Generator, n: int) -> np.ndarray:
    """``n`` points of the cube whose closed loop is damped, (n, U)."""
    found: list[np.ndarray] = []
    tried = 0
    while sum(map(len, found)) < n:
        u = rng.random((DRAWS, len(prior)))
        found.append(u[damped(prior.values(u))])
        tried += DRAWS
        if tried >= 200 * DRAWS and sum(map(len, found)) < n * tried / (4000 * DRAWS):
            raise StoreError(
                f"prior: expected ranges with stable closed loops, found {sum(map(len, found))} in {tried}"
            )
    return np.concatenate(found)[:n]


@dataclass(frozen=True)
class _Job:
    """Studies of one file: their first number in the wave and their points."""

    first: int
    u: np.ndarray


def simulated(
    prior: Prior,
    u: np.ndarray,
    where: tuple[int, int, int],
    folder: Path,
    options: ClusterOptions,
) -> Bank:
    """The studies at points ``u`` (N, U), read where they exist and simulated where not.

    ``where``: seed, wave and realizations. Raises `Interrupted` when stopped; the same call resumes.
    """
    seed, wave, realizations = where

    def name(job: _Job) -> str:
        return f"wave{wave}-{job.first:05d}.npz"

    def make(job: _Job) -> dict[str, np.ndarray]:
        ends = []
        for k, values in enumerate(prior.values(job.u)):
            own = int(stream(seed, "table_study", wave, job.first + k).integers(2**62))
            ends.append(simulate(values, own, realizations))
        return {n: np.stack([getattr(m, n) for m in ends]) for n in NAMES}

    jobs = [_Job(k, u[k : k + PART]) for k in range(0, len(u), PART)]
    parts = kept(Kind(folder, NAMES), jobs, name, lambda job: {"u": job.u}, make, options)
    moments = Moments(*(np.concatenate([p[n] for p in parts]) for n in NAMES))
    return Bank(np.concatenate([p["u"] for p in parts]), moments)
