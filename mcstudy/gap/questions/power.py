"""Detection limit: effects that this recording cannot detect, and the size or number of trials that they need.

An effect of published size with delta below `FOUND` is missed too often to conclude that it is absent. Delta is
proportional to the size of the effect and to the square root of the number of trials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.effect_library import library
from mcstudy.gap.candidates.signatures import Signature
from mcstudy.gap.questions.contrasts import Contrast

FOUND = 4.0
"""Delta at which an effect is detected with a power of about 80 %."""


@dataclass(frozen=True)
class Undetectable:
    """An effect that this recording cannot detect reliably.

    Attributes
    ----------
    effect
        Name of the effect.
    reason
        Why, as text: the expected signal in standard errors at a typical size, and how much is needed.
    size_needed, unit
        Smallest detectable size and its unit; None when it is outside the bounds.
    trials_needed
        Total number of such trials needed to detect the middle published size; None when more trials do not help.
    """

    effect: str
    reason: str
    size_needed: float | None
    unit: str
    trials_needed: int | None


def undetectable(found: Sequence[Signature], contrasts: Sequence[Contrast], trials: int) -> tuple[Undetectable, ...]:
    """Effects that would be missed at the middle of their published range of sizes."""
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
                f"{delta:.1f} at {middle:.3g} {size.unit}".rstrip(),
                float(needed) if within else None,
                size.unit,
                more if more < 10000 else None,
            )
        )
    kinds = {c.kind for c in contrasts}
    for e in library.LIBRARY.values():
        if e.kind != "linear" and e.contrast is None:
            out.append(Undetectable(e.name, "changes the noise, not the responses", None, e.size.unit, None))
        elif e.contrast == "amplitude" and "amplitude" not in kinds:
            out.append(Undetectable(e.name, "needs trials at two amplitudes", None, e.size.unit, None))
        elif e.contrast is not None and e.contrast in kinds:
            own_changes = [k for c in contrasts if c.kind == e.contrast for k in c.changes if k.effect == e.name]
            change = min(own_changes, key=lambda k: k.se, default=None)
            if change is None or FOUND * change.se > 0.4:
                worst = (
                    "" if change is None else f"; smallest detectable relative change of gain: {FOUND * change.se:.2g}"
                )
                out.append(
                    Undetectable(e.name, f"the {e.contrast} contrast is too weak{worst}", None, e.size.unit, None)
                )
    return tuple(out)
