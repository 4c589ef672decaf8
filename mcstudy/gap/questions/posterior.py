"""Which effect is missing: posterior over none, single effects, pairs, amplitude dependence, drift and the unknown.

Prior probabilities: `NONE` for no missing effect; `SINGLE`, divided among the causes of the library; `PAIR`, divided
among their pairs; `UNKNOWN` for a cause outside the library; `BESIDE` for such a cause together with a named effect.
Probabilities are right in a population with these shares, so the first can be set, and the Bayes factor of no missing
effect against all others is stated: with it anyone can apply a prior of his own. A mislabelled recording has a prior of
its own beside them (`mcstudy.gap.questions.mislabelling`).
Effects that this recording cannot distinguish (`mcstudy.gap.candidates.signatures`) form one group with one
probability.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mcstudy.effect_library import library
from mcstudy.effect_library.effect import Effect
from mcstudy.fitting.penalised import Fitted, whiten
from mcstudy.gap.candidates.scores import Scores
from mcstudy.gap.candidates.unstructured_residual import UnstructuredResidual
from mcstudy.gap.prior import BESIDE, NONE, PAIR, SINGLE, UNKNOWN
from mcstudy.gap.questions.any_gap import GapTest
from mcstudy.gap.questions.contrasts import Contrast
from mcstudy.gap.questions.departure import with_departures
from mcstudy.gap.questions.evidence import Hypothesis, SizeEstimate, possible, single, together
from mcstudy.gap.questions.interval import Interval
from mcstudy.gap.questions.mislabelling import Mislabelled
from mcstudy.gap.questions.other_forms import in_other_forms
from mcstudy.stance.response import frf

UNSTRUCTURED_SHARE = 0.25
"""Share of the unknown that is unstructured (`mcstudy.gap.candidates.unstructured_residual`)."""

SCATTERS = 0.5
"""Probability that an effect that is nonlinear within a trial scatters visible energy between the lines."""

LEADERS = 3
"""Number of leading single effects that are combined with other effects and with the unknown."""

PARTNERS = 10
"""Number of pairs that are refitted."""

PAIRS_FROM = -3.0
"""ln(prior times evidence) of the best single effect, relative to no missing effect, from which pairs are fitted."""

FARTHEST = 3.0
"""Largest size from which the fit of a pair starts, relative to that of the signature."""

NO_SIGNATURE = 1e-6
"""Squared length of a signature up to which an effect adds nothing to the leading one."""

WRONG_SIGN_GAIN = 0.2
"""Factor on the expected gain of an effect with the sign that does not occur in people, when pairs are ranked."""


@dataclass(frozen=True)
class Cause:
    """One effect, or two that act together, each representing its ambiguity group.

    Attributes
    ----------
    effects
        Name of the effect, or of the two: the most probable member of each ambiguity group.
    alternatives
        All members of the groups, which these data cannot distinguish.
    probability
        Posterior probability of the group.
    sizes
        Sizes of ``effects`` (`SizeEstimate`).
    fitted
        The refitted model.
    advice
        What seems to be mislabelled and what to check, if the cause is a mislabelled recording
        (`mcstudy.gap.questions.mislabelling`); ``effects`` then holds the code of the reading. Else empty.
    likeness
        Share of the gap that it predicts at lines that were left out of its fit (`mcstudy.gap.questions.likeness`,
        `Interval`). None without a gap in the mean response, and for a cause that leaves the mean response unchanged.
    """

    effects: tuple[str, ...]
    alternatives: tuple[tuple[str, ...], ...]
    probability: float
    sizes: tuple[SizeEstimate, ...]
    fitted: Fitted = field(repr=False)
    advice: str = ""
    likeness: Interval | None = None

    def mechanism(self, base: Fitted) -> bool:
        """Whether it is an effect, or two, of the library of ``base``'s model that changes the mean response."""
        known = library.library_of(base.model)
        return all(n in known and known[n].kind == "linear" for n in self.effects)

    def changes(self, base: Fitted) -> bool:
        """Whether its model is another one than that of ``base``, so that it changes the mean response."""
        return self.fitted.model.names != base.model.names


