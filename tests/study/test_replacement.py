"""A cube that is replaced by a larger one while it is read is read again, and is never called damaged."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import command

import mcstudy as mc
from mcstudy.errors import StoreError
from mcstudy.exits import Exit
from mcstudy.files.durable import tree_digest
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study import replay, verify
from mcstudy.study.cube import store
from mcstudy.study.cube.repair import repair
from mcstudy.study.cube.store import Cube, GroupStore
from mcstudy.study.extend import Growth, extend
from mcstudy.study.watch import Watch

pytestmark = pytest.mark.usefixtures("small_chunks")
ONE = ClusterOptions(workers=1)
GROWTH = Growth(realizations=7, amplitude=(1.0,))
"""The first amplitude is another one then, and so is every chunk."""


@pytest.fixture
def out(tiny_copy: Path) -> Path:
    return tiny_copy


def grow(out: Path, growth: Growth = GROWTH) -> None:
    """Extend a cube and say nothing."""
    with contextlib.redirect_stderr(io.StringIO()):
        extend(out, growth, ONE)


def once(monkeypatch: pytest.MonkeyPatch, place: Any, name: str, act: Callable[[], object], after: int = 0) -> None:
    """Do something in the middle of the call of a function that is the first one after some others."""
    honest, calls = getattr(place, name), []

    def acting(*args: Any, **kwargs: Any) -> Any:
        calls.append(name)
        if len(calls) == after + 1:
            act()
        return honest(*args, **kwargs)

    monkeypatch.setattr(place, name, acting)


CELL = ("--realization", "1", "--start", "2", "--fmax", "1.2", "--amplitude", "5")
READERS: dict[str, tuple[tuple[Any, str, int], tuple[str, ...]]] = {
    "verify, after its study was read": ((verify, "skeleton", 0), ("verify", "OUT", "--cells", "2")),
    "verify, in the middle of the chunks": ((GroupStore, "seal", 9), ("verify", "OUT", "--cells", "2")),
    "verify, before fits are repeated": ((verify, "again", 0), ("verify", "OUT", "--cells", "2")),
    "show": ((store, "describe", 1), ("show", "OUT", "--json")),
    "status": ((GroupStore, "status", 1), ("status", "OUT", "--json")),
    "report": ((store, "describe", 1), ("report", "OUT", "-o", "PAGE")),
    "replay": ((replay, "again", 0), ("replay", "OUT", "--group", "noisy", *CELL)),
}


@pytest.mark.parametrize("reader", READERS)
def test_a_command_that_spans_an_extension_says_what_it_says_after_it(
    out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reader: str
) -> None:
    (place, name, after), words = READERS[reader]
    words = tuple({"OUT": str(out), "PAGE": str(tmp_path / "page.html")}.get(word, word) for word in words)
    with monkeypatch.context() as patch:
        once(patch, place, name, lambda: grow(out), after)
        during = command(*words)
    assert len(Cube.open(out).study.groups["noisy"].amplitude) == 3, "it was not extended meanwhile"
    assert during[0] == Exit.DONE
    assert during == command(*words)


@pytest.mark.parametrize("lazy", [False, True])
def test_results_that_are_opened_during_an_extension_are_those_after_it(
    out: Path, monkeypatch: pytest.MonkeyPatch, lazy: bool
) -> None:
    with monkeypatch.context() as patch:
        once(patch, GroupStore, "__init__", lambda: extend(out, GROWTH, ONE), 1)
        found = mc.open_results(out, lazy=lazy)
    assert found["noisy"].sizes["realization"] == 7
    assert found["noisy"].identical(mc.open_results(out, lazy=lazy)["noisy"])


def test_results_that_are_read_after_an_extension_say_that_they_must_be_opened_again(out: Path) -> None:
    tree = mc.open_results(out)
    extend(out, GROWTH, ONE)
    with pytest.raises(StoreError, match=r"replaced by another cube since it was opened; open it again"):
        tree["noisy"]["estimate"].values  # noqa: B018
    assert np.isfinite(mc.open_results(out)["noisy"]["estimate"].values).all()


def test_results_stay_open_when_the_root_of_their_cube_is_repaired(out: Path) -> None:
    tree, whole = mc.open_results(out), mc.open_results(out, lazy=False)
    root = out / "zarr.json"
    root.write_bytes(root.read_bytes() + b" ")
    repair(out, Cube.open(out).study)
    assert tree["noisy"].load().identical(whole["noisy"])


def test_a_cube_that_is_replaced_every_time_is_one_line(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, totals = verify.skeleton, iter(range(6, 100))

    def growing(*args: Any) -> Any:
        grow(out, Growth(realizations=next(totals)))
        return real(*args)

    monkeypatch.setattr(verify, "skeleton", growing)
    code, _, error = command("verify", out, "--cells", "0")
    assert code == Exit.BAD_INPUT
    assert "replaced 4 times while it was read" in error
    assert error.count("\n") == 1


def test_damage_is_damage_though_the_cube_is_read_carefully(out: Path) -> None:
    cube = Cube.open(out).groups["noisy"]
    cube.chunk_file("estimate", cube.layout.chunks[0]).unlink()
    code, said, _ = command("verify", out)
    assert code == Exit.DIFFERS
    assert said.count("damage: ") == 1


def test_a_chunk_that_is_written_while_it_is_verified_is_sound(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cube = Cube.open(out).groups["noisy"]
    chunk = cube.layout.chunks[0]
    data, before = cube.existing(chunk), tree_digest(out)
    data["cost"][:] *= 1.5  # other numbers, as of fits that were pending
    once(monkeypatch, GroupStore, "seal", lambda: cube.write(chunk, data), 3)
    assert verify.verify(out, cells=0).damage == []
    assert tree_digest(out) != before


def test_status_watch_follows_a_cube_that_grows(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    once(monkeypatch, Watch, "look", lambda: grow(out))
    code, said, _ = command("status", out, "--watch", "--every", "0.1")
    fits = Cube.open(out).study.fits
    assert code == Exit.DONE
    assert f"{fits}/{fits} fits" in said
    assert "damaged" not in said
