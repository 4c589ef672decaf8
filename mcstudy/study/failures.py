"""Counts and lists of how fits ended, read from the status arrays of a cube."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from mcstudy.fit.status import Status
from mcstudy.study.store import Cube, GroupStore

LISTED = 20
"""Failed fits listed one by one; the rest are counted."""


def counts(store: GroupStore) -> Counter[Status]:
    """Fits of a group by status; fits of damaged or missing chunks are pending."""
    total: Counter[Status] = Counter()
    for chunk in store.layout.chunks:
        pending = store.pending(chunk)
        if pending == store.layout.fits(chunk):
            total[Status.PENDING] += pending
            continue
        values, numbers = np.unique(store.read("status", chunk), return_counts=True)
        total.update({Status(int(v)): int(n) for v, n in zip(values, numbers, strict=True)})
    return total


def failed_fits(cube: Cube) -> Iterator[str]:
    """One line for each of the first `LISTED` failed fits, then how many more there are."""
    found = 0
    bad = [s for s in Status if not s.usable and s is not Status.PENDING]
    for name, store in cube.groups.items():
        group = store.layout.group
        for chunk in store.layout.chunks:
            if store.pending(chunk):
                continue
            status = store.read("status", chunk)
            for _, k, r, s in np.argwhere(np.isin(status, bad)).tolist():
                found += 1
                if found <= LISTED:
                    yield (
                        f"group {name}, amplitude {group.amplitude[chunk.amplitude]:g}, fmax {group.fmax[k]:g} Hz, "
                        f"realization {store.layout.realizations(chunk)[r]}, start {s}: "
                        f"{Status(int(status[0, k, r, s])).text}"
                    )
    if found > LISTED:
        yield f"... and {found - LISTED} more"
