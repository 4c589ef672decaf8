"""What a fit says in words, tables and JSON never contradicts itself, whatever came out."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.files import schema
from mcstudy.identification import words
from mcstudy.identification.belief import GapFound
from mcstudy.identification.estimate import AT_LEAST, AT_MOST, ENDED
from mcstudy.identification.tables import LEANS, ROUGH, estimates, help_needed
from mcstudy.text_tables import number

Fits = dict[str, mc.FitResult]


@pytest.fixture(scope="module")
def variants(fits: Fits) -> Fits:
    """Every fit, and the same with other outcomes of its tests."""
    out = dict(fits)
    for case, r in fits.items():
        out[f"{case}, poor fit"] = replace(r, p_value=0.01)
        out[f"{case}, gap"] = replace(r, gap=GapFound(0.001, 0.0016))
        out[f"{case}, no gap"] = replace(r, gap=GapFound(0.4, 0.0016), p_value=0.5)
        out[f"{case}, lines alone"] = replace(
            r, valleys=(), stability=None, sway=None, forecasts=(), gap=None, comparison=None, paper=None
        )
    return out


def test_the_cases_are_what_their_names_say(fits: Fits) -> None:
    assert fits["good"].gap is not None
    assert not words.gap_found(fits["good"])
    assert words.gap_found(fits["effect missing"])
    open_ = {case: sum(e.verdict != "identifiable" for e in r.estimates) for case, r in fits.items()}
    assert open_["low fmax"] >= open_["good"]
    assert (fits["on bounds"].theta == fits["on bounds"].model.upper).any()


def test_every_number_says_what_it_comes_from(variants: Fits) -> None:
    """The data, unless "bound" is said; and no limit that leans on another bound is passed off as the data's alone."""
    bounded = leaning = 0
    for case, r in variants.items():
        for e, row in zip(r.estimates, estimates(r).rows, strict=True):
            cells = dict(zip(estimates(r).header, row, strict=True))
            low, high = cells[f"{100 * r.level:g} % interval"].split(" to ")
            for cell, ended, held in (
                (low, e.low_from, r.leaning(e.name)[0]),
                (high, e.high_from, r.leaning(e.name)[1]),
            ):
                assert ENDED[ended] in cell, case
                assert ("(bound)" in cell) == (ended == "bound"), (case, row)
                assert cell.endswith(LEANS) == bool(held), (case, row)
                bounded, leaning = bounded + (ended == "bound"), leaning + bool(held)
            held_at = e.name in r.model.names and r.theta[r.model.names.index(e.name)] in (
                r.model.lower[r.model.names.index(e.name)],
                r.model.upper[r.model.names.index(e.name)],
            )
            assert ("(bound)" in cells["estimate"]) == held_at, (case, row)
            if held_at:
                assert cells["Wald"] == "-", (case, row)
        said = estimates(r).note
        assert (LEANS in said) == any(any(r.leaning(e.name)) for e in r.estimates), case
        assert "No prior is used" in said
    assert bounded > 10
    assert leaning > 10


def test_an_end_that_the_search_did_not_reach_is_a_limit_on_it_and_the_note_says_so(fits: Fits) -> None:
    r = fits["good"]
    reached = tuple(replace(e, low_from="data", high_from="data") for e in r.estimates)
    r = replace(r, estimates=reached)
    assert not {AT_LEAST, AT_MOST} & set(estimates(r).note)
    first = replace(r.estimates[0], low_from="steps", high_from="steps")
    found = estimates(replace(r, estimates=(first, *r.estimates[1:])))
    low, high = found.rows[0][3].split(" to ")
    assert (low[0], high[0]) == (AT_MOST, AT_LEAST)
    assert (low[1:].rstrip(LEANS), high[1:].rstrip(LEANS)) == (number(first.low), number(first.high))
    assert f"{AT_MOST} {AT_LEAST} the search for this end did not converge" in found.note


def test_what_is_open_in_the_table_is_open_in_the_sentence(variants: Fits) -> None:
    for case, r in variants.items():
        said = words.undetermined(r)
        for kind in ("not identifiable", "lower limit only", "upper limit only"):
            names = [e.name for e in r.estimates if e.verdict == kind]
            assert (f"{kind.capitalize()}: {', '.join(names)}." in said) == bool(names), (case, said)
            assert (kind.capitalize() in said) == bool(names), (case, said)


def test_the_goodness_of_fit_and_the_gap_agree_with_what_is_advised(variants: Fits) -> None:
    for case, r in variants.items():
        said = words.belief(r)
        assert ("larger than expected from noise" in said) == (r.p_value < 0.05), case
        assert ("finds a gap" in said) == (r.gap is not None and r.gap.p_value < 0.05), case
        advised = "hold only if the model is right" in said
        assert advised == (r.p_value < 0.05 or ("finds a gap" in said and not r.method.effects)), case
        assert ("Without the added effects" in said) == bool(r.gap is not None and r.method.effects), case


def test_stable_over_all_intervals_means_every_body_and_every_range(variants: Fits) -> None:
    for case, r in variants.items():
        s, said = r.stability, words.loop(r)
        assert s is None or s.low <= r.growth_rate <= s.high, case
        if s is not None:
            assert s.stable == all(x.whole for x in s.ranges), case
            assert ("and over all intervals" in said) == s.stable, case
            for x, e in zip(s.ranges, r.estimates, strict=True):
                assert e.low <= x.low <= x.high <= e.high, case
                assert not x.whole or (x.low, x.high) == (e.low, e.high), case


