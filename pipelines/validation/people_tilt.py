"""What changes in people who stand on a tilting platform, when it tilts more and when they open their eyes?

    python pipelines/validation/people_tilt.py pipelines/recordings/comtest.toml --data DIR -o figures

Reads group FRFs (`mcstudy.read_frf_group`) with two factors, eyes and amplitude, and prints, for each of four pairs of
conditions, how well accounts of the difference predict people that were left out; then where the model fails on the
mean, which effect closes most of it for other people, and whether that depends on the body that is assumed and on the
reading of the upper body's angle. ``--only`` names parts. Results appear as they come.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
import xarray as xr

from mcstudy.effect_library import library
from mcstudy.recordings.frf_group import read_frf_group
from mcstudy.spectra.frf_groups import as_complex, as_real, scatter
from mcstudy.stance.body import Body
from mcstudy.stance.feedback import Model
from mcstudy.text_tables import table
from pipelines.validation.condition_changes import NOTHING, Account, Pair, model_of_group, pooled_minima, problem_of
from pipelines.validation.condition_fits import best_of
from pipelines.validation.conditions import changes
from pipelines.validation.mean_gap import BANDS_HZ, MeanGap, mean_gap

RESAMPLES = 2000
"""Of the scores of people, for intervals."""

MOST_SIZES = 2
"""Changes of an account whose sizes are printed, and whose account predicts people."""

HEIGHT_M, WEIGHT_KG = 1.75, 72.0

NEAREST = ("sensor_lag_theta1", "stimulus_delay", "biarticular_coupling")
"""Effects that lead in a condition with the body as described; only these are fitted to other bodies."""

BODIES = {
    "as described": Body.from_person(HEIGHT_M, WEIGHT_KG),
    "height -15 %": Body.from_person(0.85 * HEIGHT_M, WEIGHT_KG),
    "height +15 %": Body.from_person(1.15 * HEIGHT_M, WEIGHT_KG),
    "mass -15 %": Body.from_person(HEIGHT_M, 0.85 * WEIGHT_KG),
    "mass +15 %": Body.from_person(HEIGHT_M, 1.15 * WEIGHT_KG),
    "female, de Leva": Body.from_person(HEIGHT_M, WEIGHT_KG, "female"),
    "male, de Leva": Body.from_person(HEIGHT_M, WEIGHT_KG, "male"),
}
"""Adults by height, mass and mass distribution; nothing is known of these people's."""


def interval(values: np.ndarray, seed: int = 0) -> str:
    """Mean of scores of people with a 95 % interval, people drawn with replacement."""
    rng = np.random.default_rng(seed)
    means = values[rng.integers(values.size, size=(RESAMPLES, values.size))].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return f"{values.mean():.3f} [{low:.3f}, {high:.3f}]"


def pairs(group: xr.Dataset) -> dict[str, tuple[int, int]]:
    """Positions of the conditions that differ in one factor, by what differs."""
    at = {pair: k for k, pair in enumerate(zip(group["eyes"].values, group["tilt_pp_deg"].values, strict=True))}
    low, high = sorted({tilt for _, tilt in at}, key=float)
    return {
        "amplitude, eyes closed": (at["closed", low], at["closed", high]),
        "amplitude, eyes open": (at["open", low], at["open", high]),
        f"vision, {low} deg": (at["closed", low], at["open", low]),
        f"vision, {high} deg": (at["closed", high], at["open", high]),
    }


def accounts_table(pair: Pair, accounts: list[Account], splits: int, draws: int) -> str:
    """Misfit, cross-validated misfit and sizes of every account."""
    scores = pair.halves(accounts, splits)
    few = [a for a in accounts if len(a.change.factors) <= MOST_SIZES]
    sizes = dict(zip([a.change.name for a in few], pair.resampled(few, draws), strict=True))
    rows = []
    for a, score in zip(accounts, scores, strict=True):
        words = []
        if (own := sizes.get(a.change.name)) is not None:
            low, high = np.quantile(own, [0.025, 0.975], axis=0)
            words = [f"{f:.2f} [{x:.2f}, {y:.2f}]" for f, x, y in zip(a.sizes, low, high, strict=True)]
        gained = (scores[0] - score).reshape(splits, 2).mean(axis=1)
        low, high = np.quantile(gained, [0.025, 0.975])
        better = f"{gained.mean():.2f} [{low:.2f}, {high:.2f}]"
        rows.append([a.change.name, f"{a.misfit:.0f}", f"{score.mean():.2f}", better, "; ".join(words)])
    header = ["what differs", "misfit", "left-out half", "better by [splits]", "factor, or shift of the weight [95 %]"]
    return table(header, rows)


