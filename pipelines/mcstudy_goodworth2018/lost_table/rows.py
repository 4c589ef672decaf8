"""The printed numbers as functions of the moments of a study, on scales on which their errors are even.

Biases and RMS values enter as logarithms, reductions of the spread as logarithms of the ratio of spreads, rankings as
logarithms of the ratio between the last parameter that should rank first and the first that should rank behind. All
functions take moments with any leading dims and return one column per row. `mcstudy_goodworth2018.paper.rows` computes
the same numbers from a cube (held equal by a test); here they are needed for thousands of predicted studies at a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import ndtr

from mcstudy_goodworth2018.lost_table.simulate import PARAMETERS, Moments
from mcstudy_goodworth2018.paper import published
from mcstudy_goodworth2018.paper.published import FMAX_HZ
from mcstudy_goodworth2018.paper.statements import RESULTS

Kind = Literal["equal", "above", "told"]
"""equal: the paper states a number. above: it states that the row is above zero. told: compared, not used."""

Scale = Literal["percent", "reduction", "gain", "margin", "ratio", "linear", "degrees"]
"""How a column becomes the published unit: see `shown`."""


@dataclass(frozen=True)
class Row:
    """A printed number. ``value``: as printed; ``half``: half a unit of its last digit, in its own unit."""

    key: str
    label: str
    kind: Kind
    scale: Scale
    value: float
    half: float


def _published(key: str, scale: Scale, half: float, kind: Kind | None = None) -> Row:
    p = RESULTS[key]
    found: Kind = "above" if p.criterion == "at least" else "equal"
    return Row(key, p.label, kind or found, scale, p.value, half)


_F = tuple(f"{f:g}" for f in FMAX_HZ)

ROWS: tuple[Row, ...] = (
    *(_published(f"bias_12_{f}", "percent", 0.5 if f == "8" else 0.05) for f in _F),
    *(_published(f"bias_10_{f}", "percent", 0.05) for f in _F),
    *(_published(f"bias_2_{f}", "percent", 0.05) for f in _F[:2]),
    _published("bias_amplitude", "linear", 1.0),
    _published("largest_bias", "margin", 0.0),
    _published("spread_fmax", "reduction", 0.5),
    _published("spread_fmax_10", "reduction", 0.5),
    _published("spread_fmax_2", "reduction", 0.5, "told"),
    *(_published(f"spread_amplitude_{f}", "reduction", 0.05 if f == "8" else 0.5) for f in _F),
    _published("spread_8hz_better", "gain", 0.0),
    _published("spread_8hz_worse", "gain", 0.0),
    _published("lowest_cv", "margin", 0.0),
    _published("highest_cv", "margin", 0.0),
    _published("combined_cv_lowest", "margin", 0.0),
    _published("combined_cv_ratio", "ratio", 0.05),
    _published("least_influential", "margin", 0.0),
    Row("bias_8_largest", "mean |bias| at 8 Hz is the largest of the three Fmax", "above", "margin", 0.0, 0.0),
    Row("bias_passive", "Kpas1, Kpas2 are more biased than the others, every Fmax", "above", "margin", 0.0, 0.0),
    Row("spread_8_larger", "SD at 8 Hz exceeds that at 1.2 Hz, 12", "above", "margin", 0.0, 0.0),
    Row("spread_passive", "Kpas1, Kpas2 scatter more than the others, every Fmax", "above", "margin", 0.0, 0.0),
    Row("spread_sums", "sums of stiffnesses scatter less than the 12, every Fmax", "above", "margin", 0.0, 0.0),
    Row(
        "cv_stiffness_damping_each",
        "each active stiffness has a lower CV than each damping",
        "above",
        "margin",
        0.0,
        0.0,
    ),
    Row("low_cv", "K11, K12, K21, K22 have a CV below 0.2, 1.2 Hz", "above", "margin", 0.0, 0.0),
    Row("sway_1", "noise-evoked sway of the lower body, RMS", "equal", "degrees", 0.11, 0.01),
    Row("sway_2", "noise-evoked sway of the hip, RMS", "equal", "degrees", 0.08, 0.01),
)
"""Printed numbers that depend on the true values, in the order of the columns.

