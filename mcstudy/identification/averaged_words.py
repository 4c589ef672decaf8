"""Parameters averaged over causes, in words and as a table."""

from __future__ import annotations

from mcstudy.identification.averaged_record import Averaged, AveragedQuantity
from mcstudy.identification.estimate import ENDED
from mcstudy.text_tables import Table, number

TOLD = 0.05
"""Weight of a cause from which it is named."""

CLEARLY = 1.0
"""Standard errors by which a quantity moved from which this is told."""

MOVED = 0.5
"""The same from which the table names the cause."""

NAMED = 4
"""Most quantities that are named as moved."""


def finding(a: Averaged) -> str:
    """What may be missing, and what it did to the parameters."""
    likely = [f"{c.name} ({100 * c.probability:.0f} %)" for c in a.causes if c.probability >= TOLD]
    out = f"Averaged over what the model may lack: {', '.join(likely)}."
    moved = sorted((q for q in a.quantities if abs(q.moved) >= CLEARLY), key=lambda q: -abs(q.moved))
    for cause in dict.fromkeys(q.moved_by for q in moved[:NAMED]):
        told = [f"{q.name} from {number(q.base)} to {number(q.estimate)}" for q in moved[:NAMED] if q.moved_by == cause]
        out += f" {cause or 'The average'} moves {', '.join(told)}."
    if len(moved) > NAMED:
        out += f" {len(moved) - NAMED} more move by more than their standard error."
    if not moved:
        out += " No parameter moves by more than its standard error."
    open_ = [q.name for q in a.quantities if not q.determined]
    return out + (f" Not determined: {', '.join(open_)}." if open_ else "")


def table(a: Averaged, level: float) -> Table:
    """Every quantity of the model as it is and averaged, and the parts of its variance."""
    header = ["quantity", "as is", "averaged", f"{100 * level:g} %", "moved by", "data/form/cause"]
    return Table("Averaged over causes", header, [_row(q) for q in a.quantities], NOTE)


NOTE = (
    "as is: of the model without effects. -: not determined. moved by: the cause that moved it most, where it moved by "
    "more than half of its standard error. data/form/cause: percent of the variance that noise, the form of one cause, "
    "and which cause it is make."
)


def _row(q: AveragedQuantity) -> list[str]:
    parts = "/".join(f"{100 * x:.0f}" for x in (q.data, q.form, q.cause))
    interval = f"{number(q.low)}{ENDED[q.low_from]} to {number(q.high)}{ENDED[q.high_from]}"
    averaged = number(q.estimate) if q.determined else "-"
    return [q.name, number(q.base), averaged, interval, q.moved_by if abs(q.moved) > MOVED else "", parts]
