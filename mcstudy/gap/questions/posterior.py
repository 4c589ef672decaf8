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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mcstudy.effect_library import library
from mcstudy.effect_library.effect import Effect
from mcstudy.errors import InputError
from mcstudy.fitting.penalised import Fitted, whiten
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.scores import Scores
from mcstudy.gap.candidates.signatures import Signature
from mcstudy.gap.candidates.unstructured import Unstructured
from mcstudy.gap.questions.contrasts import Contrast
from mcstudy.gap.questions.departure import with_departures
from mcstudy.gap.questions.evidence import Hypothesis, SizeEstimate, possible, single, together
from mcstudy.gap.questions.interval import Interval
from mcstudy.gap.questions.mislabelling import Mislabelled
from mcstudy.gap.questions.other_forms import in_other_forms
from mcstudy.short_repr import Summary
from mcstudy.stance.response import frf

NONE = 0.30
"""Prior probability that no effect is missing: an assumption, no measurement of real bodies.

It equals the share of cases without a missing effect in the benchmark of the diagnosis (pipelines/gap_challenge.toml),
whose calibration is therefore that of a prior that is right. ``--prior-none`` replaces it; a score of the
benchmark says what the same answers are worth where the share is 0.1 or 0.5 (`other_shares`).
"""

SINGLE, PAIR, UNKNOWN, BESIDE = 0.52, 0.03, 0.11, 0.04
"""Prior probabilities of the other kinds of hypotheses (`MEANINGS`): assumptions as well.

One effect is taken to be most likely by far, two at once and a cause beside an effect to be rare, and a cause outside
the library to be a fifth as likely as one in it.
"""

MEANINGS = {
    "none": "no missing effect",
    "single": "one effect of the library",
    "pair": "two effects",
    "unknown": "a cause outside the library",
    "beside": "such a cause beside an effect",
}
"""Kinds of hypotheses with a prior probability, in words."""

UNSTRUCTURED_SHARE = 0.25
"""Share of the unknown that is unstructured (`mcstudy.gap.candidates.unstructured`)."""

SCATTERS = 0.5
"""Probability that an effect that is nonlinear within a trial scatters visible energy between the lines."""

LEADERS = 3
"""Number of leading single effects that are combined with other effects and with the unknown."""

PARTNERS = 10
"""Number of pairs that are refitted."""


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

    @property
    def mechanism(self) -> bool:
        """Whether it is an effect, or two, that changes the mean response of the body."""
        return all(n in library.LIBRARY and library.effect(n).kind == "linear" for n in self.effects)

    def changes(self, base: Fitted) -> bool:
        """Whether its model is another one than that of ``base``, so that it changes the mean response."""
        return self.fitted.model.names != base.model.names


@dataclass(frozen=True, repr=False)
class Explanation(Summary):
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

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        leading = [(" and ".join(c.effects), c.probability) for c in self.causes[:3]]
        entries = [*leading, ("outside the library", self.unknown), ("no missing effect", self.none)]
        return [(name, f"{100 * p:.0f} %") for name, p in entries]


def prior(none: float = NONE) -> dict[str, float]:
    """Prior probability of each of `MEANINGS`, with ``none`` that of no missing effect; the others keep their ratios.

    Raises `InputError` unless it is above 0 and below 1.
    """
    if not (isinstance(none, int | float) and 0 < none < 1):
        raise InputError(f"prior_none: expected a probability above 0 and below 1, got {none!r}")
    others = np.array([SINGLE, PAIR, UNKNOWN, BESIDE]) * ((1 - none) / (1 - NONE))
    return dict(zip(MEANINGS, (float(none), *others.tolist()), strict=True))


