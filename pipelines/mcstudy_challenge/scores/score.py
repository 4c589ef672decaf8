"""``challenge score``: score answers against the key."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from mcstudy.effect_library.library import LIBRARY
from mcstudy.errors import DesignError, StoreError
from mcstudy.exits import Exit
from mcstudy.files import json_files, schema
from mcstudy_challenge import files
from mcstudy_challenge.answer_checks import check_answers, check_key
from mcstudy_challenge.challenge_file import resolved
from mcstudy_challenge.design import KINDS, MAIN, OTHER_FORM, OUTSIDE
from mcstudy_challenge.scores.calibration import calibration
from mcstudy_challenge.scores.grade import ANSWERED, CONFIDENT, SCORES, SET_SIZES, WRONG, Judged, judge, true_name
from mcstudy_challenge.scores.other_shares import SHARES, other_shares
from mcstudy_challenge.scores.rates import Estimate, mean, rate
from mcstudy_challenge.scores.targets import (
    AT_MOST_5,
    TARGETS,
    Goal,
    attained,
    average,
    between,
    false_alarms,
    known,
    left,
    nothing,
    other_form,
    outside,
    share,
)

EDGES = (0.0, 2.0, 3.0, 3.5, 4.5, 5.5, 6.5, 8.0, 10.0, 15.0, math.inf)
"""Bins of delta for power against size."""

Score = dict[str, Any]


def score_files(data: Path, key: Path, answers: Path, shares: Sequence[float] = SHARES) -> Score:
    """Score answers to a data folder with its key; ``shares``: see `other_shares`.

    Raises `StoreError` when the key is not the one whose digest was published with the data, or when the answers belong
    to other data, omit a case, or contradict themselves.
    """
    manifest, sha = files.read_manifest(data.resolve(), whole=False)
    if not key.is_file() or json_files.digest(key) != manifest["key_sha256"]:
        raise StoreError(f"{key}: not the key whose SHA-256 {data / files.MANIFEST} publishes")
    truth, given = _read_key(key, manifest), files.read_answers(answers)
    if given["manifest_sha256"] != sha:
        raise StoreError(f"{answers}: answers to other data than {data}")
    result = score(truth, given, str(answers), shares)
    result["key_sha256"], result["answers_sha256"] = manifest["key_sha256"], json_files.digest(answers)
    schema.validate("challenge_score", result, "score")
    return result


def _read_key(path: Path, manifest: Mapping[str, Any]) -> dict[str, Any]:
    key = json_files.read_json(path, "challenge_key")
    try:
        design = resolved(key["design"], "design")
    except DesignError as error:
        raise StoreError(f"{path}: {error}") from None
    check_key(key["cases"], design.series, str(path))
    if {f"{c['name']}.nc" for c in key["cases"]} != set(manifest["files"]):
        raise StoreError(f"{path}: cases: expected the {len(manifest['files'])} cases of the manifest")
    return key


def score(
    key: Mapping[str, Any], answers: Mapping[str, Any], where: str = "answers", shares: Sequence[float] = SHARES
) -> Score:
    """Score answers with a key, both as their schemas describe them.

    Raises `StoreError`, one line that starts with ``where``, for answers that break the rules or omit a case.
    """
    check_answers(answers["answers"], (c["name"] for c in key["cases"]), where)
    by_name = {a["name"]: a for a in answers["answers"]}
    judged = [judge(c, by_name[c["name"]]) for c in key["cases"]]
    main = [j for j in judged if j.case["series"] == MAIN]
    series = [s for s in key["design"]["series"] if s != MAIN]
    return {
        "schema": schema.identifier("challenge_score"),
        "challenge": key["challenge"],
        "method": answers["method"],
        "cases": len(judged),
        "errors": [{"name": a["name"], "error": a["error"]} for a in answers["answers"] if "error" in a],
        "seconds_per_case": round(sum(j.seconds for j in judged) / len(judged), 3),
        "proper": _proper(main),
        "calibration": _calibration(main),
        "other_shares": other_shares(main, shares),
        "targets": [_target(t.name, t.goal, t.figure(main), t.percent) for t in TARGETS],
        "false_alarms": [
            _target(s, AT_MOST_5, false_alarms([j for j in judged if j.case["series"] == s])) for s in (MAIN, *series)
        ],
        "figures": {name: figure(main).to_dict() for name, figure in FIGURES.items()},
        "power": [_bin(main, low, high) for low, high in pairwise(EDGES)],
        "by_cause": _by_cause(main),
        "confusion": _confusion(main),
    }


LEADING = "the most probable hypothesis"
"""Statement of every answer whose calibration comes first."""

BEYOND_DOUBT = 3.29 / 1.96
"""Width of a 99.9 % interval relative to a 95 % one; ten targets at 95 % would fail every second run by chance."""


def _belief(part: str) -> Any:
    """Figure: mean probability assigned to a kind of wrong answer at delta = 6."""
    return average(between(5.5, 6.5), lambda j: j.wrong[part])


def _nearest_to_its_own(j: Judged) -> bool:
    """Whether the own mechanism, or one like it, closes most of the gap without noise, of all effects as declared. What
    changes with amplitude or time is not judged by the mean response."""
    (own,) = j.case["effects"]
    return LIBRARY[own["effect"]].contrast is not None or j.case.get("nearest") in own["kin"]


FIGURES = {
    "mean P(true) of known causes": average(known, lambda j: j.probability, "probability"),
    "group top-1 of known causes": share(known, lambda j: j.top, "top"),
    **{f"belief at delta = 6 in {part}": _belief(part) for part in WRONG},
    "group top-1 at delta >= 6": share(between(6.0, math.inf), lambda j: j.top, "top"),
    "power at delta = 4 if the direction were known": share(between(3.5, 4.5), lambda j: j.detected, "known_direction"),
    "95 % set holds the truth, all cases": share(lambda _: True, lambda j: j.covered),
    "size of the 95 % set, known causes": average(known, lambda j: j.set_size, "set_size", SET_SIZES),
    "size of the 95 % set, nothing missing": average(nothing, lambda j: j.set_size, "set_size", SET_SIZES),
    "effect-size intervals hold the truth": share(
        lambda j: j.size_inside is not None, lambda j: bool(j.size_inside), 0.95
    ),
    "gap-closed intervals hold the truth, known causes": share(
        lambda j: known(j) and j.closed_inside is not None, lambda j: bool(j.closed_inside), 0.95
    ),
    "gap-closed intervals hold the truth, outsiders": share(
        lambda j: outside(j) and j.closed_inside is not None, lambda j: bool(j.closed_inside), 0.95
    ),
    "pairs: both named": share(between(0.0, math.inf, "pair"), lambda j: j.top),
    "pairs: both named, second one visible (delta >= 4)": share(
        lambda j: j.kind == "pair" and j.case.get("residual_delta", 0.0) >= 4.0, lambda j: j.top
    ),
    "pairs: detected": share(between(0.0, math.inf, "pair"), lambda j: j.detected, "known_direction"),
    "outsiders: detected": share(outside, lambda j: j.detected, "detected"),
    "outsiders: flagged": share(outside, lambda j: j.flagged, "flagged_any_form"),
    "outsiders no declared effect imitates (delta left >= 6): flagged": share(
        lambda j: outside(j) and j.case.get("smooth_residual", 0.0) >= 6.0, lambda j: j.flagged, "flagged"
    ),
    "outsiders a form of an effect imitates (delta left < 3, delta >= 6): flagged": share(
        lambda j: outside(j) and j.delta >= 6.0 and left(j) < 3.0, lambda j: j.flagged, "flagged_any_form"
    ),
    "outsiders a form of an effect imitates (delta left < 3, delta >= 6): confidently wrong name": share(
        lambda j: outside(j) and j.delta >= 6.0 and left(j) < 3.0, lambda j: j.confident > CONFIDENT
    ),
    "false unknown, nothing missing": share(nothing, lambda j: j.flagged),
    "false unknown, known causes": share(known, lambda j: j.flagged),
    "false unknown, pairs": share(between(0.0, math.inf, "pair"), lambda j: j.flagged),
    "other form at delta >= 6 that no effect imitates better: right mechanism first": share(
        lambda j: other_form(j) and j.delta >= 6.0 and _nearest_to_its_own(j), lambda j: j.top
    ),
    "other form: mean P(mechanism)": average(other_form, lambda j: j.probability),
    "size of the 95 % set, other form": average(other_form, lambda j: j.set_size, bounds=SET_SIZES),
    "gap-closed intervals hold the truth, other form": share(
        lambda j: other_form(j) and j.closed_inside is not None, lambda j: bool(j.closed_inside), 0.95
    ),
    "near instability: false alarms": share(lambda j: j.kind == "near_unstable", lambda j: j.detected, 0.05),
    "parameters far off: false alarms": share(lambda j: j.kind == "shifted", lambda j: j.detected, 0.05),
    "nothing missing: top-1": share(nothing, lambda j: j.top, "top"),
}
"""Further figures of the main series, by name."""


def _target(name: str, goal: Goal, figure: Estimate, percent: bool = True) -> dict[str, Any]:
    word, certain = attained(goal, figure)
    return {
        "name": name,
        "goal": goal.text,
        **figure.to_dict(),
        "percent": percent,
        "verdict": word,
        "certain": certain,
        "beyond_doubt": attained(goal, figure.widened(BEYOND_DOUBT))[1],
    }


def _proper(main: Sequence[Judged]) -> dict[str, Any]:
    """Log loss and Brier score over all cases and by kind; oracle bounds exist for no effect and one known effect."""
    out: dict[str, Any] = {}
    for name, pick in (("log_loss", lambda j: j.log_loss), ("brier", lambda j: j.brier)):
        out[name] = {"all": mean((pick(j) for j in main), bounds=SCORES[name]).to_dict()}
        for kind in KINDS:
            own = [j for j in main if j.kind == kind]
            ideal = (j.ceiling.get(name, math.nan) for j in own)
            out[name][kind] = mean((pick(j) for j in own), ideal, SCORES[name]).to_dict()
    return out


def _calibration(main: Sequence[Judged]) -> list[dict[str, Any]]:
    """Calibration of what the answers state. Cases are chosen by the answer, never by the truth: calibrated answers
    are right as often as they state among those, but not among the cases of one true cause."""
    statements = [
        (LEADING, calibration((j.stated for j in main), (j.top for j in main))),
        ("nothing is missing", calibration((j.none for j in main), (nothing(j) for j in main))),
        ("the cause is outside the library", calibration((j.outside for j in main), (outside(j) for j in main))),
    ]
    for kind in ANSWERED:
        own = [j for j in main if j.answered == kind]
        name = f"{LEADING}: {kind}"
        statements.append((name, calibration((j.stated for j in own), (j.top for j in own))))
    return [{"statement": name, **found.to_dict()} for name, found in statements]


def _bin(main: Sequence[Judged], low: float, high: float) -> dict[str, Any]:
    own = [j for j in main if j.kind == "known" and low <= j.delta < high]
    ceiling = {k: [float(j.ceiling.get(k, math.nan)) for j in own] for k in ("detected", "top", "probability")}
    return {
        "low": low,
        "high": None if math.isinf(high) else high,
        "detected": rate((j.detected for j in own), ceiling["detected"]).to_dict(),
        "top": rate((j.top for j in own), ceiling["top"]).to_dict(),
        "probability": mean((j.probability for j in own), ceiling["probability"]).to_dict(),
    }


def _by_cause(main: Sequence[Judged]) -> list[dict[str, Any]]:
    """Figures for each effect, in and out of the library, at delta of 5 and more."""
    own: dict[str, list[Judged]] = defaultdict(list)
    for j in main:
        if j.kind in ("known", *OUTSIDE, *OTHER_FORM) and j.delta >= 5.0:
            own[true_name(j.case)].append(j)
    return [
        {
            "cause": name,
            "detected": rate(j.detected for j in own[name]).to_dict(),
            "top": rate((j.top for j in own[name]), (_top_ceiling(j) for j in own[name])).to_dict(),
            "confident_wrong": rate(not j.top and j.confident > 0.8 for j in own[name]).to_dict(),
        }
        for name in sorted(own)
    ]


def _top_ceiling(j: Judged) -> float:
    return float(j.ceiling.get("flagged" if j.kind in OUTSIDE else "top", math.nan))


def _confusion(main: Sequence[Judged]) -> dict[str, dict[str, int]]:
    """Rows: the truth; columns: the most probable hypothesis. Pairs are one row."""
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for j in main:
        row = "a pair" if j.kind == "pair" else true_name(j.case)
        if j.top:
            table[row]["right"] += 1
        else:
            table[row]["a pair" if "+" in j.top_name else j.top_name] += 1
    return {row: dict(table[row].most_common()) for row in sorted(table)}


def exit_code(score: Mapping[str, Any]) -> Exit:
    """`Exit.MISSED` if a target or false-alarm rate is missed at the 99.9 % level or an answer is absent."""
    rows = [*score["targets"], *score["false_alarms"]]
    missed = any(r["verdict"] == "missed" and r["beyond_doubt"] for r in rows)
    return Exit.MISSED if score["errors"] or missed else Exit.DONE
