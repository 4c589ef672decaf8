"""Rules for answers and keys that a schema cannot express and that are checked before scoring.

The hypotheses are mutually exclusive, so their probabilities sum to at most 1; the remainder to 1 counts as assigned to
causes that are not listed. Every case has exactly one answer, so hard cases can be neither omitted nor answered twice.
Sets have the stated probability, intervals have two ends, and names are names of the library.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from mcstudy.effect_library.library import LIBRARY
from mcstudy.errors import StoreError
from mcstudy_challenge.design import NOTHING_MISSING, OTHER_FORM, OUTSIDE

ROUNDING = 1e-6
"""Tolerance for the limits of a probability or a sum of probabilities."""

SET = 0.95
"""Required probability of the set of an answer."""

LONGEST_S = 1e8
"""Largest computing time of one answer, seconds: three years."""

LARGEST_CEILING = 1e6
"""Largest figure of the ideal method; figures are probabilities, scores and sizes of sets."""

NAMELESS = ("none", "unknown")
"""Hypotheses that name no effect: no effect is missing, or the cause is not in the library."""

PAIR = 2
"""Largest number of effects in one hypothesis."""


def check_answers(answers: Sequence[Mapping[str, Any]], cases: Iterable[str], where: str) -> None:
    """Raise `StoreError`, one line, unless every one of the ``cases`` has exactly one answer that can be scored."""
    names = dict.fromkeys(cases)
    times = Counter(a["name"] for a in answers)
    for given in answers:
        name = given["name"]
        if name not in names:
            raise StoreError(f"{where}: {name[:60]!r}: name: expected a case of these data, found an unknown one")
        if times[name] > 1:
            raise StoreError(f"{where}: {name}: name: expected one answer per case, found {times[name]}")
        check_answer(given, f"{where}: {name}")
    missing = [n for n in names if n not in times]
    if missing:
        raise StoreError(
            f"{where}: {missing[0]} has no answer ({len(missing)} cases without one); expected one per case"
        )


def check_answer(given: Mapping[str, Any], where: str) -> None:
    """Raise `StoreError`, one line, unless an answer that conforms to its schema can be scored."""
    if _finite(given["seconds"], f"{where}: seconds") > LONGEST_S:
        raise StoreError(f"{where}: seconds: expected at most {LONGEST_S:g}, found {given['seconds']:g}")
    if "error" in given:
        return
    p = {n: _probability(given[f"{n}_probability"], f"{where}: {n}_probability") for n in NAMELESS}
    _probability(given["p_value"], f"{where}: p_value")
    causes: dict[frozenset[str], tuple[frozenset[str], float]] = {}
    for k, cause in enumerate(given["causes"]):
        at = f"{where}: causes.{k}"
        effects = _effects(cause["effects"], f"{at}.effects")
        if effects in causes:
            raise StoreError(f"{at}.effects: expected every cause once, found {'+'.join(sorted(effects))} twice")
        group = _group(cause["group"], effects, f"{at}.group")
        for other, (others, _) in causes.items():
            if len(effects) == len(other) == 1 and group & others:
                raise StoreError(
                    f"{at}.group: expected groups without a common effect, found {min(group & others)} in two"
                )
        causes[effects] = group, _probability(cause["probability"], f"{at}.probability")
        for name, size in cause["size"].items():
            _interval(size, "value", f"{at}.size.{name[:60]!r}")
    total = sum(p.values()) + sum(q for _, q in causes.values())
    if total > 1 + ROUNDING:
        raise StoreError(f"{where}: probability: expected a sum of at most 1 over all hypotheses, found {total:.6g}")
    _check_set(given["credible_set"], p, causes, 1 - total, f"{where}: credible_set")
    places = [_probability(v, f"{where}: place.{k[:60]!r}") for k, v in given.get("place", {}).items()]
    if sum(places) > 1 + ROUNDING:
        raise StoreError(f"{where}: place: expected a sum of at most 1, found {sum(places):.6g}")
    if given["closed"] is not None:
        _check_closed(given["closed"], causes, f"{where}: closed")


def _check_set(
    entries: Sequence[str],
    p: Mapping[str, float],
    causes: Mapping[frozenset[str], tuple[frozenset[str], float]],
    rest: float,
    where: str,
) -> None:
    """Check that a set has the required probability, counting all causes that its hypotheses stand for."""
    seen: set[frozenset[str]] = set()
    held: set[frozenset[str]] = set()
    unlisted = False
    for label in entries:
        hypothesis = frozenset([label]) if label in NAMELESS else _effects(label.split("+"), where)
        if hypothesis in seen:
            raise StoreError(f"{where}: expected every hypothesis once, found {label} twice")
        seen.add(hypothesis)
        meant = [
            e for e, (group, _) in causes.items() if e == hypothesis or (len(hypothesis) == 1 and hypothesis <= group)
        ]
        held.update(meant)
        unlisted |= label not in NAMELESS and not meant
    total = sum(p[n] for n in NAMELESS if frozenset([n]) in seen) + sum(causes[e][1] for e in held)
    if total + (max(rest, 0.0) if unlisted else 0.0) < SET - ROUNDING:
        raise StoreError(f"{where}: expected hypotheses with a probability of {SET:g}, found {total:.6g}")


def _check_closed(
    closed: Mapping[str, Any], causes: Mapping[frozenset[str], tuple[frozenset[str], float]], where: str
) -> None:
    effects = _effects(str(closed["effects"]).split("+"), f"{where}.effects")
    largest = max((q for _, q in causes.values()), default=0.0)
    if causes and (effects not in causes or causes[effects][1] < largest - ROUNDING):
        raise StoreError(f"{where}.effects: expected the most probable cause, found {closed['effects']}")
    for end in ("fraction", "low", "high"):
        _probability(closed[end], f"{where}.{end}")
    _interval(closed, "fraction", where)
    if not closed["low"] <= closed["fraction"] <= closed["high"]:
        raise StoreError(f"{where}.fraction: expected a share inside its interval, found {closed['fraction']:g}")


def _effects(names: Sequence[str], where: str) -> frozenset[str]:
    for name in names:
        if name not in LIBRARY:
            raise StoreError(f"{where}: expected effects of the library (mcstudy gap effects), found {name[:60]!r}")
    if not 1 <= len(names) <= PAIR or len(set(names)) < len(names):
        raise StoreError(f"{where}: expected one effect or two different ones, found {', '.join(names)[:200]}")
    return frozenset(names)


def _group(names: Sequence[str], effects: frozenset[str], where: str) -> frozenset[str]:
    """Effects that a cause stands for: its own and those that cannot be distinguished from it."""
    for name in names:
        if name not in LIBRARY:
            raise StoreError(f"{where}: expected effects of the library (mcstudy gap effects), found {name[:60]!r}")
    if names and len(effects) > 1:
        raise StoreError(f"{where}: expected no group for a pair, found {', '.join(names)[:200]}")
    return effects | frozenset(names)


def _finite(value: float, where: str) -> float:
    if not math.isfinite(value):
        raise StoreError(f"{where}: expected a finite number, found {value}")
    return float(value)


def _probability(value: float, where: str) -> float:
    if not -ROUNDING <= _finite(value, where) <= 1 + ROUNDING:
        raise StoreError(f"{where}: expected a number from 0 to 1, found {value:g}")
    return float(value)


def _interval(given: Mapping[str, float], value: str, where: str) -> None:
    for name in (value, "low", "high"):
        _finite(given[name], f"{where}.{name}")
    if given["low"] > given["high"]:
        raise StoreError(f"{where}: expected low <= high, found {given['low']:g} and {given['high']:g}")


CAUSES = {
    **dict.fromkeys((*NOTHING_MISSING, *OUTSIDE), 0),
    **dict.fromkeys(("known", *OTHER_FORM), 1),
    "pair": 2,
}
"""Number of effects of the library in a case of each kind."""


def check_key(cases: Sequence[Mapping[str, Any]], series: Iterable[str], where: str) -> None:
    """Raise `StoreError`, one line, unless the cases of a key that conforms to its schema agree with their kinds."""
    known = set(series)
    times = Counter(c["name"] for c in cases)
    for case in cases:
        at = f"{where}: {case['name']}"
        if times[case["name"]] > 1:
            raise StoreError(f"{at}: name: expected every case once, found {times[case['name']]}")
        if case["series"] not in known:
            raise StoreError(f"{at}: series: expected one of {', '.join(sorted(known))}, found {case['series'][:60]!r}")
        if len(case["effects"]) != CAUSES[case["kind"]]:
            expected = f"expected {CAUSES[case['kind']]} for kind {case['kind']}"
            raise StoreError(f"{at}: effects: {expected}, found {len(case['effects'])}")
        for name, value in case.get("ceiling", {}).items():
            if not 0 <= value <= LARGEST_CEILING:
                expected = f"expected a number from 0 to {LARGEST_CEILING:g}"
                raise StoreError(f"{at}: ceiling.{name[:60]!r}: {expected}, found {value:g}")
        for field, kinds in (("outsider", OUTSIDE), ("form", OTHER_FORM)):
            if (field in case) != (case["kind"] in kinds):
                expected = f"expected one for kind {' or '.join(kinds)} only"
                raise StoreError(f"{at}: {field}: {expected}, found kind {case['kind']}")
