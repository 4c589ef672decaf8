"""Inside somebody's program signals are ours while a study runs, and theirs again afterwards."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from tiny_studies import EIGHT_FITS as STUDY

from mcstudy.cli import main
from mcstudy.exits import Exit
from mcstudy.files import unfinished
from mcstudy.scheduler import cluster
from mcstudy.scheduler.stopping import SIGNALS, request_stop, stop_requests


@pytest.fixture(autouse=True)
def theirs() -> Iterator[None]:
    """Handlers of somebody's program, whatever those of the program that runs the tests are."""

    def handler(*_: object) -> None:
        raise AssertionError

    before = {sign: signal.signal(sign, handler) for sign in SIGNALS}
    yield
    after = {sign: signal.signal(sign, old) for sign, old in before.items()}
    assert set(after.values()) == {handler}


@pytest.mark.parametrize("sign", SIGNALS)
def test_a_signal_sets_the_event_and_a_second_one_does_not_wait(sign: signal.Signals) -> None:
    with stop_requests() as stop:
        assert not stop.is_set()
        os.kill(os.getpid(), sign)
        assert stop.wait(10)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), sign)


def test_what_is_ignored_stays_ignored() -> None:
    theirs = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_requests() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop.wait(0.2)
    finally:
        signal.signal(signal.SIGHUP, theirs)


def test_whoever_owns_the_signals_asks_all_that_can_be_stopped() -> None:
    with stop_requests() as first, stop_requests(lambda: "halfway") as second:
        words = [request.words() for request in request_stop() if request.words]
        assert first.is_set()
        assert second.is_set()
        assert words == ["halfway"]
    assert request_stop() == []


def test_a_stopped_command_that_is_called_as_a_function_returns_its_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And leaves the process alone, which `os._exit` would end here."""
    monkeypatch.setattr(cluster, "dashboard_url", lambda _: os.kill(os.getpid(), signal.SIGHUP) or "nowhere")
    file, out = tmp_path / "tiny.toml", tmp_path / "out.zarr"
    file.write_text(STUDY)
    words = ["run", str(file), "-o", str(out), "--workers", "1", "--dashboard"]
    assert main(words) is Exit.INTERRUPTED
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"mcstudy: {out}: stopped with 8 fits left; ")


def test_what_fails_while_it_is_made_is_removed(tmp_path: Path) -> None:
    file = tmp_path / "file"
    with pytest.raises(IsADirectoryError), unfinished.unfinished(file, file.touch):
        file.write_bytes(tmp_path.read_bytes())
    assert not file.exists()
    with unfinished.unfinished(file, file.touch):
        file.rename(tmp_path / "made")
    assert (tmp_path / "made").exists()
    with unfinished.scratch_folder("mcstudy-test-") as folder:
        (folder / "inside").mkdir()
    assert not folder.exists()


def test_a_thread_that_writes_while_its_folder_is_removed_no_longer_finds_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """However fast it writes: the folder has another name before its first file is removed."""
    rmtree = shutil.rmtree
    found = []

    def writes_first(folder: Path, **options: bool) -> None:
        found.append((path / "inside").exists())
        rmtree(folder, **options)

    with unfinished.scratch_folder("mcstudy-test-") as path:
        (path / "inside").mkdir()
        monkeypatch.setattr(shutil, "rmtree", writes_first)
    assert found == [False]
    assert not list(path.parent.glob(f"{path.name}*"))
