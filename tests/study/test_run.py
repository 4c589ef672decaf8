"""However a study is run, the cube is the same; what is done is not done again; what cannot go on says so."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterable
from pathlib import Path
from unittest.mock import ANY
from urllib.parse import urlsplit
from urllib.request import urlopen

import numpy as np
import psutil
import pytest
import quick_solver

from mcstudy.errors import InputError, Interrupted, StoreError, StudyChangedError
from mcstudy.files.durable import locked, tree_digest
from mcstudy.scheduler.cluster import ClusterOptions, connect, dashboard_url
from mcstudy.study.cube.store import Cube, GroupStore
from mcstudy.study.execution import tasks
from mcstudy.study.run import ATTEMPTS, run_study
from mcstudy.study.study_file import parse_study

pytestmark = pytest.mark.usefixtures("small_chunks")
ONE = ClusterOptions(workers=1)


def test_workers_and_block_sizes_leave_no_trace_in_the_bytes(tmp_path: Path, tiny: str) -> None:
    study = parse_study(tiny)
    digests = {}
    for workers, block in ((1, None), (2, None), (2, 1), (1, 3), (2, 100)):
        out = tmp_path / f"{workers}-{block}.zarr"
        outcome = run_study(study, out, ClusterOptions(workers=workers), block)
        assert (outcome.fits, outcome.failed_fits, outcome.failed_blocks) == (128, 0, [])
        digests[workers, block] = tree_digest(out)
    assert len(set(digests.values())) == 1


def test_the_time_of_a_run_is_without_that_of_compiling(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_study(parse_study(tiny), tmp_path / "first.zarr", ONE)  # whatever is slow once
    asked: list[str] = []

    def compiles(parts: Iterable[str], _: object) -> None:
        asked.extend(parts)
        time.sleep(1.0)

    monkeypatch.setattr("mcstudy.study.run.compile_kernels", compiles)
    begun = time.monotonic()
    outcome = run_study(parse_study(tiny), tmp_path / "out.zarr", ONE)
    assert asked == ["stability", "lm"]
    assert outcome.seconds <= time.monotonic() - begun - 1.0


def test_a_second_run_does_nothing_and_changes_nothing(tiny_copy: Path, tiny_cube: Path, tiny: str) -> None:
    again = run_study(parse_study(tiny), tiny_copy, ONE)
    assert (again.fits, again.skipped) == (0, 128)
    assert tree_digest(tiny_copy) == tree_digest(tiny_cube)


def test_exactly_what_is_damaged_is_run_again(tiny_copy: Path, tiny_cube: Path, tiny: str) -> None:
    store = Cube.open(tiny_copy).groups["noisy"]
    flipped, missing = store.layout.chunks[0], store.layout.chunks[-1]
    file = store.chunk_file("estimate", flipped)
    content = bytearray(file.read_bytes())
    content[30] ^= 8
    file.write_bytes(content)
    store.chunk_file("cost", missing).unlink()
    again = run_study(parse_study(tiny), tiny_copy, ONE)
    assert again.fits == store.layout.fits(flipped) + store.layout.fits(missing)
    assert tree_digest(tiny_copy) == tree_digest(tiny_cube)


def test_a_changed_study_file_is_refused_with_what_changed(tiny_copy: Path, tiny_cube: Path, tiny: str) -> None:
    changed = tiny.replace("realizations = 5", "realizations = 6").replace("seed = 7", "seed = 8")
    with pytest.raises(StudyChangedError) as caught:
        run_study(parse_study(changed), tiny_copy, ONE)
    message = str(caught.value)
    assert "study.seed = 7, not 8" in message
    assert "group.noisy.realizations = 5, not 6" in message
    assert "\n" not in message
    assert tree_digest(tiny_copy) == tree_digest(tiny_cube)


def test_two_runs_on_one_store_are_refused(tmp_path: Path, tiny: str) -> None:
    out = tmp_path / "out.zarr"
    with locked(out), pytest.raises(StoreError, match="another run is writing"):
        run_study(parse_study(tiny), out, ONE)
    assert not out.exists()


def test_a_block_that_always_fails_is_reported_and_the_rest_finishes(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, bad = GroupStore.write, []

    def broken(self: GroupStore, chunk: object, data: object, *environments: object) -> None:
        if self.name == "ideal":
            bad.append(chunk)
            raise ValueError("cosmic ray")
        write(self, chunk, data, *environments)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(GroupStore, "write", broken)
        study, out = parse_study(tiny), tmp_path / "out.zarr"
        outcome = run_study(study, out, ONE)
        assert len(bad) == ATTEMPTS
        assert outcome.fits == 120
        assert [line for line in outcome.failed_blocks if "ideal" in line and "cosmic ray" in line]
    assert run_study(study, out, ONE).fits == 8


def test_fits_whose_report_is_lost_with_a_worker_are_counted(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The block is given to another worker, which finds everything done."""
    lost: list[tasks.Task] = []

    def loses_the_first(task: tasks.Task) -> tasks.TaskReport:
        report = tasks.run_task(task)
        if not lost:
            lost.append(task)
            raise RuntimeError("gone")
        return report

    monkeypatch.setattr("mcstudy.study.execution.attempt.run_task", loses_the_first)
    study = parse_study(tiny)
    outcome = run_study(study, tmp_path / "a.zarr", ClusterOptions(workers=1))
    assert len(lost) == 1
    assert outcome.fits == outcome.counts.total() == study.fits
    assert f"{study.fits}/{study.fits} fits (100 %)" in capsys.readouterr().err