@dataclass(frozen=True)
class Explanation:
    """The posterior: named ``causes`` by decreasing probability, and the probabilities of ``none`` and ``unknown``.

    ``unknown_locations``: probability of the unknown by location, "" without one. ``hypotheses``: every refitted
    hypothesis with its posterior probability. ``none_log_factor``: ln Bayes factor of no missing effect against all
    others.
    """

    causes: tuple[Cause, ...]
    none: float
    unknown: float
    unknown_locations: dict[str, float]
    hypotheses: tuple[tuple[Hypothesis, float], ...]
    none_log_factor: float


def explain(
    test: GapTest,
    mislabelled: Callable[[float], Sequence[Mislabelled]] | None = None,
    prior_none: float = NONE,
) -> Explanation:
    """The posterior for the recording that was tested.

    ``mislabelled``: how the recording may be mislabelled, from the log evidence and prior of the best of all other
    hypotheses. A hypothesis that no body can have (`possible`) has no weight. ``prior_none``: see
    `mcstudy.gap.prior.prior`.
    """
    base, data = test.fit.best, test.fit.data
    log_odds = float(np.log((1 - NONE) * prior_none / (1 - prior_none)))  # of no missing effect, beside all others
    none = Hypothesis((), base.log_evidence, base)
    declared = [_declared(test, e) for e in test.effects]
    singles = in_other_forms(base, data, none, declared)
    # Also leaders that no body can have: what is beside them, or in a pair, may be possible.
    leaders = sorted(singles, key=lambda h: -h.log_evidence)[:LEADERS]
    families = Counter(e.cause for e in test.effects)
    n_causes = len(families) + sum(len(c.changes) for c in test.contrasts)
    weighted: list[tuple[Hypothesis, float]] = [(none, log_odds)]
    for h, e in zip(with_departures(base, data, singles), test.effects, strict=True):
        weighted.append((h, np.log(SINGLE / n_causes / families[e.cause])))
    # With the usual prior, whatever is given, so that the Bayes factor is the same under every prior.
    if leaders and leaders[0].log_evidence + np.log(SINGLE / n_causes) > none.log_evidence + np.log(NONE) + PAIRS_FROM:
        as_declared = {h.effects: h for h in declared}
        paired = pairs(test, [as_declared[h.effects] for h in leaders])
        weighted += [(h, _log_pair(n_causes)) for h in paired]
    weighted += _changes(test, leaders[:1], n_causes)
    log_named = [_log_weight(h, w, base) for h, w in weighted]
    readings = mislabelled(max(log_named)) if mislabelled else ()
    weighted += [(m.hypothesis, m.log_weight) for m in readings]
    log_named += [_log_weight(m.hypothesis, m.log_weight, base) for m in readings]
    unknown = _unknown(none, leaders, test, n_causes)
    log_unknown = np.array([x for x, _ in unknown])
    total = np.logaddexp.reduce(np.concatenate([log_named, log_unknown]))
    probability = np.exp(np.array(log_named) - total)
    unknown_locations: dict[str, float] = {}
    for x, locations in unknown:
        for place, share in locations.items():
            unknown_locations[place] = unknown_locations.get(place, 0.0) + float(np.exp(x - total)) * share
    posterior = [(h, x) for (h, _), x in zip(weighted[1:], np.array(log_named[1:]) - total, strict=True)]
    advice = {m.hypothesis.effects: m.advice for m in readings}
    others = float(np.logaddexp.reduce(np.concatenate([log_named[1:], log_unknown])))
    return Explanation(
        causes=tuple(replace(c, advice=advice.get(c.effects, "")) for c in _grouped(posterior, test.groups)),
        none=float(probability[0]),
        unknown=float(np.exp(np.logaddexp.reduce(log_unknown) - total)),
        unknown_locations=unknown_locations,
        hypotheses=tuple((h, float(p)) for (h, _), p in zip(weighted, probability, strict=True)),
        none_log_factor=float(log_named[0]) - log_odds + float(np.log(1 - NONE)) - others,
    )


