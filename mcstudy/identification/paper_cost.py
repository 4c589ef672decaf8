"""The estimates under the cost function of Goodworth & Peterka (2018), for comparison.

That cost is the mean squared deviation relative to the measured response, over the paper's averaged frequency points.
It says nothing about the noise, so it has no likelihood and no profile likelihood interval. Its estimates are printed
beside those of maximum likelihood without intervals of their own: a sandwich interval would be symmetric and blind to
bounds and other minima like Wald's, which README.md shows to hold the truth far too rarely.
"""

from __future__ import annotations

import numpy as np

from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.identification.minimum import Minima, search, without_prior
from mcstudy.spectra.bands import Bands, published
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model


def averaged(lines: Lines) -> tuple[Bands, np.ndarray] | None:
    """The paper's points that ``lines`` fill, and their FRFs (N, 2); None for a recording without a period."""
    if lines.harmonic is None:
        return None
    held = set(map(int, lines.harmonic))
    members = tuple(m for m in published().members if held.issuperset(map(int, m)))
    if not members:
        return None
    bands = Bands(members, float((lines.harmonic / lines.f).mean()))
    return bands, bands.average(lines.y[np.searchsorted(lines.harmonic, bands.lines)])


def paper_minima(model: Model, base: Model, lines: Lines, seed: int) -> Minima | None:
    """Minima of the paper's cost; None where its points are fewer than the parameters need.

    ``base``: ``model`` without effects. ``chi2`` of the minima is 2 N times the paper's J, N the number of points.
    """
    points = averaged(lines)
    if points is None or 4 * len(points[0]) <= len(model.parameters):
        return None
    bands, y = points
    if (np.abs(y) == 0).any():
        return None
    weight = np.zeros((len(bands), 2, 2), dtype=complex)
    weight[:, [0, 1], [0, 1]] = 1 / np.abs(y)
    return search(Fitter(model, without_prior(model, base), bands.f), Data(bands.f, y, weight), seed)


def paper_estimate(model: Model, base: Model, lines: Lines, seed: int) -> np.ndarray | None:
    """(P,) parameters at the lowest stable minimum of the paper's cost, or None; see `paper_minima`."""
    minima = paper_minima(model, base, lines, seed)
    return None if minima is None else minima.theta[0]
