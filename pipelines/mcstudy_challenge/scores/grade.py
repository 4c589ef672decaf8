"""Grade one answer against one entry of the key.

Hypotheses are compared up to ambiguity groups. A cause is correct if its leading effect is in the group of the true
effect, or if the answer includes the true effect in the group of the cause and the two are similar (|cosine| above 0.9
in the key). Causes with the same meaning form one hypothesis; their probabilities add.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

from mcstudy.effect_library.library import LIBRARY
from mcstudy_challenge.design import NOTHING_MISSING, OTHER_FORM, OUTSIDE
from mcstudy_challenge.scores.oracle import FLOOR
from mcstudy_challenge.scores.rates import Bounds

CONFIDENT = 0.8
"""Probability above which a wrong name counts as confident."""

SHARE = 0.005
"""Tolerance of the share of a gap: members of one ambiguity group differ by at most this much."""

TRUTH = "truth"

UNDECIDED = "undecided"

FAILED = "error"
"""Most probable hypothesis of a recording that could not be diagnosed."""

SCORES: dict[str, Bounds] = {"log_loss": (0.0, -math.log(FLOOR)), "brier": (0.0, 2.0)}
"""Bounds of the proper scores of one case."""

LARGEST_SET = float(len(LIBRARY) + 2)
"""Size of the set of all hypotheses (none, unknown, every effect); used for a case without an answer."""

SET_SIZES: Bounds = (0.0, len(LIBRARY) * (len(LIBRARY) + 1) / 2 + 2)
"""Bounds of the size of a set, which may also contain pairs."""

ANSWERED = ("nothing missing", "a cause outside the library", "one effect of the library", "two effects")
"""Kinds of hypotheses that an answer may find most probable."""

WRONG = ("nothing missing", "a cause outside the library", "pairs", "other single causes")
"""Kinds of answers that are wrong for a known cause."""


@dataclass(frozen=True)
class Judged:
    """Grades of one answer.

    Attributes
    ----------
    case: the entry of the key. An error is an answer that is wrong in every respect.
    detected; p_value: result of the test for a gap. probability: probability assigned to the truth. top: whether the
    truth is the most probable hypothesis; top_name: the most probable one. covered, set_size: whether the 95 % set
    contains the truth, and its size in groups. flagged: whether "unknown" is the most probable hypothesis. confident:
    probability of the most probable named cause. log_loss, brier: proper scores (probabilities below `FLOOR` count as
    `FLOOR` in the logarithm; the remainder to 1 counts as one more, wrong hypothesis). size_inside, closed_inside:
    whether the 95 % intervals contain the truth; None if there is no true value; a missing interval counts as not
    containing it. ceiling: expected figures of the ideal method on this case. stated: probability of the most probable
    hypothesis; answered: its kind (of `ANSWERED`), or "" for a tie and an error. none, outside: probabilities that
    nothing is missing and that the cause is outside the library. An error counts as certain of what is not true.
    """

    case: Mapping[str, Any]
    detected: bool
    probability: float
    top: bool
    top_name: str
    covered: bool
    set_size: float
    flagged: bool
    confident: float
    log_loss: float
    brier: float
    p_value: float = math.nan
    size_inside: bool | None = None
    closed_inside: bool | None = None
    seconds: float = 0.0
    ceiling: Mapping[str, float] = field(default_factory=dict)
    wrong: Mapping[str, float] = field(default_factory=lambda: dict.fromkeys(WRONG, 0.0))
    stated: float = 1.0
    answered: str = ""
    none: float = 0.0
    outside: float = 0.0

    @property
    def kind(self) -> str:
        """Kind of the case."""
        return str(self.case["kind"])

    @property
    def delta(self) -> float:
        """Detectability of the cause."""
        return float(self.case["delta"])


def true_name(case: Mapping[str, Any]) -> str:
    """Name of the truth for tables."""
    if case["kind"] in NOTHING_MISSING:
        return "none"
    if case["kind"] in OUTSIDE:
        return f"outside: {case['outsider']['name']}"
    if case["kind"] in OTHER_FORM:
        return f"{'misshapen' if case['kind'] == 'misshapen' else 'foreign'}: {case['form']}"
    return "+".join(sorted(e["effect"] for e in case["effects"]))


def judge(case: Mapping[str, Any], answer: Mapping[str, Any]) -> Judged:
    """Compare one answer with the key."""
    ceiling = case.get("ceiling") or {}
    if "error" in answer:
        nothing = case["kind"] in NOTHING_MISSING
        return Judged(
            case, nothing, 0.0, False, FAILED, False, LARGEST_SET, not nothing and case["kind"] not in OUTSIDE,
            1.0, -math.log(FLOOR), 2.0,
            size_inside=False if case["kind"] == "known" else None,
            closed_inside=False if case.get("closable") else None,
            seconds=float(answer["seconds"]), ceiling=ceiling, wrong={**dict.fromkeys(WRONG, 0.0), WRONG[-1]: 1.0},
            none=float(not nothing), outside=float(case["kind"] not in OUTSIDE),
        )  # fmt: skip
    p = _hypotheses(case, answer)
    rest = max(0.0, 1.0 - sum(p.values()))
    own = min(p[TRUTH], 1.0)  # probabilities may exceed 1 by rounding
    best = _most_probable(p)
    named = [v for k, v in p.items() if k not in ("none", "unknown")]
    if case["kind"] in NOTHING_MISSING or case["kind"] in OUTSIDE:
        named = [v for k, v in p.items() if k not in ("none", "unknown", TRUTH)]
    held = {_name(case, label.split("+"), ()) for label in answer["credible_set"]}
    unknown = TRUTH if case["kind"] in OUTSIDE else "unknown"
    return Judged(
        case,
        bool(answer["detected"]),
        own,
        best == TRUTH,
        true_name(case) if best == TRUTH else best,
        TRUTH in held,
        float(len(held)),
        best == unknown,
        max(named, default=0.0),
        -math.log(max(own, FLOOR)),
        sum(v**2 for v in p.values()) + rest**2 - 2 * own + 1,
        float(answer["p_value"]),
        _size_inside(case, answer) if best == TRUTH else None,
        _closed_inside(case, answer),
        float(answer["seconds"]),
        ceiling,
        _wrong(p, rest),
        min(max(p.values()), 1.0),
        _answered(case, best),
        min(float(answer["none_probability"]), 1.0),
        min(float(answer["unknown_probability"]), 1.0),
    )


def _most_probable(p: Mapping[str, float]) -> str:
    """The most probable hypothesis; `UNDECIDED` when several tie, which counts as naming none."""
    first, *others = sorted(p, key=lambda k: -p[k])
    return UNDECIDED if not p[first] or any(p[k] == p[first] for k in others) else first


def _answered(case: Mapping[str, Any], best: str) -> str:
    """Kind of the most probable hypothesis ``best``."""
    if best == UNDECIDED:
        return ""
    if best == TRUTH:
        best = "unknown" if case["kind"] in OUTSIDE else "+".join(e["effect"] for e in case["effects"]) or "none"
    return {"none": ANSWERED[0], "unknown": ANSWERED[1]}.get(best, ANSWERED[3] if "+" in best else ANSWERED[2])


def _hypotheses(case: Mapping[str, Any], answer: Mapping[str, Any]) -> dict[str, float]:
    """Probability by hypothesis; hypotheses with the same meaning are added; the true one is called `TRUTH`."""
    p: dict[str, float] = {TRUTH: 0.0}
    given = [(["none"], (), float(answer["none_probability"])), (["unknown"], (), float(answer["unknown_probability"]))]
    given += [(c["effects"], c["group"], float(c["probability"])) for c in answer["causes"]]
    for effects, group, value in given:
        name = _name(case, effects, group)
        p[name] = p.get(name, 0.0) + value
    return p


def _wrong(p: Mapping[str, float], rest: float) -> dict[str, float]:
    """Probability by kind of wrong answer; the remainder to 1 counts as assigned to causes that are not listed."""
    kinds = {"none": WRONG[0], "unknown": WRONG[1], TRUTH: TRUTH}
    out = dict.fromkeys((*WRONG, TRUTH), 0.0)
    for name, value in p.items():
        out[kinds.get(name, WRONG[2] if "+" in name else WRONG[3])] += value
    out.pop(TRUTH)
    out[WRONG[3]] += rest
    return out


def _name(case: Mapping[str, Any], effects: Sequence[str], group: Sequence[str]) -> str:
    """`TRUTH`, "none", "unknown", or a name that is the same for all members of the case's ambiguity groups."""
    if list(effects) in (["none"], ["unknown"]):
        word = effects[0]
        true = (word == "none" and case["kind"] in NOTHING_MISSING) or (word == "unknown" and case["kind"] in OUTSIDE)
        return TRUTH if true else word
    truths = case["effects"]
    if truths and len(truths) == len(effects) and _matches(truths, effects, group):
        return TRUTH
    return "+".join(sorted({_representative(case, e) for e in effects}))


