"""Where a model fails on the mean of a group, and which effect closes how much of it for other people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr

from mcstudy.effect_library import library
from mcstudy.identification.condition_changes import LEADERS, NOTHING, pooled_minima, problem_of, split_means
from mcstudy.identification.conditions import best_of, fit
from mcstudy.spectra.frf_groups import as_real, scatter
from mcstudy.stance.feedback import Model

BANDS_HZ = (0.0, 0.2, 0.5, 1.0, np.inf)
"""Edges of the bands of a gap."""


@dataclass(frozen=True)
class MeanGap:
    """The gap between a model and the mean of n people in one condition.

    Attributes
    ----------
    theta: (P,), the stable fit. misfit: its squared residual in standard errors of the mean, with 4 N numbers.
    share: (2, bands), misfit by segment (lower, upper) and band. held_out: (2 splits,), cross-validated misfit per
        number, where 1 is the scatter between halves (`Pair.halves`). closes: (effects, 2 splits), share of the excess
        over 1 that an effect closes for the other half. sizes: per effect its parameters at the fit of all people.
    """

    theta: np.ndarray
    misfit: float
    share: np.ndarray
    held_out: np.ndarray
    effects: tuple[str, ...]
    closes: np.ndarray
    sizes: tuple[np.ndarray, ...]


def mean_gap(
    model: Model,
    group: xr.Dataset,
    condition: int,
    effects: Sequence[str] = (),
    *,
    starts: np.ndarray | None = None,
    splits: int = 10,
    seed: int = 0,
) -> MeanGap:
    """The gap of one condition, and what ``effects`` of the library close of it; see `MeanGap`.

    ``starts``: (M, P), of the fits; `pooled_minima` of the condition by default.
    """
    data = as_real(group["frf"].values[:, condition])
    data = data[np.isfinite(data).all(axis=1)][:, None]
    n = len(data)
    variance = np.diag(np.diag(scatter(data[:, 0]).covariance))
    mean, P = data.mean(axis=0), model.lower.size
    starts = pooled_minima(model, group, [condition]) if starts is None else starts
    first, second = split_means(data, splits, seed)
    unit = 4 * np.diag(variance) / n

    def fitted(augmented: Model, begin: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
        found = best_of(problem_of(augmented, group, NOTHING, mean[None], variance / n), begin[:, None])
        q = found.unknowns[0]
        half = problem_of(augmented, group, NOTHING, first, variance / (n / 2))
        again = fit(half, np.tile(q, (len(first), 1)), iterations=40).unknowns
        far = (half.predicted(again) - second)[:, 0]
        return q, float(found.misfit[0]), (far**2 / unit).mean(axis=1)

    theta, misfit, held_out = fitted(model, starts)
    closes, sizes = [], []
    for name in effects:
        larger = library.apply(model, name)
        own = [p.value for p in larger.parameters[P:]]
        usual = [sum(s.published) / 2 for s in library.effect(name).sizes]
        near = np.concatenate([theta[None], starts[:LEADERS]])
        begin = np.concatenate([np.hstack([near, np.tile(x, (len(near), 1))]) for x in (own, usual)])
        q, _, score = fitted(larger, begin)
        closes.append((held_out.mean() - score) / (held_out.mean() - 1.0))
        sizes.append(q[P:])
    residual = problem_of(model, group, NOTHING, mean[None], variance / n).residual(theta[None])[0, :-P]
    parts = (residual**2).reshape(2, 2, -1).sum(axis=0)  # real and imaginary parts
    f = group["f"].values
    bands = [(f >= low) & (f < high) for low, high in pairwise(BANDS_HZ)]
    share = np.array([[part[band].sum() for band in bands] for part in parts])
    return MeanGap(theta, misfit, share, held_out, tuple(effects), np.array(closes), tuple(sizes))