def explain(
    base: Fitted,
    minima: np.ndarray,
    data: Data,
    effects: Sequence[Effect],
    found: Sequence[Signature],
    groups: Sequence[tuple[str, ...]],
    scores: Scores,
    unstructured: Unstructured,
    contrasts: Sequence[Contrast],
    mislabelled: Callable[[float], Sequence[Mislabelled]] | None = None,
    prior_none: float = NONE,
) -> Explanation:
    """The posterior for one recording; effects are also fitted from the lowest ``minima`` (K, P) of the base model.

    ``mislabelled``: how the recording may be mislabelled, from the log evidence and prior of the best of all other
    hypotheses. A hypothesis that no body can have (`possible`) has no weight. ``prior_none``: see `prior`.
    """
    log_odds = float(np.log((1 - NONE) * prior_none / (1 - prior_none)))  # of no missing effect, beside all others
    residual = base.residual(data)
    none = Hypothesis((), base.log_evidence, base)
    of = {e.name: [s for s in found if s.effect == e.name] for e in effects}
    declared = [single(base, minima, data, e.name, of[e.name], residual) for e in effects]
    singles = in_other_forms(base, data, none, declared)
    families: dict[str, int] = {}
    for e in effects:
        families[e.cause] = families.get(e.cause, 0) + 1
    changes = [(c, k) for c in contrasts for k in c.changes]
    n_causes = len(families) + len(changes)
    weighted: list[tuple[Hypothesis, float]] = [(none, log_odds)]
    for h, e in zip(with_departures(base, data, singles), effects, strict=True):
        weighted.append((h, np.log(SINGLE / n_causes / families[e.cause])))
    # Also leaders that no body can have: what is beside them, or in a pair, may be possible.
    leaders = sorted(singles, key=lambda h: -h.log_evidence)[:LEADERS]
    group_of = {n: k for k, g in enumerate(groups) for n in g}
    n_pairs = n_causes * (n_causes - 1) / 2
    # With the usual prior, whatever is given, so that the Bayes factor is the same under every prior.
    if leaders and leaders[0].log_evidence + np.log(SINGLE / n_causes) > none.log_evidence + np.log(NONE) - 3:
        as_declared = {h.effects: h for h in declared}
        for h in pairs(data, base, [as_declared[h.effects] for h in leaders], effects, of, group_of):
            weighted.append((h, np.log(PAIR / n_pairs)))
    for c, k in changes:
        size = library.effect(k.effect).size
        estimate = k.gain if k.size is None else k.size
        se = k.se if k.size is None else abs(k.size / k.gain) * k.se if k.gain else k.se
        name = f"change of active gains between {c.kind}s" if k.size is None else size.name
        unit = "" if k.size is None else size.unit
        sizes = (SizeEstimate(name, estimate, se, estimate - 1.96 * se, estimate + 1.96 * se, unit),)
        own = Hypothesis((k.effect,), base.log_evidence + k.log_factor + _scattered(k.effect, base, unstructured), base)
        weighted.append((replace(own, sizes=sizes), np.log(SINGLE / n_causes)))
        for h in leaders[:1]:
            evidence = h.log_evidence + k.log_factor + _scattered(k.effect, h.fitted, unstructured)
            both = Hypothesis((*h.effects, k.effect), evidence, h.fitted, (*h.sizes, *sizes))
            weighted.append((both, np.log(PAIR / n_pairs)))
    log_named = [h.log_evidence + w if possible(h, base) else -np.inf for h, w in weighted]
    readings = mislabelled(max(log_named)) if mislabelled else ()
    weighted += [(m.hypothesis, m.log_weight) for m in readings]
    log_named += [
        m.hypothesis.log_evidence + m.log_weight if possible(m.hypothesis, base) else -np.inf for m in readings
    ]
    strange = _unknown(none, leaders, data, scores, unstructured, n_causes, _any_change(contrasts))
    log_unknown = np.array([x for x, _ in strange])
    total = np.logaddexp.reduce(np.concatenate([log_named, log_unknown]))
    probability = np.exp(np.array(log_named) - total)
    unknown_locations: dict[str, float] = {}
    for x, locations in strange:
        for place, share in locations.items():
            unknown_locations[place] = unknown_locations.get(place, 0.0) + float(np.exp(x - total)) * share
    posterior = [(h, x) for (h, _), x in zip(weighted[1:], np.array(log_named[1:]) - total, strict=True)]
    advice = {m.hypothesis.effects: m.advice for m in readings}
    others = float(np.logaddexp.reduce(np.concatenate([log_named[1:], log_unknown])))
    return Explanation(
        causes=tuple(replace(c, advice=advice.get(c.effects, "")) for c in _grouped(posterior, groups, group_of)),
        none=float(probability[0]),
        unknown=float(np.exp(np.logaddexp.reduce(log_unknown) - total)),
        unknown_locations=unknown_locations,
        hypotheses=tuple((h, float(p)) for (h, _), p in zip(weighted, probability, strict=True)),
        none_log_factor=float(log_named[0]) - log_odds + float(np.log(1 - NONE)) - others,
    )


