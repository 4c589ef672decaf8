"""One segment, several conditions: weights of 49 people on a tilting platform, with eyes closed and open.

    python pipelines/validation/comtest_conditions.py pipelines/recordings/comtest.toml --data DIR

The mean responses of the centre of mass, and of the lower body, in four conditions are fitted at once by the model of
the sensorimotor integration test (`pipelines/models/sensorimotor_integration.toml`) with a weight for each condition,
up to 1.2 Hz. Variances are those of means over people. Intervals are of resampled people, since everybody was in all
conditions; the tests of sharing count the conditions as independent, and so do not see small changes within people.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

import mcstudy as mc
from mcstudy.identification.conditions.fit import by_condition
from mcstudy.identification.conditions.settings import ConditionSettings
from mcstudy.identification.fit import searched
from mcstudy.lines.checked_recording import checked_recording
from mcstudy.lines.settings import LineSettings
from mcstudy.recordings.columns import model_of
from mcstudy.stance.body import Body
from mcstudy.stance.feedback import Model
from mcstudy.text_tables import p_value
from pipelines.measured import add_option, write

FMAX_HZ, RESAMPLES = 1.25, 200


def model_on(body: Body) -> Model:
    """The one-segment model with inertia and gravity of the whole body."""
    model = model_of("sensorimotor_integration")
    assert model is not None
    J, ratio = body.J1 + body.C2, body.mgh / 755.0
    constant = {2: J, 0: -body.mgh}
    terms = [
        replace(t, coefficient=constant[t.order]) if t.row == "body" and t.sense == "sway" else t for t in model.terms
    ]
    scale = {"Kp": ratio, "Kd": ratio, "Kt": 1 / ratio}
    parameters = [
        replace(p, value=p.value * k, lower=p.lower * k, upper=p.upper * k)
        for p in model.parameters
        for k in [scale.get(p.name, 1.0)]
    ]
    return replace(model, terms=tuple(terms), parameters=tuple(parameters), derived=())


def responses(group: xr.Dataset, angle: str, people: np.ndarray, model: Model) -> list[mc.FrfRecording]:
    """Means over ``people`` in each condition, of the lower body or the centre of mass, with their variances."""
    body = Body(*group.attrs["body"])
    upper = body.A2 / (body.A1 + body.A2) if angle == "centre of mass" else 0.0
    share = np.array([1 - upper, upper])  # both angles are in space
    one = np.einsum("pcsf,s->pcf", group["frf"].values[people], share)
    mean, variance = one.mean(axis=0), one.var(axis=0, ddof=1) / len(people)
    return [
        mc.FrfRecording(
            group["f"].values, mean[k][:, None], variance[k][:, None, None].astype(complex), name=str(name), model=model
        )
        for k, name in enumerate(group["condition"].values)
    ]


def resampled(group: xr.Dataset, angle: str, model: Model, names: Sequence[str]) -> np.ndarray:
    """Estimates (RESAMPLES, P) of people drawn with replacement."""
    rng, found = np.random.default_rng(1), []
    for _ in range(RESAMPLES):
        people = rng.integers(group.sizes["person"], size=group.sizes["person"])
        joint = by_condition(responses(group, angle, people, model), [str(c) for c in group["condition"].values])
        checked = checked_recording(joint, LineSettings(fmax=FMAX_HZ))
        best = searched(checked.lines, checked.nominal, ConditionSettings(fmax=FMAX_HZ), "resampled", ("Wp",))
        assert best.model.names == tuple(names)
        found.append(best.theta)
    return np.array(found)


def main(argv: list[str] | None = None) -> None:
    """Print and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("description", type=Path)
    parser.add_argument("--data", type=Path, required=True)
    add_option(parser)
    args = parser.parse_args(argv)
    group = mc.read_frf_group(args.description, data=args.data)
    body = Body(*group.attrs["body"])
    model, everybody = model_on(body), np.arange(group.sizes["person"])
    scale = {"Kp": 1 / body.mgh, "Kd": 1 / body.mgh, "tau": 1e3, "Kt": body.mgh}
    label = {"Kp": "Kp / mgh", "Kd": "Kd / mgh, s", "tau": "delay, ms", "Kt": "Kt mgh, 1/s"}
    weights = [str(c) for c in group["condition"].values]
    rows: dict[str, list[str]] = {}
    tests: list[list[str]] = []
    values = {}
    for angle in ("centre of mass", "lower"):
        fit = mc.fit_conditions(responses(group, angle, everybody, model), conditions=weights, fmax=FMAX_HZ)
        named = [n for n in fit.fit.model.names if n not in label]
        ends = np.quantile(resampled(group, angle, model, fit.fit.model.names), [0.025, 0.975], axis=0)
        for name, e, (low, high) in zip(fit.fit.model.names, fit.fit.estimates, ends.T, strict=False):
            k = scale.get(name, 1.0)
            shown = label.get(name) or f"weight, eyes {weights[named.index(name)]}°"
            rows.setdefault(shown, []).append(f"{k * e.estimate:.3g} [{k * low:.3g}, {k * high:.3g}]")
        rows.setdefault("squared residual / expected", []).append(f"{fit.fit.chi2 / fit.fit.expected_chi2:.1f}")
        tests.append([angle, *(p_value(fit.sharing(n).p_value) for n in ("Wp", *label))])
        values[f"residual_{angle.split()[0]}"] = {"value": fit.fit.chi2 / fit.fit.expected_chi2}
    header, table = ["", "centre of mass", "lower body"], [[name, *cells] for name, cells in rows.items()]
    below = ["one value for all of", "weight", *label.values()]
    for head, body_of in ((header, table), (below, tests)):
        print(*(" | ".join(row) for row in (head, *body_of)), sep="\n")
    write(args.json, values, {"estimates": (header, table), "tests": (below, tests)})


if __name__ == "__main__":
    main()
