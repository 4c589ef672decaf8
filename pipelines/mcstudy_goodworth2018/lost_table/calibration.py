"""Whether the inference is honest: papers simulated from known tables, inferred, and compared with their tables.

The papers are studies of the bank at points of the prior; each is inferred with an emulator that is not made of it. If
the inference is right, the rank of a true value among the points of its posterior is uniform (simulation-based
calibration: Talts, Betancourt, Simpson, Vehtari & Gelman 2018), and 90 % intervals contain 90 % of true values.

The emulator's error differs between configurations, which its one error covariance does not say, so that the posterior
is too narrow. It is therefore widened: the likelihood is raised to the largest of `POWERS` at which the intervals of
the papers contain their true values as often as they promise. Whether that holds is counted for each paper with the
power that the other papers choose.

This checks the emulator of the prior bank, the likelihood and the sampler. It does not check the emulator after the
waves, which only the paper's numbers have; the studies at the best configuration do that.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.streams import stream
from mcstudy_goodworth2018.lost_table.bank import Bank
from mcstudy_goodworth2018.lost_table.checks import rows_of
from mcstudy_goodworth2018.lost_table.emulator import Emulator
from mcstudy_goodworth2018.lost_table.kept_files import Kind, kept
from mcstudy_goodworth2018.lost_table.posterior import THOROUGH, Likelihood, tempered
from mcstudy_goodworth2018.lost_table.unknowns import Prior

LEVELS = (0.5, 0.8, 0.95)
"""Probabilities of the central intervals that are counted."""

POWERS = (0.2, 0.35, 0.6, 1.0)
"""Powers of the likelihood that are tried."""

RESULTS_OF_A_PAPER = ("rank", "width", "error")


@dataclass(frozen=True)
class Calibration:
    """Simulated papers and what was inferred from them at each of `POWERS`.

    Attributes
    ----------
    rank: share of posterior points below the true position, (N, powers, U). width: standard deviation of the posterior
    over that of the prior, (N, powers, U). error: distance of the posterior mean from the truth, in units of the cube,
    (N, powers, U). prior_error: the same for the mean of the prior, (N, U).
    """

    rank: np.ndarray
    width: np.ndarray
    error: np.ndarray
    prior_error: np.ndarray

    @property
    def covered(self) -> np.ndarray:
        """Whether the central interval of each of `LEVELS` contains the truth, (levels, N, powers, U)."""
        return np.stack([np.abs(self.rank - 0.5) <= level / 2 for level in LEVELS])

    @property
    def chosen(self) -> int:
        """Number of the largest power that the papers find wide enough; 0 if none is, the last without papers."""
        return self._largest(np.ones(len(self.rank), dtype=bool))

    @property
    def chosen_by_others(self) -> np.ndarray:
        """The same by all papers but one, (N,)."""
        every = np.arange(len(self.rank))
        return np.array([self._largest(every != k) for k in every], dtype=int)

    def _largest(self, which: np.ndarray) -> int:
        if not which.any():
            return len(POWERS) - 1
        excess = self.covered[:, which].mean(axis=(1, 3)) - np.array(LEVELS)[:, None]
        enough = np.flatnonzero(excess.mean(axis=0) >= 0)
        return int(enough.max()) if enough.size else 0


def calibrate(
    prior: Prior,
    bank: Bank,
    papers: int,
    where: tuple[int, int, int],
    folder: Path,
    options: ClusterOptions,
) -> Calibration:
    """Infer the tables of some studies of ``bank``, each from all other studies.

    ``bank``: studies at points of the prior. ``papers``: how many of its first are inferred (fewer if it has fewer).
    ``where``: seed, realizations and particles. ``folder``: where finished papers are kept.
    Raises `Interrupted` when stopped; the same call resumes.
    """
    places = range(min(papers, len(bank)))
    found = kept(
        Kind(folder, RESULTS_OF_A_PAPER),
        places,
        lambda place: f"paper{place:05d}.npz",
        lambda place: {"u": bank.u[place], "powers": np.array(POWERS)},
        lambda place: _paper(prior, bank, place, where),
        options,
    )
    shape = (0, len(POWERS), len(prior))
    rank, width, error = (np.stack([x[n] for x in found]) if found else np.empty(shape) for n in RESULTS_OF_A_PAPER)
    return Calibration(rank, width, error, np.abs(bank.u.mean(axis=0) - bank.u[: len(places)]))


def _paper(prior: Prior, bank: Bank, place: int, where: tuple[int, int, int]) -> dict[str, np.ndarray]:
    """Rank, width and error (powers, U) of the table of one study of the bank, inferred from the others."""
    seed, realizations, particles = where
    emulator = Emulator.of(prior, bank.take(np.delete(np.arange(len(bank)), place)), realizations)
    true = bank.u[place]
    likelihood = Likelihood.of(emulator, rows_of(prior, bank.take(np.array([place])))[0])
    rng = stream(seed, "table_paper", place)
    value, sd = prior.values(true), bank.u.std(axis=0)
    choice = np.array([bool(x.choices) for x in prior.unknowns])
    out: dict[str, list[np.ndarray]] = {name: [] for name in RESULTS_OF_A_PAPER}
    for found in tempered(likelihood, rng, particles, POWERS, moves=THOROUGH):
        drawn = prior.values(found.u)
        # equal values of a choice are ranked at random
        below = np.where(choice, (drawn < value) + rng.random(len(prior)) * (drawn == value), found.u < true)
        out["rank"].append(below.mean(axis=0))
        out["width"].append(found.u.std(axis=0) / sd)
        out["error"].append(np.abs(found.u.mean(axis=0) - true))
    return {name: np.stack(x) for name, x in out.items()}
