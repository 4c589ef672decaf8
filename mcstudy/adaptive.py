"""Run a study until its Monte Carlo error is small enough, by adding realizations or starts.

After every round, each group with noise is checked. If leaving out half of the starts shifts the bias by more than the
target and by more than two standard errors of that shift, the number of starts limits precision, and it is doubled.
Otherwise, if the Monte Carlo standard error (MCSE) is above the target, the number of realizations is raised to
n (MCSE / target)^2. Every step uses `mcstudy.study.extend`, so the final cube equals, bit for bit, a study run at once
with the final numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import xarray as xr

from mcstudy.analysis import accuracy
from mcstudy.analysis.results import open_results
from mcstudy.analysis.selection import best
from mcstudy.errors import InputError
from mcstudy.files.local_path import local_path
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.stance.ranges import Range
from mcstudy.study.cube.store import Cube
from mcstudy.study.design import Group, Study
from mcstudy.study.extend import Growth, extend, grown_study
from mcstudy.study.run import Outcome, run_study

FACTOR = 4
"""Largest growth of the number of realizations in one step: the MCSE is uncertain when it comes from few."""

FEWEST = 8
"""Number of realizations below which the MCSE is not trusted."""

PERCENT_RANGE = Range(1e-6, 1e6)
"""Allowed targets, percent. Below this range no number of realizations is enough; above it one is."""

MARGIN = 1.05
"""Safety factor on the number of realizations, so that the next check does not fall just short of the target."""


@dataclass(frozen=True)
class PrecisionTarget:
    """Required precision: ``statistic`` is a key of `STATISTICS`; ``percent`` is the MCSE in percent of the truth."""

    statistic: str
    percent: float


@dataclass(frozen=True)
class Look:
    """Precision of one group: largest MCSE and shift of the bias when half of the starts are left out, both percent."""

    mcse: float
    where: str
    shift: float
    shift_error: float
    shift_where: str


@dataclass
class Until:
    """Result of `run_until`.

    Attributes
    ----------
    reached: whether the MCSE of every group is at or below the target.
    steps: one line per extension, with the reason. statement: one line about the final state.
    outcome: fits of all rounds together, as for a single run.
    """

    reached: bool
    statement: str
    steps: list[str] = field(default_factory=list)
    outcome: Outcome = field(default_factory=lambda: Outcome(Path()))


@dataclass(frozen=True)
class _Step:
    """Extension of one group, with its reason; new totals of realizations or starts."""

    group: str
    why: str
    realizations: int | None = None
    starts: int | None = None

    @property
    def growth(self) -> Growth:
        return Growth(self.realizations, self.starts, groups=(self.group,))

    def change(self, study: Study) -> str:
        group = study.groups[self.group]
        if self.starts is not None:
            return f"starts {group.starts} -> {self.starts}"
        return f"realizations {group.realizations} -> {self.realizations}"


def bias_percent(cells: xr.Dataset) -> xr.DataArray:
    """MCSE of the bias of every parameter, percent of the truth."""
    truth = cells["truth"]
    return 100 * accuracy.bias(cells)["mcse"] / abs(truth.where(truth != 0))


def mean_bias_percent(cells: xr.Dataset) -> xr.DataArray:
    """MCSE of |bias| averaged over the parameters (the paper's number), percent of the truth."""
    return accuracy.mean_absolute_bias_percent(cells)["mcse"]


STATISTICS: dict[str, Callable[[xr.Dataset], xr.DataArray]] = {
    "bias": bias_percent,
    "mean_bias": mean_bias_percent,
}
"""Statistics that can have a target; it applies to the largest MCSE over parameters, amplitudes and Fmax."""


def parse_target(text: str) -> PrecisionTarget:
    """``bias=1%`` as a `PrecisionTarget`; `InputError` for anything else."""
    match = re.fullmatch(r"(\w+)=([0-9.]+(?:[eE]-?[0-9]+)?)%", text.replace(" ", ""))
    try:
        target = PrecisionTarget(match[1], float(match[2])) if match else None
    except ValueError:
        target = None
    if target is None or target.statistic not in STATISTICS or target.percent not in PERCENT_RANGE:
        names = " or ".join(f"{name}=PERCENT%" for name in STATISTICS)
        raise InputError(f"target: expected {names} with PERCENT {PERCENT_RANGE}, such as bias=1%, got {text}")
    return target


def look(cube: xr.Dataset, target: PrecisionTarget) -> Look:
    """Precision of one group of a cube, for the statistic of ``target``."""
    needed = cube[[n for n in ("estimate", "cost", "status", "truth") if n in cube]]
    cells = best(needed).compute()
    mcse, cell = _largest(STATISTICS[target.statistic](cells))
    half = best(needed.isel(start=slice(0, -(-cube.sizes["start"] // 2)))).compute()
    truth = abs(cells["truth"].where(cells["truth"] != 0))
    moved = 100 * (cells["estimate"] - half["estimate"]) / truth
    n = moved.notnull().sum("realization")
    shift, error = abs(moved.mean("realization")), moved.std("realization", ddof=1) / n.where(n > 1) ** 0.5
    if target.statistic == "mean_bias":
        shift, error = shift.mean("parameter"), error.mean("parameter")
    most, moved_most = _largest(shift.where(shift > 2 * error, 0.0), unknown=0.0)
    return Look(mcse, _place(cell), most, float(error.sel(moved_most)), _place(moved_most))


def _largest(values: xr.DataArray, unknown: float = math.inf) -> tuple[float, dict[Hashable, Any]]:
    """The largest value and its coordinates; NaN (too few realizations) counts as ``unknown``."""
    truthful = values.dropna("parameter", how="all") if "parameter" in values.dims else values
    flat = (truthful if truthful.size else values).fillna(unknown)
    cells = flat.stack(cell=flat.dims)
    worst = cells.isel(cell=int(cells.argmax("cell")))
    return float(worst), {d: worst.coords[d].item() for d in flat.dims}


def _place(cell: dict[Hashable, Any]) -> str:
    return ", ".join(f"{d} {at:g} Hz" if d == "fmax" else f"{d} {at}" for d, at in cell.items())


def run_until(
    study: Study,
    out: str | Path,
    target: PrecisionTarget,
    budget: int,
    options: ClusterOptions | None = None,
    block: int | None = None,
    say: Callable[[str], object] = str,
    quarantine: bool = False,
    *,
    allow_unstable: bool = False,
) -> Until:
    """Run ``study`` and extend it until every group with noise is at the target or the budget is spent.

    Parameters
    ----------
    out: path of the cube. If an earlier call has extended it, the run continues from there.
    budget: upper limit on the total number of fits in the cube.
    say: called with one line for each step; by default nothing is shown.
    quarantine, allow_unstable: see `run_study`.

    Raises
    ------
    InputError: no group has noise, or the study alone exceeds the budget. Other errors are those of `run_study`.
    """
    out = local_path(out)
    names = [name for name, group in study.groups.items() if group.noisy]
    if not names:
        raise InputError("target: expected a study with noise, because there is no Monte Carlo error without noise")
    current = _already_grown(study, out)
    if current.fits > budget:
        raise InputError(f"budget_fits: expected at least {current.fits}, the fits of the study so far, got {budget}")
    total = run_study(current, out, options, block, quarantine, allow_unstable=allow_unstable)
    until = Until(False, "", outcome=total)
    while True:
        tree = open_results(out, lazy=None)
        looks = {name: look(tree[name].to_dataset(), target) for name in names}
        wanted = {name: _wanted(name, current.groups[name], precision, target) for name, precision in looks.items()}
        worst = max(names, key=lambda name: looks[name].mcse)
        now = f"largest MCSE of {target.statistic} {_percent(looks[worst].mcse)} (group {worst}, {looks[worst].where})"
        if not any(wanted.values()):
            until.reached = True
            until.statement = f"reached: {now}, target {target.percent:g} %; {current.fits} of {budget} fits"
            return until
        steps = (_affordable(current, step, budget) for step in wanted.values() if step is not None)
        step = max(filter(None, steps), key=lambda s: looks[s.group].mcse, default=None)
        if step is None:
            until.statement = (
                f"stopped: the budget of {budget} fits is spent ({current.fits} run); {now}, target "
                f"{target.percent:g} %; to continue, repeat the command with a larger --budget-fits"
            )
            return until
        line = f"group {step.group}: {step.why}: {step.change(current)}"
        until.steps.append(line)
        say(line)
        _add(total, extend(out, step.growth, options, block))
        current = Cube.open(out).study


def _add(total: Outcome, more: Outcome) -> None:
    total.fits += more.fits
    total.not_needed += more.not_needed
    total.seconds += more.seconds
    total.counts.update(more.counts)
    total.failed_blocks += more.failed_blocks


def _already_grown(study: Study, out: Path) -> Study:
    """The study of the cube if it is ``study`` with more realizations or starts, else ``study`` itself."""
    if not out.exists():
        return study
    try:
        held = Cube.open(out).study
        larger = study
        for name, group in held.groups.items():
            larger = grown_study(larger, Growth(group.realizations, group.starts, groups=(name,)))
    except InputError:
        return study  # damage or another study: `run_study` repairs or reports it
    return held if larger.fingerprint == held.fingerprint else study


def _wanted(name: str, group: Group, precision: Look, target: PrecisionTarget) -> _Step | None:
    grows = group.fit.starts != "latin_hypercube" and not group.until_certain
    if precision.shift > target.percent and grows:  # otherwise starts cannot be added, or are as many as needed
        why = (
            f"leaving out half of the starts shifts the bias by {_percent(precision.shift)} "
            f"+- {precision.shift_error:.2g} ({precision.shift_where}), so the number of starts limits precision"
        )
        return _Step(name, why, starts=2 * group.starts)
    if precision.mcse <= target.percent:
        return None
    n = group.realizations
    asked = MARGIN * n * (precision.mcse / target.percent) ** 2 if math.isfinite(precision.mcse) else FEWEST
    why = f"MCSE of {target.statistic} is {_percent(precision.mcse)} ({precision.where}), target {target.percent:g} %"
    return _Step(name, why, realizations=max(n + 1, FEWEST, math.ceil(min(asked, FACTOR * n))))


def _affordable(study: Study, step: _Step, budget: int) -> _Step | None:
    """The step, or the part of it that the budget allows; None when the budget allows nothing."""
    group, left = study.groups[step.group], budget - study.fits
    cells = len(group.amplitude) * len(group.fmax)
    if step.starts is not None:
        starts = min(step.starts, group.starts + left // (cells * group.realizations))
        return replace(step, starts=starts) if starts > group.starts else None
    assert step.realizations is not None
    realizations = min(step.realizations, group.realizations + left // (cells * group.starts))
    return replace(step, realizations=realizations) if realizations > group.realizations else None


def _percent(value: float) -> str:
    return f"{value:.3g} %" if math.isfinite(value) else "not known yet"
