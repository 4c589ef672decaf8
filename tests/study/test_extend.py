"""A study that grows is the study that was large from the beginning, and never loses what it had."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest
import quick_solver

from mcstudy.errors import DesignError, Interrupted, StoreError, StudyChangedError
from mcstudy.files import durable
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube.store import Cube, GroupStore
from mcstudy.study.extend import Growth, extend, grow, grown_study
from mcstudy.study.growth import growths
from mcstudy.study.run import open_or_create, run_study
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify

ONE = ClusterOptions(workers=1)

STARTS = """
[group.sobol]
realizations = 3
starts = 3
fmax = [1.2]
amplitude = [5.0]
fit.starts = "sobol"

[group.linearised]
realizations = 2
starts = 2
fmax = [1.2]
amplitude = [5.0]
fit.starts = "linearised"
fit.cost = "ml"
"""


@pytest.fixture(autouse=True, scope="module")
def small() -> Iterator[None]:
    """Chunks of about 24 fits, so that a tiny study has many."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(*quick_solver.lm(fits_a_chunk=(24, 24)))
        yield


@pytest.fixture
def out(tmp_path: Path, tiny_cube: Path) -> Path:
    """A small study, run, without its log."""
    return shutil.copytree(tiny_cube, tmp_path / "out.zarr")


@pytest.fixture(scope="module")
def at_once(tmp_path_factory: pytest.TempPathFactory, small: None) -> Callable[[str], str]:  # noqa: ARG001
    """Digest of a study that was run in one go."""

    @cache
    def digest(text: str) -> str:
        whole = tmp_path_factory.mktemp("whole") / "whole.zarr"
        run_study(parse_study(text), whole, ONE)
        return durable.tree_digest(whole)

    return digest


@pytest.mark.parametrize(
    ("growth", "edit"),
    [
        (Growth(realizations=9), ("realizations = 5", "realizations = 9")),
        (Growth(starts=11, groups=("noisy",)), ("starts = 6", "starts = 11")),
        (Growth(fmax=(0.8,), groups=("noisy",)), ("fmax = [0.41, 1.2]", "fmax = [0.41, 1.2, 0.8]")),
        (Growth(amplitude=(4.0, 1.0), groups=("noisy",)), ("[3.0, 5.0]", "[1.0, 3.0, 4.0, 5.0]")),
    ],
)
def test_one_axis_grows_and_only_new_cells_are_run(
    out: Path, at_once: Callable[[str], str], tiny: str, growth: Growth, edit: tuple[str, str]
) -> None:
    text = tiny.replace(*edit)
    if growth.realizations:
        text = text.replace("realizations = 2", "realizations = 9")
    large = parse_study(text)
    outcome = extend(out, growth, ONE)
    assert (outcome.fits, outcome.skipped) == (large.fits - 128, 128)
    assert durable.tree_digest(out) == at_once(large.to_toml())
    assert sorted(p.name for p in out.parent.iterdir()) == ["out.zarr", "out.zarr.log"]


def test_all_axes_grow_at_once_also_with_starts_from_data(
    tmp_path: Path, at_once: Callable[[str], str], tiny: str
) -> None:
    text, out = tiny + STARTS, tmp_path / "out.zarr"
    run_study(parse_study(text), out, ONE)
    growth = Growth(realizations=7, starts=8, fmax=(2.0,), amplitude=(8.0,))
    before, large = parse_study(text), grown_study(parse_study(text), growth)
    assert extend(out, growth, ONE).fits == large.fits - before.fits
    assert durable.tree_digest(out) == at_once(large.to_toml())


REALIZATIONS, STARTS_TOO = Growth(realizations=7), Growth(starts=8, groups=("noisy",))
FMAX, AMPLITUDE = Growth(fmax=(0.8, 2.0), groups=("noisy",)), Growth(amplitude=(8.0, 1.0, 4.0), groups=("noisy",))
MIXED = Growth(realizations=7, fmax=(2.0,), amplitude=(4.0,), groups=("noisy",))


@pytest.mark.parametrize(
    "steps",
    [
        (REALIZATIONS, STARTS_TOO, FMAX, AMPLITUDE),
        (MIXED, STARTS_TOO, AMPLITUDE, FMAX, REALIZATIONS),
    ],
    ids=["one by one", "mixed, in another order"],
)
def test_the_order_of_extensions_leaves_no_trace(
    out: Path, at_once: Callable[[str], str], tiny: str, steps: tuple[Growth, ...]
) -> None:
    study = parse_study(tiny)
    for step in steps:
        extend(out, step, ONE)
        study = grown_study(study, step)
    assert durable.tree_digest(out) == at_once(study.to_toml())
    assert verify(out, cells=4).damage == []