def _matches(truths: Sequence[Mapping[str, Any]], effects: Sequence[str], group: Sequence[str]) -> bool:
    def same(truth: Mapping[str, Any], effect: str) -> bool:
        return effect in truth["group"] or (len(truths) == 1 and truth["effect"] in group and effect in truth["kin"])

    return any(all(same(t, e) for t, e in zip(truths, order, strict=True)) for order in permutations(effects))


def _representative(case: Mapping[str, Any], effect: str) -> str:
    return next((str(g[0]) for g in case.get("groups", ()) if effect in g), effect)


def _size_inside(case: Mapping[str, Any], answer: Mapping[str, Any]) -> bool | None:
    """Whether the interval of the effect's size contains the true size; only if the exact effect was named."""
    if case["kind"] != "known":
        return None
    truth = case["effects"][0]
    cause = next((c for c in answer["causes"] if c["effects"] == [truth["effect"]]), None)
    size = next(iter(truth["sizes"]))  # the size proper is declared first
    if cause is None:
        return None
    if size not in cause["size"]:
        return False
    interval = cause["size"][size]
    return bool(interval["low"] <= truth["sizes"][size] <= interval["high"])


def _closed_inside(case: Mapping[str, Any], answer: Mapping[str, Any]) -> bool | None:
    """Whether the interval of the gap closed by the named cause contains the share that it closes without noise, in
    the form in which it closes most."""
    closed = answer["closed"]
    if case["kind"] in NOTHING_MISSING or not answer["detected"]:
        return None
    closable = {**case.get("closable", {}), **case.get("any_form", {}).get("closable", {})}
    if closed is None:
        if not answer["causes"]:
            return None
        leading = max(answer["causes"], key=lambda c: float(c["probability"]))
        return False if "+".join(sorted(leading["effects"])) in closable else None
    true = closable.get("+".join(sorted(closed["effects"].split("+"))))
    return None if true is None else bool(closed["low"] - SHARE <= true <= closed["high"] + SHARE)
