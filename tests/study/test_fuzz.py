"""Whatever bytes a study file or a cube holds: a valid object, or one line that says what was expected."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import pytest
from fuzzing import FUZZ
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from refusals import or_refused
from tiny_studies import copied

from mcstudy.analysis.results import open_results
from mcstudy.models.record import ModelTable
from mcstudy.study.cube.store import Cube
from mcstudy.study.design import FitSection, Group, ModelSection, NoiseSection, SpectraSection, StimulusSection
from mcstudy.study.failures import counts
from mcstudy.study.study_file import parse_study, read_study
from mcstudy.study.verify import verify

changes = st.lists(
    st.tuples(
        st.floats(0, 1),
        st.text(max_size=8) | st.sampled_from(["1e400", "nan", "[[", "=", "'''", "9" * 30]),
        st.integers(0, 8),
    ),
    min_size=1,
    max_size=6,
)


@FUZZ
@given(edits=changes)
def test_a_mutated_study_file_is_valid_or_refused(tiny: str, edits: list[tuple[float, str, int]]) -> None:
    text = tiny
    for where, new, gone in edits:
        at = int(where * len(text))
        text = text[:at] + new + text[at + gone :]
    study = or_refused(lambda: parse_study(text))
    if study is not None:
        assert study.fits > 0


@FUZZ
@given(content=st.binary(max_size=300) | st.text(max_size=200).map(lambda s: s.encode("utf-8", "surrogatepass")))
def test_any_bytes_as_a_study_file_are_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "any.toml"
    file.write_bytes(content)
    assert or_refused(lambda: read_study(file)) is None


numbers = st.integers(-1, 10**9) | st.floats() | st.sampled_from([0, 1, 2, 0.41, 1.2, 8.0, 1e-300, 1e300, math.inf])
anything = numbers | st.booleans() | st.text(max_size=4) | st.lists(numbers, max_size=3)


def section(model: Any) -> st.SearchStrategy[dict[str, Any]]:
    """A table with some keys of a section, and nearly sensible values."""
    words = {
        name: st.sampled_from(field.annotation.__args__)
        for name, field in model.model_fields.items()
        if hasattr(field.annotation, "__args__") and all(isinstance(a, str) for a in field.annotation.__args__)
    }
    keys = {
        name: words.get(name, numbers) | anything
        for name in model.model_fields
        if name not in ("bounds", "truth", "body")
    }
    return st.fixed_dictionaries({}, optional=keys)


named = st.dictionaries(st.sampled_from(["Kpas1", "Td1", "J1", "C2", "g", "K", "x"]), anything, max_size=3)
sections = st.fixed_dictionaries(
    {},
    optional={
        "stimulus": section(StimulusSection),
        "noise": section(NoiseSection),
        "spectra": section(SpectraSection),
        "fit": section(FitSection),
        "model": st.fixed_dictionaries({}, optional={"truth": named, "body": named, "kind": anything}),
        "simulator": st.sampled_from(["none", "spectral", "time_domain"]) | anything,
    },
)


def literal(value: object) -> str:
    """TOML for a JSON-like value."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {literal(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(literal, value)) + "]"
    return json.dumps(value).replace("NaN", "nan").replace("Infinity", "inf")


@FUZZ
@given(
    group=sections,
    axes=st.fixed_dictionaries(
        {},
        optional={
            "realizations": numbers,
            "starts": numbers,
            "fmax": st.lists(numbers, max_size=3),
            "amplitude": st.lists(numbers, max_size=3),
        },
    ),
)
def test_any_group_of_a_study_file_is_valid_or_refused(group: dict[str, Any], axes: dict[str, Any]) -> None:
    assert set(ModelSection.model_fields) - set(ModelTable.model_fields) <= {"kind", "truth", "body", "bounds"}
    assert set(axes) <= set(Group.model_fields)
    table = {"realizations": 2, "starts": 3, "fmax": [8.0], "amplitude": [5.0], **axes, **group}
    lines = "\n".join(f"{key} = {literal(value)}" for key, value in table.items())
    or_refused(lambda: parse_study(f"[study]\nname = 'fuzz'\nseed = 1\n[group.g]\n{lines}\n"))


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory, tiny_cube: Path) -> Path:
    return copied(tiny_cube, tmp_path_factory.mktemp("fuzz"))


def everything(cube: Path) -> None:
    """All that reads a cube, in one way or another."""
    or_refused(lambda: [counts(store) for store in Cube.open(cube).groups.values()])
    or_refused(lambda: [node.to_dataset().load() for node in open_results(cube).children.values()])


edits = st.lists(st.tuples(st.floats(0, 1), st.binary(max_size=8), st.integers(0, 8)), min_size=1, max_size=6)


@settings(FUZZ, max_examples=FUZZ.max_examples // 6)
@given(which=st.integers(0, 1000), changes=edits)
def test_any_mutated_file_of_a_cube_is_read_or_refused(
    sound: Path, which: int, changes: list[tuple[float, bytes, int]]
) -> None:
    files = sorted(p for p in sound.rglob("*") if p.is_file())
    file = files[which % len(files)]
    honest = content = file.read_bytes()
    for where, new, gone in changes:
        at = int(where * len(content))
        content = content[:at] + new + content[at + gone :]
    assume(content != honest)
    file.write_bytes(content)
    try:
        everything(sound)
        found = or_refused(lambda: verify(sound, cells=0))
        assert found is None or [line for line in found.damage if str(file) in line or file.name == "zarr.json"]
    finally:
        file.write_bytes(honest)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@settings(FUZZ, max_examples=FUZZ.max_examples // 6)
@given(which=st.integers(0, 1000), where=st.integers(0, 10_000), value=json_values)
def test_metadata_with_any_value_in_any_place_is_read_or_refused(
    sound: Path, which: int, where: int, value: object
) -> None:
    files = sorted(p for p in sound.rglob("zarr.json") if p.parent != sound or which % 3 == 0)
    file = files[which % len(files)]
    honest = file.read_text()
    document = json.loads(honest)
    document.pop("consolidated_metadata", None)
    places = list(walk(document))
    parent, key = places[where % len(places)]
    parent[key] = value
    file.write_text(json.dumps(document))
    try:
        everything(sound)
        or_refused(lambda: verify(sound, cells=0))
    finally:
        file.write_text(honest)


def walk(value: Any) -> Any:
    """Every (container, key) of a JSON value."""
    for key, inner in list(value.items() if isinstance(value, dict) else enumerate(value)):
        yield value, key
        if isinstance(inner, (dict, list)):
            yield from walk(inner)


def test_the_fuzzed_cube_is_whole_at_the_end(sound: Path, tmp_path: Path) -> None:
    assert verify(shutil.copytree(sound, tmp_path / "copy.zarr"), cells=100).damage == []
