"""The solver of the paper, ``interior_point`` of a study file: how it attaches to the runner, and its settings."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mcstudy.files.sections import Section
from mcstudy.fitting.solvers import USUAL_ROWS, Part, Solver


class Settings(Section):
    """Choices of the solver that the documentation of fmincon leaves open.

    Defaults: the documented ones of fmincon, and the parameters as they are (`mcstudy_goodworth2018.solver.emulation`).

    Attributes
    ----------
    units
        Whether it works in the parameters' own units, or in units of the width of their bounds.
    hessian
        Whether the first quasi-Newton matrix is the identity, or scaled to the first change of the gradient.
    difference_step
        Step of the forward differences, times the larger of 1 and the parameter.
    step_tolerance
        Step, relative to the larger of 1 and the parameter, at which a fit ends.
    max_evaluations
        Most evaluations of the cost.
    barrier
        Barrier parameter at the start.
    """

    units: Literal["own", "bounds"] = "own"
    hessian: Literal["identity", "scaled"] = "identity"
    difference_step: float = Field(default=2.0**-26, ge=1e-15, le=0.1)
    step_tolerance: float = Field(default=1e-10, gt=0, lt=1)
    max_evaluations: int = Field(default=3000, ge=1, le=1_000_000)
    barrier: float = Field(default=0.1, ge=1e-12, le=1000)


solver = Solver(
    name="interior_point",
    solve="mcstudy_goodworth2018.solver.emulation:solve",
    parts={
        "interior_point": Part(
            "mcstudy_goodworth2018.solver.emulation:compile_kernel", 39, 16.0, ("steps",), ("cost",), USUAL_ROWS
        )
    },
    settings=Settings,
    fits_a_chunk=(300, 2000),
    starts_a_call=128,
    pilot_fits=96,
)
"""It takes some milliseconds per fit."""