def held_out_table(pair: Pair, accounts: list[Account]) -> str:
    """Every person's condition predicted from the other, both ways."""
    ways = [pair.held_out(accounts), pair.held_out(accounts, reverse=True)]
    rows = []
    for name in ways[0]:
        row = [name]
        for way in ways:
            row += [interval(way[name]), interval(way[name] - way["nothing"])]
        rows.append(row)
    return table(["prediction", "second from first", "minus nothing", "first from second", "minus nothing"], rows)


def gap_text(group: xr.Dataset, condition: int, gap: MeanGap) -> str:
    """Where the model fails in one condition, and what closes how much of it."""
    edges = [f"{a:g} to {b:g} Hz" if np.isfinite(b) else f"above {a:g} Hz" for a, b in pairwise(BANDS_HZ)]
    rows = [
        [name, *(f"{100 * x:.0f} ± {100 * e:.0f}" for x, e in zip(own, error, strict=True))]
        for name, own, error in zip(("lower", "upper"), gap.share, gap.share_se, strict=True)
    ]
    out = [
        f"{group['condition'].values[condition]}: misfit {gap.misfit:.0f} with {4 * group.sizes['point']} numbers; "
        f"gap {gap.gap:.0f} ± {gap.gap_se:.0f} (0: none)",
        table(["share of the gap (%)", *edges], rows),
    ]
    best = []
    for k in np.argsort(-gap.closes)[:6]:
        names = library.effect(gap.effects[k]).parameters
        sizes = ", ".join(f"{n} {x:.3g}" for n, x in zip(names, gap.sizes[k], strict=True))
        best.append([gap.effects[k], f"{100 * gap.closes[k]:.0f} ± {100 * gap.closes_se[k]:.0f}", sizes])
    out.append(table(["effect", "closes, people left out (%)", "size"], best))
    return "\n".join(out)


def gap_table(group: xr.Dataset, label: str, model: Model, starts: np.ndarray) -> str:
    """Misfit and gap of every condition, where most of the gap is, and what the effects `NEAREST` close of it."""
    rows = []
    for c, name in enumerate(group["condition"].values):
        gap = mean_gap(model, group, c, NEAREST, starts=starts)
        segment, band = np.unravel_index(gap.share.argmax(), gap.share.shape)
        edge = f"{('lower', 'upper')[segment]} body from {BANDS_HZ[band]:g} Hz, {100 * gap.share.max():.0f} %"
        closed = [f"{100 * x:.0f} ± {100 * e:.0f}" for x, e in zip(gap.closes, gap.closes_se, strict=True)]
        rows.append([str(name), f"{gap.misfit:.0f}", f"{gap.gap:.0f} ± {gap.gap_se:.0f}", edge, *closed])
    return table([label, "misfit", "gap", "largest share", *NEAREST], rows)


def hip_reading(group: xr.Dataset) -> xr.Dataset:
    """The group with its second angle read as the hip angle, not as the upper body in space."""
    other = group.copy(deep=True)
    other["frf"][:, :, 1] += other["frf"][:, :, 0]
    return other


