"""Where a model fails on the mean of a group, and which effect closes how much of it for other people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr

from mcstudy.effect_library import library
from mcstudy.spectra.frf_groups import as_real, scatter
from mcstudy.stance.feedback import Model
from pipelines.validation.condition_changes import AGAIN, LEADERS, NOTHING, pooled_minima, problem_of
from pipelines.validation.condition_fits import best_of

BANDS_HZ = (0.0, 0.2, 0.5, 1.0, np.inf)
"""Edges of the bands of a gap."""


@dataclass(frozen=True)
class MeanGap:
    """The gap between a model and the mean of n people in one condition.

    The gap is a squared residual in standard errors of the mean, cross-validated: the residual of people who were left
    out of a fit times that of those who were not. Noise has no part in its expected value, so it is zero for a model
    that is true, unlike the misfit. Errors are those of a jackknife over the folds of people.

    Attributes
    ----------
    theta: (P,), the stable fit. misfit: its squared residual in standard errors of the mean, with 4 N numbers.
    gap, gap_se: the gap. share, share_se: (2, bands), of it by segment (lower, upper) and band.
    effects: names. closes, closes_se: (effects,), share of the gap that an effect closes for people left out.
    sizes: per effect its parameters at the fit of all people.
    """

    theta: np.ndarray
    misfit: float
    gap: float
    gap_se: float
    share: np.ndarray
    share_se: np.ndarray
    effects: tuple[str, ...]
    closes: np.ndarray
    closes_se: np.ndarray
    sizes: tuple[np.ndarray, ...]


def mean_gap(
    model: Model,
    group: xr.Dataset,
    condition: int,
    effects: Sequence[str] = (),
    *,
    starts: np.ndarray | None = None,
    folds: int = 7,
    seed: int = 0,
) -> MeanGap:
    """The gap of one condition, and what ``effects`` of the library close of it; see `MeanGap`.

    ``starts``: (M, P), of the fits; `pooled_minima` of the condition by default. ``folds``: parts of the people; each
    is left out once.
    """
    data = as_real(group["frf"].values[:, condition])
    data = data[np.isfinite(data).all(axis=1)]
    n, P = len(data), model.lower.size
    variance = np.diag(np.diag(scatter(data).covariance))
    starts = pooled_minima(model, group, [condition]) if starts is None else starts
    parts = np.array_split(np.random.default_rng(seed).permutation(n), folds)
    left = np.stack([data[out].mean(axis=0) for out in parts])
    kept = np.stack([np.delete(data, out, axis=0).mean(axis=0) for out in parts])

    def fitted(augmented: Model, begin: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
        """Unknowns and misfit of all people, and the gap by fold and number, (folds, D)."""
        found = best_of(
            problem_of(augmented, group, NOTHING, data.mean(axis=0)[None, None], variance / n), begin[:, None]
        )
        others = problem_of(augmented, group, NOTHING, kept[:, None], variance / n)
        again = best_of(others, found.unknowns[None], AGAIN).unknowns
        says = others.predicted(again)[:, 0]
        return found.unknowns[0], float(found.misfit[0]), (says - kept) * (says - left) * n / np.diag(variance)

    theta, misfit, base = fitted(model, starts)
    whole = base.sum(axis=1)
    closes, sizes = [], []
    for name in effects:
        larger = library.apply(model, name)
        own = [p.value for p in larger.parameters[P:]]
        usual = [sum(s.published) / 2 for s in library.effect(name).sizes]
        near = np.concatenate([theta[None], starts[:LEADERS]])
        begin = np.concatenate([np.hstack([near, np.tile(x, (len(near), 1))]) for x in (own, usual)])
        q, _, rest = fitted(larger, begin)
        closes.append(_jackknife(whole - rest.sum(axis=1), whole))
        sizes.append(q[P:])
    f = group["f"].values
    bands = [(f >= low) & (f < high) for low, high in pairwise(BANDS_HZ)]
    of_point = base.reshape(folds, 2, 2, -1).sum(axis=1)  # real and imaginary parts
    shares = np.array(
        [[_jackknife(own[:, band].sum(axis=1), whole) for band in bands] for own in of_point.swapaxes(0, 1)]
    )
    size, error = _jackknife(whole, np.ones(folds))
    share = np.array(closes).reshape(-1, 2)
    return MeanGap(
        theta,
        misfit,
        size,
        error,
        shares[..., 0],
        shares[..., 1],
        tuple(effects),
        share[:, 0],
        share[:, 1],
        tuple(sizes),
    )


def _jackknife(part: np.ndarray, whole: np.ndarray) -> tuple[float, float]:
    """Ratio of the sums over folds, and its standard error."""
    without = (part.sum() - part) / (whole.sum() - whole)
    error = np.sqrt((part.size - 1) / part.size * ((without - without.mean()) ** 2).sum())
    return float(part.sum() / whole.sum()), float(error)
