"""Studies at one configuration, and how far the printed numbers are from them: no emulator takes part.

A printed number agrees if it is within `LIMIT` joint standard errors of the mean over the simulated studies: the
error of one study of 50 realizations (the paper's), that of our mean, and the rounding of the printed number. A ranking
agrees unless it fails by that much.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import ndtr

from mcstudy.lost_table.bank import simulated
from mcstudy.lost_table.rows import ROWS, columns, rounding, stated
from mcstudy.lost_table.run import Inferred
from mcstudy.lost_table.simulate import PARAMETERS
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.stance.body import two_segment
from mcstudy.streams import stream

LIMIT = 3.0
CANDIDATES, TRIALS = 8, 4
"""Configurations compared by real studies, and studies of each."""

EXACT = 0.02
"""Least error of a row on its scale (of logarithms: 2 %): a ranking read from a figure is no sharper."""

REPEATS = 20
"""Studies of the configuration that is reported."""

WAVE_OF_CANDIDATES, WAVE_OF_BEST, WAVE_OF_STAND_IN = 101, 102, 103


@dataclass(frozen=True)
class Checked:
    """Repeated studies of one configuration.

    Attributes
    ----------
    u: the configuration, (U,). columns: rows of each study, (K, R). distance: of the printed number from their mean,
    in joint standard errors, (R,); positive where the study's is larger, and 0 for a ranking that holds. Numbers
    without a Monte Carlo error (sway, influence) are given `EXACT`.
    """

    u: np.ndarray
    columns: np.ndarray
    distance: np.ndarray

    @property
    def agrees(self) -> np.ndarray:
        """Whether each row is within `LIMIT` joint standard errors, (R,) bool."""
        return np.asarray(np.abs(self.distance) <= LIMIT)


def distances(studies: np.ndarray) -> np.ndarray:
    """Distances (R,) of the printed numbers from studies (K, R) of one configuration."""
    k = len(studies)
    error = np.sqrt(studies.var(axis=0, ddof=1) * (1 + 1 / k) + rounding() ** 2)
    gap = studies.mean(axis=0) - stated()
    above = np.array([row.kind == "above" for row in ROWS])
    gap = np.where(above, np.minimum(gap, 0.0), gap)
    return np.asarray(np.where(gap == 0.0, 0.0, gap / np.maximum(error, EXACT)))


def stand_in(found: Inferred) -> np.ndarray:
    """The hand-calibrated stand-in as a point of the cube, (U,), with the paper's stated choices and all lines."""
    model = two_segment()
    values = dict(zip(model.names, model.truth, strict=True))
    named = {name: float(values[name]) for name in PARAMETERS}
    return found.prior.positions(
        {**named, "noise": 1.0, **dict.fromkeys(("convention", "width", "sway_over", "solver"), 0)}
    )


def best(found: Inferred, seed: int, realizations: int, out: Path, options: ClusterOptions) -> Checked:
    """The configuration of highest posterior density, by real studies of the emulator's best candidates."""
    order = np.argsort(-found.posterior.log_likelihood, kind="stable")
    chosen: list[np.ndarray] = []
    for k in order:  # candidates that differ: neighbours of the first would only repeat it
        u = found.posterior.u[k]
        if all(np.abs(u - other).max() > 0.02 for other in chosen):
            chosen.append(u)
        if len(chosen) == CANDIDATES:
            break
    where = (seed, WAVE_OF_CANDIDATES, realizations)
    bank = simulated(found.prior, np.repeat(chosen, TRIALS, axis=0), where, out / "bank", options)
    over = found.prior.values(bank.u)[:, found.prior.names.index("sway_over")]
    means = columns(bank.moments, over).reshape(len(chosen), TRIALS, -1).mean(axis=1)
    score = found.likelihood.at(means)
    return repeated(found, chosen[int(score.argmax())], (seed, WAVE_OF_BEST, realizations), out, options)


def repeated(
    found: Inferred, u: np.ndarray, where: tuple[int, int, int], out: Path, options: ClusterOptions
) -> Checked:
    """`REPEATS` studies at ``u``; ``where``: seed, wave and realizations."""
    bank = simulated(found.prior, np.repeat(u[None], REPEATS, axis=0), where, out / "bank", options)
    over = found.prior.values(bank.u)[:, found.prior.names.index("sway_over")]
    studies = columns(bank.moments, over)
    return Checked(u, studies, distances(studies))


def replicated(found: Inferred, seed: int) -> np.ndarray:
    """Rows of papers drawn from the posterior predictive, (N, R): expected rows plus the error of a study."""
    rows = found.emulator.rows(found.posterior.u)
    root = np.linalg.cholesky(found.emulator.covariance + 1e-12 * np.eye(rows.shape[1]))
    rng = stream(seed, "table_predictive")
    return np.asarray(rows + rng.standard_normal(rows.shape) @ root.T + rng.standard_normal(rows.shape) * rounding())


def tail(replicates: np.ndarray) -> np.ndarray:
    """Posterior predictive p of every row (R,): two-sided for numbers, the chance that it holds for rankings.

    The tail beyond the replicates is that of a normal distribution with their mean and standard deviation.
    """
    z = (stated() - replicates.mean(axis=0)) / np.maximum(replicates.std(axis=0, ddof=1), 1e-12)
    above = np.array([row.kind == "above" for row in ROWS])
    return np.asarray(np.where(above, ndtr(-z), 2 * ndtr(-np.abs(z))))
