"""A run that has finished a study computes its statistics too, and nothing of it can be lost or waited for."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from commands import told

from mcstudy.analysis import cache, results
from mcstudy.analysis.show import tables
from mcstudy.cli import main
from mcstudy.cli import outcome as run_end
from mcstudy.exits import Exit
from mcstudy.scheduler.stopping import request_stop
from mcstudy.study.execution.submission import Outcome


@pytest.fixture
def words(tiny_file: Path, tmp_path: Path) -> list[str]:
    return ["run", str(tiny_file), "-o", str(tmp_path / "tiny.zarr"), "--workers", "1"]


def test_the_first_look_after_a_run_computes_nothing(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(run_end, "LEAST_FITS", 1)
    assert main(words) == Exit.DONE
    monkeypatch.setattr(results, "open_results", lambda *_, **__: pytest.fail("computed again"))
    capsys.readouterr()
    assert "tiny" in told("show", str(tmp_path / "tiny.zarr"))


def test_a_study_that_runs_in_no_time_is_not_made_longer(words: list[str], tmp_path: Path) -> None:
    assert main(words) == Exit.DONE
    assert not cache.folder(tmp_path / "tiny.zarr").exists()


@pytest.mark.parametrize(
    "outcome",
    [
        Outcome(Path("a"), fits=0, skipped=20_000),
        Outcome(Path("a"), fits=20_000, failed_blocks=["lost"]),
        Outcome(Path("a"), fits=20_000_000),
    ],
    ids=["nothing new", "incomplete", "larger than memory"],
)
def test_it_is_left_to_the_look_itself(outcome: Outcome, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "show", lambda *_: pytest.fail("computed"))
    run_end.prepare(outcome, Path("a"))


def test_a_request_to_stop_does_not_wait_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, free, ended = threading.Event(), threading.Event(), threading.Event()

    def slow(_: Path) -> None:
        begun.set()
        free.wait(60)
        ended.set()

    monkeypatch.setattr(tables, "show", slow)
    threading.Thread(target=lambda: (begun.wait(60), request_stop())).start()
    run_end.prepare(Outcome(Path("a"), fits=20_000), Path("a"))
    assert begun.is_set()
    assert not ended.is_set()
    free.set()


def test_a_cube_that_cannot_be_read_is_no_failure_of_the_run(tmp_path: Path) -> None:
    run_end.prepare(Outcome(tmp_path, fits=20_000), tmp_path / "absent.zarr")
