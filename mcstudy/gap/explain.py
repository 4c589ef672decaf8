"""Which effect: the posterior over none, every effect, pairs, amplitude dependence, drift and the unknown.

Prior: `NONE` that nothing is missing, `SINGLE` shared by the causes of the library, `PAIR` by their pairs, `UNKNOWN`
that the cause is not in the library, `BESIDE` that it is not and a named effect takes what looks like it. Effects
that this recording cannot tell apart (`mcstudy.gap.signatures`) are one group with one probability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import logsumexp

from mcstudy.gap import effects as library
from mcstudy.gap.contrasts import Contrast
from mcstudy.gap.declare import Effect
from mcstudy.gap.evidence import Hypothesis, SizeEstimate, single, together
from mcstudy.gap.fitting import Data, Fitted, whiten
from mcstudy.gap.rough import Rough
from mcstudy.gap.scores import Scores
from mcstudy.gap.signatures import Signature
from mcstudy.gap.summary import Summary
from mcstudy.stance.response import frf

NONE, SINGLE, PAIR, UNKNOWN, BESIDE = 0.30, 0.52, 0.03, 0.11, 0.04

ROUGH = 0.25
"""Share of the unknown that is smooth in nothing (`mcstudy.gap.rough`)."""

LEADERS = 3
"""Leading single effects beside which others, and the unknown, are tried."""

PARTNERS = 10
"""Pairs that are refitted."""


@dataclass(frozen=True)
class Cause:
    """Effects that act together, one or two, each standing for its ambiguity group.

    Attributes
    ----------
    effects: the most probable member of every group. alternatives: all members, per effect. probability: of the group.
    sizes: of ``effects``. fitted: the refitted model.
    """

    effects: tuple[str, ...]
    alternatives: tuple[tuple[str, ...], ...]
    probability: float
    sizes: tuple[SizeEstimate, ...]
    fitted: Fitted = field(repr=False)


@dataclass(frozen=True, repr=False)
class Explanation(Summary):
    """The posterior: named ``causes`` by falling probability, and the probabilities of ``none`` and ``unknown``.

    ``unknown_places``: share of the unknown by place, "" for what cannot be placed. ``hypotheses``: every refitted
    hypothesis with its posterior probability.
    """

    causes: tuple[Cause, ...]
    none: float
    unknown: float
    unknown_places: dict[str, float]
    hypotheses: tuple[tuple[Hypothesis, float], ...]

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        leading = [(" and ".join(c.effects), c.probability) for c in self.causes[:3]]
        entries = [*leading, ("outside the library", self.unknown), ("no missing effect", self.none)]
        return [(name, f"{100 * p:.0f} %") for name, p in entries]


def explain(
    base: Fitted,
    minima: np.ndarray,
    data: Data,
    effects: Sequence[Effect],
    found: Sequence[Signature],
    groups: Sequence[tuple[str, ...]],
    scores: Scores,
    rough: Rough,
    contrasts: Sequence[Contrast],
) -> Explanation:
    """The posterior for one recording; effects also start from the lowest ``minima`` (K, P) of the base model."""
    residual = base.residual(data)
    none = Hypothesis((), base.log_evidence, base)
    of = {e.name: [s for s in found if s.effect == e.name] for e in effects}
    singles = [single(base, minima, data, e.name, of[e.name], residual) for e in effects]
    families: dict[str, int] = {}
    for e in effects:
        families[e.cause] = families.get(e.cause, 0) + 1
    changes = [(c, k) for c in contrasts for k in c.changes]
    n_causes = len(families) + len(changes)
    weighted: list[tuple[Hypothesis, float]] = [(none, np.log(NONE))]
    for h, e in zip(singles, effects, strict=True):
        weighted.append((h, np.log(SINGLE / n_causes / families[e.cause])))
    leaders = sorted(singles, key=lambda h: -h.log_evidence)[:LEADERS]
    group_of = {n: k for k, g in enumerate(groups) for n in g}
    n_pairs = n_causes * (n_causes - 1) / 2
    if leaders and leaders[0].log_evidence + np.log(SINGLE / n_causes) > none.log_evidence + np.log(NONE) - 3:
        for h in pairs(data, base, leaders, effects, of, group_of):
            weighted.append((h, np.log(PAIR / n_pairs)))
    for c, k in changes:
        size = library.effect(k.effect).size
        estimate = k.gain if k.size is None else k.size
        se = k.se if k.size is None else abs(k.size / k.gain) * k.se if k.gain else k.se
        name = f"change of active gains between {c.kind}s" if k.size is None else size.name
        sizes = (SizeEstimate(name, estimate, se, estimate - 1.96 * se, estimate + 1.96 * se, size.unit),)
        weighted.append(
            (
                Hypothesis((k.effect,), base.log_evidence + k.log_factor, base, sizes),
                np.log(SINGLE / n_causes),
            )
        )
        for h in leaders[:1]:
            weighted.append(
                (
                    Hypothesis((*h.effects, k.effect), h.log_evidence + k.log_factor, h.fitted, (*h.sizes, *sizes)),
                    np.log(PAIR / n_pairs),
                )
            )
    log_named = np.array([h.log_evidence + w for h, w in weighted])
    strange = _unknown(none, leaders, data, scores, rough, n_causes)
    log_unknown = np.array([x for x, _ in strange])
    total = logsumexp(np.concatenate([log_named, log_unknown]))
    probability = np.exp(log_named - total)
    unknown_places: dict[str, float] = {}
    for x, places in strange:
        for place, share in places.items():
            unknown_places[place] = unknown_places.get(place, 0.0) + float(np.exp(x - total)) * share
    return Explanation(
        causes=_grouped([(h, p) for (h, _), p in zip(weighted[1:], probability[1:], strict=True)], groups, group_of),
        none=float(probability[0]),
        unknown=float(np.exp(logsumexp(log_unknown) - total)),
        unknown_places=unknown_places,
        hypotheses=tuple((h, float(p)) for (h, _), p in zip(weighted, probability, strict=True)),
    )


def _grouped(
    posterior: Sequence[tuple[Hypothesis, float]], groups: Sequence[tuple[str, ...]], group_of: dict[str, int]
) -> tuple[Cause, ...]:
    """Hypotheses merged by ambiguity group, most probable first."""
    merged: dict[tuple[object, ...], list[tuple[Hypothesis, float]]] = {}
    for h, p in posterior:
        key = tuple(sorted(str(group_of.get(n, n)) for n in h.effects))
        merged.setdefault(key, []).append((h, p))
    causes = []
    for members in merged.values():
        best = max(members, key=lambda m: m[1])[0]
        alternatives = tuple(groups[group_of[n]] if n in group_of else (n,) for n in best.effects)
        causes.append(Cause(best.effects, alternatives, float(sum(p for _, p in members)), best.sizes, best.fitted))
    return tuple(sorted(causes, key=lambda c: -c.probability))


def pairs(
    data: Data,
    base: Fitted,
    leaders: Sequence[Hypothesis],
    effects: Sequence[Effect],
    of: dict[str, list[Signature]],
    group_of: dict[str, int],
) -> list[Hypothesis]:
    """The most promising pairs, refitted: what each other effect adds to a leading one, by its score there."""
    candidates: dict[frozenset[str], tuple[float, tuple[str, str], np.ndarray]] = {}
    for h in leaders:
        P = h.fitted.theta.size
        r, J = h.fitted.residual(data), h.fitted.jacobian(data)
        for e in effects:
            first = h.effects[0]
            if group_of.get(first) == group_of.get(e.name):
                continue
            model = library.apply(base.model, first, e.name)
            for s in of[e.name]:
                own = np.array([s.sizes[k.name] for k in e.sizes])
                step = whiten(
                    data.weight,
                    frf(model, np.concatenate([h.fitted.theta, own]), data.f) - h.fitted.response(data.f),
                )
                slope = -h.fitted.covariance @ (J.T @ step)
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
    none: Hypothesis, leaders: Sequence[Hypothesis], data: Data, scores: Scores, rough: Rough, n_causes: int
) -> list[tuple[float, dict[str, float]]]:
    """(ln weight times evidence, shares of the places) of the unknown beside the base model and the leaders."""
    out = []
    settings = [(none, scores, np.log(UNKNOWN))]
    for h in leaders:
        settings.append((h, Scores(h.fitted, data, [], []), np.log(BESIDE / n_causes)))
    for h, at, weight in settings:
        scored = at(h.fitted.free_residual(data))
        smooth = np.log(1 - ROUGH) + float(scored.unknown[0])
        scattered = np.log(ROUGH) + float(rough.log_factor(np.array(h.fitted.chi2)))
        log = h.log_evidence + weight + smooth
        plain, free = scored.plain[:, 0], scored.free[:, 0]
        terms = [(x - np.log(2 * len(plain)), p) for x, (_, p, _) in zip(plain, at.plain, strict=True)]
        terms += [(x - np.log(2 * len(free)), f.places) for x, f in zip(free, at.families, strict=True)]
        share = np.exp(np.array([x for x, _ in terms]) - float(scored.unknown[0]))
        places: dict[str, float] = {}
        for s, (_, where) in zip(share / share.sum(), terms, strict=True):
            place = where[0] if len(where) == 1 else ""
            places[place] = places.get(place, 0.0) + float(s)
        out.append((log, places))
        out.append((h.log_evidence + weight + scattered, {"": 1.0}))
    return out
