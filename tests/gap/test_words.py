"""What a diagnosis says in words and tables never contradicts itself, whatever it found."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mcstudy.effect_library.library import LIBRARY
from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.files import schema
from mcstudy.gap.diagnose import diagnose, diagnose_lines
from mcstudy.gap.questions.detection import Band
from mcstudy.gap.questions.power import DetectionLimits, Undetectable
from mcstudy.gap.settings import FAST
from mcstudy.gap.tables import Table, closing, evidence, tables, text
from mcstudy.gap.verdict import ON_BOUNDS, shown_causes, sway, unusual, verdict, wrapped
from mcstudy.results.diagnosis import Diagnosis
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.stimulus import Prts
from mcstudy.text_tables import PROSE, number

BASE = two_segment()
CASES: dict[str, dict[str, dict[str, float]]] = {
    "nothing missing": {},
    "a small gap": {"passive_damping_ankle": {"Bpas1": 40.0}},
    "a gap that takes the base model to its bounds": {"sensor_lag_theta2": {"tau_theta2": 0.03}},
    "two effects": {"sensor_lag_theta1": {"tau_theta1": 0.03}, "passive_damping_ankle": {"Bpas1": 60.0}},
}
Variants = list[tuple[str, Diagnosis]]
DRIFT = "gains that drift"


@pytest.fixture(scope="module")
def found(with_effects: Callable[..., Lines]) -> dict[str, Diagnosis]:
    """One diagnosis of every kind."""
    out = {case: Diagnosis.of(diagnose_lines(with_effects(3, effects), BASE, FAST)) for case, effects in CASES.items()}
    protocol = Protocol(waveform=Prts(rate_hz=100.0))
    drifting = {"effects": ["gain_drift"], "sizes": {"drift": 0.15}}
    drift = simulate_recording(protocol, BASE.truth, np.random.default_rng(4), **drifting)
    out[DRIFT] = Diagnosis.of(diagnose(drift, FAST))
    return out


@pytest.fixture(scope="module")
def variants(found: dict[str, Diagnosis]) -> Variants:
    """Every diagnosis, and the same with other outcomes of its questions."""
    everything = tuple(Undetectable(e, "1.0 at 1", None, "", None) for e in LIBRARY)

    def nothing_can_be_shown(d: Diagnosis, **outcome: Any) -> Diagnosis:
        changed = replace(d, **outcome)
        groups = [c.alternatives for c in shown_causes(changed)] if changed.detected else []
        shown = tuple(effect for group in groups for names in group for effect in names)
        return replace(changed, answers=(DetectionLimits(everything, shown, changed.method.trials),))

    out = []
    for case, d in found.items():
        wide = tuple(range(min(4, len(d.causes))))
        out += [
            (case, d),
            (f"{case}, nothing can be shown", nothing_can_be_shown(d)),
            (f"{case}, large set", nothing_can_be_shown(d, credible_set=(*wide, "unknown", "none"))),
            (f"{case}, unknown", nothing_can_be_shown(d, unknown_probability=0.999)),
            (f"{case}, not detected", nothing_can_be_shown(d, detected=False, closed=None)),
            (f"{case}, no sway", replace(d, sway_rms_deg=dict.fromkeys(d.sway_rms_deg))),
        ]
    return out


def parameters(d: Diagnosis) -> Table:
    return next(t for t in tables(d) if t.title.startswith("Parameters"))


def test_the_cases_are_what_their_names_say(found: dict[str, Diagnosis]) -> None:
    leading = {case: None if d.leading is None else set(d.leading.effects) for case, d in found.items()}
    assert leading == {
        **{case: set(effects) or None for case, effects in CASES.items()},
        DRIFT: {"gain_drift"},
    }
    assert found[DRIFT].added is None


def test_no_cause_is_both_shown_and_not_showable(variants: Variants) -> None:
    for case, d in variants:
        listed = {u.effect for a in d.answers if isinstance(a, DetectionLimits) for u in a.missed}
        said = verdict(d).partition("neither confirm nor rule out: ")[2].partition(".")[0]
        assert {name for name in said.split(", ") if name} == listed, case
        if d.leading is not None:
            causes = [d.leading, *(d.causes[k] for k in d.credible_set if isinstance(k, int))]
            assert not listed & {e for c in causes for e in c.effects}, case
        else:
            assert listed == {u.effect for u in d.undetectable}, case


def test_a_value_on_its_bound_has_no_standard_error_and_every_other_one_has(
    variants: Variants,
) -> None:
    on_bounds = 0
    for case, d in variants:
        for shift, row in zip(d.shifts, parameters(d).rows, strict=True):
            origins = [shift.without_from] + ([] if d.added is None else [shift.added_from or ""])
            for origin, cell in zip(origins, row[1:-1], strict=True):
                assert ("on its bound" in cell) == (origin == "bound"), (case, row)
                assert ("±" in cell) == (origin != "bound"), (case, row)
                on_bounds += origin == "bound"
    assert on_bounds > 10


def test_a_model_with_parameters_on_bounds_is_said_to_describe_no_body(
    found: dict[str, Diagnosis], variants: Variants
) -> None:
    for case, d in variants:
        held = [s.name for s in d.shifts if s.without_from == "bound"]
        assert ("The base model fit is not physiological" in verdict(d)) == (len(held) >= ON_BOUNDS), case
        if len(held) >= ON_BOUNDS:
            said = re.search(
                r"fit is not physiological: (.*?) are at their bounds(?:, and (.*?) (?:is|are) negative)?", verdict(d)
            )
            assert said is not None
            assert re.split(", | and ", said.group(1)) == held
            assert re.split(", | and ", said.group(2)) == [s.name for s in d.shifts if s.without < 0]
    assert "fit is not physiological" in verdict(found["a gap that takes the base model to its bounds"])


def test_a_size_far_from_those_in_people_is_said_to_be(found: dict[str, Diagnosis]) -> None:
    d = found["a gap that takes the base model to its bounds"]  # a lag of 0.03 s
    assert d.leading is not None
    (s,) = (s for s in d.leading.sizes if s.name == "tau_theta2")
    low, high = LIBRARY["sensor_lag_theta2"].size.published
    for factor, word in ((1.0, ""), (0.4 * low / s.high, "small"), (3 * high / s.low, "large")):
        other = replace(s, estimate=factor * s.estimate, low=factor * s.low, high=factor * s.high)
        said = unusual(replace(d.leading, sizes=(other,)))
        assert said.startswith("tau_theta2 = ") == bool(word), said
        assert f" s is {word} for sensor_lag_theta2 " in said or not word
    wide = replace(s, low=-0.1 * low, high=low)  # not known well enough to be called small
    assert not unusual(replace(d.leading, sizes=(wide,)))


def test_no_share_closed_is_stated_without_its_interval_and_what_noise_leaves_of_sway(
    variants: Variants,
) -> None:
    stated = 0
    for case, d in variants:
        assert (d.closed is None) == (d.added is None), case
        assert (d.to_dict()["closed"] is None) == (d.added is None), case
        share = re.search(r"closes? (\d+) % (\[\d+, \d+\])? ?of the gap", verdict(d))
        rows = {row[0]: row for row in closing(d).rows}
        assert (share is None) == (d.added is None), case
        assert ("share of the gap closed" in rows) == (d.added is not None), case
        if share is None:
            said = (
                verdict(d)
                .replace("share of the gap closed and no better", "")
                .replace("of the gap at lines left out", "")
            )
            assert "of the gap" not in said, case
            continue
        stated += 1
        assert share.group(2), case
        assert share.group(2) in rows["share of the gap closed"][2], case
        assert ("noise alone leaves" in verdict(d)) == (d.sway_noise_deg is not None), case
        assert ("error of predicted sway (deg RMS)" in rows) == (d.sway_noise_deg is not None), case
    assert stated > 5


def test_the_sentence_about_sway_follows_from_its_numbers(found: dict[str, Diagnosis]) -> None:
    d = found["a small gap"]
    assert d.sway_noise_deg is not None
    low, high = d.sway_noise_deg
    assert low < (d.sway_rms_deg["floor"] or 0) < high
    for before, after, said in (
        (low, low, "Both are within noise"),
        (low, 0.99 * high, "Both are within noise"),
        (2 * high, 0.99 * high, "then as good as noise allows"),
        (2 * high, 1.5 * high, "worse than noise allows"),
        (0.9 * high, 1.5 * high, "worse than noise allows"),
    ):
        other = replace(d, sway_rms_deg={"before": before, "after": after, "floor": d.sway_rms_deg["floor"]})
        assert said in sway(other)
    assert d.closed is not None
    part = replace(
        d,
        closed=replace(d.closed, fraction=0.3, low=0.2, high=0.4),
        sway_rms_deg={**d.sway_rms_deg, "before": 2 * high, "after": low},
    )
    assert "too coarse to show the rest of the gap" in sway(part)


def test_the_evidence_gives_the_p_values(found: dict[str, Diagnosis]) -> None:
    for case, d in found.items():
        t = d.detection
        assert t.p_value == (1 + (t.null_statistic >= t.statistic).sum()) / (1 + t.draws), case
        assert t.fit_p_value == (1 + (t.null_chi2 >= t.chi2).sum()) / (1 + t.draws), case
        plain = d.to_dict()
        schema.validate("diagnosis", plain, case)
        assert f"{plain['fit']['noise'][0]:.0f} to {plain['fit']['noise'][1]:.0f}" in evidence(d).rows[1][2], case
        assert evidence(d).rows[0][1:3] == [
            number(plain["evidence"]["log_factor"]),
            f"below {number(plain['evidence']['limit'], 2)}",
        ], case
        p = evidence(d).rows[-1][-1]
        assert f"(p {p})" in verdict(d) or f"(p = {p})" in verdict(d), case
    assert "the change of gains decides" in evidence(found[DRIFT]).note
    assert "adding passive_damping_ankle lowers the squared residual by" in evidence(found["a small gap"]).note


def test_a_band_of_one_line_is_a_frequency(found: dict[str, Diagnosis]) -> None:
    d = found["a small gap"]
    bands = (
        Band("theta1", 0.8, 0.8, 9.0, 1.0),
        Band("theta2", 2.0, 3.0, 9.0, 1.0),
        Band("theta2", 3.05, 4.0, 9.0, 1.0),
    )
    said = verdict(replace(d, detection=replace(d.detection, bands=bands)))
    assert "in the lower body's angle at 0.8 Hz, and in the hip angle from 2 to 4 Hz." in said


def test_every_effect_has_the_name_under_which_it_can_be_simulated(variants: Variants) -> None:
    sizes = {n for e in LIBRARY.values() for n in (*e.parameters, *e.nominal_form)}
    for case, d in variants:
        names = set(re.findall(r"[a-z]\w*_\w+", verdict(d) + text(d)))
        assert names <= set(LIBRARY) | sizes, case
        assert not [e for e in LIBRARY if "_" in e and e.replace("_", " ") in verdict(d) + text(d)], case


@pytest.mark.parametrize("width", [40, 80, 100, 250])
def test_the_verdict_fits_the_terminal_and_keeps_numbers_with_their_units(
    variants: Variants, width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    for case, d in variants:
        lines = wrapped(d).splitlines()
        assert max(map(len, lines)) <= min(width, PROSE), case
        assert not [line for line in lines if re.match(r"%|±", line) or line.endswith("±")], case
        assert " ".join(lines).split() == verdict(d).split(), case


def test_no_table_is_wider_than_a_wide_terminal(variants: Variants) -> None:
    for case, d in variants:
        assert max(map(len, text(d).splitlines())) <= 120, case


def test_words_below_a_table_fit_the_terminal(found: dict[str, Diagnosis], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    notes = [t.note for t in tables(found["a small gap"]) if t.note]
    shown = text(found["a small gap"])
    assert len(notes) > 4
    for note in notes:
        assert " ".join(note.split()) in " ".join(shown.split())
    assert not [x for x in shown.splitlines() if len(x) > 60 and "  " not in x]


def test_the_nearest_mechanism_is_named_whatever_wins(found: dict[str, Diagnosis], variants: Variants) -> None:
    for case, d in variants:
        said = "The nearest mechanism of the library is" in verdict(d)
        assert said == (d.leading is not None and d.nearest is not None), case
    assert found["nothing missing"].nearest is None
    near = found["two effects"].nearest
    assert near is not None
    assert near.cause.likeness is not None
    assert near.cause.likeness.low > 0.8
    assert near.cause is found["two effects"].causes[0]
    assert "likeness" in text(found["two effects"])


def test_what_a_torque_remains_is_told_with_its_intervals(found: dict[str, Diagnosis]) -> None:
    d = found["a small gap"]
    assert d.nearest is not None
    left = replace(
        d.nearest.remaining,
        probability=0.97,
        poles=1,
        numerator=np.array([0.0, -12.0, 3.0]),
        denominator=np.array([1.0, 0.05]),
    )
    told = replace(d, nearest=replace(d.nearest, remaining=left))
    assert f"a torque at the {left.row} that depends on" in verdict(told)
    assert "with 1 pole, is (-12.0 s + 3.00 s²) / (1.00 + 0.0500 s) N m" in verdict(told)
    rows = {row[0]: row[1] for t in tables(told) if t.title.startswith("What the nearest") for row in t.rows}
    assert rows["share of the active torque"] in verdict(told)
    assert not [t for t in tables(found["nothing missing"]) if t.title.startswith("What the nearest")]
    schema.validate("diagnosis", told.to_dict(), "with a torque")
    plain = told.to_dict()["nearest"]["remaining"]
    data = told.to_xarray()
    np.testing.assert_allclose(data["torque_gain"].sel(quantile=0.5), plain["gain"])
    np.testing.assert_allclose(data["likeness"].sel(quantile=0.5)[0], told.causes[0].likeness.estimate)  # type: ignore[union-attr]
    assert data["torque_gain"].attrs["units"] == left.unit
    assert "torque_gain" not in found["nothing missing"].to_xarray()


def test_an_effect_that_is_registered_no_more_is_still_told(found: dict[str, Diagnosis]) -> None:
    d = found["a small gap"]
    assert d.leading is not None
    gone = replace(d.leading, effects=("an_effect_of_yesterday",), alternatives=(("an_effect_of_yesterday",),))
    assert unusual(gone) == ""
    assert "an_effect_of_yesterday" in verdict(replace(d, causes=(gone, *d.causes[1:])))
