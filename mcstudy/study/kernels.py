"""Which compiled kernels a study needs, so that they are compiled before the first fit and not within it."""

from __future__ import annotations

from collections.abc import Iterable

from mcstudy.fitting.warm import PARTS, of_rows
from mcstudy.scheduler.compiling import begin, compile_kernels
from mcstudy.study.design import Group, Study
from mcstudy.study.models import build_model


def parts_of(groups: Iterable[Group]) -> list[str]:
    """Names of `PARTS`, in their order."""
    parts = {"stability"}
    for group in groups:
        needed = {group.simulator, group.fit.solver, group.fit.starts}
        if group.fit.starts == "linearised" or group.spectra.covariance == "through_loop":
            needed |= {"linearised", "lm"}  # which race fits of that solver
        rows = build_model(group).n_rows
        parts |= {of_rows(part, rows) for part in PARTS if part in needed}
    return PARTS.in_order(parts)


def compile_for_check(study: Study, fits: bool = True) -> None:
    """Compile what `mcstudy.study.instability` needs; meanwhile begin with what the ``fits`` of this process need."""
    if fits:
        begin(parts_of(study.groups.values()))
    compile_kernels(["stability"])
