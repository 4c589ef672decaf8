"""The result of an inference as tables of text."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from mcstudy import program
from mcstudy.text_tables import fill, number, p_value, table
from mcstudy_goodworth2018.lost_table.checks import LIMIT
from mcstudy_goodworth2018.lost_table.contradictions import REACHED
from mcstudy_goodworth2018.lost_table.unknowns import UNKNOWNS

DETERMINED, UNDETERMINED = 0.5, 0.9
"""Width of the posterior over that of the prior: below the first an unknown is determined, above the second not."""

CHOICES = {x.name: x.choices for x in UNKNOWNS if x.choices}


def text(result: xr.Dataset) -> str:
    """All tables of a result."""
    parts = [_heading(result), _unknowns(result), _choices(result), _rows(result), _contradictions(result)]
    if result.sizes["paper"] > 1:
        parts.append(_calibration(result))
    return "\n\n".join(part for part in parts if part)


def _heading(result: xr.Dataset) -> str:
    made_by = json.loads(str(result.attrs.get("program", "null")))
    other = program.other_maker(made_by, program.maker("mcstudy_goodworth2018"))
    return fill(
        f"This is {result.attrs['status']}. It rests on {result.attrs['studies']} simulated studies of "
        f"{result.attrs['realizations']} realizations. Ranges are 90 % intervals."
        + (f" Note: {other}." if other else "")
    )


def said(width: float) -> str:
    """Whether the printed numbers determine an unknown."""
    return "yes" if width < DETERMINED else "no" if width > UNDETERMINED else "partly"


def _unknowns(result: xr.Dataset) -> str:
    rows = []
    for x in UNKNOWNS:
        if x.choices:
            continue
        one = result.sel(unknown=x.name)
        prior, post = one["prior_quantile"].values, one["posterior_quantile"].values
        width = float(one["width"])
        cells = [f"{number(q[0])} to {number(q[2])}" for q in (prior, post)]
        best, stand_in = (number(float(one[name])) for name in ("best", "stand_in"))
        rows.append(
            [f"{x.name} ({x.unit})" if x.unit != "1" else x.name, *cells, best, stand_in, f"{width:.2f}", said(width)]
        )
    head = ["unknown", "prior", "posterior", "best", "stand-in", "width", "determined"]
    return (
        "Unknowns\n"
        + table(head, rows)
        + "\n"
        + fill("width: standard deviation of the posterior over that of the prior.")
    )


def _choices(result: xr.Dataset) -> str:
    rows = []
    for name, choices in CHOICES.items():
        drawn = result["posterior"].sel(unknown=name).values.astype(int)
        share = np.bincount(drawn, minlength=len(choices)) / drawn.size
        best = choices[int(result["best"].sel(unknown=name))]
        rows.append([name, ", ".join(f"{c} {s:.2f}" for c, s in zip(choices, share, strict=True)), best])
    return "Choices that the paper does not state, with their posterior probability (equal before)\n" + table(
        ["choice", "probability", "best"], rows, of_text=True
    )


def _rows(result: xr.Dataset) -> str:
    lines = []
    for key in result["row"].values:
        one = result.sel(row=key)
        kind = str(one["kind"].values)
        low, high = np.quantile(one["predicted"].values, [0.05, 0.95])
        cells = [str(one["label"].values), "> 0" if kind == "above" else number(float(one["printed"]))]
        cells.append(f"{number(float(low))} to {number(float(high))}")
        cells.append(p_value(float(one["p"])) + ("" if kind != "told" else " (not used)"))
        for name in ("best", "stand_in"):
            d = float(one[f"{name}_distance"])
            mean = float(one[f"{name}_rows"].mean())
            cells.append(f"{number(mean)} ({d:+.1f})" + ("" if abs(d) <= LIMIT else " NO"))
        lines.append(cells)
    head = ["printed number", "paper", "posterior predictive", "p", "best (distance)", "stand-in (distance)"]
    agree = " and ".join(
        f"{int((abs(result[f'{name}_distance']) <= LIMIT).sum())} of {result.sizes['row']} with the {word}"
        for name, word in (("best", "best configuration"), ("stand_in", "stand-in"))
    )
    note = (
        f"Within {LIMIT:g} joint standard errors: {agree}. Distances are those of simulated studies, without the "
        "emulator, in errors of the paper's study, of our mean and of rounding; 0 for a ranking that holds."
    )
    return "Printed numbers\n" + table(head, lines) + "\n" + fill(note)


def _contradictions(result: xr.Dataset) -> str:
    if not result.sizes["missed"]:
        return "Contradictions: the best configuration meets every printed number."
    parts = ["Printed numbers that the best configuration misses, and what they contradict"]
    label = {str(k): str(v) for k, v in zip(result["row"].values, result["label"].values, strict=True)}
    for key in result["missed"].values:
        one = result.sel(missed=key)
        both = one["trade_off"].max("of").min("point")  # the pair whose larger distance is smallest
        worst = both.where(both > REACHED, drop=True).dropna("row").sortby(both, ascending=False)
        names = "; ".join(f"{label[str(k)]} ({float(worst.sel(row=k)):.1f})" for k in worst["row"].values)
        p, by_others = p_value(float(one["p"].sel(row=key))), p_value(float(one["p_given_others"]))
        parts.append(
            fill(
                f"{label[str(key)]}: p {p}, given the others {by_others}. Nearest study "
                f"{float(one['trade_off_others'].sel(of='missed').min()):.1f}. {_others_missed(one)} "
                f"Contradicts: {names or 'no single number, but several together'}."
            )
        )
    note = (
        f"Over the {result.attrs['studies']} simulated studies, without the emulator; distances in errors of the "
        "difference of two studies. p: posterior predictive, when the number is used; and when only the others are. "
        f"Contradicts: numbers that no study meets together with it, with the smallest distance that one of the two "
        f"keeps (above {REACHED:g})."
    )
    return "\n".join([*parts, fill(note)])


def _others_missed(one: xr.Dataset) -> str:
    """Fewest other rows missed by any study, and by those that meet the row."""
    curve = one["trade_off_others"]
    distance, others = (curve.sel(of=name).values for name in ("missed", "other"))
    met = others[distance <= LIMIT]
    where = f"studies that meet it miss {met.min():.0f} others or more" if met.size else "no study meets it"
    return f"Fewest others missed by a study: {others.min():.0f}; {where}."


def _calibration(result: xr.Dataset) -> str:
    covered, chosen = result["covered"], result.attrs["power"]
    levels = "/".join(f"{100 * float(level):g}" for level in result["level"].values)
    rows = [
        [f"{float(power):g}", _percent(covered.sel(power=power)), "chosen" if float(power) == chosen else ""]
        for power in result["power"].values
    ]
    checked = covered.sel(power=result["chosen_by_others"])
    at = result.sel(power=chosen)
    ratio = float(at["paper_error"].mean() / result["prior_error"].mean())
    words = (
        f"{result.sizes['paper']} papers were simulated from known tables and inferred, with the likelihood raised to "
        "each power. The largest power is chosen whose intervals contain the true values often enough. For each paper "
        f"at the power that the others choose, {levels} % intervals contain {_percent(checked)} % of true values. At "
        f"the chosen power the distance of the posterior mean from the truth is {ratio:.2f} of that of the prior mean."
    )
    head = ["power", f"true values in central {levels} % intervals (percent ± one standard error)", ""]
    return "Calibration\n" + table(head, rows, of_text=True) + "\n" + fill(words)


def _percent(covered: xr.DataArray) -> str:
    """Percent of true values inside the intervals of each level; papers are independent, their unknowns are not."""
    by_paper = 100 * covered.mean("unknown")
    mean, error = by_paper.mean("paper").values, by_paper.std("paper", ddof=1).values / np.sqrt(covered.sizes["paper"])
    return ", ".join(f"{m:.1f} ± {e:.1f}" for m, e in zip(mean, error, strict=True))
