"""A cube can be read while it is written; what is missing or out of place is an error, what is not run is pending."""

from __future__ import annotations

import json
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import quick_solver
from two_chunks import ONE, TWO_CHUNKS

from mcstudy.analysis.results import open_results
from mcstudy.analysis.show.tables import show
from mcstudy.errors import StoreError
from mcstudy.files import durable
from mcstudy.files.durable import log_folder, tree_digest
from mcstudy.fitting.status import Status
from mcstudy.report.page import page
from mcstudy.report.study.context import Context
from mcstudy.report.study.tables import introduction
from mcstudy.study.cube import checksums
from mcstudy.study.cube.checked_store import CheckedStore
from mcstudy.study.cube.store import Cube
from mcstudy.study.cube.strays import aside_folder
from mcstudy.study.execution import tasks
from mcstudy.study.extend import Growth, extend
from mcstudy.study.failures import counts
from mcstudy.study.replay import replay
from mcstudy.study.run import run_study
from mcstudy.study.verify import verify


@pytest.fixture
def sound(two_chunks: Path) -> Path:
    return two_chunks


@pytest.fixture
def copy(tmp_path: Path, sound: Path) -> Path:
    tasks.open_group.cache_clear()
    shutil.copytree(log_folder(sound), log_folder(tmp_path / "out.zarr"))
    return shutil.copytree(sound, tmp_path / "out.zarr")


def chunk_file(out: Path, array: str, block: int) -> Path:
    (group,) = Cube.open(out).groups.values()
    return group.chunk_file(array, group.layout.chunks[block])


def swap(out: Path, array: str) -> None:
    """The same array of two chunks."""
    one, other = (chunk_file(out, array, block) for block in (0, 1))
    a, b = one.read_bytes(), other.read_bytes()
    assert a != b
    one.write_bytes(b)
    other.write_bytes(a)


ARRAYS = ("estimate", "cost", "growth_rate", "noise_covariance")
DAMAGE = [
    *((array, damage) for array in (*ARRAYS, "status") for damage in ("missing", "folder")),
    *((array, "swapped") for array in ARRAYS),  # the status of all fits of this study is the same
]
READERS: list[Callable[[Path], object]] = [
    lambda out: open_results(out, lazy=False),
    lambda out: open_results(out)["noisy"].to_dataset().compute(),
    show,
    page,
]
READ = [(*damage, READERS[0]) for damage in DAMAGE]
READ += [("estimate", damage, read) for damage in ("missing", "folder", "swapped") for read in READERS[1:]]


@pytest.mark.parametrize(("array", "damage", "read"), READ)
def test_a_chunk_that_is_missing_or_another_ones_is_refused_by_name(
    copy: Path, array: str, damage: str, read: Callable[[Path], object]
) -> None:
    file = chunk_file(copy, array, 0)
    if damage == "swapped":
        swap(copy, array)
    else:
        file.unlink()
    if damage == "folder":
        file.mkdir()
    with pytest.raises(StoreError, match=r"^[^\n]+$") as caught:
        read(copy)
    either = [file, chunk_file(copy, array, 1)] if damage == "swapped" else [file]
    assert [f for f in either if str(f) in str(caught.value)]


@pytest.mark.parametrize("damage", ["missing", "folder", "swapped", "cut"])
def test_status_counts_the_fits_of_a_chunk_that_is_not_whole_as_pending(copy: Path, damage: str) -> None:
    (store,) = Cube.open(copy).groups.values()
    before = counts(store)
    assert before[Status.PENDING] == 0
    file = chunk_file(copy, "estimate", 0)
    if damage == "swapped":
        swap(copy, "estimate")
    elif damage == "cut":
        file.write_bytes(file.read_bytes()[:-9])
    else:
        file.unlink()
    if damage == "folder":
        file.mkdir()
    touched = store.layout.chunks[: 2 if damage == "swapped" else 1]
    assert counts(store)[Status.PENDING] == sum(store.layout.fits(chunk) for chunk in touched)


