"""Files that a compiled library reads: it may loop, crash or take all memory; the command goes on or ends at once."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from mcstudy.errors import RecordingError
from mcstudy.files import reading_process
from mcstudy.files.reading_process import Answer, Unreadable, answer

HERE = "reading_process_faults"
"""Module of the functions that the other process calls here (`tests/helpers`)."""


@pytest.fixture(autouse=True)
def helpers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent.parent / "helpers"))
    reading_process.end()  # the next one sees the path


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "a.nc").write_bytes(b"content")
    return tmp_path / "a.nc"


def processes() -> list[psutil.Process]:
    return [p for p in psutil.Process().children() if "mcstudy.files.reading_process" in p.cmdline()]


def test_numbers_of_every_kind_and_shape_come_as_they_are(file: Path) -> None:
    for values in (
        np.arange(6.0).reshape(2, 3).T,
        np.array(3, ">i2"),
        np.empty((0, 4), "u1"),
        np.array([np.nan, -0.0, np.inf], "f4"),
        np.arange(1 << 20),
    ):
        made, (found,) = answer(f"{HERE}:numbers", file, values.tolist(), values.dtype.str, values.shape)
        assert made == [str(file), "7 bytes"]
        assert (found.dtype, found.shape, found.tobytes()) == (values.dtype, values.shape, values.tobytes())


def test_one_process_reads_all_files(file: Path) -> None:
    (first, _), (second, _) = (answer(f"{HERE}:its_number", file) for _ in range(2))
    assert first == second != os.getpid()
    assert [p.pid for p in processes()] == [first]


def test_relative_names_are_those_of_the_process_that_asks(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer(f"{HERE}:its_number", file)
    monkeypatch.chdir(file.parent)
    assert answer(f"{HERE}:numbers", "a.nc", [], "f8", [0])[0] == ["a.nc", "7 bytes"]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("loops", "a.nc: reading it took more than 1 s of computing: it is damaged"),
        ("crashes", r"a.nc: reading it ended in a fault of the library \(SIGSEGV\): it is damaged"),
        ("aborts", r"a.nc: reading it ended in a fault of the library \(SIGABRT\): it is damaged"),
        ("leaves", r"a.nc: the process that read it ended \(3\)"),
        ("refuses", "a.nc: wrong"),
    ],
)
def test_a_fault_is_one_line_and_the_next_file_is_read(
    file: Path, fault: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading_process, "LEAST_S", 0.6)
    for _ in range(2):
        with pytest.raises(RecordingError, match=words):
            answer(f"{HERE}:{fault}", file)
        assert answer(f"{HERE}:its_number", file)


@pytest.mark.skipif(sys.platform != "linux", reason="the system limits no memory")
def test_too_much_memory_is_one_line(file: Path) -> None:
    with pytest.raises(RecordingError, match=r"a\.nc: reading it takes too much memory: it is damaged"):
        answer(f"{HERE}:numbers", file, 0, "f8", [1 << 30])
    _, (found,) = answer(f"{HERE}:numbers", file, 0, "u1", [1 << 27], expected=1 << 27)
    assert found.size == 1 << 27


def test_other_errors_are_those_of_the_library_and_what_is_printed_is_not_the_answer(file: Path) -> None:
    with pytest.raises(Unreadable, match=r"^first line$"):
        answer(f"{HERE}:fails", file)
    assert answer(f"{HERE}:prints", file) == ("answered", [])


def test_a_process_that_was_killed_between_files_is_replaced(file: Path) -> None:
    for _ in range(2):
        answer(f"{HERE}:its_number", file)
        (process,) = processes()
        process.kill()
        process.wait()


def test_threads_read_at_the_same_time(file: Path) -> None:
    found: dict[int, Answer] = {}

    def read(k: int) -> None:
        for _ in range(20):
            found[k] = answer(f"{HERE}:numbers", file, k, "i8", [1000])

    threads = [threading.Thread(target=read, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {k: set(arrays[0].tolist()) for k, (_, arrays) in found.items()} == {k: {k} for k in range(8)}


def test_a_forked_process_reads_by_a_process_of_its_own(file: Path) -> None:
    ours, _ = answer(f"{HERE}:its_number", file)
    out, written = os.pipe()
    if (child := os.fork()) == 0:
        try:
            os.write(written, str(answer(f"{HERE}:its_number", file)[0]).encode())
        finally:
            reading_process.end()
            os._exit(0)
    os.close(written)
    theirs = int(os.read(out, 100))
    os.waitpid(child, 0)
    os.close(out)
    assert theirs not in (ours, 0)
    assert answer(f"{HERE}:its_number", file)[0] == ours


SCRIPT = f"""
import sys
from mcstudy.files.reading_process import answer
try:
    answer("{HERE}:loops", sys.argv[1])
finally:
    print("asked")
"""
"""As a user writes it: without ``if __name__ == "__main__"``."""


def waiting(file: Path) -> tuple[subprocess.Popen[str], psutil.Process]:
    """A process that waits for a file in which the library loops, and the process that reads it."""
    path = os.pathsep.join([str(Path(__file__).parent.parent / "helpers"), os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(file)],
        stdout=-1,
        stderr=-1,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    while not (readers := psutil.Process(process.pid).children()):
        time.sleep(0.01)
    while not (file.parent / "reading").exists():
        time.sleep(0.01)
    return process, readers[0]


@pytest.mark.skipif(sys.platform != "linux", reason="there it ends after a while")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL], ids=lambda n: n.name)
def test_a_signal_ends_the_process_that_asks_and_the_one_that_reads(file: Path, number: signal.Signals) -> None:
    process, reader = waiting(file)
    process.send_signal(number)
    process.communicate(timeout=60)
    assert process.returncode == -number
    assert psutil.wait_procs([reader], timeout=60)[1] == []


def test_a_folder_on_the_way_with_a_module_of_a_known_name_is_not_imported(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (file.parent / "numpy.py").write_text("raise SystemExit(9)")
    monkeypatch.chdir(file.parent)
    assert answer(f"{HERE}:its_number", "a.nc")[0]
