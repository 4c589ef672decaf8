"""The reliability diagrams of a challenge: what answers state, against how often it came true."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mcstudy.report.axes import picture
from mcstudy.report.style import COLOURS
from mcstudy_challenge.scores.score import LEADING
from mcstudy_challenge.scores.table import OVERALL

COUNTS = 20.0
"""Height of the largest bar of cases, percent of the vertical axis."""


def reliability_picture(score: Mapping[str, Any]) -> Figure:
    """The diagrams of a score (`challenge_score.json`), see `reliability`."""
    legend = "Dots: came true, with 95 % interval. Line: calibrated. Bars: cases."
    title = f"{score['challenge']}, {score['cases']} cases. {legend}"
    return picture([partial(reliability, found) for found in score["calibration"][:OVERALL]], title)


def reliability(calibration: Mapping[str, Any], ax: Axes) -> None:
    """How often came true what was stated, by bins, with Wilson's 95 % interval; below, the cases of every bin.

    Calibrated probabilities lie on the diagonal, but for chance.
    """
    name, bins = str(calibration["statement"]), calibration["bins"]
    ax.plot([0, 100], [0, 100], color=COLOURS["orange"])
    ax.axhline(0, color=COLOURS["muted"], linewidth=0.8)
    if bins:
        columns = ([b["low"], b["high"], b["stated"], *(b["right"][k] for k in ("value", "low", "high"))] for b in bins)
        left, right, stated, value, low, high = 100 * np.array(list(columns)).T
        cases = np.array([b["right"]["n"] for b in bins])
        height = COUNTS * cases / cases.max()
        ax.bar(left, height, right - left, -COUNTS - 5, align="edge", color=COLOURS["grid"], edgecolor=COLOURS["panel"])
        ax.errorbar(stated, value, np.maximum([value - low, high - value], 0), fmt="o", color=COLOURS["blue"])
    ax.set_xticks([0, 50, 100])
    ax.set_yticks([0, 50, 100])
    ax.set_xlim(0, 100)
    ax.set_ylim(-COUNTS - 5, 104)
    chance = ""
    if calibration["error"] is not None:
        error, expected = (100 * calibration[k] for k in ("error", "by_chance"))
        chance = f"\ncalibration error {error:.1f} %, calibrated {expected:.1f} %"
    ax.set_title(name if name == LEADING else f"that {name}")
    ax.set_xlabel(f"stated probability (%){chance}")
    ax.set_ylabel("came true (%)")
