"""Intervals of further quantities of a finished fit, without another search."""

from __future__ import annotations

from collections.abc import Sequence

from mcstudy.fitting.penalised import Data, Fitter
from mcstudy.identification.correction import simulated
from mcstudy.identification.minimum import Minima, without_prior
from mcstudy.identification.profile import Profile, profiles
from mcstudy.identification.quantities import Quantity
from mcstudy.identification.threshold import threshold
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.streams import stream


def further_profiles(
    model: Model, base: Model, lines: Lines, minima: Minima, wanted: Sequence[Quantity], level: float, seed: int
) -> list[Profile]:
    """Profiles of the ``wanted`` quantities of a fit of ``model`` to ``lines`` that found the ``minima``.

    ``base``: ``model`` without effects. ``seed``: of the fit, whose correction is drawn again.
    """
    if not wanted:
        return []
    data, draws = Data.of(lines), simulated(lines.noise, stream(seed, "fit correction"))
    upto = threshold(model, data, minima, wanted, draws, level)
    return profiles(Fitter(model, without_prior(model, base), lines.f), data, minima, wanted, upto.rise)
