"""Are the probabilities that `mcstudy gap compare` gives to changes of parameters right?

    python pipelines/validation/group_calibration.py --pairs 200

Every pair of groups of 8 to 16 simulated people on a tilting platform (`group_differences.py`) has one hidden cause: a
hypothesis of the comparison (`--named`, each as often as any other), no difference (`--none`), or an effect that is no
hypothesis (the rest). Sizes of named changes are drawn from the law that the comparison assumes, or with ``--common``
as one factor of 0.6 to 0.87 or 1.15 to 1.6 for all parameters of a set. Half of the pairs are the same people. Bodies
of groups scatter by 15 %, those of people by 5 %. The prior of the comparison is replaced by the shares that are drawn,
since calibration is only defined for a prior that is true. Without ``--common`` the simulated law is that of the
hypotheses; Laplace's approximation, the errors from few people and bodies that are no point of the prior are tested.
"""

from __future__ import annotations

import argparse

import numpy as np
from group_differences import people
from mcstudy_challenge.scores.calibration import calibration
from scipy.stats import binomtest

from mcstudy.group_comparison.changes import DELAY, GAIN, NOTHING, OTHER, POWER, WEIGHT, hypotheses, posterior
from mcstudy.group_comparison.compare import hypotheses_fitted
from mcstudy.group_comparison.group_model import GroupModel
from mcstudy.group_comparison.sample import sample_of
from mcstudy.stance.body import two_segment
from mcstudy.stance.stability import growth_rate
from mcstudy.streams import stream
from mcstudy.text_tables import table
from pipelines import measured

EFFECTS = {"sensor_lag_theta2": (0.03, 0.1), "stimulus_lag": (0.05, 0.2), "passive_damping_hip": (5.0, 20.0)}
"""What is no hypothesis, and its sizes."""

SPREAD = 0.15
"""Of the bodies of groups, SD of the logarithm."""

MARGIN = 0.3
"""Least distance of a group's body from the limit of stability, 1/s."""


def drawn(rng: np.random.Generator, parts: tuple[str, ...], common: bool) -> tuple[dict[str, float], dict[str, float]]:
    """Factors of the parameters in both groups; drawn again until both stand."""
    model = two_segment(stimulus="surface_tilt")
    while True:
        base = np.exp(SPREAD * rng.normal(size=len(model.names)))
        other = base.copy()
        factor = np.exp(rng.choice([-1, 1]) * rng.uniform(np.log(1.15), np.log(1.6)))
        for k in map(model.names.index, parts):
            if common:
                other[k] *= factor
            elif model.names[k] in model.weights:
                weight = model.truth[k] * base[k]
                odds = weight / (1 - weight) * np.exp(WEIGHT * rng.normal())
                other[k] = odds / (1 + odds) / model.truth[k]
            else:
                other[k] *= np.exp((DELAY if model.names[k] in model.delays else GAIN) * rng.normal())
        theta = model.truth * np.stack([base, other])
        if (growth_rate(model, theta) < -MARGIN).all() and (theta[:, -1] < 0.95).all():
            return dict(zip(model.names, base, strict=True)), dict(zip(model.names, other, strict=True))


def answer(k: int, shares: tuple[float, float], common: bool, power: float = POWER) -> tuple[str, dict[str, float]]:
    """The cause of pair ``k``, and the probability of every cause."""
    rng = stream(17, "group_calibration", k)
    named, none = shares
    causes = hypotheses(GroupModel(people(4, 1)))
    kinds = [name for name in causes if name not in (NOTHING, OTHER)]
    truth = str(rng.choice([str(rng.choice(kinds)), NOTHING, OTHER], p=[named, none, 1 - named - none]))
    before, after = drawn(rng, causes[truth], common)
    paired, n = bool(rng.integers(2)), int(rng.integers(8, 17))
    name = str(rng.choice(list(EFFECTS)))
    effect = (name, float(rng.uniform(*EFFECTS[name]))) if truth == OTHER else None
    a = people(n, 2 * k, before)
    b = people(n, 2 * k + (not paired), after, again=1, effect=effect)
    _, _, fitted = hypotheses_fitted(a, sample_of(a, b), 0)
    probability = posterior(fitted, none, 1 - named - none, power)
    return truth, dict(zip([one.name for one in fitted], probability, strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description="Calibration of the causes named by a comparison of two groups.")
    parser.add_argument("--pairs", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first pair")
    parser.add_argument("--power", type=float, default=POWER, help=f"of the evidence (default {POWER})")
    parser.add_argument("--named", type=float, default=0.7)
    parser.add_argument("--none", type=float, default=0.2)
    parser.add_argument("--common", action="store_true", help="one factor for all parameters of a set")
    measured.add_option(parser)
    args = parser.parse_args()
    stated, right, sets, of_truth, kinds = [], [], [], [], []
    for k in range(args.first, args.first + args.pairs):
        truth, probability = answer(k, (args.named, args.none), args.common, args.power)
        order = sorted(probability, key=lambda name: -probability[name])
        best = order[0]
        until = int(np.searchsorted(np.cumsum([probability[name] for name in order]), 0.95)) + 1
        stated.append(min(probability[best], 1.0))
        right.append(best == truth)
        sets.append(truth in order[:until])
        of_truth.append(probability[truth])
        kinds.append(truth if truth in (NOTHING, OTHER) else "named change")
        print(f"{k} {truth}: {probability[truth]:.3f}; first {best} {probability[best]:.3f}", flush=True)
    found = calibration(stated, right)
    rows = []
    for b in found.bins:
        hits = f"{b.right.value:.2f} [{b.right.low:.2f}, {b.right.high:.2f}]"
        rows.append([f"{b.low:g} to {b.high:g}", f"{b.right.n}", f"{b.stated:.2f}", hits])
    columns = ["probability of the first cause", "pairs", "stated", "right [95 %]"]
    print(table(columns, rows))
    print(f"calibration error {found.error:.3f}, by chance {found.by_chance:.3f} (p = {found.p_value:.2g})")
    inside = binomtest(sum(sets), len(sets)).proportion_ci(method="wilson")
    print(f"95 % sets hold the cause in {100 * np.mean(sets):.1f} % [{100 * inside.low:.1f}, {100 * inside.high:.1f}]")
    held = dict(zip(("value", "low", "high"), 100 * np.array([np.mean(sets), inside.low, inside.high]), strict=True))
    numbers = {"error": {"value": found.error}, "chance": {"value": found.by_chance}, "sets": held | {"unit": "%"}}
    measured.write(
        args.json, numbers, {"classes": (["probability of the first cause", "pairs", "stated", "right"], rows)}
    )
    for kind in sorted(set(kinds)):
        own = [r for r, of in zip(right, kinds, strict=True) if of == kind]
        print(f"{kind}: first in {sum(own)} of {len(own)}")
    print(f"log loss {-np.mean(np.log(np.maximum(of_truth, 1e-6))):.2f}")


if __name__ == "__main__":
    main()
