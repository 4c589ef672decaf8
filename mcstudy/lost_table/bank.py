"""The bank: simulated studies at many configurations, in files of a few studies each.

A study of the bank depends on the seed, its wave and its number alone, so a stopped run resumes with the same bits.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.errors import StoreError
from mcstudy.files.durable import PARTIAL, write
from mcstudy.files.json_files import ensure_folder
from mcstudy.lost_table.simulate import Moments, damped, simulate
from mcstudy.lost_table.unknowns import Prior
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.scheduler.fan_out import fan_out
from mcstudy.streams import stream

PART = 4
"""Studies per file; a kill loses at most this many per worker."""

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
        return Bank(self.u[which], Moments(*(getattr(self.moments, f.name)[which] for f in fields(Moments))))

    def joined(self, other: Bank) -> Bank:
        """The studies of both."""
        both = (np.concatenate([getattr(b.moments, f.name) for b in (self, other)]) for f in fields(Moments))
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
    ensure_folder(folder)
    for left in folder.glob(f"*{PARTIAL}"):
        left.unlink(missing_ok=True)
    jobs = [_Job(k, u[k : k + PART]) for k in range(0, len(u), PART)]

    def path(job: _Job) -> Path:
        return folder / f"wave{wave}-{job.first:05d}.npz"

    def work(job: _Job) -> bool:
        ends = []
        for k, values in enumerate(prior.values(job.u)):
            own = int(stream(seed, "table_study", wave, job.first + k).integers(2**62))
            ends.append(simulate(values, own, realizations))
        arrays = {f.name: np.stack([getattr(m, f.name) for m in ends]) for f in fields(Moments)}
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, u=job.u, **arrays)
        write(path(job), content.getvalue())
        return True

    missing = [job for job in jobs if _read(path(job), job.u) is None]
    for _ in fan_out(work, missing, options, str(folder.parent)):
        pass
    return _joined([_read(path(job), job.u) for job in jobs], folder)


def _read(path: Path, u: np.ndarray) -> dict[str, Any] | None:
    """A file of the bank; None where it is missing, damaged or of other points."""
    try:
        content = io.BytesIO(path.read_bytes())
        with np.load(content, allow_pickle=False) as file:
            arrays = {name: file[name] for name in ("u", *(f.name for f in fields(Moments)))}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        return None
    return arrays if np.array_equal(arrays["u"], u) else None


def _joined(parts: Sequence[dict[str, Any] | None], folder: Path) -> Bank:
    whole = [p for p in parts if p is not None]
    if len(whole) != len(parts):
        raise StoreError(f"{folder}: a file of the bank changed while it was read; run the same command again")
    names = [f.name for f in fields(Moments)]
    moments = Moments(*(np.concatenate([p[name] for p in whole]) for name in names))
    return Bank(np.concatenate([p["u"] for p in whole]), moments)
