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

from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.stance.body import two_segment
from mcstudy.streams import stream
from mcstudy_goodworth2018.lost_table.bank import Bank, simulated
from mcstudy_goodworth2018.lost_table.closed_form import misses
from mcstudy_goodworth2018.lost_table.emulator import Emulator
from mcstudy_goodworth2018.lost_table.rows import ROWS, columns, rounding, stated
from mcstudy_goodworth2018.lost_table.simulate import PARAMETERS
from mcstudy_goodworth2018.lost_table.unknowns import Prior

LIMIT = 3.0
LOOKED_AT, CANDIDATES, TRIALS = 60, 8, 2
"""Nearest configurations of the bank, those of them compared by new studies, and studies of each."""

CAP = 3.0
"""Largest distance that counts when studies are compared, in errors of the difference of two studies.

What counts is how many numbers are met: a number that is missed by far is missed, not worth any price."""

AIM = 10.0
"""Weight of a row that is aimed at."""

EXACT = 0.02
"""Least error of a row on its scale (of logarithms: 2 %): a ranking read from a figure is no sharper."""

REPEATS = 8
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
    def error(self) -> np.ndarray:
        """Monte Carlo error of a row of one study, (R,)."""
        return np.asarray(self.columns.std(axis=0, ddof=1))

    @property
    def agrees(self) -> np.ndarray:
        """Whether each row is within `LIMIT` joint standard errors, (R,) bool."""
        return np.asarray(np.abs(self.distance) <= LIMIT)


def distances(studies: np.ndarray) -> np.ndarray:
    """Distances (R,) of the printed numbers from studies (K, R) of one configuration."""
    k = len(studies)
    error = np.sqrt(studies.var(axis=0, ddof=1) * (1 + 1 / k) + rounding() ** 2)
    return np.asarray(gap(studies.mean(axis=0)) / np.maximum(error, EXACT))


def stand_in_point(prior: Prior) -> np.ndarray:
    """The hand-calibrated stand-in as a point of the cube, (U,), with the paper's stated choices and all lines."""
    model = two_segment()
    values = dict(zip(model.names, model.truth, strict=True))
    named = {name: float(values[name]) for name in PARAMETERS}
    return prior.positions({**named, "noise": 1.0, **dict.fromkeys(("convention", "width", "sway_over", "solver"), 0)})


def best(
    prior: Prior, bank: Bank, error: np.ndarray, where: tuple[int, int], out: Path, options: ClusterOptions
) -> Checked:
    """The configuration whose studies come nearest to the printed numbers; ``where``: seed and realizations.

    The studies of the bank are compared with the printed numbers as they are; ``error``: Monte Carlo error of a row of
    one study, (R,). The nearest few are simulated again with new noise. The one of them that misses the fewest numbers,
    by the mean of its new studies, is simulated once more for what is reported: a study that was near by luck does not
    stay near.
    """
    seed, realizations = where
    near = misfit(rows_of(prior, bank), error)
    order = np.argsort(near, kind="stable")[:LOOKED_AT]
    fixed = penalty(prior.values(bank.u[order]))
    first = np.argsort(near[order] + fixed, kind="stable")[:CANDIDATES]
    chosen, fixed = bank.u[order[first]], fixed[first]
    again = simulated(
        prior, np.repeat(chosen, TRIALS, axis=0), (seed, WAVE_OF_CANDIDATES, realizations), out / "bank", options
    )
    trials = rows_of(prior, again).reshape(len(chosen), TRIALS, -1).mean(axis=1)
    distance = np.abs(gap(trials)) / np.maximum(np.sqrt(error**2 * (1 + 1 / TRIALS) + rounding() ** 2), EXACT)
    missed = (distance > LIMIT).sum(axis=1) + fixed / CAP**2
    order = np.lexsort((np.minimum(distance**2, LIMIT**2).sum(axis=1), missed))
    return repeated(prior, chosen[order[0]], (seed, WAVE_OF_BEST, realizations), out, options)


def penalty(values: np.ndarray) -> np.ndarray:
    """What the rows that need no simulation add to `misfit` at configurations ``values`` (N, U), (N,)."""
    return CAP**2 * misses(values)


def rows_of(prior: Prior, bank: Bank) -> np.ndarray:
    """Rows (N, R) of the studies of a bank."""
    return columns(bank.moments, prior.values(bank.u)[:, prior.names.index("sway_over")])


def apart(studies: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Distances (N, R) of single studies from the printed numbers, in errors of the difference of two studies.

    ``error``: Monte Carlo error of a row of one study, (R,).
    """
    return np.asarray(gap(studies) / np.maximum(np.sqrt(2 * error**2 + rounding() ** 2), EXACT))


def misfit(studies: np.ndarray, error: np.ndarray, aim: int | None = None) -> np.ndarray:
    """Sum over rows of squared distances of single studies (N, R), each at most `CAP` errors, (N,).

    ``error``: see `apart`. ``aim``: a row that is to be met first; it counts `AIM` times as much, without a cap.
    """
    distance = apart(studies, error)
    total = np.minimum(distance**2, CAP**2).sum(axis=-1)
    return np.asarray(total if aim is None else total + AIM * distance[..., aim] ** 2)


def gap(rows: np.ndarray) -> np.ndarray:
    """Rows (..., R) minus the printed ones; 0 for a ranking that holds."""
    above = np.array([row.kind == "above" for row in ROWS])
    difference = rows - stated()
    return np.asarray(np.where(above, np.minimum(difference, 0.0), difference))


def repeated(prior: Prior, u: np.ndarray, where: tuple[int, int, int], out: Path, options: ClusterOptions) -> Checked:
    """`REPEATS` studies at ``u``; ``where``: seed, wave and realizations."""
    studies = rows_of(prior, simulated(prior, np.repeat(u[None], REPEATS, axis=0), where, out / "bank", options))
    return Checked(u, studies, distances(studies))


def replicated(emulator: Emulator, u: np.ndarray, seed: int) -> np.ndarray:
    """Rows of papers drawn from the posterior predictive, (N, R): expected rows at ``u`` plus the error of a study."""
    rows = emulator.rows(u)
    root = np.linalg.cholesky(emulator.covariance + 1e-12 * np.eye(rows.shape[1]))
    rng = stream(seed, "table_predictive")
    return np.asarray(rows + rng.standard_normal(rows.shape) @ root.T + rng.standard_normal(rows.shape) * rounding())


def tail(replicates: np.ndarray) -> np.ndarray:
    """Posterior predictive p of every row (R,): two-sided for numbers, the chance that it holds for rankings.

    The tail beyond the replicates is that of a normal distribution with their mean and standard deviation.
    """
    z = (stated() - replicates.mean(axis=0)) / np.maximum(replicates.std(axis=0, ddof=1), 1e-12)
    above = np.array([row.kind == "above" for row in ROWS])
    return np.asarray(np.where(above, ndtr(-z), 2 * ndtr(-np.abs(z))))
