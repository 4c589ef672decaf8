"""What is shown while a study runs: on a terminal, in a plain stream, in a notebook."""

from __future__ import annotations

import io
import sys
import types
from pathlib import Path
from typing import Any

import pytest

from mcstudy.scheduler import activity as activity_module
from mcstudy.scheduler import progress as module
from mcstudy.scheduler.activity import activity, doing
from mcstudy.scheduler.display import Display
from mcstudy.scheduler.progress import LEAST_STEPS, Progress, duration
from mcstudy.study.cube.store import Cube
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study
from mcstudy.study.watch import Watch


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def screen(text: str) -> list[str]:
    """What a terminal shows after the control sequences the display uses."""
    lines, row = [""], 0
    position = 0
    while position < len(text):
        if text.startswith("\033[J", position):
            del lines[row:]
            lines.append("")
            position += 3
        elif text.startswith("\033[", position):
            end = text.index("A", position)
            row -= int(text[position + 2 : end])
            position = end + 1
        elif text[position] == "\n":
            row += 1
            if row == len(lines):
                lines.append("")
            position += 1
        elif text[position] == "\r":
            position += 1
        else:
            lines[row] += text[position]
            position += 1
    return [line for line in lines if line]


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time, which passes when it is changed."""
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    return now


@pytest.mark.parametrize(
    ("total", "unit", "chunks", "done", "seconds", "line"),
    [
        (1000, "fits", 8, (250, 3, 2), 10.0, "2/8 chunks  250/1000 fits (25 %)  25 fits/s  30 s left  3 failed"),
        (80, "cases", 0, (20, 0), 10.0, "20/80 cases (25 %)  2 cases/s  30 s left  0 failed"),
        (8, "cases", 0, (1, 0), 20.0, "1/8 cases (12 %)  3 cases/min  2 min 20 s left  0 failed"),
    ],
)
def test_the_line_says_chunks_units_speed_time_left_and_failures(
    clock: list[float], total: int, unit: str, chunks: int, done: tuple[int, ...], seconds: float, line: str
) -> None:
    progress = Progress(total, io.StringIO(), chunks=chunks, unit=unit)
    progress.add(*done)
    clock[0] += seconds
    assert progress.line() == line


def test_what_had_to_be_done_before_the_first_unit_is_in_no_rate(clock: list[float]) -> None:
    progress = Progress(100, io.StringIO())
    clock[0] += 40.0
    progress.begin()
    clock[0] += 10.0
    progress.add(50, 0)
    assert progress.line() == "50/100 fits (50 %)  5 fits/s  10 s left  0 failed"
    assert progress.seconds == 10.0


def test_the_first_result_for_which_code_was_loaded_is_in_no_early_speed(clock: list[float]) -> None:
    progress = Progress(1000, io.StringIO())
    clock[0] += 2.0  # of which fits are a tenth
    progress.add(100, 0)
    for _ in range(LEAST_STEPS):
        assert "time left: estimating" in progress.line()
        clock[0] += 0.25
        progress.add(100, 0)
    assert "400 fits/s  1 s left" in progress.line()


def test_the_speed_is_that_of_the_last_while(clock: list[float]) -> None:
    progress = Progress(10_000, io.StringIO())
    for seconds, fits in [(10.0, 1000)] * 5 + [(10.0, 100)] * 10:  # the machine got other work to do
        clock[0] += seconds
        progress.add(fits, 0)
    assert "6000/10000 fits (60 %)  10 fits/s  6 min 40 s left" in progress.line()


def test_workers_that_compile_first_are_in_no_speed(clock: list[float]) -> None:
    progress = Progress(100, io.StringIO())
    progress.begin(ready=False)
    clock[0] += 60.0
    assert progress.line() == "0/100 fits (0 %)  time left: estimating  0 failed"
    progress.add(10, 0)
    assert "time left: estimating" in progress.line()
    clock[0] += 10.0
    progress.add(20, 0)
    assert progress.line() == "30/100 fits (30 %)  2 fits/s  35 s left  0 failed"


def test_the_last_lines_are_those_of_the_finished_study() -> None:
    """Whenever the results were looked at before."""
    stream, seen = io.StringIO(), ["half of it"]
    progress = Progress(2, stream, headlines=lambda _: list(seen))
    progress.add(1, 0)
    progress.show(last=True)
    seen[:] = ["all of it"]
    progress.add(1, 0)
    progress.show(last=True)
    assert stream.getvalue().splitlines()[-1] == "all of it"


def test_what_takes_long_says_what_it_does_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(activity_module, "SILENT_S", 0.0)
    monkeypatch.setattr(activity_module, "SHORTEST_S", 0.0)
    monkeypatch.setattr(activity_module, "EVERY_S", 0.001)
    plain, terminal = io.StringIO(), Terminal()
    for stream in (plain, terminal):
        monkeypatch.setattr(sys, "stderr", stream)
        with activity("reading"):
            doing("drawing")
            while stream is terminal and "drawing ... 0 s" not in terminal.getvalue():
                pass
    assert plain.getvalue() == ""
    assert screen(terminal.getvalue()) == []


def test_a_terminal_shows_the_latest_lines_below_all_messages() -> None:
    stream = Terminal()
    display = Display(stream)
    display.show(["one", "two"])
    display.say("something happened")
    display.show(["three", "four"])
    display.show(["five"])
    assert screen(stream.getvalue()) == ["something happened", "five"]


def test_a_line_wider_than_the_terminal_is_taken_back_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "30")
    stream = Terminal()
    display = Display(stream)
    display.show(["a long line of words " * 5])
    assert max(map(len, screen(stream.getvalue()))) < 30
    display.show(["end"])
    assert screen(stream.getvalue()) == ["end"]


def test_a_plain_stream_gets_no_control_sequences() -> None:
    stream = io.StringIO()
    progress = Progress(10, stream)
    progress.add(10, 0)
    progress.show(last=True)
    progress.say("done")
    assert "\033" not in stream.getvalue()
    assert stream.getvalue().endswith("0 failed\ndone\n")


def test_a_notebook_cell_is_updated_in_place(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Any] = []
    cell = types.SimpleNamespace(update=shown.append)
    made: list[Any] = []

    def display(content: Any, *, display_id: bool) -> Any:
        made.append((content, display_id))
        return cell

    ipython, ipython_display = types.ModuleType("IPython"), types.ModuleType("IPython.display")
    ipython.get_ipython = lambda: types.SimpleNamespace(kernel=object())  # type: ignore[attr-defined]
    ipython_display.display = display  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", ipython_display)
    progress = Progress(10)
    progress.add(10, 0)
    progress.show(last=True)
    assert len(made) == 1
    assert "10/10 fits (100 %)" in shown[-1]._repr_html_()
    assert "10/10 fits (100 %)" in repr(shown[-1])


@pytest.mark.usefixtures("small_chunks")
def test_headlines_are_shown_while_a_study_runs(
    tiny: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module, "LOOK_EVERY_S", -1.0)
    monkeypatch.setattr(module, "LOOK_SHARE", 1e9)
    out = tmp_path / "out.zarr"
    run_study(parse_study(tiny), out)
    text = capsys.readouterr().err
    watch = Watch(Cube.open(out))
    watch.look()
    assert watch.headlines()
    for line in watch.headlines():
        assert line in text


def test_durations_are_for_people() -> None:
    assert [duration(s) for s in (41.6, 200, 18750)] == ["42 s", "3 min 20 s", "5 h 12 min"]
