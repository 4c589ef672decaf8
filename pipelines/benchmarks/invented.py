"""Results of a chunk drawn at random, like those of fits: a third of the starts in the lowest of a few minima."""

from __future__ import annotations

import numpy as np

from mcstudy.fitting.status import Status
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.store import GroupStore

MINIMA = 6
"""Local minima of a cell; a third of its starts end in the first, the others in any of the rest."""

LAST_DIGITS = 1e-9
"""Scatter of the estimates of one minimum, relative to the distance of the bounds: what the tolerance leaves."""


def invented(store: GroupStore, chunk: Chunk) -> dict[str, np.ndarray]:
    """All arrays of a chunk, a pure function of group and chunk; about as many bytes on disk as results of fits.

    The starts of a realization are the same at every Fmax, as in a study.
    """
    rng = np.random.default_rng([chunk.amplitude, chunk.block])
    data = store.layout.empty(chunk)
    model, frf = store.experiment.model, store.layout.arrays["true_frf"].values
    width = model.upper - model.lower
    shape = data["cost"].shape
    cells = shape[:-1]
    data["frf"][...] = frf * (1 + 0.05 * rng.standard_normal(data["frf"].shape))
    if "noise_covariance" in data:
        data["noise_covariance"][...] = 1e-3 * (np.abs(frf) ** 2)[:, :, None] * np.eye(2)
    data["initial"][...] = model.lower + width * rng.random((shape[0], 1, *data["initial"].shape[2:]))
    places = model.lower + width * rng.uniform(0.01, 0.99, (*cells, MINIMA, model.truth.size))
    scatter = rng.standard_normal((*cells, model.truth.size)).clip(-4, 4)  # stays between the bounds
    places[..., 0, :] = model.truth + 0.1 * width * scatter
    reached = np.maximum(rng.integers(1 - MINIMA // 2, MINIMA, shape), 0)
    data["estimate"][...] = np.take_along_axis(places, reached[..., None], axis=-2)
    digits = rng.random(data["estimate"].shape, dtype=np.float32)
    digits *= LAST_DIGITS
    data["estimate"] += digits * width
    depth = rng.gamma(20.0, size=(*cells, 1)) * (1 + np.arange(MINIMA) / MINIMA)
    data["cost"][...] = np.take_along_axis(depth, reached, axis=-1) * (1 + LAST_DIGITS * rng.random(shape))
    data["iterations"][...] = rng.integers(5, 50, shape)
    roots = rng.normal(-2.0, 0.5, (*cells, MINIMA))
    data["growth_rate"][...] = np.take_along_axis(roots, reached, axis=-1) + LAST_DIGITS * rng.random(shape)
    data["status"][...] = int(Status.CONVERGED)
    return data
