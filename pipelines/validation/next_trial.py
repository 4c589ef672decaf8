"""Is the next trial that `mcstudy gap next` chooses better than the same again, or than any other?

    python pipelines/validation/next_trial.py pipelines/validation/next_trial.toml -o results/next_trial

Every case is a body with one effect of the library, of a size with delta = 6 in a first recording of ankle torque, with
none, or with a cause outside the library. The diagnosis knows nothing of the case. After the first recording another
one follows, and both are diagnosed together: what `mcstudy gap next` ranks first, and in the first ``compared`` cases
also one drawn from all other single kinds that it considers, and the same again, for as long and for three times as
long. Printed for each: probability of the true cause, logarithmic loss, number of causes in the 95 % set, how often it
holds the truth, and false alarms among sound bodies, with 95 % intervals; then what has the rest of the probability
after the recommended trials, and how that of the truth compares with what was expected, all kinds of cases weighted
with the shares of the prior. ``next_trial_shares.toml`` has cases of all kinds and sizes for this, ``--seed`` makes
others.

Bodies with an effect and sound ones are linear. Their recordings are drawn from the law of the steady state
(`pipelines.validation.planned_record.steady`), which the tests compare with the time-domain simulator. That simulator
makes the recordings of causes outside the library.

Effects with exactly the same responses under every stimulus (`EXACT`) count as one. Bodies whose start rings for longer
than a cycle are left out: where a stimulus evokes much more sway than noise does, the rest of the start would look like
a cause. Mislabelling does not compete. ``cases.jsonl`` keeps every case; a stopped command resumes.
"""

from __future__ import annotations

import argparse
import json
import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from mcstudy_challenge.bodies.out_of_library import OUT_OF_LIBRARY, OutOfLibraryEffect, simulate_out_of_library
from scipy.special import betaincinv

from mcstudy.effect_library.library import LIBRARY
from mcstudy.effect_library.protocol import Protocol, body_with_effects
from mcstudy.errors import FallsError, InputError, RecordingError
from mcstudy.gap.candidates.signatures import Signature, applicable, signatures
from mcstudy.gap.prior import prior
from mcstudy.gap.questions.any_gap import GapTest, gap_test
from mcstudy.gap.questions.contrasts import DRAWS as CONTRAST_DRAWS
from mcstudy.gap.questions.detection import LEVEL
from mcstudy.gap.questions.posterior import Explanation, explain
from mcstudy.gap.settings import DiagnosisSettings
from mcstudy.gap.trial_planning.choice import Plan, Situation, possible_trials, ranked
from mcstudy.gap.trial_planning.recommendation import described
from mcstudy.gap.trial_planning.trials import PERIOD_S, PlannedTrial
from mcstudy.gap.trial_planning.twins import at_own_responses
from mcstudy.lines.base_fit import base_fit
from mcstudy.lines.checked_recording import checked_recording
from mcstudy.lines.priors import opened
from mcstudy.lines.settings import LineSettings
from mcstudy.lines.settling import OVER
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.joint_recording import JointRecording
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.information import expected_line_covariance
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.stability import rightmost_root
from mcstudy.streams import stream
from pipelines.validation.planned_record import steady

Cause = tuple[Signature, ...] | OutOfLibraryEffect
"""One or two effects of the library at one size each, nothing (none of them), or a cause outside the library."""

KINDS = {"effect": "cases", "sound": "sound", "outsider": "outsiders", "pair": "pairs"}
"""Kinds of cases, and the name of their number in the file."""

OUTSIDERS = ("split_delay", "washout", "leg_wobble", "lumbar_relaxation", "sensor_crosstalk", "wandering_clock")
"""Causes outside the library that do not need an iteration of the simulator, at their largest size."""

NO_TEST = 1
"""Null samples of a comparison within a recording whose p-value nobody asks for: of bodies that are not sound."""

EXACT = ({"stimulus_lag", "sensor_lag_both"},)
"""A filter of the stimulus is the same filter of both angles, whatever the stimulus is."""

CREDIBLE = 0.95

LEAST = 1e-4
"""Probability below which the logarithmic loss does not grow."""

AGAIN = {"same": 1, "longer": 3}
"""How many times as long as the first trials the same ones are recorded again."""

WORST = 6
"""Effects with the least probability that are listed."""

SMALL = 0.005
"""Probability up to which a cause is not kept in ``cases.jsonl``."""

CONDITIONS = ("first", *AGAIN, "other", "chosen")


