"""No verb is silent for long: what takes more than two seconds says on the terminal what is being done."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from typing import Any

import pytest

from mcstudy.cli import main
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.scheduler.activity import current


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("words", "slow", "said"),
    [
        ("gap diagnose rec.nc --fast", "mcstudy.gap.diagnose.diagnose", "rec.nc: diagnosing"),
        ("gap next rec.nc", "mcstudy.gap.diagnose.diagnose", "rec.nc: diagnosing"),
        ("replay cube", "mcstudy.study.replay.replay", "cube: repeating the fit"),
        ("verify cube", "mcstudy.study.verify.verify", "cube: reading"),
        ("design design -o out", "mcstudy.stimulus_design.run.designed", "design: designing the stimulus"),
    ],
)
def test_slow_work_is_announced(words: str, slow: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    heard: list[str | None] = []

    def listen(*_: Any, **__: Any) -> None:
        heard.append(current())
        raise InputError("enough")

    nothing: Callable[..., list[Any]] = lambda *_: []  # noqa: E731 - stands for reading and compiling
    monkeypatch.setattr(slow, listen)
    monkeypatch.setattr("mcstudy.cli.verbs.gap.read_recordings", nothing)
    monkeypatch.setattr("mcstudy.scheduler.compiling.compile_kernels", nothing)
    monkeypatch.setattr(sys, "stderr", Terminal())
    more = ["--group", "g", "--realization", "0", "--start", "0", "--fmax", "1", "--amplitude", "1"]
    assert main([*words.split(), *(more if words.startswith("replay") else [])]) == Exit.BAD_INPUT
    assert heard == [said]
