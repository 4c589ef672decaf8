"""Running a study until its Monte Carlo error is small enough: more realizations or starts, as the error asks for.

After every round each group with noise is looked at. Where leaving out half of the starts moves the bias by more than
the target, and by more than two standard errors of that move, the optimiser is what limits: the starts are doubled.
Otherwise a Monte Carlo standard error (MCSE) above the target asks for realizations, n (MCSE / target)^2 of them. All
growth is that of `mcstudy.study.extend`, so the cube equals a study made at once with the final numbers, bit for bit.
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
from mcstudy.analysis.selection import best
from mcstudy.errors import InputError
from mcstudy.stance.ranges import Range
from mcstudy.study.cluster import ClusterOptions
from mcstudy.study.design import Group, Study
from mcstudy.study.extend import Growth, extend, grown_study
from mcstudy.study.results import open_results
from mcstudy.study.run import Outcome, run_study
from mcstudy.study.store import Cube

FACTOR = 4
"""Most realizations added at once, as a multiple: the error itself is known badly from a few."""

FEWEST = 8
"""Realizations below which a standard error is not believed."""

PERCENT = Range(1e-6, 1e6)
"""What a target may be: below, no number of realizations reaches it; above, one does."""

MARGIN = 1.05
"""Realizations beyond what the square law asks for, so that the next look does not fall just short."""


@dataclass(frozen=True)
class Target:
    """What is to be known how well: ``statistic`` is a key of `STATISTICS`, ``percent`` of the true value."""

    statistic: str
    percent: float


@dataclass(frozen=True)
class Look:
    """What a group says: its largest MCSE and where, and how far half of the starts move the bias (both percent)."""

    mcse: float
    where: str
    shift: float
    shift_error: float
    shift_where: str


@dataclass
class Until:
    """How it ended.

    Attributes
    ----------
    reached: whether every group's MCSE is at the target.
    steps: one line for each growth, with the reason. statement: one line about the end.
    outcome: fits of all rounds together, as of one run.
    """

    reached: bool
    statement: str
    steps: list[str] = field(default_factory=list)
    outcome: Outcome = field(default_factory=lambda: Outcome(Path()))


@dataclass(frozen=True)
class _Step:
    """A growth of one group, with its reason; new totals of realizations or starts."""

    group: str
    why: str
    realizations: int | None = None
    starts: int | None = None

    @property
    def growth(self) -> Growth:
        return Growth(self.realizations, self.starts, groups=(self.group,))

    def change(self, study: Study) -> str:
        group = study.group[self.group]
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
"""Statistics with a target: the largest MCSE over parameters, amplitudes and Fmax counts."""


def parse_target(text: str) -> Target:
    """``bias=1%`` as a `Target`; `InputError` for anything else."""
    match = re.fullmatch(r"(\w+)=([0-9.]+(?:[eE]-?[0-9]+)?)%", text.replace(" ", ""))
    try:
        target = Target(match[1], float(match[2])) if match else None
    except ValueError:
        target = None
    if target is None or target.statistic not in STATISTICS or target.percent not in PERCENT:
        names = " or ".join(f"{name}=PERCENT%" for name in STATISTICS)
        raise InputError(f"--until-mcse: expected {names} with PERCENT {PERCENT}, such as bias=1%, got {text}")
    return target


def look(cube: xr.Dataset, target: Target) -> Look:
    """What a group of a cube says about a target."""
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
    """The largest value and its coordinates; NaN, for too few realizations to tell, counts as ``unknown``."""
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
    target: Target,
    budget: int,
    options: ClusterOptions | None = None,
    block: int | None = None,
    say: Callable[[str], object] = str,
    quarantine: bool = False,
    *,
    allow_unstable: bool = False,
) -> Until:
    """Run ``study`` and let it grow until every group with noise is at the target or the budget is spent.

    Parameters
    ----------
    out: the cube; may be one that an earlier call has grown, which goes on from there.
    budget: most fits the cube may have in all.
    say: is told every step when it is taken; by default nobody is.
    quarantine, allow_unstable: as of `run_study`.

    Raises
    ------
    InputError: no group has noise, or the study alone exceeds the budget. Others as `run_study`.
    """
    out = Path(out)
    names = [name for name, group in study.group.items() if _noisy(group)]
    if not names:
        raise InputError("--until-mcse: expected a study with noise: there is no Monte Carlo error without")
    current = _already_grown(study, out)
    if current.fits > budget:
        raise InputError(f"--budget-fits: expected at least the {current.fits} fits there are already, got {budget}")
    total = run_study(current, out, options, block, quarantine, allow_unstable=allow_unstable)
    until = Until(False, "", outcome=total)
    while True:
        tree = open_results(out, lazy=None)
        looks = {name: look(tree[name].to_dataset(), target) for name in names}
        wanted = {name: _wanted(name, current.group[name], found, target) for name, found in looks.items()}
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
                f"{target.percent:g} %; the same command with a larger --budget-fits goes on"
            )
            return until
        line = f"group {step.group}: {step.why}: {step.change(current)}"
        until.steps.append(line)
        say(line)
        _add(total, extend(out, step.growth, options, block))
        current = Cube.open(out).study


def _add(total: Outcome, more: Outcome) -> None:
    total.fits += more.fits
    total.seconds += more.seconds
    total.counts.update(more.counts)
    total.failed_blocks += more.failed_blocks


def _noisy(group: Group) -> bool:
    return group.simulator != "none" and any(group.noise.psd)


def _already_grown(study: Study, out: Path) -> Study:
    """The study of the cube when it is this one with more realizations or starts, else ``study`` itself."""
    if not out.exists():
        return study
    try:
        held = Cube.open(out).study
        larger = study
        for name, group in held.group.items():
            larger = grown_study(larger, Growth(group.realizations, group.starts, groups=(name,)))
    except InputError:
        return study  # damage or another study: `run_study` repairs or says so
    return held if larger.fingerprint == held.fingerprint else study


def _wanted(name: str, group: Group, found: Look, target: Target) -> _Step | None:
    if found.shift > target.percent and group.fit.starts != "latin_hypercube":  # whose starts cannot be added to
        why = (
            f"half of the starts move the bias by {_percent(found.shift)} +- {found.shift_error:.2g} "
            f"({found.shift_where}), so the optimiser limits"
        )
        return _Step(name, why, starts=2 * group.starts)
    if found.mcse <= target.percent:
        return None
    n = group.realizations
    asked = MARGIN * n * (found.mcse / target.percent) ** 2 if math.isfinite(found.mcse) else FEWEST
    why = f"MCSE of {target.statistic} is {_percent(found.mcse)} ({found.where}), target {target.percent:g} %"
    return _Step(name, why, realizations=max(n + 1, FEWEST, math.ceil(min(asked, FACTOR * n))))


def _affordable(study: Study, step: _Step, budget: int) -> _Step | None:
    """The step, or the part of it that the budget allows; None when that is nothing."""
    group, left = study.group[step.group], budget - study.fits
    cells = len(group.amplitude) * len(group.fmax)
    if step.starts is not None:
        starts = min(step.starts, group.starts + left // (cells * group.realizations))
        return replace(step, starts=starts) if starts > group.starts else None
    assert step.realizations is not None
    realizations = min(step.realizations, group.realizations + left // (cells * group.starts))
    return replace(step, realizations=realizations) if realizations > group.realizations else None


def _percent(value: float) -> str:
    return f"{value:.3g} %" if math.isfinite(value) else "not known yet"