def same_cause(effect: str) -> set[str]:
    """Effects that count as this one."""
    exact = next((group for group in EXACT if effect in group), {effect})
    return {e.name for e in LIBRARY.values() if any(e.cause == LIBRARY[n].cause for n in exact)}


def drawn(given: dict[str, Any], k: int) -> tuple[np.ndarray, Cause, PlannedTrial]:
    """Parameters, cause and first trial of case ``k``."""
    rng = stream(given["seed"] + k, "next trial case")
    model, first = (
        two_segment(),
        PlannedTrial("ankle_torque", given["amplitude"], "prts", given["trials"], given["cycles"], 1, given["fmax"]),
    )
    theta = model.truth * rng.uniform(1 - given["spread"], 1 + given["spread"], model.truth.size)
    if (kind := kind_of(given, k)) in ("sound", "outsider"):
        return theta, () if kind == "sound" else outsider(given, k, rng), first
    causes = tuple(_signature(given, k, theta, first, rng) for _ in range(2 if kind == "pair" else 1))
    names = [s.effect for s in causes]
    if len(names) == 2 and same_cause(names[0]) & same_cause(names[1]):
        raise FallsError(f"case {k}: two forms of one cause")
    root = rightmost_root(*body_with_effects(model, theta, names, _sizes(causes))).root
    if root.imag and np.exp(root.real * PERIOD_S) > OVER:
        raise FallsError(f"case {k}: with {', '.join(names)} the start of a recording rings for longer than a cycle")
    return theta, causes, first


def _signature(
    given: dict[str, Any], k: int, theta: np.ndarray, first: PlannedTrial, rng: np.random.Generator
) -> Signature:
    """An effect of the library, as visible in the first trial as the file says: one delta, or uniform in a range."""
    model = two_segment()
    seconds = first.duration_s * (first.cycles - 1) / first.cycles
    C = expected_line_covariance(model, theta, SensorNoise(), first.f, first.drive, seconds)
    e = applicable(opened(model))[int(rng.integers(len(applicable(opened(model)))))]
    found = signatures(*at_own_responses(opened(model), theta, first.f, C), [e])
    if not isinstance(given["delta"], list):
        own = [s for s in found if abs(s.delta / given["delta"] - 1) < 0.25]
        if not own:
            raise FallsError(f"case {k}: {e.name} cannot be so visible")
        return own[int(rng.integers(len(own)))]
    delta = rng.uniform(*given["delta"])
    s = found[int(np.argmin([abs(np.log(max(s.delta, 1e-9) / delta)) for s in found]))]
    null = e.size.null or 0.0
    size = float(np.clip(null + (s.sizes[e.size.name] - null) * delta / s.delta, e.size.lower, e.size.upper))
    return replace(s, sizes=s.sizes | {e.size.name: size})


def _sizes(causes: Sequence[Signature]) -> dict[str, float]:
    """The sizes of all effects together."""
    return {name: size for s in causes for name, size in s.sizes.items()}


def outsider(given: dict[str, Any], k: int, rng: np.random.Generator) -> OutOfLibraryEffect:
    """The cause outside the library of the ``k``-th case: of its largest size, or uniform where delta is a range."""
    cause = OUT_OF_LIBRARY[OUTSIDERS[k % len(OUTSIDERS)]]
    return replace(cause, size=(cause.size[0], rng.uniform(*cause.size))) if isinstance(given["delta"], list) else cause


def recorded(plan: Plan, theta: np.ndarray, rng: np.random.Generator, cause: Cause) -> list[Recording]:
    """The recordings of planned trials of a body with this cause."""
    return [_recorded(trial, theta, rng, cause) for trial in plan]


def _recorded(trial: PlannedTrial, theta: np.ndarray, rng: np.random.Generator, cause: Cause) -> Recording:
    """The recording of a trial of a body with this cause; see `pipelines.validation.planned_record`."""
    if isinstance(cause, OutOfLibraryEffect):
        protocol = Protocol(trial.kind, trial.waveform, (trial.amplitude,) * trial.trials, trial.cycles)
        return simulate_out_of_library(cause.name, cause.size[1], protocol, theta, rng)
    return steady(trial, theta, rng, [s.effect for s in cause], _sizes(cause))


