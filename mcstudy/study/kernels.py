"""Which compiled kernels a study needs, so that they are compiled before the first fit and not within it."""

from __future__ import annotations

from collections.abc import Iterable

from mcstudy.fitting.warm import PARTS
from mcstudy.scheduler.compiling import begin, compile_kernels
from mcstudy.study.design import Group, Study


def parts_of(groups: Iterable[Group]) -> list[str]:
    """Names of `PARTS`, in their order."""
    parts = {"stability"}
    for group in groups:
        parts |= {group.simulator, group.fit.solver, group.fit.starts}
        if group.fit.starts == "linearised" or group.spectra.covariance == "through_loop":
            parts |= {"linearised", "lm"}  # which race fits of that solver
    return [part for part in PARTS if part in parts]


def compile_for_check(study: Study, fits: bool = True) -> None:
    """Compile what `mcstudy.study.instability` needs; meanwhile begin with what the ``fits`` of this process need."""
    if fits:
        begin(parts_of(study.groups.values()))
    compile_kernels(["stability"])
