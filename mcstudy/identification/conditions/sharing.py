"""Whether conditions share a parameter: the fit in which they do against that in which it has a value in each.

Two tests that do not share their assumptions. The likelihood ratio is compared with what an estimated covariance does
to that of two nested models (`mcstudy.identification.correction.nested`), and divided by the ratio of squared residual
and noise where that is above one (Birge 1932). And both models are fitted to every second cycle and judged on the
others, where there are cycles.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from mcstudy.fitting.penalised import Fitter, whiten
from mcstudy.fitting.problem import Data
from mcstudy.fitting.standard_errors import wald_covariance
from mcstudy.identification.belief import LEADING, unseen_cycles
from mcstudy.identification.conditions.settings import ConditionSettings
from mcstudy.identification.correction import Draws, Nested, nested
from mcstudy.identification.fit import BestFit, fitted_model
from mcstudy.identification.minimum import ITERATIONS, TOLERANCE, Minima, distinct, standing, without_prior
from mcstudy.lines.base_fit import drawn_starts
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import copies, split
from mcstudy.stance.response import frf_jacobian
from mcstudy.stance.stability import growth_rate

DRAWN = 16
"""Random starts of each of the two fits, beside those from the minima of the fit that is already known."""


@dataclass(frozen=True)
class Sharing:
    """What the recordings say of the sharing of one parameter.

    Attributes
    ----------
    name, unit
        The parameter.
    separate
        Whether it has a value in each condition in the fit.
    conditions
        The C conditions that hold it.
    values, half_widths
        (C,), its values where each condition has one, and half-widths of their Wald intervals.
    ratio
        Twice the log likelihood ratio of the fits without and with sharing.
    p_value
        Of that, where conditions share it.
    unseen, unseen_se
        Squared residual of cycles that the fits did not see, shared minus separate (positive: separate values predict
        better), and its standard error; None for fewer than two cycles in each condition.
    """

    name: str
    unit: str
    separate: bool
    conditions: tuple[str, ...]
    values: tuple[float, ...]
    half_widths: tuple[float, ...]
    ratio: float
    p_value: float
    unseen: float | None
    unseen_se: float | None

    @property
    def change(self) -> float:
        """Largest minus smallest value."""
        return max(self.values) - min(self.values)


@dataclass(frozen=True)
class _Fitted:
    """One of the two models: its lowest minima, and what they were found with."""

    separate: tuple[str, ...]
    model: Model
    fitter: Fitter
    minima: Minima


def sharings(
    best: BestFit, nominal: Model, separate: Sequence[str], settings: ConditionSettings, draws: Draws
) -> tuple[Sharing, ...]:
    """Of every parameter that two conditions or more hold.

    ``best``: the fit in which the parameters ``separate`` have a value in each condition. ``nominal``: the joint model
    that shares all. ``draws``: of the noise of the lines.
    """
    data, known = best.data, _Fitted(tuple(separate), best.model, best.fitter, best.minima)
    out = []
    for name in copies(nominal, nominal.names):
        other = _other(known, nominal, name, settings, data)
        out.append(_sharing(name, nominal, known, other, best.lines, settings.level, draws))
    return tuple(out)


def _other(known: _Fitted, nominal: Model, name: str, settings: ConditionSettings, data: Data) -> _Fitted:
    """The fit in which one parameter is shared where it was not, and the other way round."""
    separate = tuple(n for n in nominal.names if (n in known.separate) != (n == name))
    model = fitted_model(nominal, settings, separate)
    fitter = Fitter(model, without_prior(model, split(nominal, separate)), data.f)
    begun = known.minima.theta[:LEADING] @ _shares(nominal, separate, known.separate).T
    starts = np.vstack([begun, drawn_starts(model, settings.seed, DRAWN)])
    fits = fitter.fits(fitter.packed(data), starts, tolerance=TOLERANCE, max_iterations=ITERATIONS)
    chi2 = np.where(np.isfinite(fits.chi2), fits.chi2, np.inf)
    at, hits = distinct(chi2, len(begun))
    stood = standing(growth_rate(model, fits.estimate[at]) < 0, chi2[at], 2 * model.n_outputs * len(data.f))
    if stood.any():
        at, hits = at[stood], hits[stood]
    minima = Minima(fits.estimate[at], chi2[at], fits.information[at], hits, DRAWN, len(at), np.sort(chi2))
    return _Fitted(separate, model, fitter, minima)


def _shares(nominal: Model, to: Collection[str], of: Collection[str]) -> np.ndarray:
    """(P, Q): parameters with ``to`` separate, from those with ``of`` separate; a shared one is the mean of copies."""
    names, known = split(nominal, to).names, split(nominal, of).names
    above, below = copies(nominal, to), copies(nominal, of)
    out = np.zeros((len(names), len(known)))
    for name in nominal.names:
        for k in range(len(nominal.blocks)):
            mine, theirs = (at.get(name, {}).get(k, name) for at in (above, below))
            if mine in names and theirs in known:  # a block without the parameter has no copy of it
                out[names.index(mine), known.index(theirs)] += 1
    return np.asarray(out / out.sum(axis=1, keepdims=True))


def _sharing(
    name: str, nominal: Model, known: _Fitted, other: _Fitted, lines: Lines, level: float, draws: Draws
) -> Sharing:
    separate = name in known.separate
    small, large = (other, known) if separate else (known, other)
    places = copies(nominal, [name])[name]
    k = [large.model.names.index(n) for n in places.values()]
    null = _null(nominal, name, small, large, Data.of(lines), draws)
    worse = max(1.0, float(large.minima.chi2[0] / null.null_chi2.mean()))
    ratio = float(small.minima.chi2[0] - large.minima.chi2[0])
    sd = np.sqrt(worse * _variance(large)[k])
    unseen = unseen_cycles(lines, (small.fitter, large.fitter), (small.minima, large.minima)) or (None, None)
    return Sharing(
        name=name,
        unit=nominal.units[nominal.names.index(name)],
        separate=separate,
        conditions=tuple(nominal.stimulus_names[b] for b in places),
        values=tuple(map(float, large.minima.theta[0][k])),
        half_widths=tuple(map(float, ndtri(0.5 + level / 2) * sd)),
        ratio=ratio,
        p_value=null.p_value(ratio / worse),
        unseen=unseen[0],
        unseen_se=unseen[1],
    )


def _variance(fitted: _Fitted) -> np.ndarray:
    """Wald variances (P,) of the parameters; nan of those on a bound."""
    theta = fitted.minima.theta[0]
    free = _free(fitted.model, theta)
    out = np.full(theta.size, np.nan)
    out[free] = np.diag(wald_covariance(fitted.minima.information[0], free))
    return out


def _null(nominal: Model, name: str, small: _Fitted, large: _Fitted, data: Data, draws: Draws) -> Nested:
    """The likelihood ratio where conditions share the parameter ``name``; a bound that holds this one is no reason to
    leave it out, which errs towards sharing."""
    shares = _shares(nominal, large.separate, small.separate)
    theta = small.minima.theta[0]
    free = _free(small.model, theta) | np.isin(small.model.names, name)
    mine = shares @ free > 0
    jacobian = whiten(data.weight, frf_jacobian(large.model, shares @ theta, data.f)[1])
    return nested(jacobian[:, mine], shares[np.ix_(mine, free)], draws)


def _free(model: Model, theta: np.ndarray) -> np.ndarray:
    """Which parameters (P,) no bound holds."""
    return np.asarray((theta > model.lower) & (theta < model.upper))
