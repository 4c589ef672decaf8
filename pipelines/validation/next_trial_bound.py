"""What an ideal method could reach in the blind test of `next_trial.py`.

    python pipelines/validation/next_trial.py pipelines/validation/next_trial.toml -o results/next_trial
    python pipelines/validation/next_trial_bound.py pipelines/validation/next_trial.toml results/next_trial

For every case that was run, and the trials that followed in it, two ideal methods that know the noise, the geometry of
the body around its true parameters (the values of these are unknown to them, with the weak prior of a diagnosis) and
how every effect changes the responses:

- The first one also knows the size of every effect, and that one of them or nothing is there
  (`mcstudy_challenge.scores.oracle`). On average no method that does not know the answer can be better.
- The second one must expect what a diagnosis must expect: sizes that it does not know (half a normal distribution whose
  standard deviation is the size in this test), two effects at once, and causes outside the library (free torques and
  sensor errors, `mcstudy.gap.candidates.free_deviations`, as visible in the first recording as the effects), with the
  shares of the challenge of the diagnosis. Its forms of the effects are the declared ones, and it is linear in their
  sizes.

Beside them stands what the diagnosis reached in the same cases. Every condition is that of the cases that were given
these trials. ``bounds.jsonl`` keeps every case; a stopped command resumes.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from mcstudy_challenge.challenge_file import read_challenge
from mcstudy_challenge.scores.oracle import FLOOR, SET, Ceiling, Classifier
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr, logsumexp

from mcstudy.effect_library.library import LIBRARY, apply
from mcstudy.fitting.penalised import Fitter, whiten
from mcstudy.gap.candidates.free_deviations import free_torques
from mcstudy.gap.candidates.signatures import Signature, applicable, signatures
from mcstudy.gap.questions.other_forms import OTHER
from mcstudy.gap.trial_planning.trials import PlannedTrial
from mcstudy.gap.trial_planning.twins import at_own_responses
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.information import expected_line_covariance
from mcstudy.stance.joint import joined, under
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf, frf_jacobian
from mcstudy.streams import stream
from mcstudy.text_tables import table

sys.path.insert(0, str(Path(__file__).parent))
from next_trial import AGAIN, CONDITIONS, drawn, loss, mean, same_cause

CHALLENGE = Path(__file__).parents[1] / "gap_challenge.toml"

DRAWS = 200
"""Draws of noise for each case and condition."""


def covariance(trial: PlannedTrial, theta: np.ndarray) -> np.ndarray:
    """(N, 2, 2) of the errors of the responses of a planned trial, from theory."""
    seconds = trial.trials * (trial.cycles - trial.discard) * trial.duration_s / (trial.trials * trial.cycles)
    model = under(two_segment(), trial.kind, Body())
    return expected_line_covariance(model, theta, SensorNoise(), trial.f, trial.drive, seconds)


@dataclass(frozen=True)
class Seen:
    """What trials show together, whitened, after all parameters of the base model are fitted again.

    Attributes
    ----------
    x: (K, M) changes by every signature, at the size that it has in this test.
    shapes: for every signature (F, M) changes with its shape parameters, by a quarter of their usual range each.
    forms: for every signature (F, M) changes with the constants of its form, by the standard deviations of their prior.
    nominal: for every signature (M,) the change from its declared form to the mean of that prior.
    outside: columns (M, C) of every family of causes outside the library.
    """

    x: np.ndarray
    shapes: tuple[np.ndarray, ...]
    forms: tuple[np.ndarray, ...]
    nominal: tuple[np.ndarray, ...]
    outside: tuple[np.ndarray, ...]


def seen(theta: np.ndarray, trials: Sequence[PlannedTrial], found: Sequence[Signature]) -> Seen:
    """The changes in all trials together."""
    several = [under(two_segment(), t.kind, Body()) for t in trials]
    joint = opened(joined(several, [t.f.size for t in trials]) if len(several) > 1 else several[0])
    f, C = np.concatenate([t.f for t in trials]), np.concatenate([covariance(t, theta) for t in trials])
    rest, data = at_own_responses(joint, theta, f, C)
    clean, P = data.with_y(rest.response(f)), theta.size
    Q = np.linalg.qr(rest.jacobian(clean))[0]
    out: list[tuple[np.ndarray, ...]] = []
    for s in found:
        e, model = LIBRARY[s.effect], apply(joint, s.effect)
        fitter = Fitter(model, weak_prior(model, joint), f)
        start = np.array([[*(theta - s.shift), *(s.sizes[n] for n in model.names[P:])]])
        lower, upper = fitter.model.lower[None].copy(), fitter.model.upper[None].copy()
        lower[:, P:] = upper[:, P:] = start[:, P:]
        at = fitter.fits(fitter.packed(clean), start, lower=lower, upper=upper).estimate[0]
        x = whiten(clean.weight, frf(fitter.model, at, f) - clean.y)
        every = np.append(at, [c.nominal for c in e.forms])
        slopes = whiten(clean.weight, frf_jacobian(apply(joint, e.name, opened=[e.name]), every, f)[1][..., P + 1 :])
        shape, form = np.split((slopes - Q @ (Q.T @ slopes)).T, [len(e.sizes) - 1])
        width = np.array([(k.published[1] - k.published[0]) / 4 for k in e.sizes[1:]])
        prior = np.array([c.prior for c in e.forms]).reshape(-1, 2)
        away = (prior[:, 0] - [c.nominal for c in e.forms]) @ form
        out.append((x, shape * width[:, None], form * prior[:, 1:], away))
    x, shapes, forms, nominal = zip(*out, strict=True)
    columns = (family.columns for family in free_torques(rest, clean))
    return Seen(np.array(x), shapes, forms, nominal, tuple(c - Q @ (Q.T @ c) for c in columns))


def ceiling(x: np.ndarray, found: Sequence[Signature], given: dict[str, Any], true: int, seed: int) -> Ceiling:
    """The figures of the ideal method for signature ``true`` of residuals ``x`` (K, M)."""
    size = np.linalg.norm(x, axis=1)
    unit = x / size[:, None]
    causes = [tuple(sorted(same_cause(s.effect))) for s in found]
    named = list(dict.fromkeys(causes))
    each = np.array([sum(t.effect == s.effect for t in found) for s in found])
    effects = np.array([len({s.effect for s, c in zip(found, causes, strict=True) if c == n}) for n in named])
    group = np.array([named.index(c) for c in causes])
    known = given["cases"] / (given["cases"] + given["sound"])
    method = Classifier(
        unit @ unit.T,
        group,
        np.array([1 - known, *(known * effects / effects.sum())]),
        1 / (each * effects[group]),
        size[:, None],
        np.ones((len(found), 1)),
    )
    return method.ceiling(stream(seed, "next trial bound"), true, float(size[true]), n=DRAWS, threshold=0.0)


@dataclass(frozen=True)
class Fair:
    """Expected figures of the second ideal method on one case; see `Ceiling`. ``outside``: what it leaves for those."""

    probability: float
    log_loss: float
    set_size: float
    outside: float


def fair(now: Seen, first: Seen, found: Sequence[Signature], given: dict[str, Any], true: int, seed: int) -> Fair:
    """The figures of the second ideal method for signature ``true``; ``first``: what the first recording shows."""
    mix = read_challenge(CHALLENGE).series["main"].mix
    rng = stream(seed, "next trial fair bound")
    y = now.x[true][:, None] + rng.standard_normal((now.x.shape[1], DRAWS))
    causes = [tuple(sorted(same_cause(s.effect))) for s in found]
    named = list(dict.fromkeys(causes))
    group = np.array([named.index(c) for c in causes])
    each = np.array([sum(t.effect == s.effect for t in found) for s in found])
    effects = np.array([len({s.effect for s, c in zip(found, causes, strict=True) if c == n}) for n in named])
    share = 1 / (each * effects[group])
    two = np.array(list(combinations(range(len(found)), 2)))
    two = two[group[two[:, 0]] != group[two[:, 1]]]
    pairs = np.unique(np.sort(group[two], axis=1), axis=0, return_inverse=True)[1].ravel()
    nothing = np.full((1, DRAWS), np.log(1 - mix.known - mix.pair - mix.outsider))
    alone = np.array([one_effect(now, k, y) for k in range(len(found))])
    single = _summed(alone + np.log(mix.known / len(named) * share)[:, None], group)
    weight = mix.pair / (pairs.max() + 1) * share[two].prod(axis=1)
    double = _summed(two_effects(now, y, two) + np.log(weight)[:, None], pairs)
    variances = [given["delta"] ** 2 / (c**2).sum() for c in first.outside]
    families = [smooth(c, v, y) for c, v in zip(now.outside, variances, strict=True)]
    outside = logsumexp(families, axis=0)[None] - np.log(len(families)) + np.log(mix.outsider)
    log = np.concatenate([single, nothing, outside, double])
    p = np.exp(log - logsumexp(log, axis=0))
    own = p[group[true]]
    size = 1 + (np.cumsum(-np.sort(-p, axis=0), axis=0) < SET).sum(axis=0)
    loss = -np.log(np.maximum(own, FLOOR))
    return Fair(float(own.mean()), float(loss.mean()), float(size.mean()), float(p[len(named) + 1].mean()))


def _summed(log: np.ndarray, group: np.ndarray) -> np.ndarray:
    """ln of the sums (G, D) over the rows (K, D) of each group."""
    return np.array([logsumexp(log[group == g], axis=0) for g in range(group.max() + 1)])


def one_effect(now: Seen, k: int, y: np.ndarray) -> np.ndarray:
    """ln Bayes factor (D,) of data ``y`` (M, D) for signature ``k``, in its declared or in another form."""
    declared = np.concatenate([now.x[k : k + 1], now.shapes[k]])
    if not len(now.forms[k]):
        return one_form(declared, y, np.zeros(len(y)))
    other = one_form(np.concatenate([declared, now.forms[k]]), y, now.nominal[k])
    return np.asarray(np.logaddexp(one_form(declared, y, np.zeros(len(y))) + np.log(1 - OTHER), other + np.log(OTHER)))


def one_form(columns: np.ndarray, y: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """ln Bayes factor (D,) of data ``y`` (M, D), with this ``mean`` (M,) and normal factors of ``columns`` (k, M).

    The factor of the first column is positive.
    """
    covariance = np.linalg.inv(columns @ columns.T + np.eye(len(columns)))
    z = columns @ (y - mean[:, None])
    at = covariance @ z
    positive = log_ndtr(at[0] / np.sqrt(covariance[0, 0])) + np.log(2)
    return np.asarray(
        0.5 * (z * at).sum(axis=0) + 0.5 * np.linalg.slogdet(covariance)[1] + positive + mean @ y - 0.5 * mean @ mean
    )


def two_effects(now: Seen, y: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """ln Bayes factors (S, D) of data ``y`` (M, D) for ``pairs`` (S, 2) of signatures in their declared forms.

    The two sizes are taken to be positive independently of each other.
    """
    K, most = len(now.x), max(map(len, now.shapes))
    padded = [np.concatenate([c, np.zeros((most - len(c), len(y)))]) for c in now.shapes]
    columns = np.concatenate([now.x, *padded])
    shapes = K + most * pairs[:, :, None] + np.arange(most)
    members = np.concatenate([pairs, shapes.reshape(len(pairs), -1)], axis=1)
    gram, z = (columns @ columns.T)[members[:, :, None], members[:, None, :]], (columns @ y)[members]
    covariance = np.linalg.inv(gram + np.eye(members.shape[1]))
    at = covariance @ z
    sizes = at[:, :2] / np.sqrt(np.einsum("sii->si", covariance))[:, :2, None]
    positive = (log_ndtr(sizes) + np.log(2)).sum(axis=1)
    return np.asarray(0.5 * (z * at).sum(axis=1) + 0.5 * np.linalg.slogdet(covariance)[1][:, None] + positive)


def smooth(columns: np.ndarray, variance: float, y: np.ndarray) -> np.ndarray:
    """ln Bayes factor (D,) of data ``y`` (M, D) for ``columns`` (M, C) with normal coefficients of this variance."""
    precision = columns.T @ columns + np.eye(columns.shape[1]) / variance
    lower = np.linalg.cholesky(precision)
    part = solve_triangular(lower, columns.T @ y, lower=True)
    determinant = 2 * np.log(np.diag(lower)).sum() + columns.shape[1] * np.log(variance)
    return np.asarray(0.5 * (part**2).sum(axis=0) - 0.5 * determinant)


def bounds(given: dict[str, Any], row: dict[str, Any]) -> dict[str, tuple[Ceiling, Fair]]:
    """Both ideal methods after each of the trials that a case was given."""
    theta, causes, first = drawn(given, row["case"])
    assert isinstance(causes, tuple)
    (cause,) = causes
    base = opened(two_segment())
    found = signatures(*at_own_responses(base, theta, first.f, covariance(first, theta)), applicable(base))
    found = [s for s in found if abs(s.delta / given["delta"] - 1) < 0.25]
    true = next(k for k, s in enumerate(found) if s.effect == cause.effect and s.sizes == cause.sizes)
    plans: dict[str, list[PlannedTrial]] = {"first": []}
    plans |= {n: [replace(first, trials=times * first.trials)] for n, times in AGAIN.items()}
    plans |= {n: [PlannedTrial(**t) for t in plan] for n, plan in row["plans"].items()}
    both = {n: seen(theta, [first, *plan], found) for n, plan in plans.items() if n in row}
    alone, by = both["first"], (found, given, true, row["case"])
    return {n: (ceiling(now.x, *by), fair(now, alone, *by)) for n, now in both.items()}


def read(both: dict[str, Any]) -> dict[str, tuple[Ceiling, Fair]]:
    """The `bounds` of a case as they are kept."""
    return {name: (Ceiling(**one), Fair(**two)) for name, (one, two) in both.items()}


def main(arguments: list[str] | None = None) -> None:
    """Print the bound and what the diagnosis reached."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("results", type=Path)
    args = parser.parse_args(arguments)
    given = tomllib.loads(args.file.read_text(encoding="utf-8"))
    rows = [json.loads(x) for x in (args.results / "cases.jsonl").read_text(encoding="utf-8").splitlines()]
    rows = [r for r in rows if r["kind"] == "effect" and "first" in r]
    kept = args.results / "bounds.jsonl"
    lines = kept.read_text(encoding="utf-8").splitlines() if kept.exists() else []
    known = {r["case"]: read(r["bounds"]) for r in map(json.loads, lines)}
    for r in rows:
        if r["case"] not in known:
            known[r["case"]] = both = bounds(given, r)
            plain = {n: [asdict(x) for x in two] for n, two in both.items()}
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"case": r["case"], "bounds": plain}) + "\n")
    found = [known[r["case"]] for r in rows]
    print(
        f"{len(rows)} cases; means with 95 % bootstrap intervals over cases; ideal 1 knows sizes, 2 expects all kinds"
    )
    print(text(rows, found))


