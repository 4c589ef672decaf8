"""Every file of a cube, damaged in every way: never other numbers in silence, always named, repaired or set aside.

The cube is the smallest that has every kind of file: metadata of root, group and array, coordinates, constants, text,
and two chunks of every result with their checksums. Runs are those of a worker, without a cluster around it: what is
repaired and what is computed again is decided before one is started.

Every file is damaged in some of the ways, and every way is tried on files of every kind; ``MCSTUDY_FUZZ=1 pytest
tests/study/test_mutations.py`` damages every file in every way.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
from fuzzing import MANY
from skeletons import made_once
from two_chunks import TWO_CHUNKS

from mcstudy.analysis.results import open_results
from mcstudy.errors import InputError, StoreError
from mcstudy.files.durable import log_folder, tree_digest
from mcstudy.study import verify
from mcstudy.study.cube.store import Cube
from mcstudy.study.execution.tasks import Task, run_task
from mcstudy.study.run import run_study


@pytest.fixture(scope="module")
def sound(two_chunks: Path) -> Iterator[Path]:
    with made_once():
        yield two_chunks


class InProcess:
    """What a run hands its blocks to, without a cluster: each is filled as a worker fills it."""

    def __init__(self, cube: Cube, client: Any, options: Any, run: Any) -> None:
        del client, options
        self.cube, self.id, self.warned = cube, run.id, set[str]()

    def run(self, blocks: Any) -> list[Any]:
        for b in blocks:
            study, depth = self.cube.study.to_json(), self.cube.depths[b.group]
            run_task(Task(self.id, str(self.cube.path), study, b.group, depth, b.chunks))
        return []


@pytest.fixture(autouse=True)
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mcstudy.study.run.connect", lambda *_: contextlib.nullcontext())
    monkeypatch.setattr("mcstudy.study.run.Submission", InProcess)


def files_of(out: Path) -> list[Path]:
    return sorted(p for p in out.rglob("*") if p.is_file())


def kind(file: Path) -> str:
    """Files of one kind are neighbours: of one array, or of all arrays where an array has only one of the kind."""
    alone = len([f for f in file.parent.iterdir() if f.suffix == file.suffix and f.name != "zarr.json"]) < 3
    if file.name == "zarr.json":
        return file.name
    return file.suffix if file.suffix == ".checksums" else "constant" if alone else str(file.parent)


def neighbour(file: Path, files: list[Path]) -> Path:
    """The next file of the same kind."""
    same = [f for f in files if kind(f) == kind(file)]
    return same[(same.index(file) + 1) % len(same)]


def delete(file: Path) -> None:
    file.unlink()


def truncate(file: Path) -> None:
    content = file.read_bytes()
    file.write_bytes(content[: len(content) * 2 // 3])


def flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)


def become_a_folder(file: Path) -> None:
    content = file.read_bytes()
    file.unlink()
    file.mkdir()
    (file / file.name).write_bytes(content)


def rename_in_case(file: Path) -> None:
    file.rename(file.with_name(file.name.swapcase()))


def swap(one: Path, other: Path) -> None:
    a, b = one.read_bytes(), other.read_bytes()
    one.write_bytes(b)
    other.write_bytes(a)


def swap_with_neighbour(file: Path) -> None:
    swap(file, neighbour(file, files_of(next(p for p in file.parents if p.name == "out.zarr"))))


ALIKE = {"initial": "estimate", "estimate": "initial", "cost": "growth_rate", "growth_rate": "cost"}
"""Arrays that are alike in all but their names."""


def swap_with_another_array(file: Path) -> None:
    swap(file, file.parent.parent / ALIKE[file.parent.name] / file.name)


def replace_by_neighbour(file: Path) -> None:
    """A copy that went to the wrong place."""
    file.write_bytes(neighbour(file, files_of(next(p for p in file.parents if p.name == "out.zarr"))).read_bytes())


MUTATIONS = [
    delete,
    truncate,
    flip,
    become_a_folder,
    rename_in_case,
    swap_with_neighbour,
    swap_with_another_array,
    replace_by_neighbour,
]


def damaged_by(mutation: Callable[[Path], None], files: list[Path]) -> list[Path]:
    """Files on which a mutation is tried."""
    if mutation is swap_with_another_array:
        return [file for file in files if file.parent.name in ALIKE and file.name != "zarr.json"]
    first = MUTATIONS.index(mutation)
    return [file for i, file in enumerate(files) if (first + i + i // EVERY) % EVERY == 0]


def read(out: Path) -> dict[str, xr.Dataset] | str:
    """All data of all groups, or the one line with which they are refused."""
    try:
        tree = open_results(out, lazy=False)
    except InputError as error:
        said = str(error)
        assert "\n" not in said
        assert str(out) in said
        return said
    return {name: node.to_dataset().assign_attrs(tree.attrs) for name, node in tree.children.items()}


def unnamed(out: Path, sound: Path) -> str:
    """What is wrong with what `verify` says: it names every changed file, or one when it can go no further."""
    changed = [
        file
        for file in (out / f.relative_to(sound) for f in files_of(sound))
        if not file.is_file() or file.read_bytes() != (sound / file.relative_to(out)).read_bytes()
    ]
    try:
        verdict = verify.verify(out, cells=0)
    except StoreError as error:
        return "" if any(str(file) in str(error) for file in changed) else f"verify refuses with {error}"
    said = "\n".join((*verdict.damage, *verdict.notes))
    missed = [str(file) for file in changed if str(file) not in said]
    return f"verify does not name {missed}, but says {said}" if missed else ""


EVERY = 1 if MANY else 3
"""Of so many neighbouring files one is damaged in each way: another one in the next way, and of the next neighbours,
since many arrays have three files."""

REPAIRED = ("zarr.json", "noisy/zarr.json", "noisy/fmax", "noisy/parameter", "noisy/estimate", "noisy/status")
"""Files, or folders of files, that a run repairs here: of metadata and constants one of each kind, since what is wrong
with them is all found by one comparison of bytes; of results every chunk of the arrays that matter most."""


def check_case(sound: Path, before: Any, digest: str, out: Path, file: Path, said: Callable[[], str]) -> Iterator[str]:
    """What is wrong with the program after a mutation of ``file``, one line each."""
    now = read(out)
    if not isinstance(now, str) and not all(now[name].identical(before[name]) for name in before):
        yield "other numbers in silence"
    if what := unnamed(out, sound):
        yield what
    if not file.relative_to(out).as_posix().startswith(REPAIRED):
        return
    run_study(TWO_CHUNKS, out)
    told = said()
    if tree_digest(out) != digest:
        for line in verify.verify(out, cells=0).damage:
            if line not in told or "--quarantine" not in line:
                yield f"run leaves, and does not say what to do about: {line}"
        run_study(TWO_CHUNKS, out, quarantine=True)
    if tree_digest(out) != digest:
        yield f"not repaired: {verify.verify(out, cells=0)}"


@pytest.mark.parametrize("mutation", MUTATIONS)
def test_a_mutated_file_is_never_other_numbers_is_named_and_is_repaired(
    sound: Path, tmp_path: Path, mutation: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    before, digest = read(sound), tree_digest(sound)
    wrong, tried = [], 0
    for k, original in enumerate(damaged_by(mutation, files_of(sound))):
        out = shutil.copytree(sound, tmp_path / str(k) / "out.zarr")
        shutil.copytree(log_folder(sound), log_folder(out))
        file = out / original.relative_to(sound)
        mutation(file)
        capsys.readouterr()
        changed = tree_digest(out) != digest  # equal bytes may have changed places
        tried += changed
        for line in check_case(sound, before, digest, out, file, lambda: capsys.readouterr().err) if changed else ():
            wrong.append(f"{file.relative_to(out)}: {line}")
        shutil.rmtree(out.parent)
    assert tried >= 8
    assert not wrong, "\n".join(wrong)