def _log_weight(hypothesis: Hypothesis, log_prior: float, base: Fitted) -> float:
    """ln(prior times evidence) of a hypothesis; -inf for one that no body can have."""
    return hypothesis.log_evidence + log_prior if possible(hypothesis, base) else -np.inf


def _log_pair(n_causes: int) -> float:
    """ln prior probability of one pair of causes."""
    return float(np.log(PAIR / (n_causes * (n_causes - 1) / 2)))


def _declared(test: GapTest, effect: Effect) -> Hypothesis:
    """The hypothesis that one effect acts in its declared form; it is also fitted from the minima of the base model."""
    fit = test.fit
    signatures = [s for s in test.signatures if s.effect == effect.name]
    return single(fit.best, fit.minima, fit.data, effect.name, signatures, fit.best.residual(fit.data))


def _changes(test: GapTest, leaders: Sequence[Hypothesis], n_causes: int) -> list[tuple[Hypothesis, float]]:
    """Effects that change the gains with amplitude or over time, alone and beside each of ``leaders``; ln priors."""
    base, unstructured = test.fit.best, test.detection.unstructured
    known = library.library_of(base.model)
    weighted: list[tuple[Hypothesis, float]] = []
    for c in test.contrasts:
        for k in c.changes:
            size = known[k.effect].size
            estimate = k.gain if k.size is None else k.size
            se = k.se if k.size is None else abs(k.size / k.gain) * k.se if k.gain else k.se
            name = f"change of active gains between {c.kind}s" if k.size is None else size.name
            unit = "" if k.size is None else size.unit
            sizes = (SizeEstimate(name, estimate, se, estimate - 1.96 * se, estimate + 1.96 * se, unit),)
            evidence = base.log_evidence + k.log_factor + _scattered(known[k.effect], base, unstructured)
            weighted.append((Hypothesis((k.effect,), evidence, base, sizes), np.log(SINGLE / n_causes)))
            for h in leaders:
                evidence = h.log_evidence + k.log_factor + _scattered(known[k.effect], h.fitted, unstructured)
                both = Hypothesis((*h.effects, k.effect), evidence, h.fitted, (*h.sizes, *sizes))
                weighted.append((both, _log_pair(n_causes)))
    return weighted


def _grouped(posterior: Sequence[tuple[Hypothesis, float]], groups: Sequence[tuple[str, ...]]) -> tuple[Cause, ...]:
    """Hypotheses with their ln probabilities, merged by ambiguity group, most probable first.

    The order is right also among causes so improbable that their probability is 0.
    """
    group_of = {name: k for k, group in enumerate(groups) for name in group}
    merged: dict[tuple[object, ...], list[tuple[Hypothesis, float]]] = {}
    for h, x in posterior:
        key = tuple(sorted(str(group_of.get(n, n)) for n in h.effects))
        merged.setdefault(key, []).append((h, x))
    causes = []
    for members in merged.values():
        best = max(members, key=lambda m: m[1])[0]
        alternatives = tuple(groups[group_of[n]] if n in group_of else (n,) for n in best.effects)
        total = float(np.logaddexp.reduce([x for _, x in members]))
        causes.append((total, Cause(best.effects, alternatives, float(np.exp(total)), best.sizes, best.fitted)))
    return tuple(cause for _, cause in sorted(causes, key=lambda c: -c[0]))