def test_a_loop_without_dynamics_has_no_root_to_tell(variants: Fits) -> None:
    r = next(r for r in variants.values() if r.stability is not None)
    without = replace(r, growth_rate=-np.inf, stability=replace(r.stability, low=-np.inf, high=-np.inf))
    assert words.loop(without) == "The closed loop is stable at the estimate (no dynamics), as over all intervals."


def test_what_trades_is_not_called_determined(variants: Fits) -> None:
    found = 0
    for case, r in variants.items():
        for v in r.valleys:
            poor = {e.name for e in r.estimates if e.verdict != "identifiable"}
            wide = {e.name for e in r.estimates if (e.high - e.low) / 2 > 0.2 * abs(e.estimate)}
            assert set(v.names) & (poor | wide), case
            for c in v.combinations:
                found += 1
                assert c.low <= c.estimate <= c.high, case
                assert 3 * (c.high - c.low) < c.opposite_high - c.opposite_low, case
                if c.name in {e.name for e in r.estimates}:
                    assert (c.low, c.high) == pytest.approx((r[c.name].low, r[c.name].high), rel=1e-3), case
    assert found > 4


def test_a_forecast_is_never_wider_than_now_and_open_only_where_the_data_leave_it_open(variants: Fits) -> None:
    for case, r in variants.items():
        t = help_needed(r)
        assert (t is None) == (not r.forecasts), case
        if t is None:
            continue
        for e, f, row in zip(r.estimates, r.forecasts, t.rows, strict=True):
            cells = dict(zip(t.header, row, strict=True))
            assert f.now == pytest.approx((e.high - e.low) / 2), case
            assert f.known != e.name, case
            if e.verdict == "identifiable":
                assert max(f.cycles, f.amplitude, f.with_known, f.fmax or 0) <= f.now * (1 + 1e-9), (case, f)
                assert "open" not in row, case
            else:
                assert cells["half-width"] == "open", case
                assert f.rough, case
            assert (ROUGH in cells["cycles × 2"]) == (f.rough and cells["cycles × 2"] != "open"), case


def test_an_effect_that_is_missing_is_found_by_all_three_comparisons(fits: Fits) -> None:
    r = fits["effect added"]
    c = r.comparison
    assert c is not None
    assert c.unseen is not None
    assert c.unseen_se is not None
    assert c.log_bayes_factor > words.STRONG
    assert c.unseen > 2 * c.unseen_se
    assert r.without_chi2 is not None
    assert r.without_chi2 > r.chi2 + 20
    said = words.added(r)
    assert "is strong for passive_damping_ankle" in said
    assert "held-out cycles better" in said
    other = replace(r, comparison=replace(c, log_bayes_factor=-6.0, unseen=-1.0, unseen_se=2.0))
    assert "is strong against" in words.added(other)
    assert "neither better nor worse" in words.added(other)


def test_numbers_of_the_sentences_are_those_of_the_document(variants: Fits) -> None:
    for case, r in variants.items():
        document = r.to_dict()
        schema.validate("fit", document, case)
        said = "\n".join(words.sentences(r))
        assert f"{document['fit']['chi2']:.0f}, expected {document['fit']['expected']:.0f}" in said, case
        if document["stability"] is not None:
            assert f"{number(document['stability']['low'])} to {number(document['stability']['high'])} 1/s" in said, (
                case
            )
        if document["sway"] is not None:
            for a in document["sway"]["angles"]:
                assert f"{a['angle']} {number(a['stimulus'])}" in said, case
        for q, e, row in zip(document["quantities"], r.estimates, estimates(r).rows, strict=True):
            assert q["verdict"] == e.verdict
            assert q["on_bound"] == ("(bound)" in row[2]), case
            assert q["on_bound"] == (
                "(bound)" in dict(zip(["", "", "e"], estimates(r).rows[0], strict=False)) or q["on_bound"]
            )
            assert sum(x or 0 for x in q["information"]) == pytest.approx(1) or None in q["information"], case


def test_no_table_is_wider_than_a_wide_terminal_and_no_line_ends_in_a_space(variants: Fits) -> None:
    for case, r in variants.items():
        tables = r.text().split("\n\n")[1:-1]
        assert max(len(line) for t in tables for line in t.splitlines()) <= 120, case
        assert not re.search(r"  [a-zA-Z]|\s\.|nan|None|\)\w", "\n".join(words.sentences(r))), case


def test_a_table_in_a_notebook_and_a_dataset_hold_the_same_numbers(fits: Fits) -> None:
    for case, r in fits.items():
        shown, data = r._repr_html_(), r.to_xarray()
        assert len(repr(r)) < 2500
        for e in r.estimates:
            assert number(e.estimate) in shown, case
            one = data.sel(quantity=e.name)
            assert (float(one.estimate), float(one.low), float(one.high)) == (e.estimate, e.low, e.high)
            assert str(one["class"].values) == e.verdict
            assert str(one.unit.values) == e.unit
        assert data.estimate.dims == ("quantity",)
        assert np.isfinite(data.estimate).all()


def test_a_lowest_minimum_that_no_random_start_reached_is_not_said_to_be_missed_for_certain(fits: Fits) -> None:
    m = fits["good"].minima
    hits = np.r_[0, m.hits[1:]]
    for linear, told in ((m.chi2[0], "from the linear structure"), (np.inf, "ends of the parameters' ranges")):
        r = replace(fits["good"], minima=replace(m, hits=hits, linear=linear))
        assert f"No random start of {m.starts} ended" in words.search_words(r)
        assert told in words.search_words(r)
        assert "100 %" not in words.search_words(r)
        assert "missed_lowest" not in r.to_dict()["search"]
        schema.validate("fit", r.to_dict(), "fit")
