"""From a study and targets to the cheapest design."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from mcstudy.errors import DesignError, InputError
from mcstudy.files.json_files import named
from mcstudy.files.plain_errors import validated
from mcstudy.planning.arm import FIRST, Arm, Candidate
from mcstudy.planning.fits import Design, Fitter
from mcstudy.planning.linear import linear_values
from mcstudy.planning.local_model import QUANTILE
from mcstudy.planning.next_look import width
from mcstudy.planning.search import Rules, least_fits, next_design, search
from mcstudy.planning.solution import Answer, Crossing, Reading, Row, SolutionRecord
from mcstudy.planning.space import AMPLITUDE, CYCLES, REALIZATIONS, Space, rounded, space_of
from mcstudy.planning.targets import Target, parse_targets
from mcstudy.study.checks import check_group, noisy_outputs
from mcstudy.study.design import Study
from mcstudy.study.group import Group
from mcstudy.study.measure import stimulus
from mcstudy.study.models import build_model

LOOKS_FOR_NUMBER = 2
"""Realizations behind the number of realizations that a Monte Carlo error needs, in units of the first look."""


def solve_study(
    study: Study,
    targets: Sequence[str],
    over: Sequence[str],
    *,
    group: str | None = None,
    cost: str | None = None,
    precision: float = 0.1,
    budget: int = 200_000,
    threads: int = 1,
    say: Callable[[str], object] = str,
) -> SolutionRecord:
    """The cheapest design of a group of ``study`` that meets the targets.

    Parameters
    ----------
    targets: see `mcstudy.planning.targets`. over: axes, see `mcstudy.planning.space.space_of`.
    group: name of the group, needed if there are several. cost: formula; the recording time when None.
    precision: half-width of a 95 % interval, relative, at which the search ends: that of the answer, or of the measure
    there if it changes less than the axis (`mcstudy.planning.next_look.Width`).
    budget: largest number of fits, those of the prediction among them. threads: that fit. say: called with a line for
    every step.

    Raises `InputError`, one line, for a target, axis or study that cannot be used.
    """
    if not 0 < precision < 1:
        raise InputError(f"precision: expected a fraction between 0 and 1, got {precision:g}")
    name, section = _group(study, group)
    model = build_model(section)
    asked = parse_targets(model, targets)
    seconds = len(model.stimulus_names) * stimulus(section, section.amplitude[0]).period_s
    space = space_of(section, seconds, over, cost)
    by_number = tuple(t for t in asked if t.mcse and REALIZATIONS in space.over)
    by_design = tuple(t for t in asked if t not in by_number)
    _check_sense(space, by_number, by_design)
    _check_ends(section, name, space)
    fitter = Fitter(section, study.study.seed, space.fmax, threads)
    arms = [Arm(f, space, by_design, fitter, section.realizations) for f in space.fmax]
    kept = arms[0].least_fits(LOOKS_FOR_NUMBER * FIRST) if by_number else 0
    needed = kept + (least_fits(arms) if by_design else arms[0].prediction_fits())
    if budget < needed:
        every = f" for each of {len(arms)} Fmax" if len(arms) > 1 and by_design else ""
        raise InputError(
            f"budget: expected at least {needed} fits, which a prediction and a first look{every} need, got {budget}"
        )
    rules = Rules(precision, budget - kept)
    answer: Answer | None = None
    rows: tuple[Row, ...] = ()
    readings: tuple[Reading, ...] = ()
    design = Design(space.cycles[0], space.amplitude[0], space.fmax[0])
    decided, flat = True, False
    if by_design:
        going = search(arms, rules, say)
        best, cheapest = min(((arm, arm.cheapest()) for arm in going), key=_rank(space))
        design, known = _exactly(best, cheapest), width(best, cheapest)
        decided, flat = known.relative <= precision, known.flat and known.axis > precision
        rows = tuple(_row(arm) for arm in arms if arm.looks)
        readings = _readings(best, design, fitter)
        if cheapest.reached:
            answer = Answer(design, cheapest.cost, _crossings(best, cheapest))
    else:
        answer = Answer(design, float(space.cost(*_one(design), design.fmax)[0]), ())
    number = section.realizations
    if by_number and answer is not None:
        say(f"realizations at {design.cycles} cycles, {design.amplitude:g}, Fmax {design.fmax:g} Hz")
        left = budget - fitter.spent.fits
        number, crossing, more = _number(Arm(design.fmax, space, by_number, fitter, 1), design, space, left)
        readings = (*readings, *more)
        enough = space.realizations is not None and number <= space.realizations[1]
        answer = Answer(design, answer.cost, (*answer.crossings, crossing)) if enough else None
    return SolutionRecord(
        study=study,
        group=name,
        targets=asked,
        space=space,
        answer=answer,
        nearest=design,
        realizations=number,
        readings=readings,
        rows=rows,
        looks=tuple(look for arm in arms for look in arm.looks),
        decided=decided,
        flat=flat,
        arm=next((arm for arm in arms if arm.fmax == design.fmax and arm.looks), None),
        spent=fitter.spent,
    )


def _group(study: Study, name: str | None) -> tuple[str, Group]:
    if name is None and len(study.groups) > 1:
        raise InputError(f"group: expected one of {', '.join(study.groups)}, because the study has several")
    name = next(iter(study.groups)) if name is None else name
    if name not in study.groups:
        raise InputError(f"group: expected one of {', '.join(study.groups)}, got {name!r}")
    group = study.groups[name]
    model = build_model(group)
    if not noisy_outputs(group, model):
        raise InputError(f"group {name}: expected noise on all outputs; without noise every design is as good")
    if group.until_certain:
        raise InputError(f"group {name}: starts: expected a number, not 'until certain'")
    return name, group


def _check_sense(space: Space, by_number: Sequence[Target], by_design: Sequence[Target]) -> None:
    if REALIZATIONS in space.over and not by_number:
        raise InputError("over: realizations: varying them requires a target of the form mcse(...)")
    if not by_design and space.over != (REALIZATIONS,):
        others = ", ".join(axis for axis in space.over if axis != REALIZATIONS)
        raise InputError(f"over: {others}: mcse(...) targets depend on realizations only; expected a further target")


def _check_ends(group: Group, name: str, space: Space) -> None:
    """Refuse designs at the ends of the ranges that no study could have."""
    for cycles in space.cycles:
        fields = group.model_dump(mode="python")
        fields["stimulus"]["cycles"] = cycles
        fields |= {"fmax": space.fmax, "amplitude": tuple(sorted(set(space.amplitude)))}
        try:
            check_group(validated(Group, fields, "over"))
        except DesignError as error:
            raise DesignError(f"group.{name}: with the ranges of --over: {error}") from None


def _one(design: Design) -> tuple[np.ndarray, np.ndarray]:
    return np.array([design.cycles]), np.array([design.amplitude])


def _rank(space: Space) -> Callable[[tuple[Arm, Candidate]], tuple[float, ...]]:
    """Order of the cheapest designs of every Fmax: those that are enough by cost, the others by what they lack."""

    def rank(pair: tuple[Arm, Candidate]) -> tuple[float, ...]:
        cheapest = pair[1]
        if not cheapest.reached:
            return (1.0, cheapest.excess, 0.0, 0.0)
        return (
            0.0,
            float(rounded(cheapest.cost)),
            cheapest.amplitude if AMPLITUDE in space.over else 0.0,
            cheapest.excess,
        )

    return rank


def _exactly(arm: Arm, cheapest: Candidate) -> Design:
    """The answer with an amplitude of three digits that is not below the crossing."""
    if AMPLITUDE not in arm.space.over or not cheapest.reached:
        return next_design(arm)
    unit = 10 ** (math.floor(math.log10(cheapest.amplitude)) - 2)
    amplitude = float(f"{math.ceil(cheapest.amplitude / unit - 1e-9) * unit:.3g}")
    return Design(cheapest.cycles, min(amplitude, arm.space.amplitude[1]), arm.fmax)


def _crossings(arm: Arm, cheapest: Candidate) -> tuple[Crossing, ...]:
    out = []
    for axis in (CYCLES, AMPLITUDE):
        if axis in arm.space.over:
            low, middle, high = arm.crossing(axis, cheapest)
            middle = float(getattr(cheapest, axis)) if math.isnan(middle) else middle
            first, last = arm.space.ends(axis)
            low = first if math.isnan(low) else low
            at_end = math.isnan(high)
            out.append(Crossing(axis, middle, low, last if at_end else high, at_start=low <= first, at_end=at_end))
    return tuple(out)


def _readings(arm: Arm, design: Design, fitter: Fitter) -> tuple[Reading, ...]:
    out = []
    for target, band in zip(arm.targets, arm.bands(*_one(design)), strict=True):
        value, error = float(band.value[0]), float(band.error[0])
        ends = np.array([value - QUANTILE * error, value, value + QUANTILE * error])
        low, middle, high = (ends if target.measure.signed else np.exp(ends)) * target.limit
        out.append(Reading(target, middle, low, high, *linear_values(fitter, design, target)))
    return tuple(out)


def _row(arm: Arm) -> Row:
    low, high = (c.cost if (c := arm.cheapest(side)).reached else math.nan for side in (0, 2))
    return Row(
        **named(arm.cheapest(), "cycles", "amplitude", "cost", "reached"),
        **named(arm, "fmax", "hopeless", "relative_cost"),
        lowest_cost=low,
        highest_cost=high,
        control=str(arm.control),
    )


def _number(arm: Arm, design: Design, space: Space, left: int) -> tuple[int, Crossing, tuple[Reading, ...]]:
    """Realizations that the Monte Carlo errors need at a design, even above the largest allowed; in ``left`` fits."""
    assert space.realizations is not None
    least, most = space.realizations
    left += arm.fitter.spent.fits
    arm.predict()
    arm.look(design, LOOKS_FOR_NUMBER * FIRST, most=left - arm.fitter.spent.fits)
    measures = arm.looks[-1].found
    needed = [
        (e.value**2, max(e.value - QUANTILE * e.error, 0.0) ** 2, (e.value + QUANTILE * e.error) ** 2) for e in measures
    ]
    middle, low, high = np.max(np.array(needed), axis=0)
    number = max(least, math.ceil(middle))
    n = min(number, most)
    ends = float(max(low, least)), float(min(high, most))
    crossing = Crossing(REALIZATIONS, float(max(middle, least)), *ends, at_start=low <= least, at_end=high > most)
    readings = []
    for t, e in zip(arm.targets, measures, strict=True):
        value, low_end, high_end = ((e.value + k * QUANTILE * e.error) * t.limit / math.sqrt(n) for k in (0, -1, 1))
        readings.append(Reading(t, value, low_end, high_end, math.nan, math.nan))
    return number, crossing, tuple(readings)
