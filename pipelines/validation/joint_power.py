"""Does a diagnosis of three stimuli find and name more causes than the same time of ankle torque alone?

    python pipelines/validation/joint_power.py --cases 60 -o results/joint_power

Every case is a body with one linear effect of the library, of a size with delta = 3.9 in three trials of ankle torque
(5 N m, six cycles each), or a sound body (one in six). It is recorded twice: in these three trials, and in one trial
each of ankle torque (5 N m), hip torque (5 N m) and platform translation (3 cm RMS). Printed for both: how often a gap
is detected, probability of the true cause and logarithmic loss, and false alarms, with 95 % intervals, scored as in
``next_trial.py``. ``cases.jsonl`` keeps every case; a stopped command resumes.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from next_trial import Answer, drawn, loss, mean, recorded, share

from mcstudy.errors import FallsError, RecordingError
from mcstudy.gap.trial_planning.trials import PlannedTrial
from mcstudy.streams import stream

GIVEN = {"seed": 11, "delta": 6.0, "trials": 7, "cycles": 6, "amplitude": 5.0, "spread": 0.1}
"""As in ``next_trial.toml``: delta = 6 in seven trials, which is 3.9 in three."""

TRIALS = 3

PLATFORM_RMS_M = 0.03

SOUND = 6
"""One case in so many has no effect."""


def plans(ankle: PlannedTrial) -> dict[str, tuple[PlannedTrial, ...]]:
    """Ankle torque alone, and three stimuli in the same time."""
    ankle, one = replace(ankle, trials=TRIALS), replace(ankle, trials=1)
    unit = replace(one, kind="platform_translation", amplitude=1.0, fmax=8.0)
    peak = PLATFORM_RMS_M / float(np.sqrt(2 * (np.abs(unit.drive) ** 2).sum()))
    hip, platform = replace(one, kind="hip_torque"), replace(one, kind="platform_translation", amplitude=peak)
    return {"ankle": (ankle,), "joint": (one, hip, platform)}


def case(k: int, cases: int, fmax: float) -> dict[str, Any]:
    """Both answers to one case; the last of all are sound."""
    sound = cases // SOUND
    given = GIVEN | {"fmax": fmax, "cases": cases - sound, "sound": sound, "outsiders": 0}
    try:
        theta, cause, ankle = drawn(given, k)
        rng = stream(k, "joint power")
        out: dict[str, Any] = {"case": k, "cause": cause[0].effect if cause else None}
        for name, plan in plans(ankle).items():
            out[name] = Answer.of(recorded(plan, theta, rng, cause), fmax, True).outcome(cause)
    except (FallsError, RecordingError) as error:
        return {"case": k, "left_out": str(error)}
    return out


def table(rows: Sequence[dict[str, Any]]) -> str:
    """What was found in both recordings."""
    made = [r for r in rows if "joint" in r]
    effect, sound = [r for r in made if r["cause"]], [r for r in made if not r["cause"]]
    lines = [f"{len(effect)} cases with an effect, {len(sound)} without, {len(rows) - len(made)} left out"]
    for name in ("ankle", "joint"):
        of = [r[name] for r in effect]
        if of:
            found = share(sum(o["detected"] for o in of), len(of))
            p, size, held = (mean([o[key] for o in of]) for key in ("p", "set", "held"))
            lines.append(
                f"{name}: detected {found}, P(true) {p}, log loss {mean([loss(o) for o in of])}, "
                f"causes in 95 % set {size}, set holds truth {held}"
            )
        if sound:
            lines.append(f"{name}: false alarms {share(sum(r[name]['detected'] for r in sound), len(sound))}")
    if effect:
        less = mean([loss(r["ankle"]) - loss(r["joint"]) for r in effect])
        lines.append(f"log loss of ankle minus that of joint: {less}")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--fmax", type=float, default=3.1)
    parser.add_argument("-o", "--out", type=Path, required=True)
    args = parser.parse_args(arguments)
    args.out.mkdir(parents=True, exist_ok=True)
    kept = args.out / "cases.jsonl"
    rows = [json.loads(x) for x in kept.read_text(encoding="utf-8").splitlines()] if kept.exists() else []
    order = np.random.default_rng(0).permutation(args.cases)  # a stopped run has its share of sound bodies
    for k in (int(k) for k in order if k not in {r["case"] for r in rows}):
        rows.append(case(k, args.cases, args.fmax))
        with kept.open("a", encoding="utf-8") as file:
            file.write(json.dumps(rows[-1]) + "\n")
    print(table(rows))


if __name__ == "__main__":
    main()
