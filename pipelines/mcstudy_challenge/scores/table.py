"""A score as text: proper scores first, then targets, false alarms, power, and confusions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from mcstudy.text_tables import p_value, printable, table
from mcstudy_challenge.scores.rates import Estimate

LONGEST_TEXT = 300
"""Largest number of characters shown of a name or an error."""

OVERALL = 3
"""Statements about all cases, which come first; the others are about some of them."""

Rows = list[tuple[str, ...]]


def score_text(score: Mapping[str, Any]) -> str:
    """The whole score."""
    lines = [
        f"challenge {_plain(score['challenge'])}: {score['cases']} cases answered by {_plain(score['method'])}, "
        f"{score['seconds_per_case']:g} s per case, {len(score['errors'])} without an answer"
    ]
    for part in (_proper, _calibration, _reliability, _shares, _targets, _false_alarms, _figures, _power, _by_cause):
        header, *rows = part(score)
        if rows:
            lines += ["", table(header, rows, of_text=True)]
    lines += ["", "number of cases by most probable hypothesis, for each true cause"]
    for row, counts in score["confusion"].items():
        lines.append(f"  {_plain(row)}: " + ", ".join(f"{n} {_plain(k)}" for k, n in counts.items()))
    lines += [f"no answer to {e['name']}: {_plain(e['error'])}" for e in score["errors"][:20]]
    return "\n".join(lines)


def _plain(text: str) -> str:
    return printable(text, LONGEST_TEXT)


def _proper(score: Mapping[str, Any]) -> Rows:
    rows: Rows = [("proper score (lower is better)", "value [95 %]", "oracle bound", "cases")]
    for name, label in (("log_loss", "log loss"), ("brier", "Brier")):
        for kind, f in score["proper"][name].items():
            if f["n"]:
                rows.append((f"{label}, {kind}", _value(f, False), _ceiling(f, False), str(f["n"])))
    return rows


def _calibration(score: Mapping[str, Any]) -> Rows:
    rows: Rows = [
        ("stated probability of", "cases", "stated", "came true [95 %]", "calibration error",
         "if calibrated (95 % below)", "p", "Spiegelhalter z", "p of z")
    ]  # fmt: skip
    for c in score["calibration"]:
        chance = "" if c["by_chance"] is None else f"{_percent(c['by_chance'])} ({_percent(c['chance_high'])})"
        z = "" if c["z"] is None else f"{c['z']:.2f}"
        p, p_of_z = ("" if c[k] is None else p_value(c[k]) for k in ("p_value", "z_p_value"))
        rows.append(
            (c["statement"], str(c["right"]["n"]), _percent(c["stated"]), _value(c["right"]), _percent(c["error"]),
             chance, p, z, p_of_z)
        )  # fmt: skip
    return rows


def _reliability(score: Mapping[str, Any]) -> Rows:
    """The reliability diagrams in numbers."""
    rows: Rows = [("reliability of", "stated", "cases", "stated, mean", "came true [95 %]")]
    for c in score["calibration"][:OVERALL]:
        for b in c["bins"]:
            span = f"{100 * b['low']:.0f} to {100 * b['high']:.0f} %"
            rows.append((c["statement"], span, str(b["right"]["n"]), _percent(b["stated"]), _value(b["right"])))
    return rows


def _shares(score: Mapping[str, Any]) -> Rows:
    """What another share of cases without a missing effect would make of the probabilities."""
    rows: Rows = [
        (
            "were so many of the cases nulls",
            "first: stated minus right [95 %]",
            "nothing missing: stated minus share",
            "log loss",
        )
    ]
    return rows + [
        (f"{100 * s['nulls']:g} %", *(_value(s[k], False) if k in s else "" for k in ("first", "none", "log_loss")))
        for s in score.get("other_shares", ())
    ]


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.1f} %"


def _targets(score: Mapping[str, Any]) -> Rows:
    return [("target", "goal", "value [95 %]", "oracle bound", "cases", ""), *map(_target, score["targets"])]


def _false_alarms(score: Mapping[str, Any]) -> Rows:
    return [("false alarms in", "goal", "value [95 %]", "nominal", "cases", ""), *map(_target, score["false_alarms"])]


def _target(t: Mapping[str, Any]) -> tuple[str, ...]:
    word = t["verdict"] if t["verdict"] == "no cases" or t["certain"] else f"{t['verdict']}, within its error"
    return t["name"], t["goal"], _value(t, t["percent"]), _ceiling(t, t["percent"]), str(t["n"]), word


def _figures(score: Mapping[str, Any]) -> Rows:
    rows: Rows = [("figure", "value [95 %]", "oracle bound", "cases")]
    for name, f in score["figures"].items():
        percent = not name.startswith("size of")
        rows.append((name, _value(f, percent), _ceiling(f, percent), str(f["n"])))
    return rows


def _power(score: Mapping[str, Any]) -> Rows:
    rows: Rows = [
        ("delta", "cases", "detected", "oracle bound", "true most probable", "oracle bound", "P(true)", "oracle bound")
    ]
    for b in score["power"]:
        high = "∞" if b["high"] is None else f"{b['high']:g}"
        rows.append((f"{b['low']:g} … {high}", str(b["detected"]["n"]), *_pairs(b, "detected", "top", "probability")))
    return rows


def _pairs(row: Mapping[str, Any], *names: str) -> Iterator[str]:
    for name in names:
        yield from (_value(row[name]), _ceiling(row[name]))


def _by_cause(score: Mapping[str, Any]) -> Rows:
    rows: Rows = [("cause (delta ≥ 5)", "cases", "detected", "true most probable", "oracle bound", "confidently wrong")]
    for c in score["by_cause"]:
        detected, wrong = _value(c["detected"]), _value(c["confident_wrong"])
        rows.append((_plain(c["cause"]), str(c["top"]["n"]), detected, *_pairs(c, "top"), wrong))
    return rows


def _value(f: Mapping[str, Any], percent: bool = True) -> str:
    value, low, high = (math.nan if f[k] is None else float(f[k]) for k in ("value", "low", "high"))
    return Estimate(value, low, high, int(f["n"])).text(percent)


def _ceiling(f: Mapping[str, Any], percent: bool = True) -> str:
    if f["ceiling"] is None:
        return ""
    return f"{100 * f['ceiling']:.1f} %" if percent else f"{f['ceiling']:.2f}"
