"""Where fits start when only the bounds are known.

What to use when: `uniform` is the paper's choice and grows start by start; `sobol` fills the bounds more evenly and
grows too; `latin_hypercube` is even in every single parameter but only for the number of starts it was drawn for.
Starts that also look at the data are in `mcstudy.fitting.linearised`.

Sobol points are the same to the last bit as those of `scipy.stats.qmc.Sobol`. Importing `scipy.stats` takes half a
second, as long as the rest of a fast diagnosis, which needs 64 points. For more parameters than `DIRECTIONS` has
dimensions, SciPy makes them. Sources: Joe & Kuo 2008, SIAM J Sci Comput 30:2635 (direction numbers); Antonov & Saleev
1979 (order by Gray code); Matousek 1998, J Complexity 14:527 (scrambling by random lower triangular matrices and a
shift).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mcstudy.stance.feedback import Model

BITS = 30
"""Binary digits of a coordinate."""

# fmt: off
DIRECTIONS = (
    (3, 1), (7, 1, 3), (11, 1, 3, 1), (13, 1, 1, 1), (19, 1, 1, 3, 3), (25, 1, 3, 5, 13), (37, 1, 1, 5, 5, 17),
    (41, 1, 1, 5, 5, 5), (47, 1, 1, 7, 11, 19), (55, 1, 1, 5, 1, 1), (59, 1, 1, 1, 3, 11), (61, 1, 3, 5, 5, 31),
    (67, 1, 3, 3, 9, 7, 49), (91, 1, 1, 1, 15, 21, 21), (97, 1, 3, 1, 13, 27, 49), (103, 1, 1, 1, 15, 7, 5),
    (109, 1, 3, 1, 15, 13, 25), (115, 1, 1, 5, 5, 19, 61), (131, 1, 3, 7, 11, 23, 15, 103),
    (137, 1, 3, 7, 13, 13, 15, 69), (143, 1, 1, 3, 13, 7, 35, 63), (145, 1, 3, 5, 9, 1, 25, 53),
    (157, 1, 3, 1, 13, 9, 35, 107), (167, 1, 3, 1, 5, 27, 61, 31), (171, 1, 1, 5, 11, 19, 41, 61),
    (185, 1, 3, 5, 3, 3, 13, 69), (191, 1, 1, 7, 13, 1, 19, 1), (193, 1, 3, 7, 5, 13, 19, 59),
    (203, 1, 1, 3, 9, 25, 29, 41), (211, 1, 3, 5, 13, 23, 1, 55), (213, 1, 3, 7, 3, 13, 59, 17),
)
# fmt: on
"""From the second dimension on: the primitive polynomial, its coefficients as bits, and the first direction numbers."""


def uniform(model: Model, rng: np.random.Generator, n: int) -> np.ndarray:
    """``n`` starts uniform between the bounds, (n, P). A longer draw from the same stream begins with a shorter one."""
    return _between(model, rng.random((n, len(model.parameters))))


def sobol(model: Model, rng: np.random.Generator, n: int) -> np.ndarray:
    """``n`` scrambled Sobol points between the bounds, (n, P); most even when n is a power of two.

    The stream draws the scrambling alone, so a longer draw from the same stream begins with a shorter one.
    """
    return _between(model, sobol_points(len(model.parameters), rng, n))


def latin_hypercube(model: Model, rng: np.random.Generator, n: int) -> np.ndarray:
    """``n`` starts, (n, P), one in each of n equal slices of every parameter's bounds.

    The slices depend on ``n``: a longer draw from the same stream has other points, so a study that grows its number
    of starts must fit all of them again.
    """
    from scipy.stats import qmc  # half a second to import, which every other kind of start would wait for

    return _between(model, qmc.LatinHypercube(len(model.parameters), seed=rng).random(n))


def _between(model: Model, unit: np.ndarray) -> np.ndarray:
    return model.lower + (model.upper - model.lower) * unit


STARTS: dict[str, Callable[[Model, np.random.Generator, int], np.ndarray]] = {
    "uniform": uniform,
    "latin_hypercube": latin_hypercube,
    "sobol": sobol,
}
"""Starts that need no data, by the name a study file gives them."""


def sobol_points(dimensions: int, rng: np.random.Generator, n: int) -> np.ndarray:
    """The first ``n`` points in the unit cube, (n, dimensions), scrambled by a stream that ``rng`` spawns."""
    if dimensions > 1 + len(DIRECTIONS):
        from scipy.stats import qmc

        return qmc.Sobol(dimensions, seed=rng).random_base2((n - 1).bit_length())[:n]
    (scrambling,) = rng.spawn(1)
    shift = _bits(scrambling, dimensions, BITS) @ (1 << np.arange(BITS))
    lower = np.tril(_bits(scrambling, dimensions, BITS, BITS), -1) + np.eye(BITS, dtype=np.int64)
    place = np.arange(BITS - 1, -1, -1)  # of the binary digits, the highest first
    digits = _directions(dimensions)[:, :, None] >> place & 1
    scrambled = (np.einsum("dpk,djk->djp", lower, digits) & 1) @ (1 << place)
    order = np.arange(n)
    gray = order ^ order >> 1
    points = np.broadcast_to(shift, (n, dimensions)).copy()
    for j in range(n.bit_length()):
        points ^= np.where(gray[:, None] >> j & 1, scrambled[:, j], 0)
    return points * 2.0**-BITS


def _bits(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.integers(0, 2, size=shape, dtype=np.uint32).astype(np.int64)


def _directions(dimensions: int) -> np.ndarray:
    """Direction numbers, (dimensions, BITS), as whole numbers of `BITS` binary digits."""
    out = np.ones((dimensions, BITS), dtype=np.int64)
    for v, (polynomial, *first) in zip(out[1:], DIRECTIONS, strict=False):
        m = len(first)
        v[:m] = first
        for j in range(m, BITS):
            v[j] = v[j - m]
            for k in range(1, m + 1):
                v[j] ^= (polynomial >> (m - k) & 1) * v[j - k] << k
    return out << np.arange(BITS - 1, -1, -1)
