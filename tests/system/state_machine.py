"""Anything that may happen to a cube, in any order: run, kill, extend, damage, verify, run again.

    python tests/system/state_machine.py

Processes are forked from this one (see `forked`), so nothing but this may run in it. After every resume the tree has
the digest of a study that was never interrupted; `verify` names every damaged file and no other; and what was finished
at one look is there at the next, unless it was damaged in between. ``MCSTUDY_STATES=200`` tries that many histories,
longer ones and new ones each time; without it a few short ones, always the same.
"""

from __future__ import annotations

import logging
import os
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import forked
from forked import DONE, MEMORY, REFUSED, DieAtLine, answer, ended, fork
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule, run_state_machine_as_test
from kill_campaign import WRITERS

from mcstudy.errors import StoreError
from mcstudy.files import durable
from mcstudy.files.durable import PARTIAL, tree_digest
from mcstudy.fitting.solvers import solvers
from mcstudy.fitting.status import Status
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study import extend, run, verify
from mcstudy.study.cube import layout, run_log
from mcstudy.study.cube.store import ChunkState, Cube
from mcstudy.study.execution import tasks
from mcstudy.study.study_file import parse_study

TEXT = """
[study]
name = "states"
seed = 3

[group.noisy]
realizations = {}
starts = {}
fmax = [0.41]
amplitude = [5.0]
"""
ONE = ClusterOptions(workers=1)
SIZES = ((4, 4), (6, 4), (6, 6))
"""Realizations and starts: how the cube grows."""
STUDIES = [parse_study(TEXT.format(*size)) for size in SIZES]
MANY = os.environ.get("MCSTUDY_STATES")
SETTINGS = settings(
    max_examples=int(MANY or 4),
    stateful_step_count=20 if MANY else 6,
    derandomize=MANY is None,
    database=None,
    deadline=None,
    print_blob=False,
    report_multiple_bugs=False,
    suppress_health_check=list(HealthCheck),
    phases=(Phase.generate,),  # to make a failing history shorter takes longer than to read it
)

part = st.integers(0, 999).map(lambda n: n / 1000)
"""A place in a list whose length only the history knows."""


TRIED: Counter[str] = Counter()
"""What has happened so far."""


HOW = st.sampled_from(["flip", "cut", "delete"])


