"""A solution in words and tables."""

from __future__ import annotations

import math

from mcstudy.planning.fits import FULL, TRUTH
from mcstudy.planning.solution import Crossing, Reading, SolutionRecord
from mcstudy.planning.space import AMPLITUDE, CYCLES, REALIZATIONS
from mcstudy.stance.body import STIMULI
from mcstudy.text_tables import Table, counted, ends, fill, number

CONTROL = {TRUTH: "one fit from the true values", FULL: "none"}


def text(solution: SolutionRecord) -> str:
    """Everything that ``mcstudy solve`` prints."""
    head = f"study {solution.study.study.name}, group {solution.group}; cost: {solution.space.cost_words}"
    parts = [head, fill(statement(solution)), readings_table(solution).text()]
    return "\n\n".join([*parts, *(t.text(titled=True) for t in search_tables(solution)), fill(spent_words(solution))])


def statement(solution: SolutionRecord) -> str:
    """The answer in sentences."""
    targets = " and ".join(t.text for t in solution.targets)
    d, unit = solution.nearest, stimulus_unit(solution)
    where = f"{counted(d.cycles, 'cycle')} at {d.amplitude:g} {unit}, Fmax {d.fmax:g} Hz"
    if solution.answer is None:
        worst = max(solution.readings, key=lambda r: abs(r.value) / r.target.limit)
        surely = "is not reached by any allowed design" if _surely(solution, worst) else "is probably not reached"
        words = f"{targets} {surely}: the nearest is {where}, with {_measure(worst)}."
        words += _binds(solution)
        if math.isfinite(worst.bound):
            words += (
                f" Without bounds on the parameters no unbiased estimator has less than {_value(worst, worst.bound)} "
                "there (Cramér-Rao)."
            )
        return words
    seconds = d.cycles * solution.space.period_s
    words = f"{targets}: {where} ({seconds:.4g} s recorded)"
    if REALIZATIONS in solution.space.over:
        words += f", {solution.realizations} realizations"
    words += "."
    for crossing in solution.answer.crossings:
        words += f" {_crossing(crossing)}"
    if solution.flat:
        words += f" {_flat(solution)}"
    if not solution.decided:
        words += " The budget of fits was spent before the answer was as precise as asked."
    return words


def _binds(solution: SolutionRecord) -> str:
    """Which end of a range keeps the targets out of reach; empty where the measure is lowest inside."""
    space, d = solution.space, solution.nearest
    by_design = not solution.rows or any(r.reached for r in solution.rows)
    if by_design and space.realizations is not None and solution.realizations > space.realizations[1]:
        most = space.realizations[1]
        return f" What binds is the largest number of realizations, {most}: {solution.realizations} are needed."
    ends = []
    if CYCLES in space.over and d.cycles == space.cycles[1]:
        ends.append(f"number of cycles, {d.cycles}")
    if AMPLITUDE in space.over and d.amplitude >= 0.995 * space.amplitude[1]:
        ends.append(f"amplitude, {d.amplitude:g} {stimulus_unit(solution)}")
    return f" What binds is the largest {' and '.join(ends)}." if ends else ""


def _flat(solution: SolutionRecord) -> str:
    """Why the interval is wide."""
    worst = max(solution.readings, key=lambda r: abs(r.value) / r.target.limit)
    axis = next(c.axis for c in solution.answer.crossings) if solution.answer else ""
    known = 50 * (worst.high - worst.low) / abs(worst.value)
    return (
        f"{worst.target.name} changes less than the {axis} there: it is known to ±{known:.1f} % of its value, "
        "which leaves that interval."
    )


def _surely(solution: SolutionRecord, worst: Reading) -> bool:
    """Whether no allowed design is within reach at 95 %."""
    nearest = min(abs(worst.low), abs(worst.high)) if worst.low * worst.high > 0 else 0.0
    return nearest > worst.target.limit and all(r.hopeless for r in solution.rows)


def _crossing(c: Crossing) -> str:
    low, high = c.interval
    words = f"95 % interval of the {c.axis}: {low:.4g} to {high:.4g}."
    if c.at_start and c.value <= low * (1 + 1e-9):
        words += f" The smallest allowed value of {c.axis} is enough."
    if c.at_end:
        words += f" The largest allowed value of {c.axis} may not be enough."
    return words


def stimulus_unit(solution: SolutionRecord) -> str:
    """Unit of the stimulus amplitude."""
    return STIMULI[solution.study.groups[solution.group].stimulus.kind]


def _value(r: Reading, value: float) -> str:
    return f"{number(value)} {r.target.unit}".strip()


def limit_text(r: Reading) -> str:
    """The limit of a target with its unit."""
    return _value(r, r.target.limit)


def _measure(r: Reading) -> str:
    return f"{r.target.name} = {_value(r, r.value)} [{number(r.low)}, {number(r.high)}]"


def readings_table(solution: SolutionRecord) -> Table:
    """Every target's measure at the answer, with its interval and what linear theory says."""
    rows = [
        [
            r.target.name,
            _value(r, r.target.limit),
            number(r.value),
            ends(r.low, r.high),
            *(number(theory) if math.isfinite(theory) else "-" for theory in (r.linear, r.bound)),
        ]
        for r in solution.readings
    ]
    header = ["measure", "target", "there", "95 % interval", "linear theory", "Cramér-Rao"]
    return Table("The measures at the answer", header, rows)


def search_tables(solution: SolutionRecord) -> list[Table]:
    """What the search looked at: the Fmax, if there are several, and the designs."""
    several = [_by_fmax(solution)] if len(solution.rows) > 1 else []
    return [*several, *([_looks(solution)] if solution.looks else [])]


def _by_fmax(solution: SolutionRecord) -> Table:
    """The cheapest design with each Fmax."""
    rows = [
        [
            f"{r.fmax:g} Hz",
            str(r.cycles),
            f"{r.amplitude:.3g}",
            f"{r.cost:.4g}" if r.reached else "not reached",
            f"{_end(r.lowest_cost)} to {_end(r.highest_cost)}",
        ]
        for r in solution.rows
    ]
    return Table("The cheapest design with each Fmax", ["Fmax", "cycles", "amplitude", "cost", "95 % interval"], rows)


def _end(cost: float) -> str:
    return f"{cost:.4g}" if math.isfinite(cost) else "out of range"


def _looks(solution: SolutionRecord) -> Table:
    """Every design that was fitted."""
    targets = [r.target for r in solution.readings][: len(solution.looks[0].found)]
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
        for k in solution.looks
    ]
    head = ["cycles", "amplitude", "Fmax", "realizations", "draws", *(t.name for t in targets)]
    return Table("Designs that were fitted (± one MCSE)", head, rows)


def spent_words(solution: SolutionRecord) -> str:
    """The fits that the search made."""
    starts = solution.study.groups[solution.group].starts
    words = f"{solution.spent.fits} fits. Realizations are fitted from {counted(starts, 'start')}"
    kinds = {r.control for r in solution.rows} - {FULL}
    if kinds:
        names = " or ".join(sorted(CONTROL.get(k, "one fit from a linearised start") for k in kinds))
        return f"{words}; draws are data from the same distribution, with {names}."
    return f"{words}."
