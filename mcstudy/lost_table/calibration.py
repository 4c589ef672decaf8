"""Whether the inference is honest: papers simulated from known tables, inferred, and compared with their tables.

The papers are studies of the bank at points of the prior that the emulator is not made of. If the inference is right,
the rank of a true value among the points of its posterior is uniform (simulation-based calibration: Talts, Betancourt,
Simpson, Vehtari & Gelman 2018), and 90 % intervals contain 90 % of true values. This checks the emulator of the prior
bank, the likelihood and the sampler. It does not check the emulator after the waves, which only the paper's numbers
have; the studies at the best configuration do that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.lost_table.bank import Bank
from mcstudy.lost_table.emulator import Emulator
from mcstudy.lost_table.posterior import Likelihood, sample
from mcstudy.lost_table.rows import columns
from mcstudy.lost_table.unknowns import Prior
from mcstudy.streams import stream

LEVEL = 0.9
"""Probability of the central intervals that are counted."""


@dataclass(frozen=True)
class Calibration:
    """Simulated papers and what was inferred from them.

    Attributes
    ----------
    rank: share of posterior points below the true position, (N, U). width: standard deviation of the posterior over
    that of the prior, (N, U). error: distance of the posterior mean from the truth, in units of the cube, (N, U).
    prior_error: the same for the mean of the prior.
    """

    rank: np.ndarray
    width: np.ndarray
    error: np.ndarray
    prior_error: np.ndarray

    @property
    def covered(self) -> np.ndarray:
        """Whether the central interval of `LEVEL` contains the truth, (N, U)."""
        return np.asarray(np.abs(self.rank - 0.5) <= LEVEL / 2)


def calibrate(prior: Prior, bank: Bank, papers: int, realizations: int, particles: int, seed: int) -> Calibration:
    """Infer the tables of the last ``papers`` studies of ``bank`` from the others.

    ``bank``: studies at points of the prior. At most half of them become papers.
    """
    papers = min(papers, len(bank) // 2)
    n = len(bank) - papers
    made, held = bank.take(np.arange(n)), bank.take(np.arange(n, len(bank)))
    emulator = Emulator.of(prior, made, realizations)
    observed = columns(held.moments, prior.values(held.u)[:, prior.names.index("sway_over")])
    mean, sd = bank.u.mean(axis=0), bank.u.std(axis=0)
    choice = np.array([bool(x.choices) for x in prior.unknowns])
    rank, width, error = (np.empty((papers, len(prior))) for _ in range(3))
    for k in range(papers):
        rng = stream(seed, "table_paper", k)
        found = sample(Likelihood.of(emulator, observed[k]), rng, particles).u
        true = held.u[k]
        value, others = prior.values(true), prior.values(found)
        # equal values of a choice are ranked at random
        below = np.where(choice, (others < value) + rng.random(len(prior)) * (others == value), found < true)
        rank[k], width[k], error[k] = below.mean(axis=0), found.std(axis=0) / sd, np.abs(found.mean(axis=0) - true)
    return Calibration(rank, width, error, np.abs(mean - held.u))
