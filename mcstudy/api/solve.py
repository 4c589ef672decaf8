"""The cheapest design that reaches a target, from Python."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from mcstudy.planning.solve import solve_study
from mcstudy.results.solution import Solution
from mcstudy.scheduler.activity import activity, doing
from mcstudy.study.design import Study
from mcstudy.study.instability import refuse_unstable
from mcstudy.study.study_file import read_study


def solve(
    study: Study | str | Path,
    target: str | Sequence[str],
    over: str | Sequence[str],
    *,
    group: str | None = None,
    cost: str | None = None,
    precision: float = 0.1,
    budget_fits: int = 200_000,
    workers: int | None = None,
) -> Solution:
    """Find the cheapest design of an experiment whose estimates are as precise as wanted.

    Parameters
    ----------
    study
        A `Study`, the path of a study file, or the name of a shipped study.
    target
        What shall be reached, one or several: ``"cv(Td1) <= 10%"``. Measures are ``cv``, ``sd``, ``bias``, ``rmse`` and
        ``mcse(...)`` of one of them, of a parameter or an expression such as ``K11 + Kpas1``. Values are in percent of
        the truth (``cv``: of the mean) or in the unit of the quantity.
    over
        Axes to search, with ranges where wanted: ``"cycles"``, ``"amplitude=2:8"``, ``"fmax=0.41/1.2/8"`` (Hz),
        ``"realizations"``. One text with commas, or a list.
    group
        Name of the group; needed if the study has several.
    cost
        Formula of ``time`` (recording time, s), ``cycles``, ``amplitude`` and ``fmax`` that is minimised; the recording
        time, then the amplitude, when None.
    precision
        Half-width of the 95 % interval of the answer, relative, at which the search ends.
    budget_fits
        Largest number of fits, those of the prediction too.
    workers
        Threads that fit; one per core when None.

    Returns
    -------
    Solution
        ``design`` and ``interval`` by axis, ``table`` of every design that was looked at, ``to_study()``; print
        ``text()``.

    Raises
    ------
    InputError
        A target, an axis or the study cannot be used: one line that names it.
    """
    asked = study if isinstance(study, Study) else read_study(study)
    refuse_unstable(asked)
    targets = [target] if isinstance(target, str) else list(target)
    axes = over.split(",") if isinstance(over, str) else list(over)
    with activity("preparing"):
        record = solve_study(
            asked,
            targets,
            axes,
            group=group,
            cost=cost,
            precision=precision,
            budget=budget_fits,
            threads=workers or os.cpu_count() or 1,
            say=doing,
        )
    return Solution.of(record)
