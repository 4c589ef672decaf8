"""What this recording cannot tell: effects too small to show, and what it would take.

An effect of published size with delta below `FOUND` would be missed too often to call it absent. Delta grows with the
root of the number of trials and with size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.gap import effects as library
from mcstudy.gap.contrasts import Contrast
from mcstudy.gap.signatures import Signature

FOUND = 4.0
"""Delta at which an effect is found four times of five."""


@dataclass(frozen=True)
class Undetectable:
    """An effect this recording cannot speak about.

    Attributes
    ----------
    effect: its name. reason: in words. size_needed, unit: smallest size that would be found here (None when none
    within the bounds). trials_needed: trials like these for the middle published size (None when trials do not help).
    """

    effect: str
    reason: str
    size_needed: float | None
    unit: str
    trials_needed: int | None


def undetectable(found: Sequence[Signature], contrasts: Sequence[Contrast], trials: int) -> tuple[Undetectable, ...]:
    """Effects that would be missed at the middle of their published range."""
    out = []
    for name in dict.fromkeys(s.effect for s in found):
        size = library.effect(name).size
        own = [s for s in found if s.effect == name]
        middle = sum(size.published) / 2
        # delta is about proportional to size between the null and the size of the signature
        rate = [s.delta / max(abs(s.sizes[size.name]), 1e-300) for s in own]
        delta = float(np.median(rate)) * middle
        if delta >= FOUND:
            continue
        needed = FOUND / max(float(np.median(rate)), 1e-300)
        within = needed <= max(abs(size.upper), abs(size.lower))
        more = int(np.ceil(trials * (FOUND / max(delta, 1e-3)) ** 2))
        out.append(
            Undetectable(
                name,
                f"{delta:.1f} SE at {middle:.3g} {size.unit}".rstrip() + f" ({FOUND:g} needed)",
                float(needed) if within else None,
                size.unit,
                more if more < 10000 else None,
            )
        )
    kinds = {c.kind: c for c in contrasts}
    for e in library.LIBRARY.values():
        if e.kind != "linear" and e.contrast is None:
            out.append(Undetectable(e.name, "changes the noise, not the responses", None, e.size.unit, None))
        elif e.contrast == "amplitude" and "amplitude" not in kinds:
            out.append(Undetectable(e.name, "needs trials at two amplitudes", None, e.size.unit, None))
        elif e.contrast is not None and e.contrast in kinds:
            change = next((c for c in kinds[e.contrast].changes if c.effect == e.name), None)
            if change is None or FOUND * change.se > 0.4:
                worst = "" if change is None else f"; a change of gain of {FOUND * change.se:.2g} would be found"
                out.append(
                    Undetectable(e.name, f"the {e.contrast} contrast is too weak{worst}", None, e.size.unit, None)
                )
    return tuple(out)