@dataclass(frozen=True)
class Answer:
    """What a diagnosis says of the cause, without its other questions, which take a third of its time."""

    recording: Recording | JointRecording
    test: GapTest
    explanation: Explanation
    lines: Lines

    @classmethod
    def of(cls, recordings: Sequence[Recording], fmax: float, tested: bool) -> Answer:
        """The answer to recordings of one person; ``tested``: also with the p-value, which costs many null samples."""
        checked = checked_recording(recordings, LineSettings(fmax=fmax))
        one, lines = checked.recording, checked.lines
        assert not isinstance(one, FrfRecording)
        fit = base_fit(lines, checked.nominal, 0)
        t = gap_test(lines, fit, DiagnosisSettings(fast=True), CONTRAST_DRAWS if tested else NO_TEST)
        return cls(one, t, explain(t), lines)

    def situation(self, fmax: float) -> Situation:
        """What is known before the next trial."""
        e = self.explanation
        return Situation.after(self.recording, self.lines, self.test.fit.best, e.hypotheses, e.unknown, fmax, prior())

    def outcome(self, cause: Cause) -> dict[str, Any]:
        """What is scored."""
        effects = [s.effect for s in cause] if isinstance(cause, tuple) else []
        true = {frozenset(LIBRARY[n].cause for n in each) for each in product(*map(same_cause, effects)) if each}
        some = set().union(*map(same_cause, effects))
        causes = {"unknown": self.explanation.unknown}
        for h, q in self.explanation.hypotheses:
            named = sorted(LIBRARY[n].cause for n in h.effects)
            key = "true" if frozenset(named) in true else " and ".join(named) or "nothing"
            causes[key] = causes.get(key, 0.0) + float(q)
        right = "true" if true else "nothing" if cause == () else "unknown"
        ordered = sorted(causes, key=lambda c: -causes[c])
        size = 1 + int((np.cumsum([causes[c] for c in ordered]) < CREDIBLE).sum())
        return {
            "detected": self.test.p_value < LEVEL,
            "p": causes.get(right, 0.0),
            "pairs": sum(q for h, q in self.explanation.hypotheses if len(h.effects) == 2 and set(h.effects) & some),
            "unknown": causes["unknown"],
            "set": size,
            "held": right in ordered[:size],
            "causes": {c: round(causes[c], 4) for c in ordered if causes[c] > SMALL},
        }


def case(given: dict[str, Any], k: int, compared: bool) -> dict[str, Any]:
    """The answers after the first recording and after the chosen trial; ``compared``: also after each of the others."""
    fmax = given["fmax"]
    try:
        theta, cause, first = drawn(given, k)
        rng = stream(given["seed"] + k, "next trial noise")
        before = recorded((first,), theta, rng, cause)
        now = Answer.of(before, fmax, cause == ())
        options = possible_trials(now.situation(fmax), trials=(given["trials"],), cycles=given["cycles"])
        order = ranked(now.situation(fmax), options)
        others = [p for p in options if len(p) == 1 and p != (first,)]
        random = others[int(rng.integers(len(others)))]
        known = cause.name if isinstance(cause, OutOfLibraryEffect) else " and ".join(s.effect for s in cause) or None
        out: dict[str, Any] = {"case": k, "kind": kind_of(given, k), "cause": known, "first": now.outcome(cause)}
        out["plans"] = {n: [asdict(t) for t in plan] for n, plan in (("chosen", order[0].plan), ("other", random))}
        out["expected"] = {described(o.plan): round(o.told.bits, 3) for o in order}
        out["expected_p"] = order[0].told.probability
        out["expected_if_missing"] = order[0].told.probability_if_missing
        out["low_p"], out["low_if_missing"] = order[0].told.probability_low, order[0].told.probability_if_missing_low
        after = {"chosen": recorded(order[0].plan, theta, rng, cause)}
        if compared:
            if kind_of(given, k) == "effect":
                after["other"] = recorded(random, theta, rng, cause)
            after |= _again(first, theta, rng, cause)
        for n, further in after.items():
            out[n] = Answer.of([*before, *further], fmax, cause == ()).outcome(cause)
    except (FallsError, InputError, RecordingError) as error:
        return {"case": k, "kind": kind_of(given, k), "left_out": str(error)}
    return out


def _again(
    first: PlannedTrial, theta: np.ndarray, rng: np.random.Generator, cause: Cause
) -> dict[str, list[Recording]]:
    """The first trials again: as many, and of a body with an effect also three times as many of them."""
    times = AGAIN if isinstance(cause, tuple) and cause else {"same": AGAIN["same"]}
    most = _recorded(replace(first, trials=max(times.values()) * first.trials), theta, rng, cause)
    return {name: [most.select(tuple(range(n * first.trials)))] for name, n in times.items()}


