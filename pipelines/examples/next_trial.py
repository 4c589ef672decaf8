"""Is the next trial that `mcstudy gap next` chooses better than the same again, or than any other?

    python pipelines/examples/next_trial.py pipelines/examples/next_trial.toml -o results/next_trial

Every case is a body with one effect of the library, of a size with delta = 6 in a first recording of ankle torque, or
with none. The recordings come from the time-domain simulator; the diagnosis knows nothing of the case. After the first
recording another one of equal duration follows: the same again, one drawn from all others that `mcstudy gap next`
considers, or the one it ranks first; and the same again for three times as long. All are diagnosed together with the
first. Printed for each: probability of the true cause, logarithmic loss, number of causes in the 95 % set, how often it
holds the truth, and false alarms among sound bodies, with 95 % intervals. Effects with exactly the same responses under
every stimulus (`EXACT`) count as one. ``cases.jsonl`` keeps every case; a stopped command resumes.
"""

from __future__ import annotations

import argparse
import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.effect_library.library import LIBRARY
from mcstudy.errors import FallsError, RecordingError
from mcstudy.gap.candidates.signatures import Signature, applicable, signatures
from mcstudy.gap.diagnose import diagnose_fast
from mcstudy.gap.diagnosis import Diagnosis
from mcstudy.gap.fits.priors import opened
from mcstudy.gap.planned.choice import Situation, possible_trials, ranked
from mcstudy.gap.planned.record import simulated
from mcstudy.gap.planned.trials import PlannedTrial
from mcstudy.gap.planned.twins import at_own_responses
from mcstudy.stance.body import two_segment
from mcstudy.stance.information import expected_line_covariance
from mcstudy.stance.noise import SensorNoise
from mcstudy.streams import stream

EXACT = ({"stimulus_lag", "sensor_lag_both"},)
"""A filter of the stimulus is the same filter of both angles, whatever the stimulus is."""

CREDIBLE = 0.95

LEAST = 1e-4
"""Probability below which the logarithmic loss does not grow."""


CONDITIONS = ("first", "same", "other", "chosen", "longer")


def same_cause(effect: str) -> set[str]:
    """Effects that count as this one."""
    exact = next((group for group in EXACT if effect in group), {effect})
    return {e.name for e in LIBRARY.values() if any(e.cause == LIBRARY[n].cause for n in exact)}


def drawn(given: dict[str, Any], k: int) -> tuple[np.ndarray, Signature | None, PlannedTrial]:
    """Parameters, effect (None for a sound body) and first trial of case ``k``."""
    rng = stream(given["seed"] + k, "next trial case")
    model, first = (
        two_segment(),
        PlannedTrial("ankle_torque", given["amplitude"], "prts", given["trials"], given["cycles"], 1, given["fmax"]),
    )
    theta = model.truth * rng.uniform(1 - given["spread"], 1 + given["spread"], model.truth.size)
    if k >= given["cases"]:
        return theta, None, first
    seconds = first.duration_s * (first.cycles - 1) / first.cycles
    C = expected_line_covariance(model, theta, SensorNoise(), first.f, first.drive, seconds)
    e = applicable(opened(model))[int(rng.integers(len(applicable(opened(model)))))]
    found = signatures(*at_own_responses(opened(model), theta, first.f, C), [e])
    own = [s for s in found if abs(s.delta / given["delta"] - 1) < 0.25]
    if not own:
        raise FallsError(f"case {k}: {e.name} cannot be so visible")
    return theta, own[int(rng.integers(len(own)))], first


def outcome(d: Diagnosis, effect: str | None) -> dict[str, Any]:
    """What is scored of one diagnosis."""
    true = set() if effect is None else same_cause(effect)
    named = sum(q for h, q in d.hypotheses if h.effects and set(h.effects) <= true)
    p = d.none_probability if effect is None else named
    causes = {"unknown": d.unknown_probability}
    for h, q in d.hypotheses:
        mine = bool(h.effects) and set(h.effects) <= true
        key = "true" if mine else " and ".join(sorted(LIBRARY[n].cause if n in LIBRARY else n for n in h.effects))
        causes[key] = causes.get(key, 0.0) + q
    ordered = sorted(causes, key=lambda c: -causes[c])
    size = 1 + int((np.cumsum([causes[c] for c in ordered]) < CREDIBLE).sum())
    return {
        "detected": d.detected,
        "p": float(p),
        "set": size,
        "held": ("true" if true else "") in ordered[:size],
    }


