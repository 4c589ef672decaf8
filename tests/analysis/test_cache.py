"""Kept statistics save time and change nothing: the same bytes are printed, and what is not sound is computed again."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import mcstudy as mc
from mcstudy import program
from mcstudy.analysis import cache as module
from mcstudy.analysis import results
from mcstudy.analysis.cache import MOST, folder, kept
from mcstudy.analysis.show.tables import show
from mcstudy.cli import main
from mcstudy.errors import StoreError
from mcstudy.exits import Exit
from mcstudy.files import schema
from mcstudy.files.durable import log_folder, tree_digest
from mcstudy.study.cube.store import Cube
from mcstudy.study.verify import verify

KIND = "challenge_answers"
VALUE = {
    "schema": schema.identifier(KIND),
    "challenge": "a\u20ac",
    "manifest_sha256": "0" * 64,
    "method": "m",
    "answers": [{"name": "case1", "seconds": 0.1 + 0.2, "error": ""}],
}


@pytest.fixture
def cube(tmp_path: Path, two_chunks: Path) -> Path:
    shutil.copytree(log_folder(two_chunks), log_folder(tmp_path / "out.zarr"))
    return shutil.copytree(two_chunks, tmp_path / "out.zarr")


class Computed:
    """Hands out `VALUE` and counts how often."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self) -> dict[str, Any]:
        self.times += 1
        return VALUE


def file_of(cube: Path) -> Path:
    (file,) = folder(cube).iterdir()
    return file


