"""What a search found: the answer, its interval, every design that was looked at, and the study of the answer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from mcstudy.errors import InputError
from mcstudy.files.json_files import plain
from mcstudy.files.schema import identifier
from mcstudy.planning.arm import Arm, Look
from mcstudy.planning.fits import Design, Spent
from mcstudy.planning.space import CYCLES, REALIZATIONS, Space
from mcstudy.planning.targets import Target
from mcstudy.study.design import Study


@dataclass(frozen=True)
class Crossing:
    """Where an axis meets the targets, the others as in the answer: best estimate and 95 % interval, not rounded.

    ``at_start``, ``at_end``: whether the interval ends with the range that was allowed.
    """

    axis: str
    value: float
    low: float
    high: float
    at_start: bool
    at_end: bool

    @property
    def interval(self) -> tuple[float, float]:
        """The interval, in whole numbers where the axis has these."""
        if self.axis in (CYCLES, REALIZATIONS):
            return math.ceil(self.low - 1e-9), math.ceil(self.high - 1e-9)
        return self.low, self.high


@dataclass(frozen=True)
class Answer:
    """The cheapest design that meets the targets."""

    design: Design
    cost: float
    crossings: tuple[Crossing, ...]


@dataclass(frozen=True)
class Reading:
    """A target's measure at the answer with its 95 % interval, in the target's unit.

    ``linear``: the same in linear theory without bounds on the parameters. ``bound``: at the Cramer-Rao bound. NaN
    where there is none.
    """

    target: Target
    value: float
    low: float
    high: float
    linear: float
    bound: float


@dataclass(frozen=True)
class Row:
    """The cheapest design with one Fmax, or the nearest to the targets; ends of its cost, NaN where out of reach.

    ``hopeless``: no design reaches them at 95 %. ``control``: kind of the cheap fits. ``relative_cost``: expected cost
    of the estimates, relative to complete fits.
    """

    fmax: float
    cycles: int
    amplitude: float
    cost: float
    lowest_cost: float
    highest_cost: float
    reached: bool
    hopeless: bool
    control: str
    relative_cost: float


@dataclass(frozen=True, eq=False, repr=False)
class SolutionRecord:
    """The cheapest design that reaches the targets.

    Attributes
    ----------
    study, group
        What was asked about.
    targets
        What shall be reached.
    space
        Which designs were allowed, and what they cost.
    answer
        The design with its cost and its crossings; None where no allowed design reaches the targets.
    nearest
        That design, or the one that comes nearest to the targets.
    realizations
        Of the study of the answer.
    readings
        Every target's measure there, with 95 % intervals.
    rows
        One for every Fmax.
    looks
        Every design that was fitted.
    decided
        Whether the answer, or its measure, is as precise as was asked; false where the budget was spent before.
    flat
        Whether the measure is known as precisely as asked, but not where it meets the target, because it changes less
        than the axis.
    arm
        The model of the measures at the Fmax of the answer.
    spent
        Fits that were made.
    """

    study: Study
    group: str
    targets: tuple[Target, ...]
    space: Space
    answer: Answer | None
    nearest: Design
    realizations: int
    readings: tuple[Reading, ...]
    rows: tuple[Row, ...]
    looks: tuple[Look, ...]
    decided: bool
    flat: bool
    arm: Arm | None
    spent: Spent

    @property
    def design(self) -> dict[str, float] | None:
        """The answer by axis: ``cycles``, ``amplitude``, ``fmax`` (Hz), ``realizations``; None where there is none."""
        if self.answer is None:
            return None
        return {**_named(self.answer.design, ("cycles", "amplitude", "fmax")), "realizations": self.realizations}

    @property
    def interval(self) -> dict[str, tuple[float, float]]:
        """95 % interval of every axis that was searched (Fmax excepted), the others as in the answer."""
        return {} if self.answer is None else {c.axis: c.interval for c in self.answer.crossings}

    @property
    def table(self) -> xr.Dataset:
        """Every design that was looked at: ``value`` and ``mcse`` (look, target) in the target's unit, and its axes."""
        by_design = [r.target for r in self.readings][: len(self.looks[0].found)] if self.looks else []
        limits = np.array([t.limit for t in by_design])
        values, errors = (
            np.array([[getattr(e, part) for e in look.found] for look in self.looks]).reshape(-1, limits.size) * limits
            for part in ("value", "error")
        )
        axes = {name: [getattr(look.design, name) for look in self.looks] for name in ("cycles", "amplitude", "fmax")}
        axes |= {name: [getattr(look, name) for look in self.looks] for name in ("realizations", "draws")}
        return xr.Dataset(
            {"value": (("look", "target"), values), "mcse": (("look", "target"), errors)},
            coords={**{name: ("look", v) for name, v in axes.items()}, "target": [t.name for t in by_design]},
        )

    def to_study(self) -> Study:
        """The study with the answer in place of the group's own cycles, amplitudes, Fmax and realizations.

        Raises
        ------
        InputError
            No allowed design reaches the targets.
        """
        if self.answer is None:
            raise InputError("solution: no allowed design reaches the targets, so there is no study of it")
        d = self.answer.design
        fields = self.study.groups[self.group].model_dump(mode="json")
        fields["stimulus"]["cycles"] = d.cycles
        fields |= {"amplitude": [d.amplitude], "fmax": [d.fmax], "realizations": self.realizations}
        return Study(study=self.study.study, group={self.group: fields})

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain values, in the form of the schema ``solution``."""
        answer, axes = self.answer, ("cycles", "amplitude", "fmax")
        value = {
            "schema": identifier("solution"),
            "study": self.study.study.name,
            "group": self.group,
            "seed": self.study.study.seed,
            "targets": [t.text for t in self.targets],
            "cost_of": self.space.cost_words,
            "over": {axis: list(getattr(self.space, axis) or ()) for axis in self.space.over},
            "reached": answer is not None,
            "decided": self.decided,
            "flat": self.flat,
            "design": self.design,
            "cost": None if answer is None else answer.cost,
            "recording_s": self.nearest.cycles * self.space.period_s,
            "nearest": _named(self.nearest, axes),
            "crossings": {
                c.axis: {"value": c.value, "interval": list(c.interval), **_named(c, ("at_start", "at_end"))}
                for c in (() if answer is None else answer.crossings)
            },
            "measures": [
                {
                    "target": r.target.text,
                    "unit": r.target.unit,
                    "value": r.value,
                    "interval": [r.low, r.high],
                    "linear_theory": r.linear,
                    "cramer_rao": r.bound,
                }
                for r in self.readings
            ],
            "by_fmax": [
                {
                    **_named(r, ("fmax", "cycles", "amplitude", "reached")),
                    "cost": r.cost if r.reached else None,
                    "cost_interval": [r.lowest_cost, r.highest_cost],
                    **_named(r, ("control", "relative_cost")),
                }
                for r in self.rows
            ],
            "looks": [
                {
                    **_named(look.design, axes),
                    **_named(look, ("realizations", "draws")),
                    "ratio": [e.value for e in look.found],
                    "ratio_mcse": [e.error for e in look.found],
                }
                for look in self.looks
            ],
            "fits": self.spent.fits,
            "evaluations": self.spent.evaluations,
        }
        return dict(plain(value))


def _named(record: object, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: getattr(record, name) for name in names}