def pairs(test: GapTest, leaders: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The most promising pairs, refitted. The score of each other effect at a leading one ranks them."""
    base, data = test.fit.best, test.fit.data
    group_of = {name: k for k, group in enumerate(test.groups) for name in group}
    candidates: dict[frozenset[str], tuple[float, tuple[str, str], np.ndarray]] = {}
    for h in leaders:
        at, first = h.fitted.response(data.f), h.effects[0]
        r, J, covariance = h.fitted.residual(data), h.fitted.jacobian(data), h.fitted.covariance
        for e in test.effects:
            signatures = [s for s in test.signatures if s.effect == e.name]
            if group_of.get(first) == group_of.get(e.name) or not signatures:
                continue
            model = library.apply(base.model, first, e.name)
            sizes = np.array([[s.sizes[k.name] for k in e.sizes] for s in signatures])
            both = np.concatenate([np.tile(h.fitted.theta, (len(sizes), 1)), sizes], axis=1)
            for size, response in zip(sizes, frf(model, both, data.f), strict=True):
                step = whiten(data.weight, response - at)
                slope = -covariance @ (J.T @ step)
                left = step + J @ slope  # what the parameters of the leading effect's model cannot compensate
                length = float(left @ left)
                if not length > NO_SIGNATURE or not np.isfinite(length):
                    continue
                factor = float(np.clip(left @ r / length, -FARTHEST, FARTHEST))
                gain = float(left @ r) ** 2 / length
                if not e.size.signed and factor < 0:
                    gain *= WRONG_SIGN_GAIN
                starts = []
                for k in (factor, 0.4 * factor, 2.0 * factor):
                    shifted = h.fitted.theta + np.clip(k, -1, 1) * slope
                    starts.append(np.concatenate([shifted, [size[0] * k], size[1:]]))
                names = frozenset((first, e.name))
                rank = gain + 2 * h.log_evidence
                if names not in candidates or rank > candidates[names][0]:
                    candidates[names] = (rank, (first, e.name), np.array(starts))
    chosen = sorted(candidates.values(), key=lambda c: -c[0])[:PARTNERS]
    return [together(base, data, names, starts) for _, names, starts in chosen]


def _unknown(
    none: Hypothesis,
    leaders: Sequence[Hypothesis],
    test: GapTest,
    n_causes: int,
) -> list[tuple[float, dict[str, float]]]:
    """(ln(prior times evidence), shares of the locations) of the unknown added to the base model and to each leader."""
    out = []
    data, unstructured, change = test.fit.data, test.detection.unstructured, _any_change(test.contrasts)
    added_to = [(none, test.scores, np.log(UNKNOWN))]
    added_to += [(h, Scores(h.fitted, data, [], []), np.log(BESIDE / n_causes)) for h in leaders]
    for h, at, weight in added_to:
        scored = at(h.fitted.free_residual(data))
        smooth = np.log(1 - UNSTRUCTURED_SHARE) + float(scored.unknown[0])
        scattered = np.log(UNSTRUCTURED_SHARE) + float(unstructured.log_factor(np.array(h.fitted.chi2)))
        log = h.log_evidence + weight + smooth
        plain, free = scored.plain[:, 0], scored.free[:, 0]
        terms = [(x - np.log(2 * len(plain)), p) for x, (_, p, _) in zip(plain, at.plain, strict=True)]
        terms += [(x - np.log(2 * len(free)), f.locations) for x, f in zip(free, at.families, strict=True)]
        share = np.exp(np.array([x for x, _ in terms]) - float(scored.unknown[0]))
        locations: dict[str, float] = {}
        for s, (_, where) in zip(share / share.sum(), terms, strict=True):
            place = where[0] if len(where) == 1 else ""
            locations[place] = locations.get(place, 0.0) + float(s)
        out.append((log, locations))
        out.append((h.log_evidence + weight + scattered + change, {"": 1.0}))
    return out


def _scattered(effect: Effect, fitted: Fitted, unstructured: UnstructuredResidual) -> float:
    """ln Bayes factor of an effect from the energy that it scatters between lines; 0 for one that scatters none."""
    if not effect.scatters:
        return 0.0
    scattered = float(unstructured.log_factor(np.array(fitted.chi2)))
    return float(np.logaddexp(np.log(1 - SCATTERS), np.log(SCATTERS) + scattered))


def _any_change(contrasts: Sequence[Contrast]) -> float:
    """ln Bayes factor of a nonlinearity outside the library from all comparisons of amplitudes.

    With half of the probability it changes the gains, in either direction; the library knows effects of both.
    """
    factors = [k.log_factor for c in contrasts if c.kind == "amplitude" for k in c.changes]
    if not factors:
        return 0.0
    return float(np.logaddexp(0.0, np.logaddexp.reduce(factors) - np.log(len(factors))) - np.log(2))
