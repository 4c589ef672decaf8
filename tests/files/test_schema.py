"""Every schema is listed and sound; what does not conform is neither written nor read, and is told in one line."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pydantic
import pytest
from jsonschema import Draft202012Validator
from mcstudy_challenge import files

from mcstudy.analysis import view
from mcstudy.analysis.show import summary, tables
from mcstudy.cli import main
from mcstudy.cli.verbs import gap as gap_verb
from mcstudy.errors import StoreError
from mcstudy.exits import Exit
from mcstudy.files import json_files, schema
from mcstudy.files.untrusted import json_document
from mcstudy.study.cube import store
from mcstudy.study.study_file import parse_study
from pipelines.schemas import generated

FOLDER = Path(__file__).parents[2] / "results_schema"
GENERATED = generated()
NAMES = sorted({p.stem for p in FOLDER.glob("*/*.json")})


def test_the_page_lists_every_schema() -> None:
    listed = re.findall(r"^\| `([\d.]+)/(\w+)\.json` \|", (FOLDER / "README.md").read_text(), re.M)
    assert {name: version for version, name in listed} == schema.versions()
    assert len(listed) == len(NAMES)
    assert len(NAMES) >= 9


@pytest.mark.parametrize("name", NAMES)
def test_a_schema_is_one_and_is_called_what_its_file_is(name: str) -> None:
    Draft202012Validator.check_schema(schema.load(name))
    assert schema.identifier(name) == f"mcstudy:{name}:{schema.versions()[name]}"


@pytest.mark.skipif(
    tuple(map(int, pydantic.VERSION.split(".")[:2])) < (2, 12), reason="pydantic 2.12 generates further keys of a type"
)
@pytest.mark.parametrize("path", GENERATED)
def test_a_schema_is_what_the_records_and_the_layout_give(path: str) -> None:
    assert (FOLDER / path).read_text(encoding="utf-8") == GENERATED[path], "python -m pipelines.schemas writes it"


def test_only_superseded_versions_are_not_generated() -> None:
    files = {file.relative_to(FOLDER).as_posix() for file in FOLDER.glob("*/*.json")}
    assert files - set(GENERATED) == {"1.0.0/diagnosis.json", "1.0.0/show.json"}


def test_the_newest_version_of_a_schema_is_used() -> None:
    assert schema.versions()["show"] == "2.0.0"
    assert schema.versions()["recording"] == "1.0.0"


def test_a_diagnosis_of_version_1_0_can_still_be_read() -> None:
    """The newer schema demands nothing that the older one did not have; both refuse what neither knows."""
    old, new = (json.loads((FOLDER / v / "diagnosis.json").read_text()) for v in ("1.0.0", "1.1.0"))
    assert sorted(new["required"]) == sorted(old["required"])
    assert {"answers", "likeness", "nearest", "none_log_bayes_factor", "prior"} == (
        set(new["properties"]) - set(old["properties"])
    ) | (set(new["$defs"]["Cause"]["properties"]) - set(old["properties"]["causes"]["items"]["properties"]))
    document = json.loads((Path(__file__).parent / "diagnosis_1_0_0.json").read_text())
    for one in (old, new):
        Draft202012Validator(one).validate(document)
    schema.validate("diagnosis", document, "an old file")
    with pytest.raises(StoreError, match="nearest"):
        schema.validate("diagnosis", {**document, "nearest": {"effects": []}}, "an unsound file")


COMPLETE = {
    "detected": True,
    "p_value": 0.01,
    "none_probability": 0.1,
    "unknown_probability": 0.1,
    "causes": [],
    "credible_set": [],
    "closed": None,
}
"""What an answer without an error has."""


def test_a_diagnosis_that_does_not_conform_is_neither_written_nor_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(gap_verb, "_diagnosed", lambda *_, **__: None)
    unsound = {"schema": schema.identifier("diagnosis"), "p_value": 2.0}
    monkeypatch.setattr("mcstudy.gap.document.document", lambda _: unsound)
    for more in (["-o", str(tmp_path / "out")], ["--json"]):
        assert main(["gap", "diagnose", "a.nc", *more]) == Exit.BAD_INPUT
        said = capsys.readouterr()
        assert said.out == ""
        assert f"(diagnosis {schema.versions()['diagnosis']})" in said.err
        assert said.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_cube_that_does_not_conform_is_not_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tiny: str) -> None:
    monkeypatch.setattr(store, "describe", lambda _: {"attributes": {}, "groups": {}})
    with pytest.raises(StoreError, match=r"out\.zarr: .* \(study_cube 1\.0\.0\)"):
        store.Cube.create(tmp_path / "out.zarr", parse_study(tiny))
    assert not (tmp_path / "out.zarr").exists()


def test_tables_that_do_not_conform_are_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view, "StudyView", lambda tree: tree)
    monkeypatch.setattr(summary, "show_data", lambda *_: {"schema": schema.identifier("show")})
    with pytest.raises(StoreError, match=r"show: .*: missing \(show 2\.0\.0\)"):
        tables.report_of(None)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["challenge_manifest", "challenge_key", "challenge_answers", "challenge_score"])
def test_a_file_of_a_challenge_that_does_not_conform_is_neither_written_nor_read(tmp_path: Path, kind: str) -> None:
    file = tmp_path / "a.json"
    with pytest.raises(StoreError, match=rf"a\.json: .*\({kind} 1\.0\.0\)"):
        json_files.write_json(file, {"schema": schema.identifier(kind)}, kind)
    assert not file.exists()
    file.write_text(json.dumps({"schema": schema.identifier(kind)}))
    with pytest.raises(StoreError, match=rf"a\.json: .*\({kind} 1\.0\.0\)"):
        json_files.read_json(file, kind)


@pytest.mark.parametrize("kind", files.PARTS)
def test_a_part_that_does_not_conform_is_neither_written_nor_read(tmp_path: Path, kind: str) -> None:
    out = tmp_path / "a.json"
    with pytest.raises(StoreError, match=rf"case1\.json: .*: missing \({kind} 1\.0\.0\)"):
        files.write_part(out, kind, {}, {"name": "case1", "seconds": 0.0})
    assert not list(tmp_path.iterdir())
    files.partial_folder(out).mkdir()
    (files.partial_folder(out) / "case1.json").write_text(json.dumps({files.PARTS[kind][0]: {"name": "case1"}}))
    assert files.read_parts(out, kind) == {}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"method": 3}, "method: expected text, found 3"),
        ({"manifest_sha256": "x"}, "manifest_sha256: expected text matching ^[0-9a-f]{64}$, found 'x'"),
        ({"schema": "other"}, "schema: expected 'mcstudy:challenge_answers:1.0.0', found 'other'"),
        (
            {"by": "me"},
            "top level: expected only the keys schema, challenge, manifest_sha256, method, program, answers, "
            "found 'by'",
        ),
        ({"answers": {}}, "answers: expected a list, found {}"),
        ({"answers": [{"name": "case1"}]}, "answers.0.seconds: missing"),
        (
            {"answers": [{"name": "one", "seconds": 0, "error": ""}]},
            "answers.0.name: expected text matching ^case[0-9]+$, found 'one'",
        ),
        (
            {"answers": [{"name": "case1", "seconds": -1, "error": ""}]},
            "answers.0.seconds: expected at least 0, found -1",
        ),
        ({"answers": [{"name": "case1", "seconds": 0, "error": 5}]}, "answers.0.error: expected text, found 5"),
        (
            {"answers": [{"name": "case1", "seconds": 0, **COMPLETE, "detected": 5}]},
            "answers.0.detected: expected true or false, found 5",
        ),
    ],
)
def test_what_does_not_conform_is_told_with_place_expectation_and_find(change: dict[str, Any], message: str) -> None:
    answers = {"schema": schema.identifier("challenge_answers"), "challenge": "c", "manifest_sha256": "0" * 64}
    with pytest.raises(StoreError) as caught:
        schema.validate("challenge_answers", answers | {"method": "m", "answers": []} | change, "a.json")
    assert str(caught.value) == f"a.json: {message} (challenge_answers 1.0.0)"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "Expecting value"),
        (b"\xff", "expected UTF-8 text"),
        (b"[NaN]", "expected finite numbers, found NaN"),
        (b"[-Infinity]", "expected finite numbers, found -Infinity"),
        (b"[1e400]", "expected finite numbers, found 1e400"),
        (b"[" + b"9" * 5000 + b"]", "at most 20 digits, found 5000 digits"),
        (b'{"a": 1, "a": 2}', "expected every key once in a table, found 'a' twice"),
        (b'"\\ud800"', "one half of a surrogate pair"),
        (b"[" * 70 + b"]" * 70, "nesting of at most 64 levels"),
        (b"[" * 100_000, "nesting of at most 64 levels"),
        (b'{"a":' * 900 + b"1" + b"}" * 900, "nesting of at most 64 levels"),
    ],
    ids=["nothing", "bytes", "nan", "infinity", "1e400", "digits", "twice", "half", "deep", "deeper", "tables"],
)
def test_what_is_no_json_of_ours_is_told_in_one_line(content: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        json_document(content)
    assert "\n" not in str(caught.value)


def test_json_of_ours_is_read_as_it_is() -> None:
    value = {"a": [1, -2.5, 2**63, None, True], "b": {"c": "\N{GREEK SMALL LETTER THETA}\u20ac"}}
    assert json_document(json.dumps(value).encode()) == value
    assert json_document(b"[" * 64 + b"]" * 64)
