"""A cube is plain labelled Zarr, and damage in it is never read as numbers."""

from __future__ import annotations

import errno
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mcstudy.analysis.results import open_results
from mcstudy.errors import Interrupted, StoreError
from mcstudy.files import durable, schema
from mcstudy.fitting.status import Status
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.metadata import describe
from mcstudy.study.cube.store import Cube
from mcstudy.study.study_file import parse_study


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, tiny: str) -> Path:
    return Cube.create(tmp_path_factory.mktemp("made") / "out.zarr", parse_study(tiny)).path


@pytest.fixture
def cube(tmp_path: Path, made: Path) -> Cube:
    return Cube.open(shutil.copytree(made, tmp_path / "out.zarr"))


def fake(cube: Cube, group: str, chunk: Chunk) -> dict[str, np.ndarray]:
    data = cube.groups[group].layout.empty(chunk)
    data["status"][:] = Status.CONVERGED
    data["estimate"][:] = np.arange(data["estimate"].size).reshape(data["estimate"].shape)
    return data


@pytest.mark.parametrize("fails", ["sync_tree", "_files"])
def test_a_cube_that_cannot_be_completed_leaves_nothing(
    tmp_path: Path, tiny: str, fails: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(f"mcstudy.study.cube.store.{fails}", full)
    with pytest.raises(Interrupted, match="No space left on device"):
        Cube.create(tmp_path / "out.zarr", parse_study(tiny))
    assert list(tmp_path.iterdir()) == []


def test_xarray_alone_shows_labelled_dimensions_with_units_and_no_warning(cube: Cube) -> None:
    store = cube.groups["noisy"]
    for chunk in store.layout.chunks:
        store.write(chunk, fake(cube, "noisy", chunk))
    script = f"""
import sys, xarray
d = xarray.open_zarr({str(cube.path)!r}, group="noisy")
assert d.estimate.dims == ("amplitude", "fmax", "realization", "start", "parameter"), d.estimate.dims
assert d.amplitude.values.tolist() == [3.0, 5.0] and d.amplitude.units == "N m"
assert d.fmax.values.tolist() == [0.41, 1.2] and d.fmax.units == "Hz"
assert d.estimate.sel(parameter="K22", fmax=1.2, amplitude=5.0).shape == (5, 6)
assert d.parameter_unit.sel(parameter="Td1").values == "s"
assert str(d.status.dtype) == "uint8" and str(d.frf.dtype) == "complex128"
assert d.status.flag_meanings.split()[:2] == ["pending", "converged"]
assert all("long_name" in v.attrs for v in d.variables.values())
tree = xarray.open_datatree({str(cube.path)!r}, engine="zarr")
assert sorted(tree.children) == ["ideal", "noisy"]
assert not any(name.split(".")[0] == "mcstudy" for name in sys.modules)
"""
    subprocess.run([sys.executable, "-W", "error", "-c", script], check=True)


def test_open_results_gives_the_same_lazily(cube: Cube) -> None:
    tree = open_results(cube.path)
    assert set(tree.children) == {"noisy", "ideal"}
    assert (tree["noisy"].status == Status.PENDING).all()
    assert tree["noisy"].estimate.chunks is not None


def test_what_is_written_is_read_back(cube: Cube) -> None:
    store = cube.groups["noisy"]
    chunk = store.layout.chunks[0]
    data = fake(cube, "noisy", chunk)
    assert store.pending(chunk) == store.layout.fits(chunk)
    store.write(chunk, data)
    assert store.pending(chunk) == 0
    for name, values in store.existing(chunk).items():
        assert values.tobytes() == data[name].tobytes()


def test_status_is_written_after_everything_else_is_on_disk(cube: Cube, monkeypatch: pytest.MonkeyPatch) -> None:
    events: list[str] = []
    write, sync = durable.write, durable.sync_folder
    monkeypatch.setattr(durable, "write", lambda p, c: (write(p, c), events.append(f"write {p.parent.name}")))
    monkeypatch.setattr("mcstudy.study.cube.store.sync_folder", lambda p: (sync(p), events.append(f"sync {p.name}")))
    store = cube.groups["noisy"]
    chunk = store.layout.chunks[0]
    store.write(chunk, fake(cube, "noisy", chunk))
    *others, last = store.layout.results
    assert events[-2:] == ["write status", "sync status"]
    for name in others:
        assert events.index(f"write {name}") < events.index(f"sync {name}") < events.index("write status")
    assert last == "status"


@pytest.mark.parametrize("name", ["estimate", "status", "frf", "at_bound"])
@pytest.mark.parametrize("damage", ["flip", "truncate", "empty", "remove"])
def test_a_damaged_chunk_is_pending_and_never_numbers(cube: Cube, name: str, damage: str) -> None:
    store = cube.groups["noisy"]
    chunk = store.layout.chunks[0]
    store.write(chunk, fake(cube, "noisy", chunk))
    file = store.chunk_file(name, chunk)
    content = bytearray(file.read_bytes())
    if damage == "flip":
        content[len(content) // 2] ^= 1
    file.write_bytes({"flip": content, "truncate": content[:-3], "empty": b""}.get(damage, content))
    if damage == "remove":
        file.unlink()
    assert store.pending(chunk) == store.layout.fits(chunk)
    assert (store.existing(chunk)["status"] == Status.PENDING).all()
    if damage != "remove":
        with pytest.raises(StoreError, match=str(file)):
            store.read(name, chunk)


def test_a_cube_appears_whole_or_not_at_all(tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def power_cut(_: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mcstudy.study.cube.store.sync_tree", power_cut)
    with pytest.raises(KeyboardInterrupt):
        Cube.create(tmp_path / "out.zarr", parse_study(tiny))
    assert not (tmp_path / "out.zarr").exists()
    monkeypatch.undo()
    Cube.create(tmp_path / "out.zarr", parse_study(tiny))
    assert [p.name for p in tmp_path.iterdir()] == ["out.zarr"]


def test_the_tree_depends_on_the_study_alone(tmp_path: Path, tiny: str) -> None:
    first = Cube.create(tmp_path / "a" / "x.zarr", parse_study(tiny))
    second = Cube.create(tmp_path / "b" / "y.zarr", parse_study(tiny))
    assert durable.tree_digest(first.path) == durable.tree_digest(second.path)


def test_arrays_that_groups_share_are_those_of_each_group_alone(tmp_path: Path) -> None:
    """Equal arrays are made once and copied; an array that differs in one number, length or unit is not."""
    groups = {
        "a": "realizations = 3\nstarts = 4\nfmax = [0.41]\namplitude = [3.0]",
        "b": "realizations = 3\nstarts = 4\nfmax = [0.41]\namplitude = [5.0]",
        "c": "realizations = 3\nstarts = 5\nfmax = [0.41]\namplitude = [3.0]",
    }
    text = {name: f"[group.{name}]\n{fields}\n" for name, fields in groups.items()}
    head = '[study]\nname = "shared"\nseed = 1\n'
    together = Cube.create(tmp_path / "all.zarr", parse_study(head + "".join(text.values()))).path
    for name, own in text.items():
        alone = Cube.create(tmp_path / f"{name}.zarr", parse_study(head + own)).path
        arrays = sorted(p.name for p in (alone / name).iterdir() if p.is_dir())
        assert len(arrays) > 20
        assert sorted(p.name for p in (together / name).iterdir() if p.is_dir()) == arrays
        for array in arrays:
            assert durable.tree_digest(together / name / array) == durable.tree_digest(alone / name / array)


def edit(file: Path, **attributes: object) -> None:
    document = json.loads(file.read_text())
    document["attributes"].update(attributes)
    file.write_text(json.dumps(document))


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        ({"schema": "mcstudy:study_cube:99.0.0"}, "expected a cube of schema 'mcstudy:study_cube:1.0.0', found"),
        ({"schema": None}, "expected a cube of schema"),
        ({"fingerprint": "0" * 64}, "fingerprint"),
        ({"study": "[study"}, "attribute study: not valid TOML"),
        ({"seed": "seven"}, "attributes.seed"),
    ],
)
def test_a_cube_of_another_version_or_with_edited_attributes_is_refused_in_one_line(
    cube: Cube, attributes: dict[str, object], expected: str
) -> None:
    edit(cube.path / "zarr.json", **attributes)
    with pytest.raises(StoreError) as caught:
        Cube.open(cube.path)
    assert expected in str(caught.value)
    assert str(caught.value).startswith(str(cube.path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"[1]", b'{"attributes": 3}', b"[" * 100_000])
def test_what_is_not_a_cube_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "zarr.json").write_bytes(content)
    with pytest.raises(StoreError, match=r"^[^\n]+$"):
        Cube.open(tmp_path)


def test_every_array_of_a_cube_is_described_by_the_schema(cube: Cube, tiny: str, tmp_path: Path) -> None:
    whole = Cube.create(
        tmp_path / "whole.zarr",
        parse_study(tiny.replace("[group.noisy]", "[group.noisy]\nstore.standard_errors = true")),
    )
    described = set(schema.load("study_cube")["$defs"]["group"]["properties"]["arrays"]["properties"])
    described -= {"angle_unit", "stimulus"}  # of declared models (tests/models)
    for made, arrays in ((cube, described - {"standard_error"}), (whole, described)):
        description = describe(made.path)
        schema.validate("study_cube", description, "cube")
        assert set(description["groups"]["noisy"]["arrays"]) == arrays


@pytest.mark.parametrize(
    ("array", "key", "value"),
    [
        ("status", "data_type", "int64"),
        ("status", "fill_value", 255),
        ("estimate", "dimension_names", ["a", "b", "c", "d", "e"]),
        ("cost", "codecs", [{"name": "bytes", "configuration": {"endian": "little"}}]),
        ("growth_rate", "attributes", {"long_name": "growth", "units": "Hz"}),
    ],
)
def test_the_schema_refuses_another_structure(cube: Cube, array: str, key: str, value: object) -> None:
    description = describe(cube.path)
    description["groups"]["noisy"]["arrays"][array][key] = value
    with pytest.raises(StoreError, match=rf"groups\.noisy\.arrays\.{array}\.{key}"):
        schema.validate("study_cube", description, "cube")
