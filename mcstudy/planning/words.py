"""A solution in words and tables."""

from __future__ import annotations

import math

from mcstudy.planning.fits import FULL, TRUTH
from mcstudy.planning.result import Crossing, Reading, Solution
from mcstudy.planning.space import AMPLITUDE, CYCLES, REALIZATIONS
from mcstudy.stance.body import STIMULI
from mcstudy.text_tables import Table, counted, fill, number, table

CONTROL = {TRUTH: "one fit from the true values", FULL: "none"}


def text(found: Solution) -> str:
    """Everything that ``mcstudy solve`` prints."""
    head = f"study {found.study.study.name}, group {found.group}; cost: {found.space.cost_words}"
    readings = readings_table(found)
    parts = [head, fill(statement(found)), table(readings.header, readings.rows)]
    if len(found.rows) > 1:
        parts.append(_titled(by_fmax_table(found)))
    if found.looks:
        parts.append(_titled(looks_table(found)))
    return "\n\n".join([*parts, fill(spent_words(found))])


Cells = Table


def _titled(cells: Cells) -> str:
    return f"{cells.title}\n{table(cells.header, cells.rows)}"


def statement(found: Solution) -> str:
    """The answer in sentences."""
    targets = " and ".join(t.text for t in found.targets)
    d, unit = found.nearest, stimulus_unit(found)
    where = f"{counted(d.cycles, 'cycle')} at {d.amplitude:g} {unit}, Fmax {d.fmax:g} Hz"
    if found.answer is None:
        worst = max(found.readings, key=lambda r: abs(r.value) / r.target.limit)
        surely = "is not reached by any allowed design" if _surely(found, worst) else "is probably not reached"
        words = f"{targets} {surely}: the nearest is {where}, with {_measure(worst)}."
        words += _binds(found)
        if math.isfinite(worst.bound):
            words += (
                f" Without bounds on the parameters no unbiased estimator has less than {_value(worst, worst.bound)} "
                "there (Cramér-Rao)."
            )
        return words
    seconds = d.cycles * found.space.period_s
    words = f"{targets}: {where} ({seconds:.4g} s recorded)"
    if REALIZATIONS in found.space.over:
        words += f", {found.realizations} realizations"
    words += "."
    for crossing in found.answer.crossings:
        words += f" {_crossing(crossing)}"
    if found.flat:
        words += f" {_flat(found)}"
    if not found.decided:
        words += " The budget of fits was spent before the answer was as precise as asked."
    return words


def _binds(found: Solution) -> str:
    """Which end of a range keeps the targets out of reach; empty where the measure is lowest inside."""
    space, d = found.space, found.nearest
    by_design = not found.rows or any(r.reached for r in found.rows)
    if by_design and space.realizations is not None and found.realizations > space.realizations[1]:
        most = space.realizations[1]
        return f" What binds is the largest number of realizations, {most}: {found.realizations} are needed."
    ends = []
    if CYCLES in space.over and d.cycles == space.cycles[1]:
        ends.append(f"number of cycles, {d.cycles}")
    if AMPLITUDE in space.over and d.amplitude >= 0.995 * space.amplitude[1]:
        ends.append(f"amplitude, {d.amplitude:g} {stimulus_unit(found)}")
    return f" What binds is the largest {' and '.join(ends)}." if ends else ""


def _flat(found: Solution) -> str:
    """Why the interval is wide."""
    worst = max(found.readings, key=lambda r: abs(r.value) / r.target.limit)
    axis = next(c.axis for c in found.answer.crossings) if found.answer else ""
    known = 50 * (worst.high - worst.low) / abs(worst.value)
    return (
        f"{worst.target.name} changes less than the {axis} there: it is known to ±{known:.1f} % of its value, "
        "which leaves that interval."
    )


def _surely(found: Solution, worst: Reading) -> bool:
    """Whether no allowed design is within reach at 95 %."""
    nearest = min(abs(worst.low), abs(worst.high)) if worst.low * worst.high > 0 else 0.0
    return nearest > worst.target.limit and all(r.hopeless for r in found.rows)


def _crossing(c: Crossing) -> str:
    low, high = c.interval
    words = f"95 % interval of the {c.axis}: {low:.4g} to {high:.4g}."
    if c.at_start and c.value <= low * (1 + 1e-9):
        words += f" The smallest allowed value of {c.axis} is enough."
    if c.at_end:
        words += f" The largest allowed value of {c.axis} may not be enough."
    return words


def stimulus_unit(found: Solution) -> str:
    """Unit of the stimulus amplitude."""
    return STIMULI[found.study.groups[found.group].stimulus.kind]


def _value(r: Reading, value: float) -> str:
    return f"{number(value)} {r.target.unit}".strip()


def limit_text(r: Reading) -> str:
    """The limit of a target with its unit."""
    return _value(r, r.target.limit)


def _measure(r: Reading) -> str:
    return f"{r.target.name} = {_value(r, r.value)} [{number(r.low)}, {number(r.high)}]"


def readings_table(found: Solution) -> Cells:
    """Every target's measure at the answer, with its interval and what linear theory says."""
    rows = [
        [
            r.target.name,
            _value(r, r.target.limit),
            number(r.value),
            f"{number(r.low)} to {number(r.high)}",
            number(r.linear) if math.isfinite(r.linear) else "-",
            number(r.bound) if math.isfinite(r.bound) else "-",
        ]
        for r in found.readings
    ]
    header = ["measure", "target", "there", "95 % interval", "linear theory", "Cramér-Rao"]
    return Cells("The measures at the answer", header, rows)


def by_fmax_table(found: Solution) -> Cells:
    """The cheapest design with each Fmax."""
    rows = [
        [
            f"{r.fmax:g} Hz",
            str(r.cycles),
            f"{r.amplitude:.3g}",
            f"{r.cost:.4g}" if r.reached else "not reached",
            f"{_end(r.lowest_cost)} to {_end(r.highest_cost)}",
        ]
        for r in found.rows
    ]
    return Cells("The cheapest design with each Fmax", ["Fmax", "cycles", "amplitude", "cost", "95 % interval"], rows)


def _end(cost: float) -> str:
    return f"{cost:.4g}" if math.isfinite(cost) else "out of range"


def looks_table(found: Solution) -> Cells:
    """Every design that was fitted."""
    targets = [r.target for r in found.readings][: len(found.looks[0].found)]
    rows = [
        [
            str(k.design.cycles),
            f"{k.design.amplitude:.4g}",
            f"{k.design.fmax:g}",
            str(k.realizations),
            str(k.draws) if k.draws else "-",
            *(
                f"{number(e.value * t.limit)} ± {number(e.error * t.limit, 2)} {t.unit}".strip()
                for e, t in zip(k.found, targets, strict=True)
            ),
        ]
        for k in found.looks
    ]
    head = ["cycles", "amplitude", "Fmax", "realizations", "draws", *(t.name for t in targets)]
    return Cells("Designs that were fitted (± one MCSE)", head, rows)


def spent_words(found: Solution) -> str:
    """The fits that the search made."""
    starts = found.study.groups[found.group].starts
    words = f"{found.spent.fits} fits. Realizations are fitted from {counted(starts, 'start')}"
    kinds = {r.control for r in found.rows} - {FULL}
    if kinds:
        names = " or ".join(sorted(CONTROL.get(k, "one fit from a linearised start") for k in kinds))
        return f"{words}; draws are data from the same distribution, with {names}."
    return f"{words}."