def test_a_second_look_prints_the_same_bytes_and_computes_nothing(
    cube: Path, two_chunks: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = tree_digest(cube)
    looks = [["show", str(cube)], ["show", str(cube), "--json"], ["show", str(cube), "--compare", str(two_chunks)]]

    def printed() -> list[str]:
        assert [main(words) for words in looks] == [Exit.DONE] * len(looks)
        return capsys.readouterr().out.splitlines()

    first = printed()
    assert repr(mc.summary(cube)) == show(cube).text()
    assert mc.summary(cube).to_dict() == show(cube).data
    monkeypatch.delattr(results, "open_results")
    assert printed() == first
    assert tree_digest(cube) == before
    assert verify(cube, cells=1).damage == []


def test_statistics_come_back_to_the_last_bit(cube: Path) -> None:
    computed = Computed()
    assert [kept(KIND, [cube], [], computed) for _ in range(3)] == [VALUE] * 3
    assert computed.times == 1


def _flipped(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[-20] ^= 1
    file.write_bytes(content)


def _of_another_key(file: Path) -> None:
    other = file.with_name("0" * 64)
    module._write(other, VALUE)
    other.replace(file)


def _of_another_kind(file: Path) -> None:
    module._write(file, VALUE | {"answers": 3})


def _no_json(file: Path) -> None:
    file.write_bytes(module._seal(file.name, b"{") + b"\n{")


def _link(file: Path) -> None:
    file.rename(file.with_name("elsewhere"))
    file.symlink_to("elsewhere")


@pytest.mark.parametrize(
    "damage",
    [
        _flipped,
        _of_another_key,
        _of_another_kind,
        _no_json,
        _link,
        lambda file: file.write_bytes(b""),
        lambda file: os.truncate(file, 100),
        lambda file: file.unlink(),
    ],
    ids=["flipped", "another key", "another kind", "no JSON", "link", "empty", "truncated", "gone"],
)
def test_a_damaged_or_alien_file_is_computed_again_and_replaced(cube: Path, damage: Callable[[Path], object]) -> None:
    computed = Computed()
    kept(KIND, [cube], [], computed)
    file = file_of(cube)
    sound = file.read_bytes()
    damage(file)
    assert kept(KIND, [cube], [], computed) == VALUE
    assert computed.times == 2
    assert not file.is_symlink()
    assert file.read_bytes() == sound


def _edit(path: Path) -> None:
    path.write_bytes(path.read_bytes() + b" ")


STALE: dict[str, Callable[[Path, pytest.MonkeyPatch], object]] = {
    "metadata": lambda cube, _: _edit(cube / "noisy" / "cost" / "zarr.json"),
    "a chunk": lambda cube, _: _edit(next((cube / "noisy" / "cost").glob("c.*"))),
    "a checksum file": lambda cube, _: _edit(next((cube / "noisy" / "status").glob("*.checksums"))),
    "a file less": lambda cube, _: next((cube / "noisy" / "frf").glob("c.*")).unlink(),
    "a file more": lambda cube, _: (cube / "noisy" / "stray").write_bytes(b""),
    "a folder more": lambda cube, _: (cube / "noisy" / "stray").mkdir(),
    "a link more": lambda cube, _: (cube / "noisy" / "stray").symlink_to("cost"),
    "the run log": lambda cube, _: _edit(log_folder(cube) / "runs.jsonl"),
    "no run log": lambda cube, _: (log_folder(cube) / "runs.jsonl").unlink(),
    "the program": lambda _, patch: patch.setattr(program, "source", lambda *_: "0" * 64),
    "a library": lambda _, patch: patch.setattr(program, "versions", lambda names: dict.fromkeys(names, "2")),
    "a setting": lambda _, patch: patch.setenv("OPENBLAS_CORETYPE", "Prescott"),
    "threads": lambda _, patch: patch.setenv("OMP_NUM_THREADS", "7"),
}


@pytest.mark.parametrize("change", STALE)
def test_statistics_of_other_bytes_or_another_program_are_not_taken(
    cube: Path, change: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed = Computed()
    kept(KIND, [cube], [], computed)
    STALE[change](cube, monkeypatch)
    kept(KIND, [cube], [], computed)
    assert computed.times == 2


def test_other_questions_have_other_statistics(cube: Path, two_chunks: Path) -> None:
    computed = Computed()
    for cubes, words in (([cube], []), ([cube], ["a"]), ([cube, two_chunks], []), ([cube, two_chunks], ["a"])):
        kept(KIND, cubes, words, computed)
    assert computed.times == 4


@pytest.mark.parametrize("array", ["estimate", "cost", "noisy"])
def test_a_cube_that_was_shown_and_then_damaged_is_refused_by_name(cube: Path, array: str) -> None:
    show(cube)
    (group,) = Cube.open(cube).groups.values()
    file = group.chunk_file("estimate" if array == "noisy" else array, group.layout.chunks[0])
    _flipped(file)
    with pytest.raises(StoreError, match=f"{file}: checksum does not match"):
        show(cube)


def test_a_folder_that_cannot_be_written_has_no_kept_statistics(cube: Path) -> None:
    shutil.rmtree(log_folder(cube))
    log_folder(cube).write_bytes(b"")
    computed = Computed()
    assert [kept(KIND, [cube], [], computed) for _ in range(2)] == [VALUE] * 2
    assert computed.times == 2


def test_a_cube_without_its_log_is_kept_too(cube: Path) -> None:
    shutil.rmtree(log_folder(cube))
    computed = Computed()
    assert [kept(KIND, [cube], [], computed) for _ in range(2)] == [VALUE] * 2
    assert computed.times == 1


def test_nothing_is_kept_of_a_cube_that_changed_while_it_was_read(cube: Path) -> None:
    def compute() -> dict[str, Any]:
        _edit(cube / "zarr.json")
        return VALUE

    assert kept(KIND, [cube], [], compute) == VALUE
    assert not folder(cube).exists()


def test_nothing_is_kept_and_nothing_taken_where_the_program_has_changed_since_it_started(
    cube: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed = Computed()
    with monkeypatch.context() as patch:
        patch.setattr(program, "STARTED", {**program.STARTED, "errors.py": (0, 0, 0)})
        assert [kept(KIND, [cube], [], computed) for _ in range(2)] == [VALUE] * 2
        assert not folder(cube).exists()
    kept(KIND, [cube], [], computed)
    with monkeypatch.context() as patch:
        patch.setattr(program, "STARTED", {**program.STARTED, "errors.py": (0, 0, 0)})
        kept(KIND, [cube], [], computed)
    assert computed.times == 4


def test_nothing_is_kept_of_a_program_that_changed_while_it_computed(
    cube: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compute() -> dict[str, Any]:
        monkeypatch.setattr(program, "STARTED", {**program.STARTED, "errors.py": (0, 0, 0)})
        return VALUE

    assert kept(KIND, [cube], [], compute) == VALUE
    assert not folder(cube).exists()


def test_many_at_once_get_the_same_and_leave_one_whole_file(cube: Path) -> None:
    together, found = threading.Barrier(4), []

    def compute() -> dict[str, Any]:
        together.wait(60)  # all of them have found nothing
        return VALUE

    threads = [threading.Thread(target=lambda: found.append(kept(KIND, [cube], [], compute))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [VALUE] * 4
    assert module._read(file_of(cube), KIND) == VALUE


def test_only_the_newest_are_kept(cube: Path) -> None:
    for k in range(MOST + 3):
        kept(KIND, [cube], [str(k)], Computed())
        newest = max(folder(cube).iterdir(), key=lambda f: f.stat().st_mtime_ns)
        os.utime(newest, ns=(k, k))  # files written within one tick of the clock would be of the same age
    assert len(list(folder(cube).iterdir())) == MOST
    computed = Computed()
    kept(KIND, [cube], [str(MOST + 2)], computed)
    assert computed.times == 0


def test_the_cube_is_read_once_for_what_is_kept_and_twice_for_what_is_computed(
    cube: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mcstudy.report.page import page

    content, read = module._content, list[Path]()
    monkeypatch.setattr(module, "_content", lambda path: (read.append(path), content(path))[1])
    for look, times in ((page, 2), (page, 1), (show, 1), (mc.summary, 1)):
        read.clear()
        look(cube)  # type: ignore[operator]
        assert read == [cube] * times, look


def test_a_summary_of_a_path_is_what_is_kept_and_that_of_a_tree_is_the_same(
    cube: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_the_tree = mc.summary(mc.open_results(cube))
    show(cube)
    monkeypatch.setattr(results, "open_results", lambda *_, **__: pytest.fail("computed again"))
    of_the_path = mc.summary(cube)
    assert repr(of_the_path) == repr(of_the_tree)
    assert of_the_path.to_dict() == of_the_tree.to_dict()
    monkeypatch.undo()
    assert of_the_path._repr_html_() == of_the_tree._repr_html_()


def test_a_page_is_drawn_once(cube: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mcstudy.report.page import page
    from mcstudy.report.study import page as study_page

    first = page(cube)
    monkeypatch.setattr(study_page, "_page", lambda *_: pytest.fail("drawn again"))
    assert page(cube) == first
    with pytest.raises(pytest.fail.Exception, match="drawn again"):
        page(cube, [cube])
