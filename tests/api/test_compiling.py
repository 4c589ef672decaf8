"""What Python callers wait for on a new installation is compiled by one process per core, as on the command line."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import mcstudy as mc
from mcstudy.api import recordings
from mcstudy.scheduler.compiling import DIAGNOSIS, PERSON

SCRIPT = """
import sys
import mcstudy as mc
from mcstudy.fitting import warm
from mcstudy.scheduler.compiling import compile_kernels

compile_kernels(["steps"])
print(warm._misses())
"""


class _Asked(Exception):
    pass


@pytest.mark.parametrize(
    ("call", "kernels"),
    [(mc.diagnose, DIAGNOSIS), (mc.fit, PERSON), (lambda path: mc.diagnose(path, fast=True), DIAGNOSIS)],
)
def test_a_recording_is_read_and_then_its_kernels_are_asked_for(
    call: Callable[[Path], object], kernels: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = mc.write_recording(mc.simulate(amplitude=5.0, cycles=4, seed=4), tmp_path / "a.nc")

    def asked(parts: tuple[str, ...]) -> None:
        raise _Asked(parts)

    monkeypatch.setattr(recordings, "compile_kernels", asked)
    with pytest.raises(_Asked) as caught:
        call(path)
    assert caught.value.args == (kernels,)
    with pytest.raises(mc.InputError):  # a bad file is reported first
        call(tmp_path / "absent.nc")


def test_a_script_without_a_main_guard_compiles_in_other_processes_and_says_so(tmp_path: Path) -> None:
    """The compiling processes import no module of the caller's, so nothing of it runs twice."""
    script, calls = tmp_path / "plain.py", tmp_path / "calls"
    script.write_text(f"open({str(calls)!r}, 'a').write('x')\n" + SCRIPT)
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, env=env, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert calls.read_text() == "x"
    assert done.stdout.split() == ["0"], "compiled in the caller's process"
    assert done.stderr.splitlines()
    assert all(line.startswith("compiling the kernels (once, about ") for line in done.stderr.splitlines())