The two readings of "combined" for the reduction of 41 % are both compared; only the first, on ten numbers, is used.
"~0.11" and "~0.08" deg are taken as rounded to 0.02. "No systematic effect" of the torque on bias: zero within 1 %.
"""

KEYS = tuple(row.key for row in ROWS)
SINGLE = np.arange(len(PARAMETERS))
SUMS = np.array([len(PARAMETERS), len(PARAMETERS) + 1])
TEN = np.array([k for k, name in enumerate(PARAMETERS) if name not in ("K11", "K22", "Kpas1", "Kpas2")] + [*SUMS])


def _places(names: tuple[str, ...]) -> np.ndarray:
    return np.array([PARAMETERS.index(name) for name in names])


def folded(mean: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Expected absolute value of a normal variable."""
    sd = np.maximum(sd, 1e-12)
    ratio = mean / sd
    return np.asarray(sd * np.sqrt(2 / np.pi) * np.exp(-(ratio**2) / 2) + mean * (2 * ndtr(ratio) - 1))


def columns(moments: Moments, over: np.ndarray, realizations: int | None = None) -> np.ndarray:
    """The rows (..., len(ROWS)) of studies with these moments.

    Parameters
    ----------
    moments: with leading dims (...).
    over: number of the span over which the RMS of sway is taken, (...).
    realizations: None when the moments are those of a study. When they are expected moments: the realizations of the
        study, whose error adds to the mean of an absolute bias.
    """
    bias, spread = moments.bias, moments.spread
    size = np.abs(bias) if realizations is None else folded(bias, spread / np.sqrt(realizations))
    low, mid, high = 0, 1, 2
    out: dict[str, np.ndarray] = {}
    for k, f in enumerate(_F):
        out[f"bias_12_{f}"] = _log(100 * _mean(size[..., k, :, :], SINGLE))
        out[f"bias_10_{f}"] = _log(100 * _mean(size[..., k, :, :], TEN))
        out[f"spread_amplitude_{f}"] = _log(
            spread[..., k, 1, SINGLE].mean(axis=-1) / spread[..., k, 0, SINGLE].mean(axis=-1)
        )
    for k in (low, mid):
        out[f"bias_2_{_F[k]}"] = _log(100 * _mean(size[..., k, :, :], SUMS))
    by_torque = 100 * size[..., SINGLE].mean(axis=(-1, -3))
    out["bias_amplitude"] = by_torque[..., 0] - by_torque[..., 1]
    out["largest_bias"] = _lead(size[..., mid, :, :][..., SINGLE].mean(axis=-2), published.LARGEST_BIAS, largest=True)
    for key, which in (("spread_fmax", SINGLE), ("spread_fmax_10", TEN), ("spread_fmax_2", SUMS)):
        out[key] = _log(_mean(spread[..., mid, :, :], which) / _mean(spread[..., low, :, :], which))
    better, worse = _places(published.BETTER_AT_8HZ), _places(published.WORSE_AT_8HZ)
    out["spread_8hz_better"] = -_log(_mean(spread[..., high, :, :], better) / _mean(spread[..., mid, :, :], better))
    out["spread_8hz_worse"] = -_log(_mean(spread[..., mid, :, :], worse) / _mean(spread[..., high, :, :], worse))
    cv = (spread[..., mid, :, :] / np.maximum(np.abs(1 + bias[..., mid, :, :]), 1e-3)).mean(axis=-2)
    single, sums = cv[..., SINGLE], cv[..., SUMS]
    out["lowest_cv"] = _lead(single, published.LOWEST_CV, largest=False)
    out["highest_cv"] = _lead(single, published.HIGHEST_CV, largest=True)
    out["combined_cv_lowest"] = _log(single.min(axis=-1) / sums.max(axis=-1))
    out["combined_cv_ratio"] = _log((sums / single[..., _places(("K11", "K22"))]).mean(axis=-1))
    out["least_influential"] = _lead(moments.influence, published.LEAST_INFLUENTIAL, largest=False)
    means = _log(size[..., SINGLE].mean(axis=(-2, -1)))
    out["bias_8_largest"] = means[..., high] - means[..., :high].max(axis=-1)
    passive = _places(("Kpas1", "Kpas2"))
    others = np.setdiff1d(SINGLE, passive)
    for key, x in (("bias_passive", size), ("spread_passive", spread)):
        out[key] = (_log(_mean(x, passive)) - _log(_mean(x, others))).min(axis=-1)
    out["spread_8_larger"] = _log(_mean(spread[..., high, :, :], SINGLE) / _mean(spread[..., mid, :, :], SINGLE))
    out["spread_sums"] = (_log(_mean(spread, SINGLE)) - _log(_mean(spread, SUMS))).min(axis=-1)
    stiff = cv[..., _places(published.LOW_CV_STIFFNESSES)].max(axis=-1)
    damp = cv[..., _places(("B11", "B12", "B21", "B22"))].min(axis=-1)
    out["cv_stiffness_damping_each"] = _log(damp) - _log(stiff)
    out["low_cv"] = np.log(published.LOW_CV) - _log(stiff)
    sway = np.take_along_axis(moments.sway, over.astype(int)[..., None, None], axis=-2)[..., 0, :]
    out["sway_1"], out["sway_2"] = _log(sway[..., 0]), _log(sway[..., 1])
    return np.stack([out[key] for key in KEYS], axis=-1)


