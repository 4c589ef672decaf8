"""The alternatives the paper argues with are on the page, beside what the paper says of them."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path

import pytest
import xarray as xr

pytest.importorskip("matplotlib")

from mcstudy_goodworth2018.alternatives.files import TwoStimuliResult, read_alternative, write_alternative

from mcstudy.analysis.search.stable_starts import hit_rate_by_start
from mcstudy.cli import main
from mcstudy.errors import StoreError
from mcstudy.exits import Exit
from mcstudy.text_tables import with_error


def figure_of(page: Path, key: str) -> str:
    text = html.unescape(page.read_text(encoding="utf-8"))
    found = re.search(rf'<figure id="{key}".*?</figure>', text, re.DOTALL)
    assert found is not None, key
    return found[0]


def test_every_study_says_whether_one_start_suffices(paper_page: Path, paper_tree: xr.DataTree) -> None:
    text = figure_of(paper_page, "onestart")
    group = paper_tree["accuracy"]
    rate = hit_rate_by_start(group.to_dataset().compute(), group.mc.model).sel(amplitude=5.0)
    for f in (0.41, 1.2, 8.0):
        value, mcse = (100 * float(rate[k].sel(fmax=f, loop="unstable")) for k in ("value", "mcse"))
        row = re.search(rf'<th scope="row">{f:g} Hz</th>(.*?)</tr>', text[text.index("Group accuracy") :])
        assert row is not None
        assert f"<td>{with_error(value, mcse)}</td>" in row[1]
    assert "single set of reasonable initial guesses" in text


def test_another_study_and_both_examples_come_beside_it(paper_page: Path) -> None:
    assert "study other" in figure_of(paper_page, "beside-0")
    two = figure_of(paper_page, "beside-1")
    assert "cannot distinguish between T11 and T21" in two
    assert "two <stimuli>: off by 2.25 % (chance alone 2.5 %)" in two
    assert "one stimulus: off by 150 % (chance alone 2.5 %)" in two
    assert "Made by <code>python two_stimuli.py -o two.json</code>" in two
    population = figure_of(paper_page, "beside-2")
    assert "no more than 3 standard errors on K11, by more on Kpas1 (+170.0 ± 1.0 %)" in population
    assert "Made by <code>python population.py -o population.json</code>" in population


def test_a_file_is_read_as_it_was_written(alternatives: list[Path]) -> None:
    two = read_alternative(alternatives[0])
    assert isinstance(two, TwoStimuliResult)
    assert two.f.tolist() == [0.1, 0.3, 1.0]
    assert two.estimators["one stimulus"][0] == 1
    assert two.estimators["one stimulus"][1]["T21"]["off"].tolist() == [150.0] * 3


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"kind": "other"}, "kind: expected one of 'two_stimuli', 'population', found 'other'"),
        (
            {"schema": "mcstudy:alternative:2.0.0"},
            "schema: expected 'mcstudy:alternative:1.0.0', found 'mcstudy:alternative:2.0.0'",
        ),
        ({"frequency": [0.1]}, "two <stimuli>: T11: off: expected 1 numbers, one per frequency, got 3"),
        ({"estimators": None}, "estimators: expected a list, found None"),
    ],
)
def test_another_file_is_refused_in_one_line(
    alternatives: list[Path],
    other_cube: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: dict[str, object],
    expected: str,
) -> None:
    file = tmp_path / "changed.json"
    file.write_text(json.dumps({**json.loads(alternatives[0].read_text()), **change}))
    page = tmp_path / "page.html"
    assert main(["report", str(other_cube), "--beside", str(file), "-o", str(page)]) == Exit.BAD_INPUT
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"{file}: {expected}" in error


def test_what_does_not_conform_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match=r"rows: expected at least 1 item, found \[\]"):
        write_alternative(tmp_path / "x.json", {"kind": "population", "command": "c", "settings": {}, "rows": []})
    assert not (tmp_path / "x.json").exists()
