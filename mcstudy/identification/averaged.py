"""Parameters of a person averaged over what the model may lack.

Every hypothesis of the diagnosis (nothing missing, each effect of the library in its form, pairs, changes with
amplitude or time) is fitted without prior, and each quantity has its profile likelihood in each. Beside each acts what
the hypothesis leaves open: beside an effect a small smooth remainder, because a real mechanism never has quite the
declared form (`mcstudy.gap.questions.departure`); beside none, and beside the leading effects, a cause outside the
library, a smooth unknown torque or error of the sensors. Both move a quantity and widen it, to first order
(`mcstudy.identification.deviation`). All are pooled by their posterior probabilities
(`mcstudy.identification.mixture`).

The variance of the pooled distribution has three parts: what noise leaves open where cause and form are known (data),
the forms of one cause (form), and which cause it is (cause).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mcstudy.effect_library.effect import Effect
from mcstudy.effect_library.library import library_of
from mcstudy.fitting.arguments import Prior
from mcstudy.fitting.penalised import Fitted, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.prior import BESIDE, UNKNOWN
from mcstudy.gap.questions.any_gap import GapTest
from mcstudy.gap.questions.departure import EXACT, SHARES, VISIBLE
from mcstudy.gap.questions.evidence import Hypothesis
from mcstudy.gap.questions.posterior import LEADERS, explain
from mcstudy.identification.averaged_record import OUTSIDE, Averaged, AveragedQuantity, CauseShare, cause_name
from mcstudy.identification.bounds import bounded
from mcstudy.identification.correction import Draws, simulated
from mcstudy.identification.deviation import Deviation, Deviations
from mcstudy.identification.estimate import Estimate
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.minimum import Minima, from_starts, without_prior
from mcstudy.identification.mixture import NODES, WEIGHT, distribution, on_bound, quantiles
from mcstudy.identification.outside import SLACK, Problem, Unknown, unknown
from mcstudy.identification.profile import Linearised, Profile, profiles
from mcstudy.identification.settings import FitSettings
from mcstudy.identification.threshold import Threshold, threshold
from mcstudy.identification.varying import varied
from mcstudy.models.quantities import Quantity, quantities
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.streams import stream

PROFILED, LEAST = 0.02, 0.003
"""Probability of a hypothesis from which its profiles are computed, and from which it has a part at all: between them
its distributions are normal."""

CURVE = (0.5,)
"""Root of the share of the threshold at which the profiles of hypotheses have a point between estimate and end."""

STARTS = 2
"""Minima of the fit without effects from which fits with effects start, with two sizes each."""


@dataclass(frozen=True)
class Alone:
    """One hypothesis fitted without prior.

    Attributes
    ----------
    effects: names, empty for none. probability: of it, whatever it leaves open. log_evidence: as in `Hypothesis`.
    values: (K, Z) distributions of the quantities. centre, variance: (K,) of the fit to first order. form: (K,) share
    of that variance that open constants of the form make. at: the fit. free: (P,) parameters that no bound holds. gain:
    by how much it lowers the squared residual of the fit without effects. beside: smooth deviations beside it.
    """

    effects: tuple[str, ...]
    probability: float
    log_evidence: float
    values: np.ndarray
    centre: np.ndarray
    variance: np.ndarray
    form: np.ndarray
    at: Fitted
    free: np.ndarray
    gain: float
    beside: Deviations


@dataclass(frozen=True)
class Part:
    """One explanation in the pool: its cause, weight, and distributions (K, Z) of the quantities.

    form: (K,) share of the variance that its form makes, outside: (K,) that a cause outside the library makes.
    """

    cause: tuple[str, ...]
    weight: float
    values: np.ndarray
    form: np.ndarray
    outside: np.ndarray


def averaged(test: GapTest, fit: FitRecord, nominal: Model, settings: FitSettings) -> Averaged:
    """The average for a ``fit`` without effects, whose lines were tested. ``nominal``: its model without bounds."""
    explanation = explain(test)
    data, wanted = Data.of(fit.lines), _wanted(fit.model, fit, settings)
    draws = simulated(fit.lines.noise, stream(settings.seed, "fit correction"))
    known = library_of(nominal)
    found = sorted((x for x in explanation.hypotheses if set(x[0].effects) <= known.keys()), key=lambda x: -x[1])
    singles = [h for h, _ in found if len(h.effects) == 1]
    leaders = {
        h.effects for h in sorted((h for h in singles if _changes(h, fit)), key=lambda h: -h.log_evidence)[:LEADERS]
    }
    none = _bare(fit, data, wanted, draws, *next(x for x in found if not x[0].effects))
    alone = [none]
    for h, p in found:
        if h.effects and (p >= LEAST or h.effects in leaders):
            other = _changes(h, fit)
            one = _fitted(h, p, fit, nominal, data, draws, settings) if other else _same(none, h, p)
            own = _wanted(one.at.model, fit, settings)
            alone.append(_at_truth(one, [known[e] for e in h.effects], test, fit.lines, own))
    parts = [p for a in alone for p in _with_remainders(a)]
    bases = [a for a in alone if a.effects in leaders]
    parts += _outside(none, bases, _unknown(fit, test, bases, data, wanted), explanation.unknown, len(singles))
    return Averaged(_causes(parts), tuple(_quantity(k, e, parts, fit) for k, e in enumerate(fit.estimates)))


def _wanted(model: Model, fit: FitRecord, settings: FitSettings) -> list[Quantity]:
    """The quantities of the fit without effects, of a model with them."""
    names = [e.name for e in fit.estimates]
    own = {q.name: q for q in quantities(model, settings.quantities)}
    return [own[name] for name in names]


def _changes(h: Hypothesis, fit: FitRecord) -> bool:
    """Whether the model of a hypothesis is another one than that of the fit without effects."""
    return set(h.fitted.model.names) != set(fit.model.names)


def _distributions(
    intervals: Sequence[Profile], wanted: Sequence[Quantity], minima: Minima, rise: Threshold, level: float
) -> np.ndarray:
    each = zip(intervals, wanted, rise.rise, strict=True)
    return np.array([distribution(p, q.value(minima.theta[0]), r, level) for p, q, r in each])


def _bare(
    fit: FitRecord, data: Data, wanted: Sequence[Quantity], draws: Draws, h: Hypothesis, probability: float
) -> Alone:
    """The fit without effects as a hypothesis."""
    rise = threshold(fit.model, data, fit.minima, wanted, draws, fit.level)
    intervals = [e.profile for e in fit.estimates]
    values = _distributions(intervals, wanted, fit.minima, rise, fit.level)
    return _alone(fit.model, data, fit.minima, rise.near, values, h, probability)


def _same(none: Alone, h: Hypothesis, probability: float) -> Alone:
    """A change with amplitude or time: it leaves the mean response that of a model without effects."""
    return replace(none, effects=h.effects, probability=probability, log_evidence=h.log_evidence)


def _at_truth(a: Alone, effects: Sequence[Effect], test: GapTest, lines: Lines, wanted: Sequence[Quantity]) -> Alone:
    """The same with varying gains where they are those of the model (`mcstudy.identification.varying`)."""
    found = varied(effects, test.contrasts, lines, a.at, a.free)
    if found is None:
        return a
    mean, covariance = found
    gradients = np.array([q.gradient(a.at.theta) for q in wanted])
    variance = np.einsum("kp,pq,kq->k", gradients, covariance, gradients)
    shift, added = gradients @ mean, np.clip(np.nan_to_num(1 - a.variance / variance), 0.0, None)
    stretched = (a.values - a.centre[:, None]) / np.sqrt(1 - added)[:, None]
    values = (a.centre + shift)[:, None] + stretched
    return replace(a, values=values, form=added + (1 - added) * a.form, centre=a.centre + shift)


def _unknown(
    fit: FitRecord, test: GapTest, leaders: Sequence[Alone], data: Data, wanted: Sequence[Quantity]
) -> list[Unknown]:
    """Causes outside the library beside no effect, refitted; the last is none of them."""
    own = test.fit.best
    P = len(fit.model.names)
    prior = Prior(own.prior.mean[:P], SLACK * own.prior.scale[:P])
    anchors = [fit.theta, own.theta, *(a.at.theta[:P] for a in leaders)]
    return unknown(Problem(fit.model, prior, data), anchors, wanted)


def _fitted(
    h: Hypothesis,
    probability: float,
    fit: FitRecord,
    nominal: Model,
    data: Data,
    draws: Draws,
    settings: FitSettings,
) -> Alone:
    """A hypothesis fitted without prior, in the form that the diagnosis found the more probable."""
    model = bounded(h.fitted.model, nominal, settings.bounds or {})
    wanted, P = _wanted(model, fit, settings), len(fit.model.names)
    added = h.fitted.theta[P:]
    starts = [h.fitted.theta, *(np.append(m, k * added) for m in fit.minima.theta[:STARTS] for k in (0.3, 1.0))]
    fitter = Fitter(model, without_prior(model, nominal), data.f)
    minima = from_starts(fitter, data, np.array(starts))
    rise = threshold(model, data, minima, wanted, draws, fit.level)
    if probability >= PROFILED:
        intervals = profiles(fitter, data, minima, wanted, rise.rise, CURVE)
        values = _distributions(intervals, wanted, minima, rise, fit.level)
    else:
        centre = np.array([q.value(minima.theta[0]) for q in wanted])
        values = centre[:, None] + np.sqrt(np.nan_to_num(rise.near.variance))[:, None] * NODES
    alone = _alone(model, data, minima, rise.near, values, h, probability)
    form = _form(model, rise.near, library_of(nominal).shape_parameters)
    return replace(alone, form=form, gain=float(fit.chi2 - minima.chi2[0]))


def _alone(
    model: Model, data: Data, minima: Minima, near: Linearised, values: np.ndarray, h: Hypothesis, probability: float
) -> Alone:
    prior = h.fitted.prior._replace(weight=0.0)
    at = Fitted(model, prior, minima.theta[0], float(minima.chi2[0]), 0.0, minima.information[0])
    return Alone(
        effects=h.effects,
        probability=probability,
        log_evidence=h.log_evidence,
        values=values,
        centre=values[:, values.shape[1] // 2],
        variance=near.variance,
        form=np.zeros(len(values)),
        at=at,
        free=near.free,
        gain=0.0,
        beside=Deviations(at, data, near),
    )


def _form(model: Model, near: Linearised, shapes: set[str]) -> np.ndarray:
    """Share (K,) of the variances that open constants of the form make: without them it would be that much smaller."""
    shape = np.isin(np.array(model.names)[near.free], sorted(shapes))
    across = near.gradients[:, near.free] @ near.covariance[:, shape]
    taken = np.linalg.pinv(near.covariance[np.ix_(shape, shape)], hermitian=True)
    return np.clip(np.nan_to_num(np.einsum("ks,st,kt->k", across, taken, across) / near.variance), 0.0, 1.0)


def _with_remainders(a: Alone) -> Iterator[Part]:
    """A hypothesis alone and with each small remainder of its effect beside it."""
    energies = a.gain * np.square(SHARES)
    beside = a.beside.of_energies(list(energies)) if len(a.effects) == 1 and a.gain and energies.max() > VISIBLE else []
    weight = _shares([np.log(EXACT), *(d.log_factor + np.log((1 - EXACT) / len(beside)) for d in beside)])
    nothing = np.zeros(len(a.centre))
    yield Part(a.effects, a.probability * weight[0], a.values, a.form, nothing)
    for d, w in zip(beside, weight[1:], strict=True):
        moved, added = _moved(a, d)
        yield Part(a.effects, a.probability * w, moved, added + (1 - added) * a.form, nothing)


def _outside(
    none: Alone, leaders: Sequence[Alone], refitted: Sequence[Unknown], probability: float, causes: int
) -> list[Part]:
    """A smooth deviation of any size beside none and beside each leading effect.

    ``refitted``: those beside none. ``probability``: of all together. ``causes``: number of single effects, which share
    the prior of `BESIDE`.
    """
    *unknown, alone = refitted
    beside = [
        (a, d, a.log_evidence + np.log(BESIDE / causes) + d.log_factor) for a in leaders for d in a.beside.sized()
    ]
    log = [none.log_evidence + np.log(UNKNOWN) + u.log_evidence - alone.log_evidence for u in unknown]
    weight = probability * _shares([*log, *(x for _, _, x in beside)])
    nothing = np.zeros(len(none.centre))
    out = []
    for u, w in zip(unknown, weight, strict=False):
        widened = np.clip(1 - none.variance / u.variance, 0.0, 1.0)
        values = u.centre[:, None] + np.sqrt(u.variance)[:, None] * NODES
        out.append(Part((OUTSIDE,), w, values, nothing, np.nan_to_num(widened, nan=1.0)))
    for (a, d, _), w in zip(beside, weight[len(unknown) :], strict=True):
        moved, added = _moved(a, d)
        out.append(Part((*a.effects, OUTSIDE), w, moved, (1 - added) * a.form, added))
    return out


def _moved(a: Alone, d: Deviation) -> tuple[np.ndarray, np.ndarray]:
    """Distributions (K, Z) beside a deviation, and the share (K,) of their variance that it adds."""
    added = np.nan_to_num(d.variance / (a.variance + d.variance))
    stretched = (a.values - a.centre[:, None]) / np.sqrt(1 - added)[:, None]
    return a.centre[:, None] + d.shift[:, None] + stretched, added


def _shares(log: Sequence[float]) -> np.ndarray:
    x = np.exp(np.array(log) - max(log))
    return np.asarray(x / x.sum())


def _causes(parts: Sequence[Part]) -> tuple[CauseShare, ...]:
    """Weights by cause, the largest first."""
    total: dict[tuple[str, ...], float] = {}
    for p in parts:
        total[p.cause] = total.get(p.cause, 0.0) + p.weight
    whole = sum(total.values())
    return tuple(CauseShare(c, w / whole) for c, w in sorted(total.items(), key=lambda x: -x[1]) if w > 0)


def _quantity(k: int, e: Estimate, parts: Sequence[Part], fit: FitRecord) -> AveragedQuantity:
    """Quantity ``k`` of every part, pooled; ``e``: of the model without effects."""
    low, high = _limits(e.name, fit.model)
    values = np.clip([p.values[k] for p in parts], low, high)
    weight = np.array([p.weight for p in parts])
    weight /= weight.sum()
    tail = (1 - fit.level) / 2
    lowest, middle, highest = quantiles(values, weight, (tail, 0.5, 1 - tail))
    mean, variance = values @ WEIGHT, ((values - (values @ WEIGHT)[:, None]) ** 2) @ WEIGHT
    outside, form = np.array([[p.outside[k], (1 - p.outside[k]) * p.form[k]] for p in parts]).T
    causes = {c: [i for i, p in enumerate(parts) if p.cause == c] for c in dict.fromkeys(p.cause for p in parts)}
    share = {c: weight[i].sum() for c, i in causes.items()}
    centre = {c: float(weight[i] @ mean[i] / share[c]) if share[c] else float(mean[i[0]]) for c, i in causes.items()}
    at = np.array([centre[p.cause] for p in parts])
    whole = float(weight @ mean)
    by_form = float(weight @ (variance * form + (mean - at) ** 2))
    by_cause = float(weight @ (variance * outside + (at - whole) ** 2))
    total = float(weight @ (variance + (mean - whole) ** 2)) or 1.0
    pull = {c: share[c] * (centre[c] - centre[()]) * np.sign(middle - e.estimate) for c in causes if c}
    strongest = max(pull, key=lambda c: pull[c], default=())
    return AveragedQuantity(
        name=e.name,
        unit=e.unit,
        base=e.estimate,
        base_low=e.low,
        base_high=e.high,
        estimate=float(middle),
        low=float(lowest),
        high=float(highest),
        low_from="bound" if on_bound(values, weight, lowest) else "data",
        high_from="bound" if on_bound(values, weight, highest) else "data",
        data=1 - (by_form + by_cause) / total,
        form=by_form / total,
        cause=by_cause / total,
        moved_by=cause_name(strongest) if pull.get(strongest, 0.0) > 0 else "",
    )


def _limits(name: str, model: Model) -> tuple[float, float]:
    """Smallest and largest value of a parameter, or of a sum of parameters, within the bounds of the fit."""
    terms = name.split(" + ")
    if not set(terms) <= set(model.names):
        return -np.inf, np.inf
    at = [model.names.index(t) for t in terms]
    return float(np.asarray(model.lower)[at].sum()), float(np.asarray(model.upper)[at].sum())
