"""Fits of many people: who they are, what is told, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.files import schema
from mcstudy.identification.people.group_words import spread
from mcstudy.identification.people.members import members, read_people
from mcstudy.text_tables import number

FMAX = 1.2
PEOPLE = (("ann", "open"), ("ben", "open"), ("ann", "closed"), ("ben", "closed"))


@pytest.fixture(scope="module")
def recordings() -> list[mc.Recording]:
    """Two people with eyes open and closed; closed eyes add a fifth to the stiffness."""
    stiffness = {"ann": 1000.0, "ben": 1150.0}
    return [
        replace(
            mc.simulate(
                cycles=3,
                rate_hz=50.0,
                amplitude=[8.0],
                seed=k,
                parameters={"K11": stiffness[person] * (1.2 if condition == "closed" else 1.0)},
            ),
            person=person,
            condition=condition,
            name=f"{person} {condition}",
        )
        for k, (person, condition) in enumerate(PEOPLE)
    ]


@pytest.fixture(scope="module")
def files(recordings: list[mc.Recording], tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("people")
    paths = [folder / f"{r.person}_{r.condition}.nc" for r in recordings]
    for r, path in zip(recordings, paths, strict=True):
        mc.write_recording(r, path)
    rows = [f"{path.name},{r.person},{r.condition},x" for r, path in zip(recordings, paths, strict=True)]
    (folder / "people.csv").write_text("\n".join(["file,person,condition,note", *rows]) + "\n")
    return paths


@pytest.fixture(scope="module")
def group(recordings: list[mc.Recording]) -> mc.GroupResult:
    return mc.fit_group(
        recordings,
        person=[r.person for r in recordings],
        condition=[r.condition for r in recordings],
        fmax=FMAX,
        workers=1,
    )


def test_people_in_all_conditions_are_compared_with_themselves(group: mc.GroupResult) -> None:
    assert group.conditions == ("open", "closed")
    assert group.people == ("ann", "ben")
    assert group.paired
    d = group.difference("K11 + Kpas1")
    assert (d.condition, d.reference, d.people) == ("closed", "open", (2, 2))
    assert d.low < d.difference < d.high
    truth = 0.2 * (1000 + 1150) / 2
    assert d.low < truth < d.high


def test_what_no_person_identifies_the_group_does_not_either(group: mc.GroupResult) -> None:
    kpas = group["Kpas1", "open"]
    assert all(i.low_from == "bound" for i in kpas.individuals)
    assert kpas.verdict == "not determined"
    assert "Not determined by these people" in group.text()
    assert group["K11 + Kpas1", "open"].verdict != "not determined"


def test_each_persons_fit_is_that_of_the_person_alone(recordings: list[mc.Recording], group: mc.GroupResult) -> None:
    alone = mc.fit(recordings[1], fmax=FMAX)
    own = next(i for i in group["B11", "open"].individuals if i.person == "ben")
    assert (own.estimate, own.low, own.high) == (alone["B11"].estimate, alone["B11"].low, alone["B11"].high)


def test_fits_that_were_made_before_give_the_same_group(group: mc.GroupResult) -> None:
    again = mc.fit_group(
        list(group.fits.values()), person=[p for p, _ in group.fits], condition=[c for _, c in group.fits], workers=1
    )
    assert again.to_dict() == group.to_dict()


def test_the_document_conforms_and_the_dataset_holds_the_same_numbers(group: mc.GroupResult) -> None:
    document = json.loads(json.dumps(group.to_dict(), allow_nan=False))
    schema.validate("group", document, "group")
    data = group.to_xarray()
    assert data["mean"].sel(condition="open", quantity="B22") == group["B22", "open"].mean
    assert data.difference.sel(comparison="closed - open", quantity="K12") == group.difference("K12").difference
    assert data.individual_low.sel(person="ann", condition="closed", quantity="Td1") == next(
        i.low for i in group["Td1", "closed"].individuals if i.person == "ann"
    )
    assert np.isnan(data.individual_shrunken).all()  # two people
    assert "<caption>GroupResult</caption>" in group._repr_html_()
    with pytest.raises(KeyError, match="expected a quantity"):
        group["K11"]


def test_a_spread_that_may_be_zero_has_no_point_value(group: mc.GroupResult) -> None:
    """Where errors of the fits explain all scatter of two people, zero would be told as if it had been measured."""
    none = [m for m in group.means if np.isnan(m.between)]
    assert none
    assert all(m.between > 0 for m in group.means if m not in none)
    documents = {(m["quantity"], m["condition"]): m for m in group.to_dict()["means"]}
    for m in none:
        assert documents[m.quantity, m.condition]["between"] is None
        assert m.between_low == 0 < m.between_high
        assert spread(m) in ("not determined", f"0 (at most {number(m.between_high)})")
        assert spread(m) in group.text()


def test_a_limit_of_the_spread_is_told_where_data_set_it(group: mc.GroupResult) -> None:
    m = replace(group.means[0], between=np.nan, between_low=0.0, between_high=12.0, between_high_from="data")
    assert spread(m) == "0 (at most 12.0)"
    assert spread(replace(m, between=3.0)) == "3.00"


def test_tests_and_intervals_of_differences_agree(group: mc.GroupResult) -> None:
    for d in group.differences:
        assert (d.p_value >= 1 - group.level) == (d.low <= 0 <= d.high), d.quantity


def test_the_command_prints_and_writes_what_python_returns(
    files: list[Path], group: mc.GroupResult, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = files[0].parent / "people.csv"
    words = ["fit", "--people", str(table), "--fmax", str(FMAX), "--workers", "1"]
    assert main([*words, "-o", str(tmp_path)]) == Exit.DONE
    assert capsys.readouterr().out.strip() == group.text()
    written = json.loads((tmp_path / "group.json").read_text())
    assert written["means"] == json.loads(json.dumps(group.to_dict()["means"]))


def test_a_failed_person_is_named_and_the_others_are_kept(
    files: list[Path], recordings: list[mc.Recording], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / "cyd.nc"
    bad.write_bytes(b"no recording")
    rows = [f"{f},{r.person},{r.condition}" for f, r in list(zip(files, recordings, strict=True))[:2]]
    table = tmp_path / "people.csv"
    table.write_text("\n".join(["file,person,condition", *rows, f"{bad},cyd,open"]))
    assert main(["fit", "--people", str(table), "--fmax", str(FMAX), "--workers", "1"]) == Exit.FITS_FAILED
    said = capsys.readouterr().out
    assert f"Failed: cyd, open: {bad}: " in said
    assert said.startswith("people: 2\n")
    assert "There is one condition, so there is no difference to tell." in said


def test_recordings_say_who_was_recorded(files: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    words = ["fit", *map(str, files[:2]), "--group", "person", "--fmax", str(FMAX), "--workers", "1"]
    assert main(words) == Exit.DONE
    assert capsys.readouterr().out.startswith("people: 2\n")


@pytest.mark.parametrize("ending", [".nc", ".zarr", ""])
def test_person_and_condition_survive_a_file(recordings: list[mc.Recording], tmp_path: Path, ending: str) -> None:
    path = mc.write_recording(recordings[2], tmp_path / f"r{ending}")
    read = mc.read_recording(path)
    assert isinstance(read, mc.Recording)
    assert (read.person, read.condition) == ("ann", "closed")


def test_recordings_of_one_person_and_condition_are_one_member() -> None:
    found = members(["a", "b", "c"], ["ann", "ben", "ann"], ["x", "x", "x"])
    assert [(m.person, m.items) for m in found] == [("ann", ("a", "c")), ("ben", ("b",))]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("file,person\n", "at least one row"),
        ("file,name\na,b\n", "expected one column 'person'"),
        ("file,person\na\n", "line 2: expected 2 columns, got 1"),
        ("file,person\na,\n", "line 2: person: expected a value"),
        ("", "found nothing"),
    ],
)
def test_a_wrong_table_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    table = tmp_path / "people.csv"
    table.write_text(text)
    with pytest.raises(InputError) as error:
        read_people(table)
    assert said in str(error.value)
    assert str(error.value).startswith(str(table))
    assert "\n" not in str(error.value)


def test_a_table_from_a_spreadsheet_is_read(tmp_path: Path) -> None:
    table = tmp_path / "people.csv"
    table.write_bytes("\ufefffile;person;vision\r\na.nc;s01;open\r\n\r\nb.nc;s02;closed\r\n".encode())
    found = read_people(table, "vision")
    assert [(r.file.name, r.person, r.condition) for r in found] == [("a.nc", "s01", "open"), ("b.nc", "s02", "closed")]
    assert read_people(table)[0].condition == "all"


def test_bad_groups_are_refused_in_one_line(group: mc.GroupResult) -> None:
    fits = list(group.fits.values())
    wider = replace(fits[1], level=0.9)
    fewer = replace(fits[1], estimates=fits[1].estimates[:-1])
    other = replace(fits[2], recording=replace(fits[2].recording, body=mc.Body(J1=50.0)))
    cases: list[tuple[list[mc.FitResult], list[str], list[str] | None, bool | None, str]] = [
        (fits[:1], ["ann"], None, None, "expected at least two in condition all, got one (ann)"),
        (fits[:2], ["ann", "ben"], None, True, "paired: expected at least two conditions, got one (all)"),
        (fits, ["a", "b", "a", "c"], ["x", "x", "y", "y"], None, "b is only in x"),
        (fits, ["a", "b", "c", "d"], ["x", "x", "y", "y"], True, "a is only in x"),
        ([fits[0], wider], ["a", "b"], None, None, "b: level: expected 0.95"),
        ([fits[0], fewer], ["a", "b"], None, None, "b: quantities: expected K11"),
        (
            [*fits[:2], other, fits[3]],
            ["a", "b", "a", "b"],
            ["x", "x", "y", "y"],
            None,
            "a, y: body: expected the same",
        ),
        (fits, ["a"], None, None, "person: expected one name per recording, 4 in all"),
        (fits[:2], ["a", ""], None, None, "person: recording 2: expected a name"),
        (fits[:2], ["a", "a"], None, None, "expected one fit per person and condition"),
    ]
    for given, person, condition, paired, said in cases:
        with pytest.raises(InputError) as error:
            mc.fit_group(given, person=person, condition=condition, paired=paired, workers=1)
        assert said in str(error.value)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "REC: expected at least one recording"),
        (["--group", "condition"], "REC: expected at least one recording"),
        (["r.nc", "--paired"], "expected together with --people or --group"),
        (["--people", "nowhere.csv"], "nowhere.csv: cannot be read"),
    ],
)
def test_a_wrong_command_is_one_line(capsys: pytest.CaptureFixture[str], words: list[str], said: str) -> None:
    assert main(["fit", *words]) == Exit.BAD_INPUT
    assert said in capsys.readouterr().err
