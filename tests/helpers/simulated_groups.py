"""Groups of simulated people on a tilting platform, in closed form, whose differences have known causes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from mcstudy.recordings.frf_group import group_dataset
from mcstudy.recordings.frf_group_sheet import TableSheet
from mcstudy.spectra.frf_groups import in_space
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.response import frf

POINTS = ((1,), (2,), (3, 4), (4, 5), (5, 6, 7), (6, 7, 8, 9), (8, 9, 10, 11), (10, 11, 12, 13), (12, 13, 14, 15, 16))


def people(
    n: int, seed: int, change: Mapping[str, float] | None = None, *, noise: float = 0.3, again: int = 0
) -> xr.Dataset:
    """One condition of ``n`` people whose parameters scatter by 5 % about the stand-in truth.

    ``change``: factors of parameters, the same for everybody. ``noise``: SD of the FRFs at 0.5 Hz, relative to the
    stimulus; it falls with frequency. ``again``: number of the recording; another one has other noise.
    """
    model = two_segment(stimulus="surface_tilt")
    sheet = TableSheet(file="", gain="*", phase="*", period_s=20.0, points=POINTS, prts_state_s=0.25)
    f_line, average = sheet.lines()
    theta = model.truth * np.exp(0.05 * np.random.default_rng([seed, 0]).normal(size=(n, len(model.truth))))
    for name, factor in (change or {}).items():
        theta[:, model.names.index(name)] *= factor
    rng = np.random.default_rng([seed, 1, again])
    lines = in_space(frf(model, theta, f_line))
    size = noise * (0.5 / np.maximum(f_line, 0.2))[None, :, None] / np.sqrt(2)
    lines = lines + size * (rng.normal(size=lines.shape) + 1j * rng.normal(size=lines.shape))
    points = np.einsum("nl,pls->psn", average, lines)[:, None]
    names = [f"person {seed}-{k}" for k in range(n)]
    return group_dataset(points, names, [()], [], f_line, average, "surface_tilt", Body())