def test_status_reads_the_ends_of_the_large_arrays_and_verify_every_byte(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (store,) = Cube.open(copy).groups.values()
    file = chunk_file(copy, "estimate", 0)
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    assert counts(store)[Status.PENDING] == 0
    assert verify(copy, cells=0).damage[0].startswith(f"{file}: checksum does not match")
    read: list[str] = []
    real = checksums.cube_bytes
    monkeypatch.setattr(checksums, "cube_bytes", lambda root, key: read.append(key) or real(root, key))
    counts(store)
    assert {key.split("/")[1] for key in read} == {"status"}


@pytest.mark.parametrize("read", READERS)
def test_a_damaged_copy_of_metadata_which_only_zarr_reads_is_refused_in_one_line(
    copy: Path, read: Callable[[Path], object]
) -> None:
    file = copy / "noisy" / "zarr.json"
    document = json.loads(file.read_text())
    document["consolidated_metadata"]["metadata"]["cost"]["chunk_key_encoding"] = {"neme": "default"}
    file.write_text(json.dumps(document))
    with pytest.raises(StoreError, match=r"^[^\n]*out\.zarr: damaged metadata [^\n]*$"):
        read(copy)


def test_a_missing_chunk_is_refused_by_replay(copy: Path) -> None:
    file = chunk_file(copy, "initial", 0)
    file.unlink()
    with pytest.raises(StoreError, match=f"{file}: missing"):
        replay(copy, amplitude=5.0, fmax=0.41, realization=0, start=0)


def test_swapped_chunks_are_not_taken_over_when_the_study_grows(copy: Path, tmp_path: Path) -> None:
    swap(copy, "estimate")
    extend(copy, Growth(realizations=5), ONE)
    whole = tmp_path / "whole.zarr"
    run_study(Cube.open(copy).study, whole, ONE)
    assert tree_digest(copy) == tree_digest(whole)


def test_a_cube_can_be_read_at_every_step_of_a_run_and_holds_right_numbers_or_pending_fits(
    sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a run that writes its chunks after every other fit, and of one that repairs a cube."""
    final = open_results(sound, lazy=False)["noisy"].to_dataset()
    monkeypatch.setitem(*quick_solver.lm(fits_a_chunk=(4, 4)))
    monkeypatch.setattr(tasks, "CHECKPOINT_S", 0.0)
    monkeypatch.setitem(*quick_solver.lm(starts_a_call=2))
    out = tmp_path / "out.zarr"
    seen: set[int] = set()

    def look() -> None:
        if not out.exists():
            return
        data = open_results(out, lazy=False)["noisy"].to_dataset()
        done = data["status"] != int(Status.PENDING)
        seen.add(int(done.sum()))
        for name in ("estimate", "cost", "growth_rate", "initial", "iterations"):
            there, expected = data[name].values[done.values], final[name].values[done.values]
            assert there.tobytes() == expected.tobytes(), name

    write = durable.write

    def watched_write(path: Path, content: bytes | memoryview) -> None:
        write(path, content)
        look()

    monkeypatch.setattr(durable, "write", watched_write)
    run_study(TWO_CHUNKS, out, ONE)
    assert seen == set(range(0, TWO_CHUNKS.fits + 1, 2))
    assert tree_digest(out) == tree_digest(sound)
    seen.clear()
    chunk_file(out, "cost", 1).unlink()
    with pytest.raises(StoreError, match="missing"):
        look()
    monkeypatch.setattr(durable, "write", write)
    taken_up = type(Cube.open(out).groups["noisy"]).taken_up

    def watched_taken_up(*args: object) -> object:
        found = taken_up(*args)  # type: ignore[arg-type]
        monkeypatch.setattr(durable, "write", watched_write)
        look()  # what was reported complete has been taken back: no error, but pending fits
        return found

    monkeypatch.setattr("mcstudy.study.cube.store.GroupStore.taken_up", watched_taken_up)
    run_study(TWO_CHUNKS, out, ONE)
    assert min(seen) == TWO_CHUNKS.fits // 2
    assert tree_digest(out) == tree_digest(sound)


def test_of_a_cube_that_may_be_growing_the_status_is_read_first(sound: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a fit that ends in between would be done, and without an estimate."""
    keys: list[str] = []
    get = CheckedStore.get_sync

    def watched(self: CheckedStore, key: str, **options: Any) -> Any:
        keys.append(key)
        return get(self, key, **options)

    monkeypatch.setattr(CheckedStore, "get_sync", watched)
    open_results(sound, lazy=False)
    results = [k for k in keys if k.split("/")[1:2] in (["status"], ["cost"], ["estimate"]) and "/c." in k]
    assert [k.split("/")[1] for k in results[:2]] == ["status", "status"]
    assert len(results) == 6


def without_checksums(out: Path) -> list[Path]:
    """As an older program would have left it."""
    notes = sorted(out.rglob("*.checksums"))
    assert len(notes) == 2
    for note in notes:
        note.unlink()
    log = log_folder(out) / "runs.jsonl"
    events = [json.loads(line) for line in log.read_text().splitlines()]
    for event in events:
        event.pop("checksums", None)
    log.write_text("".join(json.dumps(event) + "\n" for event in events))
    return notes


def test_an_older_cube_without_checksums_is_read_noted_and_completed(
    copy: Path, sound: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, _ = without_checksums(copy)
    opened = open_results(copy, lazy=False)["noisy"].to_dataset()
    assert opened.identical(open_results(sound, lazy=False)["noisy"].to_dataset())
    verdict = verify(copy, cells=0)
    assert verdict.damage == []
    (line,) = verdict.notes
    assert str(first) in line
    assert run_study(TWO_CHUNKS, copy, ONE).fits == 0
    assert "repaired: missing checksums of 2 chunks" in capsys.readouterr().err
    assert tree_digest(copy) == tree_digest(sound)


@pytest.mark.parametrize("array", ["estimate", "status"])
def test_a_missing_chunk_of_an_older_cube_is_refused_too(copy: Path, array: str) -> None:
    without_checksums(copy)
    file = chunk_file(copy, array, 0)
    file.unlink()
    with pytest.raises(StoreError, match=f"{file}: missing"):
        show(copy)


def test_the_fits_of_a_chunk_that_was_not_run_are_pending_in_every_table(copy: Path) -> None:
    without_checksums(copy)
    shutil.rmtree(log_folder(copy))
    chunk_file(copy, "status", 0).unlink()  # as a run that was stopped leaves it
    line = "Not complete: 4 of 8 fits of group noisy are pending; all numbers are from the fits that have been run."
    assert line in show(copy).text()
    assert json.loads(show(copy).json())["groups"]["noisy"]["fits"]["pending"] == 4
    assert line in introduction(Context(open_results(copy)))


def test_no_table_of_a_complete_cube_speaks_of_pending_fits(sound: Path) -> None:
    assert "pending" not in show(sound).text()


def test_what_does_not_belong_is_told_and_set_aside_when_asked(
    copy: Path, sound: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (copy / "README.txt").write_text("mine")
    extra = copy / "noisy" / "cost" / "c.0.0.9.0"
    extra.write_bytes(b"x")
    run_study(TWO_CHUNKS, copy, ONE)
    told = capsys.readouterr().err
    for file in (copy / "README.txt", extra):
        assert f"{file}: not part of the cube (mcstudy run --quarantine sets it aside)" in told
        assert file.exists()
    run_study(TWO_CHUNKS, copy, ONE, quarantine=True)
    assert tree_digest(copy) == tree_digest(sound)
    assert (aside_folder(copy) / "1" / "README.txt").read_text() == "mine"
    assert (aside_folder(copy) / "1" / "noisy" / "cost" / "c.0.0.9.0").read_bytes() == b"x"


def test_a_folder_that_does_not_belong_is_refused_with_what_to_do_and_set_aside_when_asked(
    copy: Path, sound: Path
) -> None:
    folder = copy / "noisy" / "backup"
    folder.mkdir()
    (folder / "old").write_text("mine")
    assert [line for line in verify(copy, cells=0).damage if line.startswith(f"{folder}: not part of the cube")]
    with pytest.raises(StoreError, match=f"{folder}: not part of the cube .*--quarantine"):
        run_study(TWO_CHUNKS, copy, ONE)
    for k in (1, 2):
        run_study(TWO_CHUNKS, copy, ONE, quarantine=True)
        assert (aside_folder(copy) / str(k) / "noisy" / "backup" / "old").read_text() == "mine"
        assert tree_digest(copy) == tree_digest(sound)
        shutil.copytree(aside_folder(copy) / str(k) / "noisy" / "backup", folder)


def test_paths_may_be_text(copy: Path, sound: Path, tmp_path: Path) -> None:
    text = str(copy)
    assert run_study(TWO_CHUNKS, text, ONE).fits == 0
    assert verify(text, cells=0).damage == []
    assert Cube.open(text).study.fingerprint == TWO_CHUNKS.fingerprint
    assert Cube.create(str(tmp_path / "new.zarr"), TWO_CHUNKS).path == tmp_path / "new.zarr"
    assert replay(text, amplitude=5.0, fmax=0.41, realization=0, start=0).differ == ()
    assert tree_digest(copy) == tree_digest(sound)
    assert extend(text, Growth(realizations=5), ONE).fits == 2


def test_a_cube_opened_lazily_can_be_sent_to_another_process(sound: Path) -> None:
    tree = pickle.loads(pickle.dumps(open_results(sound)["noisy"].to_dataset()))
    np.testing.assert_array_equal(tree["cost"], open_results(sound, lazy=False)["noisy"]["cost"])
