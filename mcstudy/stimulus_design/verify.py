"""Whether a design keeps its promise: bounded fits to simulated noise, with the design and with the sequence.

The studies are ordinary ones (`mcstudy.study`). Design and sequence share the noise and the number of cycles; the fits
start anew and stay within the bounds of the study, which the prediction leaves out. The bodies are drawn for the
verification and were not used by the design.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from mcstudy.analysis.selection import best
from mcstudy.errors import InputError
from mcstudy.spectra.bands import PERIOD_S
from mcstudy.stimulus_design.bodies import drawn
from mcstudy.stimulus_design.design_file import DesignFile
from mcstudy.stimulus_design.spectrum import Designed
from mcstudy.streams import stream
from mcstudy.study.design import Study
from mcstudy.study.group import ModelSection

COSTS: dict[str, dict[str, Any]] = {
    "ml": {
        "spectra": {"points": "odd_lines", "ramp": "remove", "covariance": "through_loop"},
        "fit": {"cost": "ml", "starts": "linearised"},
    },
    "paper": {"fit": {"cost": "paper", "starts": "linearised"}},
}
"""Estimators compared: maximum likelihood on single lines without the ramp, and the paper's on its 28 points."""

STIMULI = ("sequence", "design")


@dataclass(frozen=True, eq=False)
class Spread:
    """Spread of the best fits of one group of fits with the sequence (0) and with the design (1), P parameters.

    Attributes
    ----------
    fmax: Hz. cost: ``ml`` or ``paper``. cv: standard deviation over true value, (2, P). bias: mean error over true
    value, (2, P). at_bound: share of fits with the parameter on a bound, (2, P). ratio: of the standard deviations,
    sequence over design, (P,). ratio_error: its standard error, (P,). mean, mean_error: geometric mean of the ratio
    over parameters, and its standard error. n: realizations in which both fits ended.
    """

    fmax: float
    cost: str
    cv: np.ndarray
    bias: np.ndarray
    at_bound: np.ndarray
    ratio: np.ndarray
    ratio_error: np.ndarray
    mean: float
    mean_error: float
    n: int


def costs(file: DesignFile) -> tuple[str, ...]:
    """The estimators that a design file can be verified with: the paper's points exist for its cycle only."""
    papers = not file.model.declared and abs(file.period_s - PERIOD_S) < 1e-9
    return ("ml", "paper") if papers else ("ml",)


def study_of(designed: Designed) -> Study:
    """The study of the design and the sequence for the body of the file; a user's starting point."""
    return _study(designed, _nominal(designed))


def verification_of(designed: Designed) -> Study:
    """`study_of` and the same for the bodies drawn for the verification, with maximum likelihood only."""
    file, groups = designed.file, _nominal(designed)
    axes = {"realizations": file.verify.body_realizations, "fmax": [file.design.fmax]}
    for n, body in enumerate(bodies_of(designed)):
        groups |= _groups(designed, body, axes, ("ml",), f"body{n + 1:02d}_")
    return _study(designed, groups)


def bodies_of(designed: Designed) -> list[ModelSection]:
    """The bodies of the verification."""
    file = designed.file
    return drawn(file, file.verify.bodies, stream(file.design.seed, "design_bodies"))


def _nominal(designed: Designed) -> dict[str, dict[str, Any]]:
    verify = designed.file.verify
    axes = {"realizations": max(verify.realizations, 1), "fmax": sorted(verify.fmax)}
    return _groups(designed, designed.file.model, axes, costs(designed.file), "")


def _study(designed: Designed, groups: dict[str, dict[str, Any]]) -> Study:
    asked = designed.file.design
    about = "a designed stimulus and the sequence that it is compared with"
    study: Study = Study(study={"name": asked.name, "seed": asked.seed, "description": about}, group=groups)
    return study


def _groups(
    designed: Designed, model: ModelSection, axes: dict[str, Any], costs: tuple[str, ...], prefix: str
) -> dict[str, dict[str, Any]]:
    """Groups with each stimulus and cost for one body, as tables of a study file."""
    file = designed.file
    shared = file.stimulus.model_dump(mode="json") | {"cycles": file.cycles}
    lines = {"sequence": {}, "design": {"lines": designed.lines.model_dump(mode="json")}}
    amplitude = {"sequence": file.design.amplitude, "design": designed.stimulus.amplitude}
    settings = COSTS
    if file.model.declared:
        ml = COSTS["ml"]
        settings = {"ml": ml | {"spectra": ml["spectra"] | {"highest_hz": file.design.fmax}}}
    return {
        f"{prefix}{which}_{cost}": {
            **axes,
            "starts": file.verify.starts,
            "amplitude": [amplitude[which]],
            "model": model,
            "stimulus": shared | lines[which],
            "noise": file.noise,
            **settings[cost],
        }
        for cost in costs
        for which in STIMULI
    }


def spreads(results: xr.DataTree, prefix: str, cost: str) -> list[Spread]:
    """The spread at every Fmax of the groups with this prefix and cost; raises `InputError` when fits are missing."""
    cells = [best(results[f"{prefix}{which}_{cost}"].to_dataset()).isel(amplitude=0) for which in STIMULI]
    return [spread([c.isel(fmax=k) for c in cells], cost) for k in range(cells[0].sizes["fmax"])]


def spread(cells: list[xr.Dataset], cost: str) -> Spread:
    """Of the best fits with the sequence and with the design at one Fmax, dims (realization, parameter)."""
    truth = cells[0]["truth"].transpose("parameter").values
    x = np.stack([c["estimate"].transpose("realization", "parameter").values / truth for c in cells])
    bound = np.stack([(c["at_bound"] != 0).transpose("realization", "parameter").values for c in cells])
    done = np.isfinite(x).all(axis=(0, 2))
    if done.sum() < 3:
        raise InputError(f"verification: expected at least 3 realizations with a fit of both stimuli, got {done.sum()}")
    x, bound = x[:, done], bound[:, done]
    sd = x.std(axis=1, ddof=1)
    ratio, ratio_error, mean, mean_error = compared(x)
    return Spread(
        fmax=float(cells[0]["fmax"]),
        cost=cost,
        cv=sd,
        bias=x.mean(axis=1) - 1,
        at_bound=bound.mean(axis=1),
        ratio=ratio,
        ratio_error=ratio_error,
        mean=mean,
        mean_error=mean_error,
        n=int(done.sum()),
    )


def compared(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Ratios (P,) of the standard deviations of two paired samples ``x`` (2, R, P), their errors, the geometric mean.

    Standard errors are those of the jackknife over realizations, of the logarithms; both samples share the noise. They
    are NaN where all but one estimate are equal (on a bound), ratios where all are.
    """
    n = x.shape[1]
    centred = x - x.mean(axis=1, keepdims=True)
    total = (centred**2).sum(axis=1, keepdims=True)
    without = total - centred**2 * n / (n - 1)  # sum of squares about the mean, one realization left out
    with np.errstate(divide="ignore", invalid="ignore"):
        left = 0.5 * np.log(without[0] / without[1])  # (R, P)
        whole = 0.5 * np.log(total[0, 0] / total[1, 0])

    def error(values: np.ndarray) -> np.ndarray:
        return np.asarray(np.sqrt((n - 1) / n * ((values - values.mean(axis=0)) ** 2).sum(axis=0)))

    ratio = np.exp(whole)
    mean = float(np.exp(whole.mean()))
    return ratio, ratio * error(left), mean, mean * float(error(left.mean(axis=1)))
