"""A small smooth deviation beside a fit: its marginal likelihood, and samples of the energy that it has.

The deviation is of one of the families of free torques and sensor errors (`mcstudy.gap.candidates.free_deviations`),
as in the scores of what is unknown (`mcstudy.gap.candidates.scores`), but of a given size: it adds a given *energy* to
the squared residual on average, after the parameters of the model are refitted. Derived.
"""

from __future__ import annotations

import numpy as np

from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.fitting.small_linear import gaussian_factor
from mcstudy.gap.candidates.free_deviations import free_torques
from mcstudy.gap.candidates.scores import Projection


class Remainder:
    """A deviation beside one fit of ``data``, of any family and of any of the ``energies`` (E,), all equally probable.

    Attributes
    ----------
    log_factor: ln Bayes factor of the deviation against none.
    """

    def __init__(self, fitted: Fitted, data: Data, energies: np.ndarray) -> None:
        projection, residual = Projection.of(fitted, data), fitted.free_residual(data)
        self._terms = []
        for family in free_torques(fitted, data):
            gram = np.ascontiguousarray(family.columns.T @ projection(family.columns))
            b = np.ascontiguousarray((family.columns.T @ residual)[:, None])
            self._terms += [(gram, b, float(e / np.trace(gram))) for e in energies]
        self._log = np.array([float(gaussian_factor(*term)[0]) for term in self._terms])
        self.log_factor = float(np.logaddexp.reduce(self._log) - np.log(self._log.size))

    def samples(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Posterior samples (n,) of the energy of the deviation, given that there is one."""
        weight = np.exp(self._log - np.logaddexp.reduce(self._log))
        out = []
        for (gram, b, variance), m in zip(self._terms, rng.multinomial(n, weight), strict=True):
            if not m:
                continue
            precision = gram + np.eye(len(gram)) / variance
            root = np.linalg.cholesky(precision)
            c = np.linalg.solve(precision, b) + np.linalg.solve(root.T, rng.standard_normal((len(b), m)))
            out.append(np.einsum("in,ij,jn->n", c, gram, c, optimize=True))
        return np.asarray(rng.permutation(np.concatenate(out)))