def kind_of(given: dict[str, Any], k: int) -> str:
    """Whether case ``k`` has an effect of the library, nothing, a cause outside the library, or two effects."""
    ends = np.cumsum([given.get(number, 0) for number in KINDS.values()])
    return list(KINDS)[int(np.searchsorted(ends, k, side="right"))]


def in_turn(given: dict[str, Any]) -> list[int]:
    """Numbers of all cases, the kinds mixed, so that a stopped run has its share of each."""
    number = [given.get(number, 0) for number in KINDS.values()]
    place = [(k + 0.5) / n for n in number for k in range(n)]
    return sorted(range(len(place)), key=lambda k: (place[k], k))


def mean(x: Sequence[float]) -> str:
    """Mean with a 95 % bootstrap interval."""
    a, rng = np.array(x, dtype=float), np.random.default_rng(0)
    low, high = np.quantile(a[rng.integers(a.size, size=(4000, a.size))].mean(axis=1), (0.025, 0.975))
    return f"{a.mean():.2f} [{low:.2f}, {high:.2f}]"


def share(hits: int, n: int) -> str:
    """Percentage with an exact 95 % interval (Clopper & Pearson)."""
    low, high = (betaincinv(hits + a, n - hits + 1 - a, q) for a, q in ((0, 0.025), (1, 0.975)))
    return f"{hits} of {n} [{100 * low if hits else 0:.0f}, {100 * high if hits < n else 100:.0f} %]"


def shares(rows: Sequence[dict[str, Any]]) -> list[tuple[str, list[float]]]:
    """What has the probability after the chosen trials of bodies with an effect, kind by kind."""
    found = []
    for r in rows:
        causes, pairs = r["chosen"]["causes"], r["chosen"]["pairs"]
        two = sum(p for c, p in causes.items() if " and " in c)
        own = {
            "the true effect": r["chosen"]["p"],
            "it and another one": pairs,
            "two other ones": max(two - pairs, 0.0),
        }
        own |= {"outside the library": r["chosen"]["unknown"], "nothing": causes.get("nothing", 0.0)}
        found.append(own | {"another effect": max(1 - sum(own.values()), 0.0)})
    return [(name, [f[name] for f in found]) for name in found[0]]