def figure(group: xr.Dataset, model_points: dict[int, np.ndarray], path: Path) -> None:
    """Means of the group with their standard errors, and fits, as an SVG document."""
    import matplotlib.pyplot as plt

    colours = ("#57606a", "#b5470a", "#0969da", "#1a7f37")
    f = group["f"].values
    with plt.rc_context({"svg.fonttype": "none", "font.size": 8, "svg.hashsalt": "people"}):
        drawn, axes = plt.subplots(2, 2, figsize=(7.0, 5.0), sharex=True)
        for segment, name in enumerate(("lower body in space", "upper body in space")):
            gain, phase = axes[0, segment], axes[1, segment]
            for c, colour in enumerate(colours):
                data = group["frf"].values[:, c, segment]
                mean, n = data.mean(axis=0), len(data)
                error = np.abs(data - mean).std(axis=0, ddof=1) / np.sqrt(n)
                label = group["condition"].values[c] + " deg"
                gain.errorbar(f, np.abs(mean), 1.96 * error, fmt="o", ms=3, lw=0.8, color=colour, label=label)
                gain.plot(f, np.abs(model_points[c][segment]), "-", lw=1, color=colour)
                angle = np.degrees(np.unwrap(np.angle(mean)))
                phase.plot(f, angle, "o", ms=3, color=colour)
                fitted = np.degrees(np.unwrap(np.angle(model_points[c][segment])))
                phase.plot(f, fitted + 360 * np.round((angle - fitted).mean() / 360), "-", lw=1, color=colour)
            gain.set(xscale="log", yscale="log", title=name, ylabel="gain (deg/deg)")
            phase.set(xlabel="frequency (Hz)", ylabel="phase (deg)")
        axes[0, 0].legend(frameon=False)
        drawn.tight_layout()
        path.parent.mkdir(parents=True, exist_ok=True)
        drawn.savefig(path, metadata={"Date": None})
        plt.close(drawn)


def fitted_points(group: xr.Dataset, body: Body) -> tuple[dict[int, np.ndarray], list[float]]:
    """Points (2, N) of the fit of every condition's mean, and its misfit."""
    model, points, misfits = model_of_group(group, body), {}, []
    starts = pooled_minima(model, group, range(group.sizes["condition"]))[:, None]
    for c in range(group.sizes["condition"]):
        data = as_real(group["frf"].values[:, c])
        variance = np.diag(np.diag(scatter(data).covariance)) / len(data)
        problem = problem_of(model, group, NOTHING, data.mean(axis=0)[None, None], variance)
        found = best_of(problem, starts)
        points[c] = as_complex(problem.predicted(found.unknowns)[0, 0])
        misfits.append(float(found.misfit[0]))
    return points, misfits


PARTS = ("accounts", "held-out", "gap", "bodies", "figure")


def main(arguments: list[str] | None = None) -> None:
    """Print what ``--only`` asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("description", type=Path, help="TOML of a group of FRFs with columns eyes and tilt_pp_deg")
    parser.add_argument("--data", type=Path, help="folder of its table")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="parts to print")
    parser.add_argument("--pairs", default="", help="only pairs of conditions whose name contains this, as vision")
    parser.add_argument("--splits", type=int, default=10, help="random halves, each used both ways (default 10)")
    parser.add_argument("--draws", type=int, default=40, help="draws of people for the factors (default 40)")
    parser.add_argument("-o", "--out", type=Path, default=Path("."), help="folder for the figure")
    args = parser.parse_args(arguments)
    group = read_frf_group(args.description, data=args.data)
    body = BODIES["as described"]
    model = model_of_group(group, body)
    starts = pooled_minima(model, group, range(group.sizes["condition"]))
    print(
        f"{group.sizes['person']} people, {group.sizes['condition']} conditions, body of {HEIGHT_M} m, {WEIGHT_KG} kg"
    )
    for name, (first, second) in pairs(group).items():
        if args.pairs not in name or not {"accounts", "held-out"} & set(args.only):
            continue
        pair = Pair(model, group, first, second, starts)
        accounts = pair.accounts(changes(model))
        if "accounts" in args.only:
            print(f"\n{name}\n{accounts_table(pair, accounts, args.splits, args.draws)}", flush=True)
        few = [a for a in accounts if len(a.change.factors) <= MOST_SIZES]
        if "held-out" in args.only:
            print(f"\n{name}: people predicted\n{held_out_table(pair, few)}", flush=True)
    if "gap" in args.only:
        for c in range(group.sizes["condition"]):
            found = mean_gap(model, group, c, list(library.LIBRARY.linear), starts=starts)
            print(f"\n{gap_text(group, c, found)}", flush=True)
    if "bodies" in args.only:
        for label, other in list(BODIES.items())[1:]:
            print(f"\n{gap_table(group, label, model_of_group(group, other), starts)}", flush=True)
        read = hip_reading(group)
        own = pooled_minima(model, read, range(read.sizes["condition"]))
        print(f"\n{gap_table(read, 'upper angle is the hip', model, own)}", flush=True)
    if "figure" in args.only:
        figure(group, fitted_points(group, body)[0], args.out / "people_tilt.svg")
        print(f"\n{args.out / 'people_tilt.svg'}")


if __name__ == "__main__":
    main()