def _log(x: np.ndarray) -> np.ndarray:
    return np.log(np.maximum(x, 1e-9))


def _mean(x: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Mean over torques and the parameters ``which`` of (..., 2, 14)."""
    return np.asarray(x[..., which].mean(axis=(-2, -1)))


def _lead(x: np.ndarray, names: tuple[str, ...], largest: bool) -> np.ndarray:
    inside = np.zeros(len(PARAMETERS), dtype=bool)
    inside[_places(names)] = True
    first, rest = x[..., inside], x[..., ~inside]
    if largest:
        return _log(first.min(axis=-1)) - _log(rest.max(axis=-1))
    return _log(rest.min(axis=-1)) - _log(first.max(axis=-1))


def stated() -> np.ndarray:
    """The paper's columns (len(ROWS),); 0 for a ranking."""
    return np.array([_column(row, row.value) for row in ROWS])


def rounding() -> np.ndarray:
    """Standard deviation that rounding adds to a column of a printed number, (len(ROWS),)."""
    out = np.zeros(len(ROWS))
    for k, row in enumerate(ROWS):
        if row.half > 0:
            ends = [_column(row, row.value + sign * row.half) for sign in (-1, 1)]
            out[k] = abs(ends[1] - ends[0]) / np.sqrt(12)
    return out


def _column(row: Row, value: float) -> float:
    if row.scale == "linear":
        return value
    if row.scale in ("reduction", "gain"):
        return float(np.log(1 - value / 100)) * (1 if row.scale == "reduction" else -1)
    if row.scale == "margin":
        return float(np.log(1 + value / 100))
    return float(np.log(value))


def shown(x: np.ndarray) -> np.ndarray:
    """Columns (..., len(ROWS)) in the units of the paper (percent, ratio, deg)."""
    out = np.array(x, dtype=float)
    for k, row in enumerate(ROWS):
        if row.scale == "reduction":
            out[..., k] = 100 * (1 - np.exp(x[..., k]))
        elif row.scale == "gain":
            out[..., k] = 100 * -np.expm1(-x[..., k])
        elif row.scale == "margin":
            out[..., k] = 100 * np.expm1(np.minimum(x[..., k], 20.0))
        elif row.scale != "linear":
            out[..., k] = np.exp(x[..., k])
    return out