def test_a_store_deleted_under_the_run_does_not_come_back_in_pieces(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out.zarr"
    write = GroupStore.write

    def vanish(self: GroupStore, chunk: object, data: object, *environments: object) -> None:
        if out.exists():
            out.rename(tmp_path / "moved.zarr")
        write(self, chunk, data, *environments)  # type: ignore[arg-type]

    monkeypatch.setattr(GroupStore, "write", vanish)
    with pytest.raises(Interrupted, match=r"out\.zarr: the results folder is not writable \(No such file"):
        run_study(parse_study(tiny), out, ONE)
    assert not out.exists()


def test_a_stop_request_ends_the_run_as_resumable(
    tmp_path: Path, tiny_cube: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    study, out, earlier = parse_study(tiny), tmp_path / "out.zarr", set(tasks.STOP)
    write, runs = GroupStore.write, set[str]()

    def stop_after_one(self: GroupStore, chunk: object, data: object, *environments: object) -> None:
        write(self, chunk, data, *environments)  # type: ignore[arg-type]
        if not runs:  # a thread that outlives this run must not stop the next one
            runs.update(tasks.STOP.keys() - earlier)
            tasks.STOP[min(runs)].set()

    with monkeypatch.context() as patch:
        patch.setattr(GroupStore, "write", stop_after_one)
        with pytest.raises(Interrupted, match="run the same command again to resume"):
            run_study(study, out, ONE)
    cube = Cube.open(out)
    chunks = tuple(cube.groups["noisy"].layout.chunks)
    late = tasks.Task(min(runs), str(out), study.to_json(), "noisy", cube.depths["noisy"], chunks)
    assert tasks.run_task(late) == tasks.TaskReport(complete=False, seconds=ANY), "begun after the end of its run"
    resumed = run_study(study, out, ONE)
    assert 0 < resumed.fits < 128
    assert tree_digest(out) == tree_digest(tiny_cube)


def test_the_log_is_beside_the_cube_and_names_no_host_or_path(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for function in ("socket.gethostname", "platform.node"):
        monkeypatch.setattr(function, lambda: "secret-host")
    out = tmp_path / "out.zarr"
    run_study(parse_study(tiny), out, ONE)
    log = (tmp_path / "out.zarr.log" / "runs.jsonl").read_text()
    events = [json.loads(line) for line in log.splitlines()]
    assert (events[0]["event"], events[-1]["event"]) == ("begin", "end")
    assert sum(e["fits"] for e in events if e["event"] == "block") == 128
    assert events[0]["environment"]["versions"]["numpy"]
    everything = log + "".join(p.read_text() for p in out.rglob("zarr.json"))
    assert "secret-host" not in everything
    assert str(tmp_path) not in everything


def test_a_run_can_be_started_from_another_thread(tmp_path: Path, tiny: str) -> None:
    outcomes = []
    study = parse_study(tiny)
    thread = threading.Thread(target=lambda: outcomes.append(run_study(study, tmp_path / "out.zarr", ONE)))
    thread.start()
    thread.join()
    assert outcomes[0].fits == 128


@pytest.mark.parametrize("dashboard", [False, True])
def test_a_local_run_listens_on_this_machine_only_with_its_dashboard_where_asked(
    dashboard: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mcstudy.scheduler.cluster.DASHBOARD_PORT", 0)  # the usual one is soon another test's
    with connect(ClusterOptions(workers=1, dashboard=dashboard)) as client:
        assert client.submit(sum, [1, 2]).result() == 3
        listening = [c for c in psutil.Process().net_connections("inet") if c.status == psutil.CONN_LISTEN]
        if dashboard:
            with urlopen(url := dashboard_url(client), timeout=60) as answer:
                assert b"Dask" in answer.read()
            assert urlsplit(url).port in {c.laddr.port for c in listening}
    assert listening
    assert {c.laddr.ip for c in listening} == {"127.0.0.1"}


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (ClusterOptions(scheduler="localhost"), "expected tcp://HOST:PORT or tls://HOST:PORT"),
        (ClusterOptions(scheduler="http://localhost:1"), "expected tcp://HOST:PORT or tls://HOST:PORT"),
        (
            ClusterOptions(scheduler="tcp://192.0.2.1:8786"),
            "expected tls:// for 192.0.2.1.*--insecure accepts",
        ),
        (ClusterOptions(scheduler="tls://localhost:8786", tls_ca=Path("/none.pem")), "--tls-ca: expected a readable"),
    ],
)
def test_a_scheduler_that_is_not_safe_or_not_there_is_refused(
    tmp_path: Path, tiny: str, options: ClusterOptions, expected: str
) -> None:
    with pytest.raises(InputError, match=expected):
        run_study(parse_study(tiny), tmp_path / "out.zarr", options)


def test_an_unencrypted_scheduler_on_another_machine_is_tried_when_the_user_insists(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mcstudy.scheduler.cluster.CONNECT_S", 0.2)  # an address that nobody has
    options = ClusterOptions(scheduler="tcp://192.0.2.1:8786", insecure=True)
    with pytest.raises(InputError, match=r"expected a running scheduler at tcp://192\.0\.2\.1:8786"):
        run_study(parse_study(tiny), tmp_path / "out.zarr", options)


def test_a_cube_keeps_its_chunks_when_the_program_would_choose_others_now(
    tiny_copy: Path, tiny_cube: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Cube.open(tiny_copy).groups["noisy"]
    store.chunk_file("status", store.layout.chunks[0]).unlink()
    monkeypatch.setitem(*quick_solver.lm(fits_a_chunk=(500, 5000)))
    run_study(parse_study(tiny), tiny_copy, ONE)
    assert tree_digest(tiny_copy) == tree_digest(tiny_cube)


def test_a_block_that_hangs_is_given_up_and_the_rest_finishes(
    tmp_path: Path, tiny_cube: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    release, run_task, released = threading.Event(), tasks.run_task, []

    def hang(task: tasks.Task) -> tasks.TaskReport:
        if task.group == "ideal":
            released.append(release.wait(60))
        return run_task(task)

    out, study = tmp_path / "out.zarr", parse_study(tiny)
    with monkeypatch.context() as patch:
        patch.setattr("mcstudy.study.execution.attempt.run_task", hang)
        outcome = run_study(study, out, ClusterOptions(workers=1, block_timeout=5.0))  # an ordinary block stays below
        assert released == []  # the run did not wait
        release.set()
    assert outcome.fits == 120
    (line,) = outcome.failed_blocks
    assert "group ideal" in line
    assert "ran longer than 5 s" in line
    run_study(study, out, ONE)
    assert tree_digest(out) == tree_digest(tiny_cube)


def test_a_chunk_that_two_workers_wrote_at_once_gets_a_second_look(
    tmp_path: Path, tiny_cube: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_task, torn = tasks.run_task, []

    def first_time_torn(task: tasks.Task) -> tasks.TaskReport:
        report = run_task(task)
        if task.group == "ideal" and not torn:
            # The status of the faster of two writers over the numbers of the slower one, which had not got so far.
            store = tasks.open_group(task.path, task.study, task.group, task.depth)
            data = store.existing(task.chunks[0])
            data["cost"][..., 2:], data["estimate"][..., 2:, :] = np.nan, np.nan
            store.write(task.chunks[0], data)
            torn.append(task)
            raise RuntimeError("the connection was lost")
        return report

    out, study = tmp_path / "out.zarr", parse_study(tiny)
    with monkeypatch.context() as patch:
        patch.setattr("mcstudy.study.execution.attempt.run_task", first_time_torn)
        assert run_study(study, out, ONE).failed_blocks == []
    assert torn
    assert tree_digest(out) == tree_digest(tiny_cube)


def test_an_error_that_cannot_be_sent_is_still_reported(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: tasks.Task) -> tasks.TaskReport:
        raise ValueError(threading.Lock(), "cannot be pickled")

    monkeypatch.setattr("mcstudy.study.execution.attempt.run_task", broken)
    outcome = run_study(parse_study(tiny), tmp_path / "out.zarr", ONE, 100)
    assert len(outcome.failed_blocks) == 2
    assert all("cannot be pickled" in line for line in outcome.failed_blocks)
