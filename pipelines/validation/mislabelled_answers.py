"""What the diagnosis says about a mislabelled recording, in classes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from mcstudy.effect_library.library import LIBRARY
from mcstudy.errors import InputError
from mcstudy.gap.diagnose import diagnose
from mcstudy.gap.settings import CAUSE_ONLY, DiagnosisSettings
from mcstudy.gap.verdict import verdict
from mcstudy.recordings.recording import Recording

CLASSES = (
    "refused, right words",
    "refused, other words",
    "right recording cause",
    "other recording cause",
    "outside the library",
    "stimulus or sensor",
    "physiological",
    "undecided",
    "no gap",
)
"""Classes of answers. A recording is refused, has no gap, or one kind of cause has more than half of the probability;
when none has, the answer is undecided."""

BODY = ("ankle", "hip", "body")


@dataclass(frozen=True)
class Answer:
    """The class of an answer, one of `CLASSES`, and its words."""

    kind: str
    words: str


def answered(recording: Recording, codes: Sequence[str]) -> Answer:
    """Diagnose a recording. ``codes``: readings, or parts of a message, that describe the mistake."""
    try:
        d = diagnose(recording, DiagnosisSettings(fast=True, asked=CAUSE_ONLY))
    except InputError as error:
        message = str(error)
        named = re.findall(r"'(\w+)'", message.partition("accept ")[2])[:1] or [message]
        right = any(c == named[0] or (" " in c and c in message) for c in codes)
        return Answer(CLASSES[0 if right else 1], message)
    if not d.detected:
        return Answer("no gap", verdict(d))
    share = dict.fromkeys(CLASSES, 0.0)
    for cause in d.causes:
        share[_class(cause.effects, codes)] += cause.probability
    share["outside the library"] += d.unknown_probability
    share["no gap"] += d.none_probability
    kind = max(share, key=lambda k: share[k])
    leading = "; ".join(f"{' and '.join(c.effects)} {c.probability:.2f}" for c in d.causes[:3])
    words = f"{leading}; outside {d.unknown_probability:.2f}; none {d.none_probability:.2f}"
    return Answer(kind if share[kind] > 0.5 else "undecided", words)


def _class(effects: Sequence[str], codes: Sequence[str]) -> str:
    if set(effects) & set(codes):
        return "right recording cause"
    if any(e not in LIBRARY for e in effects):
        return "other recording cause"
    return "physiological" if any(set(LIBRARY[e].place) & set(BODY) for e in effects) else "stimulus or sensor"
