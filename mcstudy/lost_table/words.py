"""The result of an inference as tables of text."""

from __future__ import annotations

import numpy as np
import xarray as xr

from mcstudy.analysis.montecarlo import score_interval
from mcstudy.lost_table.checks import LIMIT
from mcstudy.lost_table.contradictions import REACHED
from mcstudy.lost_table.unknowns import UNKNOWNS
from mcstudy.text_tables import fill, number, table

DETERMINED, UNDETERMINED = 0.5, 0.9
"""Width of the posterior over that of the prior: below the first an unknown is determined, above the second not."""

CHOICES = {x.name: x.choices for x in UNKNOWNS if x.choices}


def text(result: xr.Dataset) -> str:
    """All tables of a result."""
    parts = [_heading(result), _unknowns(result), _choices(result), _rows(result), _contradictions(result)]
    if result.sizes["paper"]:
        parts.append(_calibration(result))
    return "\n\n".join(part for part in parts if part)


def _heading(result: xr.Dataset) -> str:
    return fill(
        f"This is {result.attrs['status']}. It rests on {result.attrs['studies']} simulated studies of "
        f"{result.attrs['realizations']} realizations. Ranges are 90 % intervals."
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
        cells.append(_p(float(one["p"])) + ("" if kind != "told" else " (not used)"))
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


def _p(p: float) -> str:
    return "< 0.001" if p < 1e-3 else f"{p:.3f}"


def _contradictions(result: xr.Dataset) -> str:
    if not result.sizes["failed"]:
        return "Contradictions: no printed number has a posterior predictive p below 0.01."
    lines = []
    label = {str(k): str(v) for k, v in zip(result["row"].values, result["label"].values, strict=True)}
    for key in result["failed"].values:
        fronts = result["trade_off"].sel(failed=key)
        both = fronts.max("of").min("point")  # the pair whose larger distance is smallest
        worst = both.where(both > REACHED, drop=True).dropna("row").sortby(both, ascending=False)
        names = "; ".join(f"{label[str(k)]} ({float(worst.sel(row=k)):.1f})" for k in worst["row"].values[:6])
        alone = float(fronts.sel(of="failed").min())
        lines.append([label[str(key)], f"{alone:.1f}", names or "no single row; several together"])
    note = (
        "alone: smallest distance of the row with one other row and nothing else required. contradicts: rows that "
        f"cannot be met together with it, with the smallest distance that one of the two keeps (above {REACHED:g} "
        "standard errors of a study)."
    )
    return (
        "Printed numbers that the posterior does not reproduce (p < 0.01)\n"
        + table(["printed number", "alone", "contradicts"], lines, of_text=True)
        + "\n"
        + fill(note)
    )


def _calibration(result: xr.Dataset) -> str:
    n = result.sizes["paper"]
    covered = result["covered"].values
    share = float(covered.mean())
    # papers are independent, their unknowns are not: the interval counts papers
    by_paper = covered.mean(axis=1)
    error = float(by_paper.std(ddof=1) / np.sqrt(n)) if n > 1 else float("nan")
    single = covered.mean(axis=0)
    centre, half = score_interval(single, n)
    odd = [
        f"{name} {s:.2f} ({c - h:.2f} to {c + h:.2f})"
        for name, s, c, h in zip(result["unknown"].values, single, centre, half, strict=True)
        if not c - h <= 0.9 <= c + h
    ]
    ratio = float(result["paper_error"].mean() / result["prior_error"].mean())
    words = (
        f"Calibration: {n} papers were simulated from known tables and inferred. 90 % intervals contain the true value "
        f"in {100 * share:.1f} ± {100 * error:.1f} % of cases. "
        + (
            f"Outside the sampling error of 90 %: {', '.join(odd)}. "
            if odd
            else "No unknown is outside its sampling error. "
        )
        + f"The distance of the posterior mean from the truth is {ratio:.2f} of that of the prior mean."
    )
    return fill(words)