def case(given: dict[str, Any], k: int) -> dict[str, Any] | None:
    """All diagnoses of one case; None for one without a stable body."""
    try:
        theta, s, first = drawn(given, k)
        effects, sizes = ((), {}) if s is None else ((s.effect,), s.sizes)
        rng = stream(given["seed"] + k, "next trial noise")
        recorded = simulated(first, theta, rng, effects, sizes)
        d = diagnose_fast(recorded, fmax=given["fmax"])
        options = possible_trials(Situation.of(d), trials=(given["trials"],), cycles=given["cycles"])
        chosen = ranked(Situation.of(d), options)[0].trial
        others = [t for t in options if t != first]
        longer = PlannedTrial(
            first.kind, first.amplitude, first.spectrum, given["longer"] * first.trials, first.cycles, 1, first.fmax
        )
        after = {"same": first, "other": others[int(rng.integers(len(others)))], "chosen": chosen, "longer": longer}
        effect = None if s is None else s.effect
        out = {
            "case": k,
            "effect": effect,
            "trials": {n: f"{t.kind} {t.amplitude:g} {t.spectrum}" for n, t in after.items()},
        }
        out["first"] = outcome(d, effect)
        for name, t in after.items():
            further = simulated(t, theta, rng, effects, sizes)
            out[name] = outcome(diagnose_fast([recorded, further], fmax=given["fmax"]), effect)
    except (FallsError, RecordingError) as error:
        return {"case": k, "left_out": str(error)}
    return out


def in_turn(cases: int, sound: int) -> list[int]:
    """Numbers of all cases, the sound ones among the others, so that a stopped run has its share of both."""
    place = {k: k / cases for k in range(cases)} | {cases + k: (k + 0.5) / sound for k in range(sound)}
    return sorted(place, key=lambda k: place[k])


def table(rows: list[dict[str, Any]]) -> str:
    """The table of all cases."""
    rng = np.random.default_rng(0)

    def mean(x: list[float]) -> str:
        a = np.array(x, dtype=float)
        low, high = np.quantile(a[rng.integers(a.size, size=(2000, a.size))].mean(axis=1), (0.025, 0.975))
        return f"{a.mean():.2f} [{low:.2f}, {high:.2f}]"

    ill = [r for r in rows if "first" in r and r["effect"]]
    sound = [r for r in rows if "first" in r and not r["effect"]]
    lines = [f"{len(ill)} cases with an effect, {len(sound)} without; means with 95 % bootstrap intervals"]
    header = ("after", "P(true)", "log loss (nat)", "causes in 95 % set", "set holds truth", "detected")
    lines.append(" ".join(f"{h:19}" for h in header))
    for name in CONDITIONS:
        of = [r[name] for r in ill]
        loss = [-np.log(max(o["p"], LEAST)) for o in of]
        cells = [
            mean([o["p"] for o in of]),
            mean(loss),
            *(mean([o[k] for o in of]) for k in ("set", "held", "detected")),
        ]
        lines.append(" ".join(f"{c:19}" for c in (name, *cells)))
    if sound:
        alarms = {n: sum(r[n]["detected"] for r in sound) for n in CONDITIONS}
        lines.append(f"false alarms of {len(sound)}: " + ", ".join(f"{n} {a}" for n, a in alarms.items()))
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    args = parser.parse_args(arguments)
    given = tomllib.loads(args.file.read_text(encoding="utf-8"))
    args.out.mkdir(parents=True, exist_ok=True)
    kept = args.out / "cases.jsonl"
    rows = [json.loads(x) for x in kept.read_text(encoding="utf-8").splitlines()] if kept.exists() else []
    for k in in_turn(given["cases"], given["sound"]):
        if k not in {r["case"] for r in rows}:
            rows.append(case(given, k) or {})
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print(table(rows))


if __name__ == "__main__":
    main()