def text(rows: Sequence[dict[str, Any]], found: Sequence[dict[str, tuple[Ceiling, Fair]]]) -> str:
    """The table, and the cases in which the diagnosis is furthest from the second ideal method."""
    header = (
        "after",
        "cases",
        *(h for name in ("P(true)", "log loss (nat)", "95 % set") for h in (name, "ideal 1", "ideal 2")),
    )
    lines = []
    for name in CONDITIONS:
        here = [(r[name], b[name]) for r, b in zip(rows, found, strict=True) if name in r]
        if not here:
            continue
        own, both = zip(*here, strict=True)
        one, two = zip(*both, strict=True)
        cells = [[o["p"] for o in own], [b.probability for b in one], [b.probability for b in two]]
        cells += [[loss(o) for o in own], [b.log_loss for b in one], [b.log_loss for b in two]]
        cells += [[o["set"] for o in own], [b.set_size for b in one], [b.set_size for b in two]]
        lines.append([name, str(len(here)), *map(mean, cells)])
    out = [table(header, lines)]
    outside = mean([b["chosen"][1].outside for b in found])
    out.append(f"after chosen, ideal 2 leaves {outside} for a cause outside the library")
    out.append("largest differences after the chosen trials: P(true) of the diagnosis, of ideal 2, effect, case")
    after = [(b["chosen"][1].probability, r["chosen"]["p"], r) for r, b in zip(rows, found, strict=True)]
    for bound, p, r in sorted(after, key=lambda x: x[1] - x[0])[:12]:
        out.append(f"{p:.2f} {bound:.2f} {r['cause']} {r['case']}")
    return "\n".join(out)


if __name__ == "__main__":
    main()