def test_a_half_done_and_damaged_cube_grows_too(out: Path, at_once: Callable[[str], str], tiny: str) -> None:
    store = Cube.open(out).groups["noisy"]
    first, second, third = store.layout.chunks[:3]
    store.chunk_file("status", first).unlink()
    store.chunk_file("cost", second).write_bytes(b"broken")
    half = store.existing(third)
    for name, values in store.layout.empty(third).items():
        if store.layout.arrays[name].dims[3:4] == ("start",):
            half[name][:, :, :, 2:] = values[:, :, :, 2:]
    store.write(third, half)
    growth = Growth(realizations=8, groups=("noisy",))
    lost = store.layout.fits(first) + store.layout.fits(second) + store.layout.fits(third) * 4 // 6
    assert extend(out, growth, ONE).fits == 72 + lost
    assert durable.tree_digest(out) == at_once(grown_study(parse_study(tiny), growth).to_toml())


@pytest.mark.parametrize("moment", ["create", "copy", "replace", "run"])
def test_an_interrupted_extension_loses_nothing_and_resumes(
    out: Path, at_once: Callable[[str], str], tiny: str, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    before = durable.tree_digest(out)
    growth = Growth(realizations=8, groups=("noisy",))
    write, copied = GroupStore.write, iter(range(2))

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    def stop_after_two(self: GroupStore, chunk: object, data: object, *environments: object) -> None:
        if next(copied, None) is None:
            raise KeyboardInterrupt
        write(self, chunk, data, *environments)  # type: ignore[arg-type]

    def full(self: GroupStore, chunk: object, data: object, *environments: object) -> None:
        if self.path.parent == out:
            raise OSError(28, "No space left on device")
        write(self, chunk, data, *environments)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        if moment == "create":
            patch.setattr("mcstudy.study.cube.store.sync_tree", stop)
        elif moment == "copy":
            patch.setattr(GroupStore, "write", stop_after_two)
        elif moment == "replace":
            patch.setattr("mcstudy.study.extend.replace_tree", stop)
        else:
            patch.setattr(GroupStore, "write", full)
        with pytest.raises((KeyboardInterrupt, Interrupted)):
            extend(out, growth, ONE)
    assert verify(out, cells=0).damage == []
    if moment != "run":
        assert durable.tree_digest(out) == before
    assert extend(out, growth, ONE).skipped == 128
    assert durable.tree_digest(out) == at_once(grown_study(parse_study(tiny), growth).to_toml())
    assert not list(out.parent.glob(".*"))


def test_a_cube_that_grew_and_lost_its_root_before_the_log_knew_is_the_larger_studys(
    out: Path, tiny_cube: Path, at_once: Callable[[str], str], tiny: str
) -> None:
    """Killed between the exchange of the folders and the next line of the log, which still tells of the small study."""
    larger = tiny.replace("realizations = 5", "realizations = 6").replace("starts = 6", "starts = 7")
    shutil.copytree(durable.log_folder(tiny_cube), durable.log_folder(out))
    grow(Cube.open(out), Growth(6, 7, groups=("noisy",)))
    (out / "zarr.json").unlink()
    before = durable.tree_digest(out)
    with pytest.raises(StoreError, match="expected a results cube"):
        run_study(parse_study(tiny), out, ONE)
    assert durable.tree_digest(out) == before
    assert run_study(parse_study(larger), out, ONE).skipped == 128
    assert durable.tree_digest(out) == at_once(larger)


def test_a_cube_that_has_only_grown_is_sound_with_more_to_do(out: Path) -> None:
    """Killed before any of the new fits: new starts of realizations that are otherwise done are not even drawn."""
    grow(Cube.open(out), Growth(starts=9, groups=("noisy",)))
    found = verify(out)
    assert (found.damage, found.pending) == ([], 5 * 3 * 2 * 2)
    assert found.recomputed > 0


def test_a_cube_whose_metadata_were_edited_grows_from_what_they_were(
    out: Path, at_once: Callable[[str], str], tiny: str
) -> None:
    root = out / "zarr.json"
    document = json.loads(root.read_text())
    document["attributes"]["environment"]["machine"] = "abacus"
    root.write_text(json.dumps(document))
    extend(out, Growth(6, groups=("noisy",)), ONE)
    assert durable.tree_digest(out) == at_once(tiny.replace("realizations = 5", "realizations = 6"))


def test_growing_by_nothing_changes_nothing(out: Path) -> None:
    before = durable.tree_digest(out)
    assert extend(out, Growth(realizations=5, groups=("noisy",)), ONE).fits == 0
    assert durable.tree_digest(out) == before


@pytest.mark.parametrize(
    ("growth", "expected"),
    [
        (Growth(realizations=4), r"group\.noisy\.realizations: expected at least 5"),
        (Growth(realizations=0), r"group\.noisy\.realizations: expected at least 5, the number in the cube, got 0"),
        (Growth(starts=0), r"group\.noisy\.starts: expected at least 6, the number in the cube, got 0"),
        (Growth(realizations=10**30), r"group\.noisy\.realizations: expected at most"),
        (Growth(fmax=(1e300,)), r"group\.noisy\.fmax\.2: expected a number from"),
        (Growth(amplitude=(1e308,)), r"group\.noisy\.amplitude\.2: expected a number from"),
        (Growth(amplitude=(1e-30,)), r"group\.noisy\.amplitude\.0: expected a number from"),
        (Growth(groups=("loud",)), r"group: expected one of noisy, ideal, got loud"),
        (Growth(fmax=(0.001,)), r"group\.noisy\.fmax: expected at least"),
        (Growth(amplitude=(-1.0,)), r"group\.noisy\.amplitude"),
        (Growth(fmax=(float("nan"),)), r"fmax"),
    ],
)
def test_what_cannot_grow_is_one_line(tiny: str, growth: Growth, expected: str) -> None:
    with pytest.raises(DesignError, match=expected) as caught:
        grown_study(parse_study(tiny), growth)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("edits", "commands"),
    [
        ([("realizations = 5", "realizations = 8")], ["--realizations 8 --group noisy"]),
        (
            [("realizations = 5", "realizations = 8"), ("realizations = 2", "realizations = 3")],
            ["--realizations 8 --group noisy", "--realizations 3 --group ideal"],
        ),
        ([("starts = 6", "starts = 9"), ("starts = 4", "starts = 9")], ["--starts 9"]),
        (
            [("[3.0, 5.0]", "[3.0, 5.0, 9.0]"), ("[0.41, 1.2]", "[0.41, 1.2, 8.0]")],
            ["--fmax 8.0 --amplitude 9.0 --group noisy"],
        ),
    ],
)
def test_a_larger_study_file_is_told_the_command_that_grows_the_cube(
    tiny: str, tmp_path: Path, edits: list[tuple[str, str]], commands: list[str]
) -> None:
    path, text = tmp_path / "out.zarr", tiny
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    small, large = Cube.create(path, parse_study(tiny)).study, parse_study(text)
    with pytest.raises(StudyChangedError, match=r"was made with group\..* = .*, not .*; to grow it: ") as refused:
        open_or_create(path, large)
    assert str(refused.value).endswith(" && ".join(f"mcstudy extend {path} {words}" for words in commands))
    steps = growths(small, large)
    assert steps is not None
    for step in steps:
        small = grown_study(small, step)
    assert small == large
    path.rename(tmp_path / "old.zarr")
    Cube.create(path, large)
    with pytest.raises(StudyChangedError, match=r"was extended: it has group\..*, and holds all") as refused:
        open_or_create(path, parse_study(tiny))
    assert str(refused.value).endswith(
        f"to see it: mcstudy show {path}; to run what is pending in it: mcstudy extend {path}"
    )
    assert "\n" not in str(refused.value)


