"""Intermediate results of a cube while it is written; every finished chunk is read once.

For a group with noise the headline number is the paper's bias: the mean over parameters of |mean estimate - truth| in
percent of the truth (Goodworth & Peterka 2018, note to Table II), at the largest amplitude and every Fmax. For a group
without noise it is the largest error of a best fit. Both equal those of ``mcstudy show`` on the complete realizations;
the standard error is computed to first order (a bias near zero keeps its sign).
"""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from mcstudy.errors import StoreError
from mcstudy.fitting.status import USABLE, Status
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.store import Cube, GroupStore

LEAST = 3
"""Smallest number of realizations for which the standard error of a mean is shown."""

MOST_FMAX, MOST_LINES = 4, 12
"""Largest number of Fmax values per group, and of lines in total, that are shown."""


@dataclass
class RunningErrors:
    """Statistics of the relative errors of best fits: count, mean (P,), summed outer products (P, P), and largest."""

    n: int = 0
    mean: np.ndarray = field(default_factory=lambda: np.zeros(0))
    square: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    largest: float = 0.0

    def add(self, x: np.ndarray) -> None:
        """More rows (n, P)."""
        if not len(x):
            return
        if not self.n:
            self.mean, self.square = np.zeros(x.shape[1]), np.zeros((x.shape[1], x.shape[1]))
        total, centre = self.n + len(x), x.mean(axis=0)
        off = centre - self.mean
        self.square += (x - centre).T @ (x - centre) + np.outer(off, off) * self.n * len(x) / total
        self.mean = self.mean + off * len(x) / total
        self.n, self.largest = total, max(self.largest, float(np.abs(x).max()))

    def mean_absolute_bias(self) -> tuple[float, float]:
        """Mean |bias| over parameters and its Monte Carlo standard error, both relative to the truth."""
        weight = np.sign(self.mean) / self.mean.size
        variance = weight @ self.square @ weight / (self.n - 1) / self.n
        return float(np.abs(self.mean).mean()), math.sqrt(max(variance, 0.0))


class Watch:
    """A cube that may still be written to."""

    def __init__(self, cube: Cube) -> None:
        self.cube = cube
        self.chunks = sum(len(store.layout.chunks) for store in cube.groups.values())
        self._complete: set[tuple[str, Chunk]] = set()
        self._unreadable: set[tuple[str, Chunk]] = set()
        self._partial: dict[tuple[str, Chunk], tuple[int, Counter[int]]] = {}
        self._counts: Counter[int] = Counter()
        self._moments: dict[tuple[str, int, int], RunningErrors] = {}

    @property
    def chunks_done(self) -> int:
        """Complete chunks seen so far."""
        return len(self._complete)

    @property
    def unreadable(self) -> int:
        """Chunks that were damaged, or had a missing or swapped file, at the last look."""
        return len(self._unreadable)

    @property
    def counts(self) -> Counter[int]:
        """Fits seen so far by `Status` value, without pending ones."""
        return sum((c for _, c in self._partial.values()), self._counts)

    @property
    def failed(self) -> int:
        """Fits that ended without a usable result."""
        return sum(n for status, n in self.counts.items() if Status(status).failed)

    @property
    def done(self) -> int:
        """Fits that are not pending: run, or not needed."""
        return sum(self.counts.values())

    def look(self, seconds: float = math.inf) -> None:
        """Read new chunks for at most about ``seconds``; damaged or incomplete chunks are tried again later."""
        end = time.monotonic() + seconds
        for name, store in self.cube.groups.items():
            for chunk in store.layout.chunks:
                if (name, chunk) in self._complete:
                    continue
                if time.monotonic() > end:
                    return
                self._look_at(name, store, chunk)

    def _look_at(self, name: str, store: GroupStore, chunk: Chunk) -> None:
        self._unreadable.discard((name, chunk))
        try:
            changed = store.chunk_file("status", chunk).stat().st_mtime_ns
        except OSError:
            return  # not there yet
        if self._partial.get((name, chunk), (0,))[0] == changed:
            return
        try:
            status = store.read("status", chunk)
            counts = Counter(status[status != Status.PENDING].tolist())
            if counts.total() < status.size:
                self._partial[name, chunk] = changed, counts
                return
            self._add(name, store, chunk, status)
        except StoreError:
            self._unreadable.add((name, chunk))  # `verify` reports it, `run` repairs it
            return
        self._partial.pop((name, chunk), None)
        self._complete.add((name, chunk))
        self._counts += counts

    def _add(self, name: str, store: GroupStore, chunk: Chunk, status: np.ndarray) -> None:
        cost, estimate = store.read("cost", chunk)[0], store.read("estimate", chunk)[0]
        cost = np.where(np.isin(status[0], USABLE) & np.isfinite(cost), cost, np.inf)
        first = cost.argmin(axis=-1)[..., None]
        best = np.take_along_axis(estimate, first[..., None], axis=2)[:, :, 0]
        usable = np.isfinite(np.take_along_axis(cost, first, axis=-1)[..., 0])
        truth = store.experiment.model.truth
        known = truth != 0
        for k in range(best.shape[0]):
            cell = self._moments.setdefault((name, chunk.amplitude, k), RunningErrors())
            cell.add(best[k][usable[k]][:, known] / truth[known] - 1)

    def news(self, seconds: float) -> list[str]:
        """`headlines` after a `look` of at most about ``seconds``."""
        self.look(seconds)
        return self.headlines()

    def headlines(self) -> list[str]:
        """Lines for every group with enough results."""
        out = []
        for name, store in self.cube.groups.items():
            group, unit = store.layout.group, store.experiment.model.stimulus_unit
            a = len(group.amplitude) - 1
            for k, f in list(enumerate(group.fmax))[:MOST_FMAX]:
                m = self._moments.get((name, a, k), RunningErrors())
                if group.simulator == "none" and m.n:
                    out.append(f"{name}, {f:g} Hz: largest error of a best fit {100 * m.largest:.1e} %")
                elif group.simulator != "none" and m.n >= LEAST:
                    value, error = (100 * x for x in m.mean_absolute_bias())
                    where = f"{name}, {group.amplitude[a]:g} {unit}, {f:g} Hz"
                    out.append(f"{where}: mean |bias| {value:.3g} ± {error:.2g} % (MCSE; {m.n} realizations)")
        return out[:MOST_LINES]
