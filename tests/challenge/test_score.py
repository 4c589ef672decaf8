"""The score: an oracle passes every target, a guesser fails them, and the ceilings are what theory says."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from mcstudy_challenge.design import NOTHING_MISSING, OTHER_FORM, OUTSIDE, Stratum
from mcstudy_challenge.scores.grade import judge
from mcstudy_challenge.scores.oracle import FLOOR, Classifier, log_evidence, size_grid
from mcstudy_challenge.scores.rates import mean, rate
from mcstudy_challenge.scores.score import FIGURES, LEADING, exit_code, score
from mcstudy_challenge.scores.table import score_text
from mcstudy_challenge.scores.targets import TARGETS
from scipy import stats

from mcstudy.errors import StoreError
from mcstudy.exits import Exit
from mcstudy.files import schema

EFFECTS = ("head_mode", "stimulus_gain", "leg_inertia_error", "force_feedback")
GROUPS = [["stimulus_gain", "leg_inertia_error"]]
SIZES = {"head_mode": "m_head", "stimulus_gain": "eps_stim", "leg_inertia_error": "eps_leg", "force_feedback": "Gforce"}
CASES = 520


def make_key(rng: np.random.Generator) -> dict[str, Any]:
    """A key of cases that were never simulated."""
    kinds = ["none"] * 100 + ["known"] * 180 + ["outsider"] * 60 + ["pair"] * 40 + ["misshapen"] * 20
    kinds += ["shifted"] * 10 + ["near_unstable"] * 10 + ["foreign"] * 60
    kinds += ["foreign_mechanism"] * 20 + ["foreign_outsider"] * 20
    cases = []
    for k, kind in enumerate(kinds):
        case: dict[str, Any] = {"name": f"case{k:03d}", "series": "main", "kind": kind, "parameters": {"K11": 1.0}}
        case |= {"delta": 0.0, "effects": [], "groups": GROUPS}
        names: Any = {"known": rng.choice(EFFECTS, 1), "pair": ("force_feedback", "head_mode")}.get(kind, ())
        if kind in OTHER_FORM:
            names, case["form"] = ("head_mode",), "head_damped"
        for name in map(str, names):
            group = next((g for g in GROUPS if name in g), [name])
            case["effects"].append(
                {"effect": name, "sizes": {SIZES[name]: 1.0}, "delta": 6.0, "group": group, "kin": group}
            )
        if kind not in NOTHING_MISSING:
            case["delta"] = float(rng.choice([4.0, 6.0, 12.0]))
            case |= {"closable": dict.fromkeys(EFFECTS, 0.3), "nearest": "head_mode", "residual_delta": case["delta"]}
            case["closable"]["+".join(sorted(e["effect"] for e in case["effects"]))] = 1.0
        if kind in OUTSIDE:
            case["outsider"] = {"name": "wobble", "size": 1.0, "unit": "kg"}
            case["any_form"] = {k: case[k] for k in ("closable", "nearest", "residual_delta")}
            case["any_form"]["smooth_residual"] = case["delta"]
        cases.append(case)
    key = {"schema": schema.identifier("challenge_key"), "challenge": "synthetic", "fingerprint": "0" * 64}
    return key | {"design": {"series": {"main": {}}}, "cases": cases}


def answers(key: dict[str, Any], method: str, give: Any) -> dict[str, Any]:
    given = [{"name": c["name"], "seconds": 0.0, **give(c, k)} for k, c in enumerate(key["cases"])]
    out = {"schema": schema.identifier("challenge_answers"), "challenge": "synthetic", "manifest_sha256": "0" * 64}
    out |= {"method": method, "answers": given}
    schema.validate("challenge_answers", out, method)
    return out


def cause(effects: list[str], p: float, group: list[str] | None = None, low: float = 0.9) -> dict[str, Any]:
    size = {SIZES[e]: {"value": 1.0, "low": low, "high": 1.1} for e in effects}
    return {"effects": effects, "group": group or [], "probability": p, "size": size}


def plain(**more: Any) -> dict[str, Any]:
    base = {"seconds": 0.0, "detected": False, "p_value": 0.5, "none_probability": 0.0, "unknown_probability": 0.0}
    return base | {"causes": [], "credible_set": ["none"], "closed": None} | more


def oracle(case: dict[str, Any], k: int) -> dict[str, Any]:
    """Knows the truth; its intervals hold it in 95 of 100 cases, as they should."""
    if case["kind"] in NOTHING_MISSING:
        return plain(none_probability=1.0)
    if case["kind"] in OUTSIDE:
        return plain(detected=True, p_value=0.0, unknown_probability=1.0, credible_set=["unknown"])
    names = [e["effect"] for e in case["effects"]]
    label = "+".join(sorted(names))
    high = 1.0 if k % 20 else 0.99
    closed = {"effects": label, "fraction": 0.95, "low": 0.9, "high": high}
    return plain(detected=True, p_value=0.0, causes=[cause(names, 1.0)], credible_set=[label], closed=closed)


def guesser(_: dict[str, Any], k: int) -> dict[str, Any]:
    """Tosses a coin for a gap, and names a cause that has nothing to do with the case."""
    rng = np.random.default_rng(k)
    name = str(rng.choice(EFFECTS))
    closed = {"effects": name, "fraction": 1.0, "low": float(rng.random()), "high": 1.0}
    return plain(
        detected=bool(rng.random() < 0.5), causes=[cause([name], 0.9)], none_probability=0.05, unknown_probability=0.05,
        credible_set=[name, "none"], closed=closed,
    )  # fmt: skip


def first(key: dict[str, Any], kind: str, effect: str = "") -> dict[str, Any]:
    """The first case of a kind, or with an effect."""
    cases = (c for c in key["cases"] if c["kind"] == kind)
    case: dict[str, Any] = next(c for c in cases if not effect or c["effects"][0]["effect"] == effect)
    return case


@pytest.fixture(scope="module")
def key() -> dict[str, Any]:
    key = make_key(np.random.default_rng(0))
    schema.validate("challenge_key", key, "key")
    return key


def test_an_oracle_reaches_every_target(key: dict[str, Any]) -> None:
    result = score(key, answers(key, "oracle", oracle))
    schema.validate("challenge_score", result, "score")
    assert {t["name"]: t["verdict"] for t in result["targets"]} == {t["name"]: "reached" for t in result["targets"]}
    assert result["proper"]["log_loss"]["all"]["value"] == 0.0
    assert result["proper"]["brier"]["all"]["value"] == 0.0
    assert exit_code(result) == 0
    assert "synthetic" in score_text(result)


def test_a_guesser_misses_them_beyond_doubt(key: dict[str, Any]) -> None:
    result = score(key, answers(key, "guesser", guesser))
    missed = {t["name"] for t in result["targets"] if t["verdict"] == "missed" and t["certain"]}
    assert missed >= {
        "false alarms",
        "detection at delta = 4",
        "true group most probable at delta = 6",
        "mean P(true group) at delta = 6",
        "95 % set contains the truth",
        "out-of-library effect recognized at delta ≥ 10",
        "confidently wrong name, out-of-library effect",
        "misshapen: right mechanism most probable at delta ≥ 6",
    }
    assert exit_code(result) == Exit.MISSED
    assert result["proper"]["log_loss"]["all"]["value"] > 2.0


def test_honest_ignorance_beats_confident_guessing_in_the_proper_scores(key: dict[str, Any]) -> None:
    def ignorant(_: dict[str, Any], __: int) -> dict[str, Any]:
        return plain(
            none_probability=0.3, unknown_probability=0.15, causes=[cause([e], 0.55 / len(EFFECTS)) for e in EFFECTS],
            credible_set=["none", "unknown", *EFFECTS],
        )  # fmt: skip

    honest, guessed = score(key, answers(key, "i", ignorant)), score(key, answers(key, "g", guesser))
    for name in ("log_loss", "brier"):
        assert honest["proper"][name]["all"]["value"] < guessed["proper"][name]["all"]["value"]


def test_naming_any_member_of_the_true_group_is_right(key: dict[str, Any]) -> None:
    case = first(key, "known", "stimulus_gain")
    other = judge(case, plain(causes=[cause(["leg_inertia_error"], 1.0)]))
    assert other.top
    assert other.probability == 1.0
    split = [cause(["leg_inertia_error"], 0.3), cause(["stimulus_gain"], 0.3), cause(["head_mode"], 0.4)]
    assert judge(case, plain(causes=split)).probability == pytest.approx(0.6)


def test_a_group_of_everything_is_not_an_answer(key: dict[str, Any]) -> None:
    case = first(key, "known", "stimulus_gain")
    everything = plain(causes=[cause(["head_mode"], 1.0, group=list(EFFECTS))])
    assert not judge(case, everything).top


def test_one_of_two_causes_is_not_the_pair(key: dict[str, Any]) -> None:
    case = first(key, "pair")
    assert not judge(case, plain(causes=[cause(["head_mode"], 1.0)])).top
    both = plain(causes=[cause(["head_mode", "force_feedback"], 1.0)], credible_set=["force_feedback+head_mode"])
    judged = judge(case, both)
    assert judged.top
    assert judged.covered


def test_intervals_are_judged_only_where_there_is_something_to_hold(key: dict[str, Any]) -> None:
    case = first(key, "known")
    name = case["effects"][0]["effect"]
    closed = {"effects": name, "fraction": 0.5, "low": 0.4, "high": 0.6}
    answer = plain(detected=True, causes=[cause([name], 1.0, low=1.05)], closed=closed)
    judged = judge(case, answer)
    assert judged.size_inside is False
    assert judged.closed_inside is False
    nothing = first(key, "none")
    assert judge(nothing, answer).closed_inside is None


def test_wilson_interval_is_the_textbook_one() -> None:
    # Newcombe 1998, Stat Med 17:857, Table I: 81/263 and 0/20
    found = rate([True] * 81 + [False] * 182)
    assert (found.low, found.high) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    none = rate([False] * 20)
    assert (none.low, none.high) == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert rate([]).n == 0
    assert math.isnan(mean([1.0]).low)
    assert mean([0.25]).text() == "25.0 %"


def test_ideal_detection_of_one_effect_is_the_normal_test() -> None:
    """With one effect and one size the likelihood ratio is the one-sided z test."""
    delta, weight = np.array([4.0]), np.array([1.0])
    lone = Classifier(np.eye(1), np.array([0]), np.array([0.5, 0.5]), np.ones(1), delta, weight)
    found = lone.ceiling(np.random.default_rng(1), 0, 2.0, n=20_000)
    assert found.known_direction == pytest.approx(stats.norm.sf(stats.norm.isf(0.05) - 2.0))
    assert found.detected == pytest.approx(found.known_direction, abs=0.02)


def test_ideal_classifier_is_calibrated_and_bounded_by_what_it_knows() -> None:
    cosine = np.array([[1.0, 0.9, 0.0], [0.9, 1.0, 0.0], [0.0, 0.0, 1.0]])
    delta, weight = size_grid([Stratum(share=1.0, low=1.0, high=12.0)])
    prior = np.array([0.4, 0.2, 0.2, 0.2])
    ideal = Classifier(cosine, np.array([0, 1, 2]), prior, np.ones(3), delta, weight)
    rng = np.random.default_rng(2)
    found = [ideal.ceiling(rng, k, float(d), n=200) for k in range(3) for d in np.linspace(1, 12, 30)]
    nothing = [ideal.ceiling(rng, None, 0.0, n=200) for _ in range(30)]
    right = 0.6 * np.mean([c.top for c in found]) + 0.4 * np.mean([c.top for c in nothing])
    covered = 0.6 * np.mean([c.covered for c in found]) + 0.4 * np.mean([c.covered for c in nothing])
    # A Bayes classifier cannot be more often right than the best guess; its 95 % sets hold at least 95 %.
    assert 0.8 < right < 1.0
    assert covered > 0.945
    assert np.mean([c.detected for c in nothing]) == pytest.approx(0.05, abs=0.012)
    alike = np.mean([c.top for c in found[:60]])
    apart = np.mean([c.top for c in found[60:]])
    assert apart > alike + 0.05


def test_groups_that_count_as_one_are_easier_to_name() -> None:
    cosine = np.array([[1.0, 0.92], [0.92, 1.0]])
    delta, weight = size_grid([Stratum(share=1.0, low=5.0, high=7.0)])
    ideal = Classifier(cosine, np.array([0, 1]), np.array([0.4, 0.3, 0.3]), np.ones(2), delta, weight)
    apart = ideal.ceiling(np.random.default_rng(3), 0, 6.0)
    together = ideal.ceiling(np.random.default_rng(3), 0, 6.0, similar=[0, 1])
    assert together.top > apart.top
    assert together.probability > 0.99
    assert together.set_size < apart.set_size


def test_evidence_of_a_fixed_size_is_exact() -> None:
    z = np.array([-1.0, 0.0, 3.0])
    assert log_evidence(z, np.array([2.0]), np.array([1.0])) == pytest.approx(2 * z - 2)


def with_changes(key: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """The oracle's answers, with other values in that to case 100, the first with a known cause: by place, a value or
    what makes it of the old one."""
    given = copy.deepcopy(answers(key, "oracle", oracle))
    for place, value in changes.items():
        inner = given["answers"][100]
        *parents, last = place.split(".")
        for name in parents:
            inner = inner[int(name)] if isinstance(inner, list) else inner[name]
        inner[last] = value(inner.get(last)) if callable(value) else value
    return given


def sizes_with(**ends: float) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda sizes: {name: size | ends for name, size in sizes.items()}


TWO = [["head_mode"], ["force_feedback"]]

UNTRUE: dict[str, tuple[dict[str, Any], str]] = {
    "a sum of 1.8": ({"none_probability": 0.8}, "probability: expected a sum of at most 1 .*found 1.8"),
    "two certain causes": (
        {"causes": [cause(effects, 1.0) for effects in TWO], "closed": None},
        "probability: expected a sum of at most 1 .*found 2",
    ),
    "a cause twice": (
        {"causes": lambda causes: [*causes, causes[0] | {"probability": 0.0}]},
        "causes.1.effects: expected every cause once",
    ),
    "p = NaN": ({"p_value": math.nan}, "p_value: expected a finite number, found nan"),
    "NaN probability": ({"none_probability": math.nan}, "none_probability: expected a finite number"),
    "endless seconds": ({"seconds": math.inf}, "seconds: expected a finite number, found inf"),
    "an effect nobody knows": (
        {"causes.0.effects": ["ghost"]},
        "causes.0.effects: expected effects of the library .*found 'ghost'",
    ),
    "a group of nobody": ({"causes.0.group": ["ghost"]}, "causes.0.group: expected effects of the .*found 'ghost'"),
    "three effects": (
        {"causes.0.effects": ["head_mode", "stimulus_gain", "force_feedback"]},
        "causes.0.effects: expected one effect or two",
    ),
    "an effect in two groups": (
        {"causes": [cause(effects, 0.5, ["sensor_lag_both"]) for effects in TWO], "closed": None},
        "causes.1.group: expected groups without a common effect, found sensor_lag_both",
    ),
    "an empty set": ({"credible_set": []}, "credible_set: expected hypotheses with a probability of 0.95"),
    "a set of what is not believed": (
        {"credible_set": ["none", "unknown"]},
        "credible_set: expected hypotheses with a probability of 0.95, found 0",
    ),
    "a set of the unheard of": (
        {"credible_set": lambda named: [*named, "ghost"]},
        "credible_set: expected effects of the library",
    ),
    "a set that says it twice": ({"credible_set": lambda named: named * 2}, "credible_set: expected every hypothesis"),
    "an interval back to front": (
        {"causes.0.size": sizes_with(low=1.2)},
        "causes.0.size.*: expected low <= high, found 1.2 and 1.1",
    ),
    "an endless interval": (
        {"causes.0.size": sizes_with(high=math.inf)},
        "causes.0.size.*high: expected a finite number",
    ),
    "a share of 1.1": ({"closed.high": 1.1}, "closed.high: expected a number from 0 to 1, found 1.1"),
    "a share back to front": ({"closed.low": 0.995, "closed.high": 0.5}, "closed: expected low <= high"),
    "the share of another cause": (
        {"closed.effects": "sensor_lag_both"},
        "closed.effects: expected the most probable cause, found sensor_lag_both",
    ),
    "places that sum to 2": (
        {"place": {"hip": 1.0, "ankle": 1.0}},
        "place: expected a sum of at most 1, found 2",
    ),
    "a case never set": ({"name": "case999"}, "case999.*expected a case of these data"),
    "a case answered twice": ({"name": "case101"}, "case101: name: expected one answer per case, found 2"),
}


@pytest.mark.parametrize("name", UNTRUE)
def test_answers_that_cannot_be_believed_are_refused(key: dict[str, Any], name: str) -> None:
    changes, message = UNTRUE[name]
    with pytest.raises(StoreError, match=f"^a.json: .*{message}") as caught:
        score(key, with_changes(key, changes), "a.json")
    assert "case100" in str(caught.value) or "case" in message
    assert "\n" not in str(caught.value)


def test_an_identical_second_answer_is_refused_too(key: dict[str, Any]) -> None:
    given = answers(key, "oracle", oracle)
    with pytest.raises(StoreError, match=f"case{CASES - 1}: name: expected one answer per case, found 2"):
        score(key, given | {"answers": [*given["answers"], given["answers"][-1]]})


def test_what_is_missing_to_one_is_given_to_wrong_causes(key: dict[str, Any]) -> None:
    case = first(key, "known")
    name = case["effects"][0]["effect"]
    half = judge(case, plain(causes=[cause([name], 0.5)]))
    assert half.probability == 0.5
    assert half.log_loss == pytest.approx(math.log(2))
    assert half.brier == pytest.approx(0.5)
    assert sum(half.wrong.values()) == pytest.approx(0.5)
    nothing_said = judge(case, plain())
    silent = judge(case, {"seconds": 0.0, "error": "no idea"})
    assert not nothing_said.top
    assert nothing_said.brier == silent.brier == 2.0
    assert nothing_said.log_loss == silent.log_loss


def test_who_cannot_decide_is_not_right(key: dict[str, Any]) -> None:
    """Equal probabilities for everything name nothing, whatever the truth is."""
    case = first(key, "known")
    even = plain(none_probability=0.2, causes=[cause([e], 0.2) for e in EFFECTS if e != "leg_inertia_error"])
    judged = judge(case, even)
    assert not judged.top
    assert judged.top_name == "undecided"


@pytest.mark.parametrize("give", [oracle, guesser])
def test_leaving_out_hard_cases_gains_nothing(key: dict[str, Any], give: Any) -> None:
    """No figure is better when half of the cases have an error in place of an answer."""

    def gives_up(case: dict[str, Any], k: int) -> dict[str, Any]:
        return {"error": "too hard"} if k % 2 else give(case, k)

    tried, gave_up = score(key, answers(key, "tried", give)), score(key, answers(key, "gave up", gives_up))
    assert len(gave_up["errors"]) == CASES // 2
    for target, a, b in zip(TARGETS, tried["targets"], gave_up["targets"], strict=True):
        assert b["n"] >= a["n"], target.name
        low_is_good = math.isinf(target.goal.low)
        assert b["value"] >= a["value"] if low_is_good else b["value"] <= a["value"], target.name
    for name in ("log_loss", "brier"):
        assert gave_up["proper"][name]["all"]["value"] > tried["proper"][name]["all"]["value"]
    for a, b in zip(tried["calibration"], gave_up["calibration"], strict=True):
        assert b["error"] is None or b["error"] >= a["error"] or a["statement"].startswith(f"{LEADING}:")


def test_the_share_closed_is_judged_by_the_form_in_which_an_effect_closes_most(key: dict[str, Any]) -> None:
    case = first(key, "outsider")
    closed = {"effects": "head_mode", "fraction": 0.9, "low": 0.8, "high": 1.0}
    answer = plain(detected=True, causes=[cause(["head_mode"], 1.0)], closed=closed)
    assert case["any_form"]["closable"]["head_mode"] == 0.3
    assert judge(case, answer).closed_inside is False
    open_form = {"closable": {"head_mode": 0.9}, "nearest": "head_mode", "residual_delta": 3.0, "smooth_residual": 2.0}
    assert judge({**case, "any_form": open_form}, answer).closed_inside is True


def test_outsiders_count_as_such_by_what_the_nearest_form_of_an_effect_leaves(key: dict[str, Any]) -> None:
    case = {**first(key, "outsider"), "delta": 12.0}
    far = {t.name: t.figure for t in TARGETS if "comes near" in t.name or t.name.startswith("the same")}
    near = {name: f for name, f in FIGURES.items() if name.startswith("outsiders a form of an effect imitates")}
    assert len(far) == len(near) == 2
    for left, wanted in ((7.0, far), (2.0, near)):
        form = {"closable": {}, "nearest": "head_mode", "residual_delta": left, "smooth_residual": left}
        judged = judge({**case, "any_form": form}, plain(causes=[cause(["head_mode"], 0.9)]))
        for name, figure in {**far, **near}.items():
            found = figure([judged])
            assert found.n == (name in wanted), name
            assert not found.n or found.value == float("confidently" in name), name


def test_an_interval_that_is_withheld_does_not_hold_the_truth(key: dict[str, Any]) -> None:
    case = first(key, "known")
    name = case["effects"][0]["effect"]
    sound = plain(detected=True, causes=[cause([name], 1.0)])
    assert judge(case, sound).closed_inside is False
    assert judge(case, sound).size_inside is True
    sound["causes"][0]["size"] = {}
    assert judge(case, sound).size_inside is False
    silent = judge(case, {"seconds": 0.0, "error": "no idea"})
    assert (silent.size_inside, silent.closed_inside) == (False, False)
    assert silent.set_size > len(EFFECTS)


def test_intervals_of_a_score_lie_where_scores_can(key: dict[str, Any]) -> None:
    """Also with few cases and nearly all of them right, where a mean +- 1.96 standard errors leaves the scale."""

    def nearly(case: dict[str, Any], k: int) -> dict[str, Any]:
        return guesser(case, k) if k % 60 == 10 else oracle(case, k)

    result = score(key, answers(key, "nearly", nearly))
    figures = [*result["targets"], *result["false_alarms"], *result["figures"].values()]
    figures += [b[k] for b in result["power"] for k in ("detected", "top", "probability")]
    figures += [f for c in result["by_cause"] for f in c.values() if isinstance(f, dict)]
    figures += [f for c in result["calibration"] for f in (c["right"], *(b["right"] for b in c["bins"]))]
    sizes = [f for n, f in result["figures"].items() if n.startswith("size of")]
    for f in figures:
        largest = math.inf if f in sizes or f.get("percent") is False else 1.0
        assert f["low"] is None or 0.0 <= f["low"] <= f["value"] <= f["high"] <= largest
    for name, largest in (("brier", 2.0), ("log_loss", -math.log(FLOOR))):
        for f in result["proper"][name].values():
            assert 0.0 <= f["low"] <= f["value"] <= f["high"] <= largest + 1e-5
    assert result["proper"]["brier"]["all"]["low"] > 0.0


def test_calibration_counts_the_answers_as_they_state_and_not_as_the_truth_is(key: dict[str, Any]) -> None:
    """A method that always states 70 % for one effect is as often right as that effect is the cause."""

    def stubborn(_: dict[str, Any], __: int) -> dict[str, Any]:
        return plain(
            causes=[cause(["head_mode"], 0.7)], none_probability=0.2, unknown_probability=0.1,
            credible_set=["head_mode", "none", "unknown"],
        )  # fmt: skip

    judged = score(key, answers(key, "stubborn", stubborn))
    found = {c["statement"]: c for c in judged["calibration"]}
    named = [[e["effect"] for e in c["effects"]] == ["head_mode"] for c in key["cases"]]
    nothing = [c["kind"] in NOTHING_MISSING for c in key["cases"]]
    for statement, stated, true in ((LEADING, 0.7, named), ("nothing is missing", 0.2, nothing)):
        (only,) = found[statement]["bins"]
        assert (found[statement]["stated"], only["stated"]) == (stated, stated)
        assert only["right"]["value"] == pytest.approx(np.mean(true), abs=1e-5)
        assert found[statement]["error"] == pytest.approx(abs(stated - np.mean(true)), abs=2e-5)
    assert found[f"{LEADING}: one effect of the library"]["right"]["n"] == CASES
    assert found[f"{LEADING}: two effects"]["right"]["n"] == 0
    perfect = score(key, answers(key, "oracle", oracle))["calibration"]
    assert {c["error"] for c in perfect} == {0.0}
    assert "Spiegelhalter" in score_text(judged)


def test_interval_of_a_mean_is_wilson_s_for_hits_and_the_usual_one_far_from_the_bounds() -> None:
    hits = [True] * 3 + [False] * 40
    assert (mean(map(float, hits)).low, mean(map(float, hits)).high) == pytest.approx((rate(hits).low, rate(hits).high))
    x = np.random.default_rng(0).uniform(0.4, 0.6, 2000)
    half = 1.96 * x.std(ddof=1) / math.sqrt(x.size)
    assert (mean(x).low, mean(x).high) == pytest.approx((x.mean() - half, x.mean() + half), abs=2e-5)
    assert mean(2 * x, bounds=(0.0, 2.0)).low == pytest.approx(2 * mean(x).low)
    assert mean([0.0] * 20).low == 0.0
    assert mean([0.0] * 20).high == pytest.approx(rate([False] * 20).high)
    with pytest.raises(ValueError, match="from 0 to 1"):
        mean([0.5, 1.5])


def test_interval_of_a_skewed_mean_holds_it_as_often_as_it_says() -> None:
    """Brier scores of a good method: most are near zero, few are large."""
    rng = np.random.default_rng(1)
    draws = np.where(rng.random((400, 150)) < 0.06, rng.uniform(0.2, 2.0, (400, 150)), 0.02 * rng.random((400, 150)))
    true = 0.06 * 1.1 + 0.94 * 0.01
    found = [mean(x, bounds=(0.0, 2.0)) for x in draws]
    assert all(0.0 < f.low < f.value < f.high < 2.0 for f in found)
    assert np.mean([f.low <= true <= f.high for f in found]) > 0.91


def test_probabilities_that_exceed_one_by_rounding_are_scored(key: dict[str, Any]) -> None:
    """Their logarithm was below 0, the smallest loss, and no score was written."""
    given = answers(key, "rounded", oracle)
    for case, answer in zip(key["cases"], given["answers"], strict=True):
        if case["kind"] in NOTHING_MISSING:
            answer["none_probability"] = 1.0 + 3e-14
        if case["kind"] in OUTSIDE:
            answer["unknown_probability"] = 1.0 + 3e-14
    assert score(key, given)["proper"]["log_loss"]["none"]["value"] == 0.0
