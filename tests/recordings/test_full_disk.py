"""A disk that becomes full while a recording is written: one line, and what was there is as it was."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import mcstudy as mc
from mcstudy.recordings.io import write_recording

WRITE = """
import resource, signal, sys
from pathlib import Path
from mcstudy_challenge.make import write_case
from mcstudy.errors import McstudyError
from mcstudy.recordings.io import read_recording, write_recording
recording = read_recording("there.nc")
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
for limit in (0, 1_000, 20_000, 60_000):  # bytes of a file
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    for name, write in (("there.nc", write_recording), ("new.zarr", write_recording), ("case.nc", write_case)):
        try:
            write(recording, Path(name))
        except McstudyError as error:
            print(limit, error)
        else:
            print(limit, name, "written")
"""


def test_a_full_disk_is_one_line_and_loses_nothing(tmp_path: Path) -> None:
    recording = mc.simulate(cycles=3, rate_hz=100.0, seed=1)
    there = write_recording(recording, tmp_path / "there.nc").read_bytes()
    ran = subprocess.run([sys.executable, "-c", WRITE], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    names = ("there.nc", "new.zarr", "case.nc")
    expected = [
        f"{limit} {name}: cannot be written: File too large" for limit in (0, 1000, 20000, 60000) for name in names
    ]
    assert ran.stdout.splitlines() == expected
    assert not [p.name for p in tmp_path.iterdir() if p.suffix in {".nc", ".zarr"} and p.name != "there.nc"]
    assert (tmp_path / "there.nc").read_bytes() == there
