"""What an ideal method could reach in the blind test of `next_trial.py`.

    python pipelines/examples/next_trial.py pipelines/examples/next_trial.toml -o results/next_trial
    python pipelines/examples/next_trial_bound.py pipelines/examples/next_trial.toml results/next_trial

For every case that was run, and the trials that followed in it: the Bayes classifier of `mcstudy.challenge.oracle`,
which knows the noise, the geometry of the body around its true parameters (the values of these are unknown to it, with
the weak prior of a diagnosis), how every effect of its size in this test changes the responses, and that there is one
of them or nothing. It expects neither a cause outside the library nor two effects at once. On average no method that
does not know the answer can be better. Beside it stands what the diagnosis reached in the same cases.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.challenge.oracle import Ceiling, Classifier
from mcstudy.effect_library.library import apply
from mcstudy.fitting.penalised import Fitter, whiten
from mcstudy.gap.candidates.signatures import Signature, applicable, signatures
from mcstudy.gap.fits.priors import opened, weak_prior
from mcstudy.gap.planned.trials import PlannedTrial
from mcstudy.gap.planned.twins import at_own_responses
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.information import expected_line_covariance
from mcstudy.stance.joint import joined, under
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.streams import stream
from mcstudy.text_tables import table

sys.path.insert(0, str(Path(__file__).parent))
from next_trial import AGAIN, CONDITIONS, drawn, loss, mean, same_cause

DRAWS = 200
"""Draws of noise for each case and condition."""


def covariance(trial: PlannedTrial, theta: np.ndarray) -> np.ndarray:
    """(N, 2, 2) of the errors of the responses of a planned trial, from theory."""
    seconds = trial.trials * (trial.cycles - trial.discard) * trial.duration_s / (trial.trials * trial.cycles)
    model = under(two_segment(), trial.kind, Body())
    return expected_line_covariance(model, theta, SensorNoise(), trial.f, trial.drive, seconds)


def residuals(theta: np.ndarray, trials: Sequence[PlannedTrial], found: Sequence[Signature]) -> np.ndarray:
    """(K, M) whitened changes by every signature in all trials together, after all other parameters are refitted."""
    several = [under(two_segment(), t.kind, Body()) for t in trials]
    joint = opened(joined(several, [t.f.size for t in trials]) if len(several) > 1 else several[0])
    f, C = np.concatenate([t.f for t in trials]), np.concatenate([covariance(t, theta) for t in trials])
    rest, data = at_own_responses(joint, theta, f, C)
    clean, out = data.with_y(rest.response(f)), []
    for s in found:
        model = apply(joint, s.effect)
        fitter = Fitter(model, weak_prior(model, joint), f)
        start = np.array([[*(theta - s.shift), *(s.sizes[n] for n in model.names[theta.size :])]])
        lower, upper = fitter.model.lower[None].copy(), fitter.model.upper[None].copy()
        lower[:, theta.size :] = upper[:, theta.size :] = start[:, theta.size :]
        at = fitter.fits(clean.packed, start, lower=lower, upper=upper).estimate[0]
        out.append(whiten(clean.weight, frf(fitter.model, at, f) - clean.y))
    return np.array(out)


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


def bounds(given: dict[str, Any], row: dict[str, Any]) -> dict[str, Ceiling]:
    """The ideal method after each of the trials of a case."""
    theta, cause, first = drawn(given, row["case"])
    assert isinstance(cause, Signature)
    base = opened(two_segment())
    found = signatures(*at_own_responses(base, theta, first.f, covariance(first, theta)), applicable(base))
    found = [s for s in found if abs(s.delta / given["delta"] - 1) < 0.25]
    true = next(k for k, s in enumerate(found) if s.effect == cause.effect and s.sizes == cause.sizes)
    plans: dict[str, list[PlannedTrial]] = {"first": []}
    plans |= {n: [replace(first, trials=times * first.trials)] for n, times in AGAIN.items()}
    plans |= {n: [PlannedTrial(**t) for t in plan] for n, plan in row["plans"].items()}
    return {
        n: ceiling(residuals(theta, [first, *plan], found), found, given, true, row["case"])
        for n, plan in plans.items()
    }


def main(arguments: list[str] | None = None) -> None:
    """Print the bound and what the diagnosis reached."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("results", type=Path)
    args = parser.parse_args(arguments)
    given = tomllib.loads(args.file.read_text(encoding="utf-8"))
    rows = [json.loads(x) for x in (args.results / "cases.jsonl").read_text(encoding="utf-8").splitlines()]
    rows = [r for r in rows if r["kind"] == "effect" and "first" in r]
    found = [bounds(given, r) for r in rows]
    header = ("after", "P(true)", "ideal", "log loss (nat)", "ideal", "95 % set", "ideal")
    lines = []
    for name in CONDITIONS:
        own, ideal = [r[name] for r in rows], [b[name] for b in found]
        cells = [[o["p"] for o in own], [b.probability for b in ideal], [loss(o) for o in own]]
        cells += [[b.log_loss for b in ideal], [o["set"] for o in own], [b.set_size for b in ideal]]
        lines.append([name, *map(mean, cells)])
    print(f"{len(rows)} cases; means with 95 % bootstrap intervals over cases")
    print(table(header, lines))
    print("largest differences after the chosen trials: P(true) of the diagnosis, ideal, effect, case")
    gap = [(b["chosen"].probability - r["chosen"]["p"], k) for k, (r, b) in enumerate(zip(rows, found, strict=True))]
    for _, k in sorted(gap, reverse=True)[:12]:
        p, bound = rows[k]["chosen"]["p"], found[k]["chosen"].probability
        print(f"{p:.2f} {bound:.2f} {rows[k]['cause']} {rows[k]['case']}")


if __name__ == "__main__":
    main()
