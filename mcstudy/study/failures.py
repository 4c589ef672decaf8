"""Numbers of fits by status, and a list of failed fits, read from the status arrays of a cube.

Of the other arrays only the ends are read (`GroupStore.status`), so the time does not grow with the bytes of a cube.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from mcstudy.fitting.status import Status
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.store import Cube, GroupStore

LISTED = 20
"""Number of failed fits that are listed; further ones are only counted."""

FAILED = [s for s in Status if s.failed]


def counts(store: GroupStore) -> Counter[Status]:
    """Fits of a group by status; fits of chunks with missing, swapped or cut files are pending."""
    return _read(store)[0]


def failed_fits(cube: Cube) -> Iterator[str]:
    """One line for each of the first `LISTED` failed fits, then how many more there are."""
    yield from account(cube)[1]


def account(cube: Cube) -> tuple[dict[str, Counter[Status]], list[str]]:
    """`counts` by group and the lines of `failed_fits`, from one reading of the cube."""
    by_group, lines, total = {}, [], 0
    for name, store in cube.groups.items():
        by_group[name], failures, failed = _read(store)
        group = store.layout.group
        lines += [
            f"group {name}, amplitude {group.amplitude[chunk.amplitude]:g}, fmax {group.fmax[k]:g} Hz, "
            f"realization {store.layout.realizations(chunk)[r]}, start {s}: {status.text}"
            for chunk, k, r, s, status in failed[: LISTED - min(total, LISTED)]
        ]
        total += failures
    return by_group, lines + [f"... and {total - LISTED} more"] * (total > LISTED)


def _read(store: GroupStore) -> tuple[Counter[Status], int, list[tuple[Chunk, int, int, int, Status]]]:
    """Fits by status; of chunks without pending fits, how many failed, and where the first ones are. Reads once."""
    total: Counter[Status] = Counter()
    failures = 0
    failed: list[tuple[Chunk, int, int, int, Status]] = []
    for chunk in store.layout.chunks:
        status = store.status(chunk)
        if status is None or (status == Status.PENDING).all():
            total[Status.PENDING] += store.layout.fits(chunk)
            continue
        values, numbers = np.unique(status, return_counts=True)
        total.update({Status(int(v)): int(n) for v, n in zip(values, numbers, strict=True)})
        if Status.PENDING not in values and np.isin(values, FAILED).any():
            at = np.argwhere(np.isin(status, FAILED)).tolist()
            failures += len(at)
            left = at[: LISTED - len(failed)]
            failed += [(chunk, k, r, s, Status(int(status[0, k, r, s]))) for _, k, r, s in left]
    return total, failures, failed
