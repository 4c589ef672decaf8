"""The trade-offs of an inference of the lost table: how far a missed number is, against how many others are missed."""

from __future__ import annotations

from functools import partial

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mcstudy.report.axes import picture
from mcstudy.report.style import COLOURS, DASHES
from mcstudy_goodworth2018.lost_table.checks import LIMIT

COLUMNS, SIZE = 3, (3.2, 2.6)
FURTHEST = 15.0
"""Distances beyond this are drawn at it."""


def trade_offs_picture(result: xr.Dataset) -> Figure:
    """One panel per missed number, see `trade_off`."""
    status = str(result.attrs["status"]).capitalize()
    title = f"Dots: simulated studies. Line: none is better in both. Dashed: {LIMIT:g} errors. {status}."
    return picture([partial(trade_off, result, str(key)) for key in result["missed"].values], title, COLUMNS, SIZE)


def trade_off(result: xr.Dataset, key: str, ax: Axes) -> None:
    """How many other numbers are missed over the distance of one: a dot per simulated study, and a line of the best."""
    distances = np.abs(result["bank_distance"].values)
    distance = distances[:, list(result["row"].values).index(key)]
    others = (distances[:, result["kind"].values != "told"] > LIMIT).sum(axis=1) - (distance > LIMIT)
    best = result["trade_off_others"].sel(missed=key)
    ax.plot(np.minimum(distance, FURTHEST), others, ".", color=COLOURS["muted"], alpha=0.45)
    ax.plot(np.minimum(best.sel(of="missed"), FURTHEST), best.sel(of="other"), color=COLOURS["orange"])
    ax.axvline(LIMIT, color=COLOURS["muted"], linestyle=DASHES[1])
    ax.set_xlim(0, FURTHEST)
    ax.set_ylim(0, None)
    ax.set_xlabel(f"distance, errors ({FURTHEST:g}: or more)")
    ax.set_ylabel("others missed")
    ax.set_title(str(result["label"].sel(row=key).values))
