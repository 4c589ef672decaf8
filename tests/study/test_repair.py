"""Whatever is damaged is found, named, and repaired by the next run - and only that."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from json_edits import edit
from tiny_studies import copied

from mcstudy.errors import StoreError
from mcstudy.files.durable import log_folder, tree_digest
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube.store import Cube
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify

ONE = ClusterOptions(workers=1)


@pytest.fixture(scope="module")
def sound(tiny_cube: Path) -> Path:
    return tiny_cube


@pytest.fixture
def copy(tmp_path: Path, sound: Path) -> Path:
    return copied(sound, tmp_path)


def flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 3] ^= 16
    file.write_bytes(content)


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:20])


SKELETON = [
    ("zarr.json", Path.unlink),
    ("zarr.json", cut),
    ("zarr.json", edit("attributes.fingerprint", "0" * 64)),
    ("zarr.json", edit("attributes.study", "")),
    ("zarr.json", edit("attributes.seed", 8)),
    ("zarr.json", edit("attributes.environment", None)),
    ("zarr.json", edit("attributes.environment.versions.numpy", "1.0")),
    ("zarr.json", edit("attributes.environment.threads", {})),
    ("zarr.json", edit("consolidated_metadata.metadata.noisy.attributes.environment.machine", "abacus")),
    ("noisy/zarr.json", edit("attributes.environment.cpu_features", [])),
    ("noisy/zarr.json", edit("attributes.fingerprint", "0" * 64)),
    ("noisy/zarr.json", edit("attributes.design", {})),
    ("noisy/zarr.json", edit("attributes.realizations_a_chunk", 3)),
    ("noisy/zarr.json", Path.unlink),
    ("noisy/status/zarr.json", edit("chunk_grid.configuration.chunk_shape", [1, 2, 5, 6])),
    ("noisy/estimate/zarr.json", edit("shape", [10**9] * 5)),
    ("noisy/truth/zarr.json", edit("attributes.provenance", "measured")),
    ("noisy/cost/zarr.json", cut),
    ("noisy/fmax/c.0", flip),
    ("ideal/parameter/c.0", Path.unlink),
    ("ideal/true_frf", shutil.rmtree),
]


@pytest.mark.parametrize(("file", "damage"), SKELETON)
def test_damaged_metadata_and_coordinates_are_named_and_repaired_without_a_fit(
    copy: Path, sound: Path, tiny: str, file: str, damage: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    damage(copy / file)
    try:
        found = verify(copy, cells=0).damage
    except StoreError as error:
        found = [str(error)]  # not even the study it belongs to can be read
    assert [line for line in found if str(copy) in line]
    assert run_study(parse_study(tiny), copy, ONE).fits == 0
    assert tree_digest(copy) == tree_digest(sound)
    assert f"repaired: {file}" in capsys.readouterr().err


def test_a_lost_array_is_made_again_with_its_fits_and_no_others(copy: Path, sound: Path, tiny: str) -> None:
    shutil.rmtree(copy / "ideal" / "cost")
    assert [line for line in verify(copy, cells=0).damage if "ideal/cost" in line]
    assert run_study(parse_study(tiny), copy, ONE).fits == 8
    assert tree_digest(copy) == tree_digest(sound)


def test_everything_damaged_at_once_is_repaired_at_once(copy: Path, sound: Path, tiny: str) -> None:
    for file, damage in SKELETON[1], SKELETON[9], SKELETON[13], SKELETON[15]:
        damage(copy / file)
    chunk = sorted((copy / "noisy" / "estimate").glob("c.*"))[0]
    flip(chunk)
    assert run_study(parse_study(tiny), copy, ONE).fits == 24
    assert tree_digest(copy) == tree_digest(sound)


@pytest.mark.parametrize(("file", "damage"), SKELETON[:6])
def test_a_cube_that_came_without_its_log_is_repaired_too(
    copy: Path, sound: Path, tiny: str, file: str, damage: Callable[[Path], None]
) -> None:
    shutil.rmtree(log_folder(copy))
    damage(copy / file)
    assert run_study(parse_study(tiny), copy, ONE).fits == 0
    assert tree_digest(copy) == tree_digest(sound)


def test_the_environment_of_a_cube_is_told_by_its_copies_and_not_by_the_log_of_one_before_it(
    copy: Path, sound: Path, tiny: str
) -> None:
    """A cube was removed and its log stayed; the run that made this one was killed before its first line."""
    log = log_folder(copy) / "runs.jsonl"
    begin = json.loads(log.read_text().splitlines()[0])
    begin["made_in"]["machine"] = "abacus"
    log.write_text(json.dumps(begin) + "\n")
    assert verify(copy, cells=0).damage == []
    (copy / "zarr.json").unlink()
    run_study(parse_study(tiny), copy, ONE)
    assert tree_digest(copy) == tree_digest(sound)


def test_sound_chunks_of_an_array_whose_metadata_is_damaged_are_not_blamed(copy: Path) -> None:
    files = [copy / "noisy" / "cost" / "zarr.json", copy / "ideal" / "status" / "zarr.json", copy / "noisy/zarr.json"]
    for file in files:
        cut(file)
    lines = verify(copy).damage
    assert all(any(line.startswith(f"{file}: ") for line in lines) for file in files)
    assert [line for line in lines if not line.startswith(tuple(f"{file}: " for file in files))] == []


@pytest.mark.parametrize("log", [True, False])
def test_what_is_another_study_or_nobodys_is_left_alone(copy: Path, tiny: str, log: bool) -> None:
    (copy / "zarr.json").unlink()
    if not log:
        shutil.rmtree(log_folder(copy))
    other, before = parse_study(tiny.replace("seed = 7", "seed = 8")), tree_digest(copy)
    with pytest.raises(StoreError, match=r"expected a results cube"):
        run_study(other, copy, ONE)
    assert tree_digest(copy) == before
    if not log:
        for group in ("noisy", "ideal"):
            (copy / group / "zarr.json").unlink()
        before = tree_digest(copy)
        with pytest.raises(StoreError, match=r"expected a results cube"):
            run_study(parse_study(tiny), copy, ONE)
        assert tree_digest(copy) == before


def test_a_cube_of_another_version_is_not_repaired(copy: Path, tiny: str) -> None:
    edit("attributes.schema", "mcstudy:study_cube:99.0.0")(copy / "zarr.json")
    before = tree_digest(copy)
    with pytest.raises(StoreError, match="expected a cube of schema"):
        run_study(parse_study(tiny), copy, ONE)
    assert tree_digest(copy) == before


def test_blocks_of_another_environment_are_warned_of_and_recorded(
    copy: Path, sound: Path, tiny: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (copy / "ideal" / "status" / "c.0.0.0.0").unlink()
    here = json.loads((copy / "zarr.json").read_text())["attributes"]["environment"]
    threads = {**here["threads"], "OMP_NUM_THREADS": "64"}
    other = {**here, "versions": {**here["versions"], "numpy": "1.0"}, "machine": "abacus", "threads": threads}
    monkeypatch.setattr("mcstudy.study.execution.attempt.environment", lambda: other)  # the worker's, not the client's
    assert run_study(parse_study(tiny), copy, ONE).fits == 8
    warned = capsys.readouterr().err
    expected = [
        f"versions.numpy: {here['versions']['numpy']} -> 1.0",
        f"machine: {here['machine']} -> abacus",
        f"threads.OMP_NUM_THREADS: {here['threads']['OMP_NUM_THREADS']} -> 64",
    ]
    said = "; ".join(expected)
    assert warned.count(f"warning: workers of another environment than the cube's have written to it: {said}\n") == 1
    events = [json.loads(line) for line in (log_folder(copy) / "runs.jsonl").read_text().splitlines()]
    blocks = [e for e in events if e["event"] == "block"]
    assert [b.get("other_environment") for b in blocks[:-1]] == [None] * (len(blocks) - 1)
    assert blocks[-1]["other_environment"] == expected
    numbers = [{f.relative_to(out): f.read_bytes() for f in out.rglob("c.?.*[0-9]")} for out in (copy, sound)]
    assert numbers[0] == numbers[1]
    cube = Cube.open(copy)
    assert list(cube.attributes["environments"].values()) == [other]
    group = cube.groups["ideal"]
    assert group.environments(group.layout.chunks[0]) == tuple(cube.attributes["environments"])