def least(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The true effects with the least mean probability after the chosen trials, and what has most of the rest."""
    of: dict[str, list[dict[str, Any]]] = {}
    for r in rows:
        of.setdefault(r["cause"], []).append(r)
    lines = []
    for name in sorted(of, key=lambda n: np.mean([r["chosen"]["p"] for r in of[n]]))[:WORST]:
        rivals: dict[str, float] = {}
        for r in of[name]:
            for c, p in r["chosen"]["causes"].items():
                rivals[c] = rivals.get(c, 0.0) + p / len(of[name])
        rivals.pop("true", None)
        most = ", ".join(f"{c} {rivals[c]:.2f}" for c in sorted(rivals, key=lambda c: -rivals[c])[:3])
        p, expected = (np.mean(x) for x in zip(*((r["chosen"]["p"], r["expected_p"]) for r in of[name]), strict=True))
        lines.append(f"{name}, {len(of[name])} cases: P(true) {p:.2f}, expected by the choice {expected:.2f}; {most}")
    return lines


def loss(outcome: dict[str, Any]) -> float:
    """Logarithmic loss, nat."""
    return -float(np.log(max(outcome["p"], LEAST)))


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The tables of all cases."""
    made = [r for r in rows if "first" in r]
    effect, sound, outside, _ = ([r for r in made if r["kind"] == kind] for kind in KINDS)
    lines = [
        f"{len(effect)} cases with an effect, {len(sound)} without, {len(outside)} with a cause outside the library, "
        f"{len(rows) - len(made)} left out; means with 95 % bootstrap intervals"
    ]
    header = ("after", "cases", "P(true)", "log loss (nat)", "causes in 95 % set", "set holds truth", "P > 0.95")
    lines.append(" ".join(f"{h:19}" for h in header))
    for name in CONDITIONS:
        of = [r[name] for r in effect if name in r]
        if of:
            cells = [name, str(len(of)), mean([o["p"] for o in of]), mean([loss(o) for o in of])]
            cells += [mean([o[k] for o in of]) for k in ("set", "held")] + [mean([o["p"] > CREDIBLE for o in of])]
            lines.append(" ".join(f"{c:19}" for c in cells))
    for name in CONDITIONS:
        both = [(r[name], r["chosen"]) for r in effect if name in r and name not in ("first", "chosen")]
        if both:
            worse = mean([loss(x) - loss(y) for x, y in both])
            p, size = (mean([y[k] - x[k] for x, y in both]) for k in ("p", "set"))
            lines.append(
                f"log loss of {name} minus that of chosen, {len(both)} cases with both: {worse}; "
                f"chosen minus {name}: P(true) {p}, causes in the set {size}"
            )
    if effect:
        lines.append("after chosen, mean probability: " + "; ".join(f"{n} {mean(p)}" for n, p in shares(effect)))
        lines += least(effect)
    for name in ("first", "same", "chosen"):
        if sound:
            of = [r[name]["detected"] for r in sound if name in r]
            lines.append(f"false alarms after {name}: {share(sum(of), len(of))}")
        if of := [r[name]["p"] for r in outside if name in r]:
            lines.append(
                f"outside the library after {name}: P(unknown) {mean(of)}, "
                f"above one half in {share(sum(p > 0.5 for p in of), len(of))}"
            )
    return "\n".join(lines + promises(made))


def promises(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Expected and found probability of the true cause after the chosen trials, kinds with the shares of the prior.

    Then the shortfall that `mcstudy.gap.trial_planning.gain.SHORT` states, fitted to these cases (least squares).
    """
    rows, share = [r for r in rows if "low_p" in r], prior()
    weight = {"effect": share["single"], "sound": share["none"], "pair": share["pair"]}
    weight["outsider"] = share["unknown"] + share["beside"]
    kinds = [r["kind"] for r in rows]
    lines = []
    every = [weight[k] / kinds.count(k) for k in kinds]
    some = {
        "all": ("expected_p", "low_p", lambda _: True),
        "no gap detected": ("expected_p", "low_p", lambda r: not r["first"]["detected"]),
        "something missing": ("expected_if_missing", "low_if_missing", lambda r: r["kind"] != "sound"),
    }
    for name, (high, low, belongs) in some.items():
        these = [(r, w) for r, w in zip(rows, every, strict=True) if belongs(r)]
        if len(these) < 2:
            continue
        w = np.array([x for _, x in these]) / sum(x for _, x in these)
        upper, lower, p = (np.array([get(r) for r, _ in these]) for get in _numbers(high, low))
        n = np.array([r["first"]["causes"].get("nothing", 0.0) for r, _ in these])
        X = np.sqrt(w)[:, None] * np.stack([upper * (1 - n), upper * n], axis=1)
        short = np.linalg.lstsq(X, np.sqrt(w) * (upper - p), rcond=None)[0]
        off, se = w @ (p - lower), np.sqrt(w**2 @ (p - lower - w @ (p - lower)) ** 2)
        lines.append(
            f"{name}, {len(these)} cases: expected {w @ lower:.2f} to {w @ upper:.2f}, found {w @ p:.2f}, found minus "
            f"lower end {off:+.2f} +- {se:.2f}; short by {short[0]:.2f} (something missing), {short[1]:.2f} (nothing)"
        )
    return lines


def _numbers(high: str, low: str) -> tuple[Callable[[dict[str, Any]], float], ...]:
    """What is compared of a case: both ends of what was expected, and what was found."""
    return (lambda r: r[high]), (lambda r: r[low]), (lambda r: r["chosen"]["p"])


def main(arguments: list[str] | None = None) -> None:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, help="instead of that of the file: other cases")
    parser.add_argument("--seconds", type=float, default=np.inf, help="start no further case after so much CPU time")
    args = parser.parse_args(arguments)
    given = tomllib.loads(args.file.read_text(encoding="utf-8"))
    given |= {} if args.seed is None else {"seed": args.seed}
    args.out.mkdir(parents=True, exist_ok=True)
    kept = args.out / "cases.jsonl"
    rows = [json.loads(x) for x in kept.read_text(encoding="utf-8").splitlines()] if kept.exists() else []
    known = {r["case"] for r in rows}
    for place, k in enumerate(in_turn(given)):
        start = time.process_time()
        if start > args.seconds:
            break
        if k not in known:
            row = case(given, k, place < given["compared"])
            rows.append(row | {"cpu_s": round(time.process_time() - start, 2)})
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print(table(rows))


if __name__ == "__main__":
    main()
