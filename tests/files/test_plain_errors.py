"""Whatever pydantic finds wrong, in a study file, a challenge file, a recording sheet or settings: our own words."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from mcstudy_challenge.design import Series

from mcstudy.errors import DesignError, InputError
from mcstudy.files.plain_errors import short, validated
from mcstudy.own_model import run_model
from mcstudy.recordings.assembly import read_sheet
from mcstudy.stance.body import one_segment
from mcstudy.study.design import Group
from mcstudy.study.study_file import parse_study

GROUP = {"realizations": 2, "starts": 3, "fmax": [8.0], "amplitude": [5.0]}
PROSE = re.compile(r"[Ii]nput|valid |Extra|permitted|Tuple|[Dd]ictionary|validation|instance of|parse|should")
"""Words that are pydantic's."""

CASES: list[tuple[Any, dict[str, Any], str]] = [
    (Group, {"realizations": 0}, "realizations: expected at least 1, got 0"),
    (Group, {"realizations": 1.5}, "realizations: expected a whole number, got 1.5"),
    (Group, {"realizations": 10**25}, "realizations: expected at most 10000000, got 10000000000000000000000000"),
    (Group, {"fmax": []}, "fmax: expected a list with at least 1 item, got []"),
    (Group, {"fmax": [1.0] * 1001}, "fmax: expected a list with at most 1000 items, got [1.0, "),
    (Group, {"fmax": "8"}, "fmax: expected a list, got '8'"),
    (Group, {"fmax": [-1.0]}, "fmax.0: expected a number from 1e-07 to 1e+06 Hz, got -1.0"),
    (Group, {"model": {"truth": 3}}, "model.truth: expected a table, got 3"),
    (Group, {"model": {"bounds": {"top": 1.0}}}, "model.bounds.top: unknown key, expected one of lower, upper, "),
    (Group, {"simulator": "x"}, "simulator: expected 'none', 'spectral' or 'time_domain', got 'x'"),
    (Series, {"cases": 0}, "cases: expected at least 1, got 0"),
    (Series, {"cases": 1, "sizes": {"strata": [{"part": 1.0}]}}, "sizes.strata.0.part: unknown key, expected one of "),
    (Series, {"cases": 1, "mix": {"none": 2.0}}, "mix.none: expected at most 1, got 2.0"),
    (Series, {"cases": 1, "noise": {"psd": [1.0]}}, "noise.psd.1: missing"),
    (Series, {"cases": 1, "protocol": []}, "protocol: expected a table, got []"),
]


@pytest.mark.parametrize(("model", "change", "message"), CASES, ids=[c[2][:40] for c in CASES])
def test_a_mistake_is_told_in_plain_words(model: Any, change: dict[str, Any], message: str) -> None:
    with pytest.raises(DesignError) as caught:
        validated(model, (GROUP if model is Group else {}) | change)
    assert str(caught.value).startswith(message)
    assert not PROSE.search(str(caught.value))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("sheet", "message"),
    [
        ("period = 3", "period: unknown key, expected one of stimulus, name, provenance, "),
        ("[[trials]]\nfil = 'a'", "trials.0.fil: unknown key, expected one of file, amplitude, "),
        ("[[trials]]\ntheta1 = 3.5", "trials.0.theta1: expected a table, got 3.5"),
        (
            "[[trials]]\nstimulus = {column = []}",
            "trials.0.stimulus.column: expected a whole number or a string, got []",
        ),
        ("rate_hz = 'fast'", "rate_hz: expected a number, got 'fast'"),
        ("rate_hz = 0", "rate_hz: expected greater than 0, got 0"),
        ("convention = 'rms'", "convention: expected 'peak' or 'peak_to_peak', got 'rms'"),
        ("body = {order = 'm1'}", "body.order: expected a list, got 'm1'"),
        (f"rate_hz = {'9' * 4000}", "rate_hz: expected a number, got 999"),
        (f"rate_hz = 0x{'f' * 5000}", "rate_hz: expected a number, got a value too long to show"),
        (f"name = {'[' * 200}{']' * 200}", "name: expected a string, got [[["),
    ],
)
def test_a_recording_sheet_speaks_the_same_words(tmp_path: Path, sheet: str, message: str) -> None:
    path = tmp_path / "a.toml"
    path.write_text(sheet)
    with pytest.raises(InputError) as caught:
        read_sheet(path)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert not PROSE.search(str(caught.value).removeprefix(str(path)))


def test_settings_in_python_speak_the_same_words() -> None:
    with pytest.raises(DesignError) as caught:
        run_model(one_segment(), realizations=0, starts=1, fmax=(1.2,), amplitude=(5.0,))
    assert str(caught.value) == "group.model.realizations: expected at least 1, got 0"
    with pytest.raises(DesignError, match=r"^group\.model\.speed: unknown key, expected one of realizations, starts, "):
        run_model(one_segment(), realizations=1, starts=1, fmax=(1.2,), amplitude=(5.0,), speed={})


def test_what_json_cannot_carry_is_one_line_too() -> None:
    deep: list[Any] = []
    for _ in range(5000):
        deep = [deep]
    for value in (10**5000, deep):
        with pytest.raises(DesignError, match=r"too many digits|less deeply nested"):
            validated(Group, GROUP | {"starts": value}, "group.a")
        assert short(value)
    with pytest.raises(DesignError, match=r"group\.a: expected numbers, text, lists and tables only"):
        validated(Group, GROUP | {"starts": {1}}, "group.a")


@pytest.mark.parametrize("name", ["\n", "\x1b[2J", "long" * 100])
def test_a_name_that_would_steer_a_terminal_is_written_out(name: str) -> None:
    quoted = json.dumps(name)
    head = "[study]\nname = 'a'\nseed = 1\n"
    for text in (f"{quoted} = 1", f"{head}[group.{quoted}]\nfit = 3", f"{head}[group.a.noise]\n{quoted} = 3"):
        with pytest.raises(DesignError) as caught:
            parse_study(text)
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 300