def _grouped(
    posterior: Sequence[tuple[Hypothesis, float]], groups: Sequence[tuple[str, ...]], group_of: dict[str, int]
) -> tuple[Cause, ...]:
    """Hypotheses with their ln probabilities, merged by ambiguity group, most probable first.

    The order is right also among causes so improbable that their probability is 0.
    """
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


def pairs(
    data: Data,
    base: Fitted,
    leaders: Sequence[Hypothesis],
    effects: Sequence[Effect],
    of: dict[str, list[Signature]],
    group_of: dict[str, int],
) -> list[Hypothesis]:
    """The most promising pairs, refitted. The score of each other effect at a leading one ranks them."""
    candidates: dict[frozenset[str], tuple[float, tuple[str, str], np.ndarray]] = {}
    for h in leaders:
        P, at = h.fitted.theta.size, h.fitted.response(data.f)
        r, J, covariance = h.fitted.residual(data), h.fitted.jacobian(data), h.fitted.covariance
        for e in effects:
            first = h.effects[0]
            if group_of.get(first) == group_of.get(e.name) or not of[e.name]:
                continue
            model = library.apply(base.model, first, e.name)
            sizes = np.array([[s.sizes[k.name] for k in e.sizes] for s in of[e.name]])
            both = np.concatenate([np.tile(h.fitted.theta, (len(sizes), 1)), sizes], axis=1)
            for own, response in zip(sizes, frf(model, both, data.f), strict=True):
                step = whiten(data.weight, response - at)
                slope = -covariance @ (J.T @ step)
                left = step + J @ slope
                length = float(left @ left)
                if not length > 1e-6 or not np.isfinite(length):
                    continue
                factor = float(np.clip(left @ r / length, -3, 3))
                gain = float(left @ r) ** 2 / length
                if not e.size.signed and factor < 0:
                    gain *= 0.2
                starts = []
                for k in (factor, 0.4 * factor, 2.0 * factor):
                    shifted = h.fitted.theta + np.clip(k, -1, 1) * slope
                    starts.append(np.concatenate([shifted, [own[0] * k], own[1:]]))
                key = frozenset((first, e.name))
                rank = gain + 2 * h.log_evidence
                if key not in candidates or rank > candidates[key][0]:
                    assert len(starts[0]) == P + len(own)
                    candidates[key] = (rank, (first, e.name), np.array(starts))
    chosen = sorted(candidates.values(), key=lambda c: -c[0])[:PARTNERS]
    return [together(base, data, names, starts) for _, names, starts in chosen]


def _unknown(
    none: Hypothesis,
    leaders: Sequence[Hypothesis],
    data: Data,
    scores: Scores,
    unstructured: Unstructured,
    n_causes: int,
    change: float,
) -> list[tuple[float, dict[str, float]]]:
    """(ln(prior times evidence), shares of the locations) of the unknown added to the base model and to each leader.

    ``change``: ln Bayes factor of an unknown nonlinearity from how the responses change with amplitude.
    """
    out = []
    settings = [(none, scores, np.log(UNKNOWN))]
    for h in leaders:
        settings.append((h, Scores(h.fitted, data, [], []), np.log(BESIDE / n_causes)))
    for h, at, weight in settings:
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


def _scattered(effect: str, fitted: Fitted, unstructured: Unstructured) -> float:
    """ln Bayes factor of an effect from the energy that it scatters between lines; 0 for one that scatters none."""
    if not library.effect(effect).scatters:
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