def test_a_change_that_is_no_growth_is_told_no_command(tiny: str, tmp_path: Path) -> None:
    lhs = "[fit]\nstarts = 'latin_hypercube'\n"
    for before, after in (
        (tiny, tiny.replace("seed = 7", "seed = 8")),
        (tiny, tiny.replace("realizations = 5", "realizations = 8").replace("starts = 6", "starts = 5")),
        (tiny + lhs, tiny.replace("starts = 6", "starts = 9") + lhs),
    ):
        Cube.create(tmp_path / "out.zarr", parse_study(before))
        with pytest.raises(StudyChangedError, match="was made with another study file: ") as refused:
            open_or_create(tmp_path / "out.zarr", parse_study(after))
        assert "mcstudy extend" not in str(refused.value)
        shutil.rmtree(tmp_path / "out.zarr")


def test_latin_hypercube_starts_do_not_grow_but_the_rest_does(tiny: str) -> None:
    study = parse_study(tiny + '[fit]\nstarts = "latin_hypercube"\n')
    with pytest.raises(DesignError, match="Latin hypercube starts depend on their number"):
        grown_study(study, Growth(starts=100))
    assert grown_study(study, Growth(realizations=100)).groups["noisy"].realizations == 100


@pytest.mark.parametrize("exchange", [True, False])
def test_a_folder_takes_the_place_of_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exchange: bool) -> None:
    if not exchange:
        monkeypatch.setattr(durable, "_exchange", lambda *_: False)
    old, new = tmp_path / "old", tmp_path / "new"
    for folder in (old, new):
        folder.mkdir()
        (folder / "name").write_text(folder.name)
    durable.replace_tree(old, new)
    assert [p.name for p in tmp_path.iterdir()] == ["old"]
    assert (old / "name").read_text() == "new"


@pytest.mark.parametrize("step", [1, 2])
def test_a_kill_between_two_renames_is_recovered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int) -> None:
    monkeypatch.setattr(durable, "_exchange", lambda *_: False)
    old, new = tmp_path / "old", tmp_path / "new"
    for folder in (old, new):
        folder.mkdir()
        (folder / "name").write_text(folder.name)
    rename, renamed, remove = Path.rename, iter(range(step)), durable.shutil.rmtree

    def killed_before_rename(self: Path, target: Path) -> Path:
        if next(renamed, None) is None:
            raise KeyboardInterrupt
        return rename(self, target)

    def killed_before_removal(path: Path, ignore_errors: bool) -> None:
        if path.exists():
            raise KeyboardInterrupt
        remove(path, ignore_errors=ignore_errors)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", killed_before_rename)
        patch.setattr(durable.shutil, "rmtree", killed_before_removal)
        with pytest.raises(KeyboardInterrupt):
            durable.replace_tree(old, new)
    durable.recover(old)
    assert (old / "name").read_text() == ("old" if step == 1 else "new")
    assert not list(tmp_path.glob(".*"))
