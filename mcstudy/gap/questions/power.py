"""Detection limit: effects that this recording cannot detect, and the size or number of trials that they need.

An effect of published size with delta below `FOUND` is missed too often to conclude that it is absent. Delta is
proportional to the size of the effect and to the square root of the number of trials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from mcstudy.effect_library.library import LIBRARY, Library, library_of
from mcstudy.gap.candidates.signatures import Signature
from mcstudy.gap.questions.contrasts import Contrast
from mcstudy.gap.questions.question import Answer, Inquiry, shown_causes
from mcstudy.text_tables import Table, number

FOUND = 4.0
"""Delta at which an effect is detected with a power of about 80 %."""

MOST_TRIALS = 100
"""Larger numbers of trials are not written out."""


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


@dataclass(frozen=True)
class DetectionLimits(Answer):
    """The effects that this recording cannot detect reliably.

    Attributes
    ----------
    effects
        All of them (`Undetectable`).
    shown
        Effects of the leading cause and of the 95 % set, which these data show whatever their size; none without a gap.
    trials
        Number of trials of the recording.
    """

    name: ClassVar[str] = "undetectable"
    effects: tuple[Undetectable, ...]
    shown: tuple[str, ...]
    trials: int

    @property
    def missed(self) -> list[Undetectable]:
        """Those that are not shown."""
        return [u for u in self.effects if u.effect not in self.shown]

    def to_dict(self) -> list[dict[str, Any]]:
        """All effects below the detection limit."""
        return [asdict(u) for u in self.effects]

    def sentence(self) -> str:
        """The effects of which nothing can be said."""
        missed = [u.effect for u in self.missed]
        return f"These data can neither confirm nor rule out: {', '.join(missed)}." if missed else ""

    def table(self) -> Table:
        """What each of them would need."""

        def trials(needed: int | None) -> str:
            return "-" if needed is None else f"> {MOST_TRIALS}" if needed > MOST_TRIALS else str(needed)

        rows = [
            [
                u.effect,
                u.reason,
                "-" if u.size_needed is None else f"{number(u.size_needed, 2)} {u.unit}".rstrip(),
                trials(u.trials_needed),
            ]
            for u in self.missed
        ]
        return Table(
            "Effects below the detection limit of these data",
            ["below the detection limit", "expected z, or why not", "size needed", "trials needed"],
            rows,
            f"expected z: usual size of the effect (middle of its range), divided by the standard error with which "
            f"these data would estimate it. At z = {FOUND:g} an effect is detected in about 80 % of recordings. size "
            f"needed: the smallest size with z = {FOUND:g} in these data. trials needed: how many trials like these, "
            f"in all (now: {self.trials}), give the usual size z = {FOUND:g}. -: no size in the bounds is detectable.",
        )


def detection_limits(inquiry: Inquiry) -> DetectionLimits:
    """Effects that would be missed at the middle of their published range of sizes."""
    test, trials = inquiry.test, int(np.unique(inquiry.lines.trial).size)
    causes = shown_causes(inquiry.causes, inquiry.credible_set, inquiry.leading) if inquiry.detected else []
    shown = tuple(dict.fromkeys(effect for cause in causes for group in cause.alternatives for effect in group))
    known = library_of(test.fit.model)
    return DetectionLimits(undetectable(test.signatures, test.contrasts, trials, known), shown, trials)


def undetectable(
    shapes: Sequence[Signature], contrasts: Sequence[Contrast], trials: int, known: Library = LIBRARY
) -> tuple[Undetectable, ...]:
    """Effects of the library ``known`` that would be missed at the middle of their published range of sizes."""
    out = []
    for name in dict.fromkeys(s.effect for s in shapes):
        size = known[name].size
        signatures = [s for s in shapes if s.effect == name]
        middle = sum(size.published) / 2
        # delta is about proportional to size between the null and the size of the signature
        rate = [s.delta / max(abs(s.sizes[size.name]), 1e-300) for s in signatures]
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
    for e in known.values():
        if e.kind != "linear" and e.contrast is None:
            out.append(Undetectable(e.name, "changes the noise, not the responses", None, e.size.unit, None))
        elif e.contrast == "amplitude" and "amplitude" not in kinds:
            out.append(Undetectable(e.name, "needs trials at two amplitudes", None, e.size.unit, None))
        elif e.contrast is not None and e.contrast in kinds:
            changes = [k for c in contrasts if c.kind == e.contrast for k in c.changes if k.effect == e.name]
            change = min(changes, key=lambda k: k.se, default=None)
            if change is None or FOUND * change.se > 0.4:
                worst = (
                    "" if change is None else f"; smallest detectable relative change of gain: {FOUND * change.se:.2g}"
                )
                out.append(
                    Undetectable(e.name, f"the {e.contrast} contrast is too weak{worst}", None, e.size.unit, None)
                )
    return tuple(out)
