"""How much each parameter matters to the FRFs, by frequency range (Goodworth & Peterka 2018, Methods and Fig. 7C)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from mcstudy.analysis.labels import ONE, labelled
from mcstudy.errors import InputError
from mcstudy.fitting.problem import paper_cost
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf

RANGES: dict[str, tuple[float, float]] = {"low": (0.023, 0.3), "mid": (0.43, 2.5), "high": (3.2, 8.0)}
"""Frequency ranges of Fig. 7C, Hz. The gaps between them are the paper's."""

_EDGE = 0.01  # the paper rounds its frequencies (0.02287 is printed 0.023, 8.0055 as 8.00), so the edges give by 1 %


def sensitivity(
    model: Model,
    theta: np.ndarray,
    f: np.ndarray,
    change: float = 0.1,
    ranges: Mapping[str, tuple[float, float]] = RANGES,
) -> xr.Dataset:
    """J_true between the FRFs at ``theta`` and with one parameter changed by ``-change`` or ``+change`` of itself.

    Parameters
    ----------
    model: the model; theta: (P,) where to vary it; f: frequencies in Hz, (N,).

    Returns
    -------
    Dataset ``value`` with dims (range, direction, parameter) and ``share`` (range, parameter): the mean of both
    directions as a fraction of the range's total, the slices of the paper's pies. Exact: no Monte Carlo error.
    Ranges without any of ``f`` are left out; raises `InputError` when all are.
    """
    inside = {name: (f >= lo * (1 - _EDGE)) & (f <= hi * (1 + _EDGE)) for name, (lo, hi) in ranges.items()}
    inside = {name: lines for name, lines in inside.items() if lines.any()}
    if not inside:
        raise InputError(f"frequency: none of the {f.size} frequencies lies in a range of {dict(ranges)}")
    P = theta.size
    value = np.zeros((len(inside), 2, P))
    for d, sign in enumerate((-1.0, 1.0)):
        varied = np.tile(theta, (P, 1))
        varied[np.arange(P), np.arange(P)] *= 1 + sign * change
        for r, lines in enumerate(inside.values()):
            problem = paper_cost(model, f[lines], frf(model, theta, f[lines]))
            value[r, d] = [problem.cost(v) for v in varied]
    out = xr.Dataset(
        {"value": (("range", "direction", "parameter"), value)},
        coords={
            "range": list(inside),
            "direction": [-change, change],
            "parameter": list(model.names),
        },
    )
    mean = out["value"].mean("direction")
    return labelled(
        out.assign(share=mean / mean.sum("parameter")),
        None,
        "J_true between the FRFs before and after the change",
        share=("share of the parameter in the frequency range", ONE),
    )


def influence(model: Model, theta: np.ndarray, f: np.ndarray, change: float = 0.1) -> xr.DataArray:
    """One number per parameter: `sensitivity` averaged over both directions and the ranges, dims (parameter,)."""
    return sensitivity(model, theta, f, change)["value"].mean(("range", "direction"))