class Whole:
    """What is computed once: cubes nothing happened to, and the lines between which a process may die."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        first = STUDIES[0]
        warm = Cube.create(folder / "warm.zarr", first)
        self.skeleton = {p.relative_to(warm.path) for p in warm.path.rglob("*") if p.is_file()}
        (store,) = warm.groups.values()
        chunk = store.layout.chunks[0]
        tasks.fill(store.experiment, store.layout, chunk, store.layout.empty(chunk))  # compiled once, before any fork
        self.digests = []
        for k, study in enumerate(STUDIES):
            out = folder / f"{k}.zarr"
            assert ended(fork(partial(run.run_study, study, out, ONE))) == DONE
            self.digests.append(tree_digest(out))
        cubes = (folder / "lines.zarr", folder / "0.zarr")
        works = (partial(run.run_study, first, cubes[0], ONE), partial(extend.extend, cubes[1], growth(1), ONE))
        self.lines = [self.ask(partial(count_lines, work)) for work in works]

    def ask(self, work: Callable[[], object]) -> Any:
        """What ``work`` returns, computed in a process of its own."""
        return answer(work, self.folder / "answer.json")


def growth(size: int) -> extend.Growth:
    """Up to one of the sizes."""
    return extend.Growth(*SIZES[size])


def count_lines(work: Callable[[], object]) -> list[tuple[str, int, int]]:
    """File, line, and how often it is reached."""
    with DieAtLine(WRITERS) as counted:
        work()
    return [(*place, n) for place, n in sorted(counted.reached.items())]


def look(out: Path) -> dict[str, Any]:
    """Size of the cube (None without one), finished fits by realization, and chunks reported complete that are not."""
    durable.recover(out)
    if not out.exists():
        return {"size": None, "done": {}, "gone": []}
    cube = Cube.open_unchecked(out)
    size = [study.fingerprint for study in STUDIES].index(cube.study.fingerprint)
    (store,) = cube.groups.values()
    done = {}
    for chunk in store.layout.chunks:
        if store.state(chunk) is not ChunkState.BROKEN:
            finished = store.read("status", chunk)[0] != Status.PENDING
            for r, realization in enumerate(store.layout.realizations(chunk)):
                done[str(realization)] = int(finished[:, r].sum())
    told = [layout.Chunk(a, b) for _, a, b in run_log.reported(out, cube.study.fingerprint)]
    gone = [store.layout.key("status", chunk) for chunk in told if store.pending(chunk)]
    return {"size": size, "done": done, "gone": gone}


def named(out: Path) -> list[str]:
    """Lines of `verify`, or the one that says why there are none."""
    try:
        return verify.verify(out, cells=1).damage
    except StoreError as error:
        return [f"REFUSED {error}"]


class States(RuleBasedStateMachine):
    """A cube and what is known of it: its size, damaged files, and fits that were finished at the last look."""

    whole: Whole

    def __init__(self) -> None:
        super().__init__()
        TRIED["histories"] += 1
        self.folder = Path(tempfile.mkdtemp(dir=self.whole.folder))
        self.out = self.folder / "out.zarr"
        self.size: int | None = None
        self.damaged: dict[Path, bytes | None] = {}
        self.redone: set[Path] = set()
        self.done: dict[str, int] = {}

    @initialize(kills=st.tuples(part, part, st.booleans()), damage=st.tuples(part, part, HOW))
    def ending(self, kills: tuple[float, float, bool], damage: tuple[float, float, str]) -> None:
        """How the history is going to end."""
        self.end = kills, damage

    def teardown(self) -> None:
        """Every history ends in kills, damage, a look and a resume, so that nothing that went wrong goes unseen."""
        kills, damage = self.end
        self.kill_an_extension(2, *kills)
        self.corrupt(*damage, chunk=True)
        self.corrupt(*damage, chunk=False)
        self.verify()
        self.kill_a_run(*kills)
        self.run_to_the_end()
        shutil.rmtree(self.folder)

    @rule()
    def run_to_the_end(self) -> None:
        """First run, resume and repair are the same call."""
        size = self.size or 0
        if self.nameless(size):
            return
        assert ended(fork(self.running(size))) == DONE
        self.finished(size)

    @rule(to=st.integers(1, 2))
    def extend_to(self, to: int) -> None:
        """Also of a cube that is not finished, or damaged; one that cannot be opened is refused untouched."""
        if self.size is None:
            return
        before, to = tree_digest(self.out), max(to, self.size)
        code = ended(fork(self.growing(to)))
        if code == REFUSED and any(self.in_skeleton(file) for file in self.damaged):
            assert tree_digest(self.out) == before
            return
        assert code == DONE
        self.finished(to)

    @rule(at=part, visit=part, often=st.booleans())
    def kill_a_run(self, at: float, visit: float, often: bool) -> None:
        size = self.size or 0
        if not self.nameless(size):
            self.kill(self.running(size), 0, at, visit, often, size)

    @rule(to=st.integers(1, 2), at=part, visit=part, often=st.booleans())
    def kill_an_extension(self, to: int, at: float, visit: float, often: bool) -> None:
        """Of a cube whose metadata is whole: others may be refused."""
        if self.size is not None and not any(self.in_skeleton(file) for file in self.damaged):
            to = max(to, self.size)
            self.kill(self.growing(to), 1, at, visit, often, to)

    @rule(which=part, where=part, how=HOW)
    def corrupt_a_chunk(self, which: float, where: float, how: str) -> None:
        self.corrupt(which, where, how, chunk=True)

    @rule(which=part, where=part, how=HOW)
    def corrupt_the_rest(self, which: float, where: float, how: str) -> None:
        self.corrupt(which, where, how, chunk=False)

    def corrupt(self, which: float, where: float, how: str, chunk: bool) -> None:
        """A bit, the end, or all of one file, of a chunk or not."""
        if self.size is None:
            self.run_to_the_end()
        files = [f for f in self.files() if f not in self.damaged and self.in_skeleton(f) != chunk]
        if not files:
            return
        file = files[int(which * len(files))]
        content = bytearray(file.read_bytes())
        place = int(where * len(content))
        if how == "delete":
            file.unlink()
        elif how == "cut":
            file.write_bytes(content[:place])
        else:
            content[place] ^= 1 << int(where * 1000) % 8
            file.write_bytes(content)
        TRIED["files damaged"] += 1
        self.damaged[file] = self.content(file)
        if chunk:
            self.redone.add(self.status_of(file))
            self.done = {r: n for r, n in self.done.items() if int(r) // self.depth != self.block(file)}

    @rule()
    def verify(self) -> None:
        """Every damaged file is named, and nothing else; files that nobody ever said were there are not missed."""
        if self.size is None:
            return
        TRIED["looks by verify"] += 1
        lines = self.whole.ask(partial(named, self.out))
        root = self.out / "zarr.json"
        if lines and lines[0].startswith("REFUSED"):
            assert root in self.damaged, lines
            return
        told = self.reported()
        for file in self.damaged:
            status = self.status_of(file)
            if file.suffix == ".checksums" and not file.exists() and status.name not in told:
                continue  # a note like that of a run that was stopped, which has none
            if self.in_skeleton(file) or status.exists() or (file == status and file.name in told):
                assert any(line.startswith(f"{file}: ") for line in lines), (file, lines)
        for line in lines:
            assert self.blames_a_damaged_file(line), (line, sorted(self.damaged))

    # What the rules are made of.

    @property
    def depth(self) -> int:
        """Realizations a chunk; as the layout of the studies asks for."""
        assert self.size is not None
        return layout.realizations_a_chunk(STUDIES[self.size].groups["noisy"])

    def running(self, size: int) -> Callable[[], object]:
        return partial(run.run_study, STUDIES[size], self.out, ONE)

    def growing(self, to: int) -> Callable[[], object]:
        return partial(extend.extend, self.out, growth(to), ONE)

    def files(self) -> list[Path]:
        return sorted(p for p in self.out.rglob("*") if p.is_file() and p.suffix != PARTIAL)

    def content(self, file: Path) -> bytes | None:
        return file.read_bytes() if file.exists() else None

    def in_skeleton(self, file: Path) -> bool:
        """Whether a file is there before any fit: metadata, coordinates, constants."""
        return file.relative_to(self.out) in self.whole.skeleton

    def block(self, file: Path) -> int:
        """Which chunk of realizations a file of results belongs to: data have no Fmax before it, fits do."""
        return int(file.name.split(".")[2 if file.parent.name in ("frf", "noise_covariance") else 3])

    def status_of(self, file: Path) -> Path:
        if self.in_skeleton(file):
            return file
        return self.out / "noisy" / "status" / f"c.0.0.{self.block(file)}.0"

    def reported(self) -> list[str]:
        assert self.size is not None
        return [f"c.{a}.0.{b}.0" for _, a, b in run_log.reported(self.out, STUDIES[self.size].fingerprint)]

    def nameless(self, size: int) -> bool:
        """Without root and group only the log tells whose a cube is; one that cannot be told is left alone."""
        if not {self.out / "zarr.json", self.out / "noisy" / "zarr.json"} <= set(self.damaged):
            return False
        before = tree_digest(self.out)
        if ended(fork(self.running(size))) == DONE:
            self.finished(size)
        else:
            assert tree_digest(self.out) == before
        return True

    def blames_a_damaged_file(self, line: str) -> bool:
        """Whether a line is about a damaged file: it names it, its folders, or the status taken back for it."""
        named = [p for file in self.damaged for p in (file, *self.folders(file))]
        return line.startswith(tuple(f"{p}: " for p in (*named, *self.redone)))

    def folders(self, file: Path) -> list[Path]:
        return [p for p in file.parents if p.is_relative_to(self.out)]

    def finished(self, size: int) -> None:
        """A run has ended: everything is there, to the byte."""
        assert tree_digest(self.out) == self.whole.digests[size], self.differences(size)
        TRIED["runs to the end"] += 1
        n, starts = SIZES[size]
        self.size, self.damaged, self.redone, self.done = size, {}, set(), {str(r): starts for r in range(n)}

    def differences(self, size: int) -> list[str]:
        sound = self.whole.folder / f"{size}.zarr"
        names = {p.relative_to(root) for root in (sound, self.out) for p in root.rglob("*") if p.is_file()}
        return [str(n) for n in sorted(names) if self.content(sound / n) != self.content(self.out / n)]

    def kill(self, work: Callable[[], object], which: int, at: float, visit: float, often: bool, size: int) -> None:
        """Die before a line that writes, or end if it is not reached (so often)."""
        lines = self.whole.lines[which]
        file, line, n = lines[int(at * len(lines))]
        moment = (file, line, 1 + int(visit * n))

        def dying() -> None:
            if often:  # a write after every fit
                tasks.CHECKPOINT_S = 0.0
                solvers()["lm"] = replace(solvers()["lm"], starts_a_call=1)
            with DieAtLine(WRITERS, moment):
                work()

        code = ended(fork(dying))
        if code == DONE:
            self.finished(size)
            return
        assert code == -signal.SIGKILL
        TRIED["kills"] += 1
        self.damaged = {f: c for f, c in self.damaged.items() if self.content(f) == c}
        if any(self.in_skeleton(file) for file in self.damaged):
            return  # what is there cannot be looked at before it is repaired
        found = self.whole.ask(partial(look, self.out))
        if found["size"] != self.size:
            self.damaged, self.redone = {}, set()  # another cube has taken its place
        self.size = found["size"]
        lost = {r: n for r, n in self.done.items() if found["done"].get(r, 0) < n}
        assert not lost, (lost, found)
        assert set(found["gone"]) <= {file.name for file in self.redone}, (found, self.redone)
        self.done = found["done"]


def try_histories(how: settings, aim: str | None = None) -> None:
    """Raises for the first history that loses something or ends wrong; dies at lines of the file ``aim`` if reached."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    solvers()["lm"] = replace(solvers()["lm"], fits_a_chunk=(8, 8))
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
        try:
            States.whole = Whole(Path(folder))
            States.whole.lines = [[at for at in lines if at[0] == aim] or lines for lines in States.whole.lines]
            run_state_machine_as_test(States, settings=how)
        finally:
            forked.kill_all()


def main() -> int:
    """Try histories; 0 when nothing was lost or wrong."""
    try:
        try_histories(SETTINGS)
    finally:
        print(", ".join(f"{n} {what}" for what, n in TRIED.items()), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
