"""The problems that all solvers solve: cells of the paper's study, made by the study's own experiment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from mcstudy.fitting.problem import Problem
from mcstudy.study.experiment import Experiment
from mcstudy.study.study_file import parse_study

AMPLITUDE = 5.0
FMAX = (1.2, 8.0)

STUDY = """
[study]
name = "benchmark"
seed = 2018

[group.accuracy]
realizations = {realizations}
starts = {starts}
fmax = [{fmax}]
amplitude = [{amplitude}]
"""


def study_text(
    realizations: int, starts: int, fmax: tuple[float, ...] = FMAX, amplitude: float | str = AMPLITUDE
) -> str:
    """A study file with one group; several amplitudes as text, with commas."""
    axis = ", ".join(map(str, fmax))
    return STUDY.format(realizations=realizations, starts=starts, fmax=axis, amplitude=amplitude)


@dataclass(frozen=True)
class Case:
    """One fit problem of the study and its starts (S, P)."""

    fmax: float
    realization: int
    problem: Problem
    starts: np.ndarray


@cache
def experiment(starts: int) -> Experiment:
    """The paper's accuracy group at the benchmark's Fmax."""
    study = parse_study(study_text(1, starts))
    return Experiment(study.groups["accuracy"], study.study.seed)


def cases(realizations: int, starts: int) -> list[Case]:
    """Cells of the study: every Fmax of every realization, at one amplitude."""
    paper = experiment(starts)
    out = []
    for r in range(realizations):
        data = paper.measure(AMPLITUDE, r)
        for fmax in FMAX:
            problem = paper.problem(data, fmax)
            out.append(Case(fmax, r, problem, paper.starts([problem], [r])[0]))
    return out
