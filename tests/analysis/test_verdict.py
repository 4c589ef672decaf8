"""Three verdicts on a published number: agrees, differs, cannot tell, by the errors of both studies."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.analysis.publications.sampling import Value
from mcstudy.analysis.publications.statement import Criterion, Published
from mcstudy.analysis.publications.verdict import DEFINITION, OURS, THEIRS, Verdict, judge
from mcstudy.analysis.publications.verdict_names import AGREES, CANNOT_TELL, DIFFERS


def statement(value: float = 10.0, criterion: Criterion = "equal", **more: float) -> Published:
    """A published number with a margin of 3."""
    return Published("key", "label", "%", value, "10", "somewhere", criterion, margin=3.0, **more)  # type: ignore[arg-type]


def verdict(ours: float, one: float, blocks: int = 1, **more: float) -> Verdict:
    """Of a number whose study of 50 has the error ``one``."""
    return judge(statement(**more), Value(ours, one / np.sqrt(blocks), one, 50 * blocks, blocks))


def test_equal_numbers_agree_only_if_the_errors_are_small_against_the_margin() -> None:
    assert verdict(10.0, 1.0).name == AGREES  # 1.645 sqrt(2) = 2.3 < 3
    loose = verdict(10.0, 1.5)
    assert (loose.name, loose.limited_by) == (CANNOT_TELL, OURS)
    assert verdict(10.0, 1.5, blocks=loose.needed // 50).name == AGREES


def test_the_papers_own_error_can_make_an_answer_impossible() -> None:
    for blocks in (1, 60, 100_000):
        found = verdict(10.0, 2.0, blocks)  # 1.645 x 2 > 3, whatever ours is
        assert (found.name, found.limited_by, found.needed) == (CANNOT_TELL, THEIRS, 0)


def test_imprecision_is_no_agreement() -> None:
    assert verdict(-85.0, 95.0, value=0.0, criterion="at least").name == CANNOT_TELL  # type: ignore[arg-type]


def test_the_needed_realizations_tell_and_fewer_do_not() -> None:
    found = verdict(16.0, 1.6)
    assert found.name == CANNOT_TELL
    needed = found.needed // 50
    assert verdict(16.0, 1.6, needed).name == DIFFERS
    assert verdict(16.0, 1.6, max(needed - 1, 1)).name == CANNOT_TELL


def test_rounding_is_not_a_difference() -> None:
    assert verdict(16.0, 1.0).name == DIFFERS
    assert verdict(16.0, 1.0, half_unit=1.0).name == CANNOT_TELL
    assert verdict(16.0, 1.0, half_unit=1.0).distance == pytest.approx(5 / np.sqrt(2))


@pytest.mark.parametrize(("ours", "name"), [(9.0, AGREES), (2.0, CANNOT_TELL), (-6.0, DIFFERS)])
def test_a_ranking_holds_fails_or_is_open(ours: float, name: str) -> None:
    assert verdict(ours, 1.0, value=0.0, criterion="at least").name == name  # type: ignore[arg-type]
    assert verdict(-ours, 1.0, value=0.0, criterion="at most").name == name  # type: ignore[arg-type]


def test_fewer_realizations_than_the_papers_are_not_compared() -> None:
    found = judge(statement(), Value(30.0, 1.0, 0.5, 10))
    assert (found.name, found.needed, found.limited_by) == (CANNOT_TELL, 50, OURS)


def test_what_the_paper_gives_no_number_for_has_no_verdict() -> None:
    assert judge(statement(float("nan"), "none"), Value(1.0, 0.1, 0.1, 50)).name == ""


@pytest.mark.parametrize(
    ("low", "high", "name"),
    [
        (2.0, 5.0, DIFFERS),
        (5.0, 12.0, CANNOT_TELL),
        (5.0, 40.0, CANNOT_TELL),
        (9.5, 10.5, AGREES),
        (30.0, 40.0, DIFFERS),
    ],
)
def test_all_readings_of_a_definition_must_say_the_same(low: float, high: float, name: str) -> None:
    found = judge(statement(), Value(low, 0.5, 0.5, 50, low=low, high=high))
    assert found.name == name
    assert (found.limited_by == DEFINITION) == (name == CANNOT_TELL)


def test_exact_numbers_are_judged_by_the_margin_alone() -> None:
    assert judge(statement(n=0), Value(12.9, 0.0, 0.0, 1)).name == AGREES
    assert judge(statement(n=0), Value(13.1, 0.0, 0.0, 1)).name == DIFFERS


def test_two_equal_studies_rarely_differ_and_agree_more_often_the_larger_ours_is() -> None:
    """The rule against simulated truth: normal numbers, errors estimated with 49 degrees of freedom."""
    rng = np.random.default_rng(11)
    shares = []
    for blocks in (1, 4, 40):
        paper = 10 + rng.standard_normal(2000)
        ours = 10 + rng.standard_normal(2000) / np.sqrt(blocks)
        error = np.sqrt(rng.chisquare(49, 2000) / 49)
        found = [verdict(o, e, blocks, value=p).name for p, o, e in zip(paper, ours, error, strict=True)]
        assert found.count(DIFFERS) <= 0.01 * len(found)
        shares.append(found.count(AGREES) / len(found))
    assert shares[0] < shares[1] < shares[2]
